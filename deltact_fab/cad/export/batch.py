"""Parts to files: the same dimensions give the same bytes, in any process and any order."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import replace
from pathlib import Path

from ...aliases import Progress
from ...errors import InputError
from ...jobs import arrivals, processors
from .. import feasibility
from ..dimensions import Design
from ..part import Part
from ..registry import of_group
from .folder import MANIFEST, PartFile, earlier, manifest, place, staged
from .formats import glb
from .part_files import (
    ASSEMBLY,
    DRAWN,
    FORMATS,
    WIRING,
    FileBytes,
    Task,
    applicable,
    checked_formats,
    make,
    on_platform,
    whole,
    whole_name,
)
from .stored import Store

TOLERANCE_MM = (0.001, 1.0)
MAX_JOBS = 4
# Files of so many parts are worth sharing: a worker first loads the kernel, 4 s and 500 MB.
SHARED_FROM = 12
_DIGITS = 6


def export_parts(
    design: Design,
    parts: Sequence[Part],
    formats: Sequence[str],
    tolerance_mm: float,
    out_dir: Path,
    progress: Progress | None = None,
    *,
    cached: bool = True,
    jobs: int | None = None,
    executor: Executor | None = None,
) -> list[PartFile]:
    """Write every part in every format that applies to it, and manifest.json, into out_dir.

    tolerance_mm: largest distance of a mesh from the surface; measured, not only asked for.
    progress: called with (done, total, what) at the start, after each part, and at the end.
    cached: files made before from the same dimensions, sources and kernel are taken from the
        user's cache, and new ones put there; when none is missing the kernel is not loaded.
    jobs: processes; None decides by the work that is left. executor: in place of them.

    assembly.step, assembly.glb, wiring.svg and wiring.pdf are written when all of the sensor's
    parts are among parts.

    Afterwards the folder is what its manifest says: what an earlier export's manifest.json lists
    and is not written again is removed, unless it was changed since; other files stay.

    Returns what was written: the assembly first, then by part. Nothing appears under its name
    before every file is made and checked; the manifest goes first and comes last. Raises
    InputError for unusable arguments or dimensions, for a manifest.json that no export wrote, and
    for a file or folder in the place of one to be written that is not an earlier export's, as it
    was; RunFailed when a part cannot be made, the folder cannot be written, a worker dies, or on
    Ctrl-C.
    """
    kinds = checked_formats(formats)
    low, high = TOLERANCE_MM
    if not (math.isfinite(tolerance_mm) and low <= tolerance_mm <= high):
        raise InputError(f"tolerance {tolerance_mm:g} mm: expected {low:g} to {high:g} mm")
    if jobs is not None and jobs < 1:
        raise InputError(f"jobs {jobs}: expected 1 or more")
    named = {part.name: part for part in parts if part.indenter or part.places(design)}
    units: list[tuple[Part | None, tuple[str, ...]]] = [
        (part, applicable(part, kinds)) for part in named.values()
    ]
    if not any(own for _, own in units):
        raise InputError(f"format {', '.join(kinds)}: applies to none of {', '.join(named)}")
    if any(part.indenter is None for part in named.values()):
        feasibility.check(design)
    # In the registry's order, where all of them are there.
    whole_sensor = [part.name for part in of_group("sensor", design)]
    complete = set(whole_sensor) <= set(named)
    sensor = tuple(named[name] for name in whole_sensor) if complete else ()
    if sensor and (own := tuple(kind for kind in kinds if kind in ("step", *DRAWN))):
        units.insert(0, (None, own))
    names = [f"{_name(part, kind)}.{kind}" for part, own in units for kind in own]
    if sensor and "glb" in kinds:
        names.append(f"{ASSEMBLY}.glb")
    earlier(Path(out_dir), names)
    tell = progress or (lambda done, total, what: None)
    store = Store(design, tolerance_mm, cached)
    with staged(Path(out_dir)) as folder:
        batch = _Batch(folder, store, sensor)
        _make(batch, units, (design, tolerance_mm), jobs, executor, tell)
        if sensor and "glb" in kinds:
            batch.keep(None, _assembly_glb(batch, design))
        files = batch.files()
        (folder / MANIFEST).write_text(manifest(files), encoding="utf-8", newline="\n")
        place(folder, Path(out_dir), names)
    tell(len(units), len(units), "done")
    return files


def _name(part: Part | None, kind: str) -> str:
    return part.name if part else whole_name(kind)


class _Batch:
    """What is in the temporary folder so far, without its bytes."""

    def __init__(self, folder: Path, store: Store, sensor: tuple[Part, ...]) -> None:
        self.folder, self.store, self.sensor = folder, store, sensor
        self.held: dict[tuple[str, str], FileBytes] = {}
        self._entries: list[PartFile] = []

    def missing(self, part: Part | None, kinds: Sequence[str]) -> tuple[str, ...]:
        """Take from the cache what it has, and return the formats that it has not."""
        absent = []
        for kind in kinds:
            made = self.store.get((part,) if part else self.sensor, kind)
            if made is None:
                absent.append(kind)
            else:
                self.keep(part, made)
        return tuple(absent)

    def add(self, part: Part | None, made: FileBytes) -> None:
        """Keep a file that was made now, also for the next time."""
        self.keep(part, made)
        self.store.put((part,) if part else self.sensor, made)

    def keep(self, part: Part | None, made: FileBytes) -> None:
        """Write one file and note what it is."""
        name = _name(part, made.format)
        self.held[name, made.format] = replace(made, data=b"")
        entry = self._written(name, made)
        if part:
            entry = replace(
                entry, material=part.material, process=part.process, quantity=part.quantity,
                turned=part.lies.turn if on_platform(part, made.format) else None,
            )  # fmt: skip
        self._entries.append(entry)

    def _written(self, name: str, made: FileBytes) -> PartFile:
        path = self.folder / f"{name}.{made.format}"
        path.write_bytes(made.data)
        low, high = (tuple(round(v, _DIGITS) + 0.0 for v in corner) for corner in made.box_mm)
        deviation_mm = made.deviation_mm
        return PartFile(
            part=name,
            file=path.name,
            material="",
            process="wired" if name == WIRING else "assembled",
            quantity=1,
            volume_mm3=round(made.volume_mm3, _DIGITS),
            bounding_box_mm=(low, high),
            mesh_deviation_mm=None if deviation_mm is None else round(deviation_mm, _DIGITS),
            sha256=hashlib.sha256(made.data).hexdigest(),
        )

    def files(self) -> list[PartFile]:
        """Entries in an order of their own: that of asking or making does not count."""

        def rank(entry: PartFile) -> tuple[bool, str, int]:
            kind = entry.file.removeprefix(f"{entry.part}.")
            return entry.part != ASSEMBLY, entry.part, FORMATS.index(kind)

        return sorted(self._entries, key=rank)


def _make(
    batch: _Batch,
    units: Sequence[tuple[Part | None, tuple[str, ...]]],
    dimensions: tuple[Design, float],
    jobs: int | None,
    executor: Executor | None,
    tell: Progress,
) -> None:
    """Everything but assembly.glb, from the cache or from the kernel, into the folder."""
    tasks = [
        Task(part, absent, *dimensions, () if part else batch.sensor)
        for part, kinds in units
        if (absent := batch.missing(part, kinds))
    ]
    names = [task.part.name if task.part else ASSEMBLY for task in tasks]
    done = len(units) - len(tasks)
    tell(done, len(units), names[0] if names else "cache")

    def arrived(index: int, made: list[FileBytes]) -> None:
        nonlocal done
        for one in made:
            batch.add(tasks[index].part, one)
        done += 1
        tell(done, len(units), names[index])

    arrivals(make, tasks, arrived, executor, workers=_jobs(jobs, len(tasks)))


def _jobs(asked: int | None, tasks: int) -> int:
    """Processes: as many as asked for, else several when the work is worth it."""
    if asked is not None:
        return asked
    return min(processors(), MAX_JOBS) if tasks >= SHARED_FROM else 1


def _assembly_glb(batch: _Batch, design: Design) -> FileBytes:
    """The parts' own GLB files put in their places."""
    drawn, sizes, deviations_mm = [], [], []
    for part in batch.sensor:
        where, data = part.places(design), (batch.folder / f"{part.name}.glb").read_bytes()
        drawn.append(glb.read_part(data, part.colour, where))
        held = batch.held[part.name, "glb"]
        sizes.append((held.volume_mm3, held.box_mm, where))
        deviations_mm.append(held.deviation_mm or 0.0)
    return FileBytes("glb", glb.glb_bytes(drawn), *whole(sizes), max(deviations_mm))
