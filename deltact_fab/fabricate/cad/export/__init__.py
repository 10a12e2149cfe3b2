"""Parts to files: the same dimensions give the same bytes, in any process and any order.

part_files.py runs in a worker; step.py and dxf.py write the exact solid, meshes.py its mesh.
"""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import asdict, replace
from hashlib import sha256
from pathlib import Path
from typing import Any

from deltact_fab.common import (
    InputError,
    Progress,
    RunFailed,
    Store,
    check_writable,
    count_workers,
    make_folder,
    run_each,
    write_files,
)

from .. import feasibility
from ..build import made_by, part_key
from ..dimensions import Design
from ..part import Part
from ..registry import parts_of_group
from . import meshes
from .part_files import (
    ASSEMBLY,
    DRAWN,
    EXPORT_FORMATS,
    MESHED,
    Made,
    PartFile,
    Task,
    applicable,
    checked_formats,
    make,
    whole,
)

MANIFEST = "manifest.json"
TOLERANCE_MM = (0.001, 1.0)
MAX_JOBS = 4
# Files of so many parts are worth sharing: a worker first loads the kernel, 4 s and 500 MB.
SHARED_FROM = 12
STORE = Store("cad", limit_bytes=512 * 2**20)
# What a drawing says beside its part: limits of its machine, the title block.
BESIDE_DRAWINGS = ("drawing", "resin_printer", "laser", "optics")
# About ten designs at 0.01 mm; the longest unused go first.
DIGITS = 6  # of lengths and volumes in the manifest


def export_parts(
    design: Design,
    parts: Sequence[Part],
    formats: Sequence[str] | None,
    tolerance_mm: float,
    out_dir: Path,
    progress: Progress | None = None,
    *,
    cached: bool = True,
    jobs: int | None = None,
) -> list[PartFile]:
    """Write every part in every format that applies to it, and manifest.json, into out_dir.

    formats: of EXPORT_FORMATS; None: all.
    tolerance_mm: largest distance of a mesh from the surface; measured, not only asked for.
    progress: called with (done, total, what) at the start, after each part, and at the end.
    cached: files made before from the same dimensions, sources and kernel are taken from the
    user's cache, and new ones put there; when none is missing the kernel is not loaded.
    jobs: processes; None decides by the work that is left.

    assembly.step, assembly.glb, wiring.svg and wiring.pdf are written when all of the sensor's
    parts are among parts. A file that has the name of one is replaced, and what an earlier export's
    manifest lists and is not written again goes, unless it was changed since; other files stay.

    Returns what was written: the assembly first, then by part. All files appear at once, or none.
    Raises InputError for unusable arguments or dimensions; RunFailed when a part cannot be made, a
    file cannot be written, a worker dies, or on Ctrl-C.
    """
    kinds = EXPORT_FORMATS if formats is None else checked_formats(formats)
    out_dir = Path(out_dir)
    low, high = TOLERANCE_MM
    if not (math.isfinite(tolerance_mm) and low <= tolerance_mm <= high):
        raise InputError(f"tolerance {tolerance_mm:g} mm: expected {low:g} to {high:g} mm")
    if jobs is not None and jobs < 1:
        raise InputError(f"jobs {jobs}: expected 1 or more")
    named = {part.name: part for part in parts if part.indenter or part.places(design)}
    tasks = [
        Task((part,), applicable(part, kinds), design, tolerance_mm) for part in named.values()
    ]
    if not any(task.formats for task in tasks):
        raise InputError(f"format {', '.join(kinds)}: applies to none of {', '.join(named)}")
    if any(part.indenter is None for part in named.values()):
        feasibility.check_feasible(design)
    # In the registry's order, where all of them are there.
    whole_sensor = [part.name for part in parts_of_group("sensor", design)]
    complete = set(whole_sensor) <= set(named)
    sensor = tuple(named[name] for name in whole_sensor) if complete else ()
    if sensor and (own := tuple(kind for kind in kinds if kind in ("step", *DRAWN))):
        tasks.insert(0, Task(sensor, own, design, tolerance_mm))
    check_writable(out_dir, folder=True)
    tell = progress or (lambda done, total, what: None)
    made = _made(tasks, cached, jobs, tell)
    if sensor and "glb" in kinds:
        made.append(_assembly_glb(sensor, design, made))
    # In an order of their own: that of asking or making does not count.
    made.sort(key=lambda m: (m[0].part != ASSEMBLY, m[0].part, EXPORT_FORMATS.index(_kind(m[0]))))
    files = [_rounded(entry) for entry, _ in made]
    wanted = {out_dir / entry.file: data for entry, data in made}
    told = json.dumps({"files": [asdict(entry) for entry in files]}, indent=2) + "\n"
    wanted[out_dir / MANIFEST] = told.encode()
    make_folder(out_dir)
    write_files(wanted, _earlier(out_dir) - {*wanted}, RunFailed)
    tell(len(tasks), len(tasks), "done")
    return files


def _earlier(folder: Path) -> set[Path]:
    """What an export wrote there and nobody changed: no folder holds parts of two designs."""
    found = set()
    with suppress(OSError, ValueError, KeyError, TypeError):  # no manifest, or not one of ours
        for entry in json.loads((folder / MANIFEST).read_text())["files"]:
            path = folder / Path(entry["file"]).name
            if path.is_file() and sha256(path.read_bytes()).hexdigest() == entry["sha256"]:
                found.add(path)
    return found


def _made(tasks: Sequence[Task], cached: bool, jobs: int | None, tell: Progress) -> list[Made]:
    """Everything but assembly.glb, from the cache or from the kernel."""
    found: list[Made] = []
    missing: list[Task] = []
    for task in tasks:
        held: dict[str, Made | None] = {
            kind: STORE.read(stored_by(task, kind)) if cached else None for kind in task.formats
        }
        found += [one for one in held.values() if one is not None]
        if absent := tuple(kind for kind, one in held.items() if one is None):
            missing.append(replace(task, formats=absent))
    begun = len(tasks) - len(missing)
    tell(begun, len(tasks), missing[0].name if missing else "cache")

    def arrived(index: int, made: list[Made]) -> None:
        for one in made if cached else ():
            STORE.write(stored_by(missing[index], _kind(one[0])), one)

    # Several processes where the work is worth it.
    shared = min(count_workers(), MAX_JOBS) if len(missing) >= SHARED_FROM else 1
    made = run_each(
        make, missing, [task.name for task in missing], None,
        lambda done, _, what: tell(begun + done, len(tasks), what),
        on_result=arrived, workers=jobs or shared,
    )  # fmt: skip
    return found + [one for several in made for one in several]


def stored_by(task: Task, kind: str) -> dict[str, Any]:
    """Everything that a file is made from: its key in the cache."""
    design, alone = task.design, len(task.parts) == 1
    beside: Any = None if alone else [part.places(design) for part in task.parts]
    if kind in DRAWN:
        # The wiring is drawn of the whole design.
        sections = {name: getattr(design, name) for name in BESIDE_DRAWINGS}
        beside = [sections, design.unverified()] if alone else design
    return made_by(
        "fabricate.cad.export.part_files",
        parts=[part_key(part, design) for part in task.parts],
        beside=beside,
        format=kind,
        tolerance_mm=task.tolerance_mm if kind in MESHED else None,
    )


def _assembly_glb(sensor: Sequence[Part], design: Design, made: Sequence[Made]) -> Made:
    """The parts' own GLB files put in their places."""
    held = {entry.file: (entry, data) for entry, data in made}
    bodies, sizes, deviations_mm = {}, [], []
    for part in sensor:
        where, (entry, data) = part.places(design), held[f"{part.name}.glb"]
        bodies[part.name] = meshes.read_part(data), where
        sizes.append((entry.volume_mm3, entry.bounding_box_mm, where))
        deviations_mm.append(entry.mesh_deviation_mm or 0.0)
    return whole(ASSEMBLY, "glb", meshes.glb_bytes(bodies), sizes, max(deviations_mm))


def _kind(entry: PartFile) -> str:
    return entry.file.rpartition(".")[2]


def _rounded(entry: PartFile) -> PartFile:
    """Without the digits that tell nothing."""
    box_mm: Any = tuple(tuple(round(v, DIGITS) + 0.0 for v in c) for c in entry.bounding_box_mm)
    volume_mm3, off_mm = round(entry.volume_mm3, DIGITS), entry.mesh_deviation_mm
    off_mm = None if off_mm is None else round(off_mm, DIGITS)
    return replace(entry, volume_mm3=volume_mm3, bounding_box_mm=box_mm, mesh_deviation_mm=off_mm)
