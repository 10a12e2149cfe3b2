"""Export parts to files: equal dimensions give equal bytes, in any process and any order.

part_files.py runs in a worker; step.py and dxf.py write the exact solid, meshes.py its mesh.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import asdict, replace
from hashlib import sha256
from pathlib import Path
from typing import Any

from deltact_fab.common import (
    InputError,
    MissingLibrary,
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
from ..build import cad_cache_key, part_key
from ..check.verdict import BUILD_WARNING, DesignVerdict, judge_design
from ..dimensions import Design
from ..fabrication.bom import bom_lines
from ..part import BOUGHT_PROCESS, Part
from ..registry import parts_of_group
from . import index, meshes
from .part_files import (
    ASSEMBLY_NAME,
    DRAWING_FORMATS,
    EXPORT_FORMATS,
    MESH_FORMATS,
    PROCESS_FOLDERS,
    ExportTask,
    FileData,
    PartFile,
    assembly_file,
    checked_formats,
    make,
    part_formats,
)

MANIFEST_FILE = "manifest.json"
WARNING_FILE = "NOT-TO-BE-BUILT.txt"
BOM_FILE = f"{PROCESS_FOLDERS[BOUGHT_PROCESS]}/bom.csv"
TOLERANCE_MM = (0.001, 1.0)  # by hand: finer meshes exceed memory, coarser ones look faceted
MAX_JOBS = 4  # by hand: each takes 500 MB
# By hand: fewer parts are not worth a worker, which first loads the kernel (4 s, 500 MB).
MIN_SHARED_TASKS = 12
EXPORT_STORE = Store("cad", limit_bytes=512 * 2**20)  # by hand: about ten designs at 0.01 mm
# Further sections that a drawing depends on: tolerances of its machine, title block.
DRAWING_SECTIONS = ("drawing", "resin_printer", "laser", "optics")
FILE_DIGITS = 6  # by hand, lengths and volumes in the manifest: more would be rounding noise


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
    judge: Callable[[], DesignVerdict] | None = None,
    force: bool = False,
) -> list[PartFile]:
    """Write every part in every format that applies to it, with manifest.json and index.html.

    formats: of EXPORT_FORMATS; None: all.
    tolerance_mm: largest distance of a mesh from the surface, verified by measurement.
    progress: called with (count, total, step) at the start, after each part, and at the end.
    cached: use and fill the user's cache of files by dimensions, code and kernel version; when no
    file is missing the kernel is not loaded.
    jobs: processes; None: chosen by the number of missing files.
    judge: returns the verdict of the design; None: that of its rules and the solids of these parts.
    With a verdict of the whole design the bill of materials is written too.
    force: write a design that fails, marked as not to be built.

    assembly.step, assembly.glb, wiring.svg and wiring.pdf are written if parts include the whole
    sensor, index.html with the extra `report`; each process has a folder. Files of the same name
    are replaced, and unchanged files of an earlier export (by its manifest) that are not written
    again are removed; other files stay.

    Returns the written files: the assembly first, then by part. All files appear at once, or none.
    Raises InputError for unusable arguments or dimensions; RunFailed when a check fails, a part
    cannot be made, a file cannot be written, a worker dies, or on Ctrl-C.
    """
    kinds = EXPORT_FORMATS if formats is None else checked_formats(formats)
    out_dir = Path(out_dir)
    low, high = TOLERANCE_MM
    if not (math.isfinite(tolerance_mm) and low <= tolerance_mm <= high):
        raise InputError(f"tolerance {tolerance_mm:g} mm: expected {low:g} to {high:g} mm")
    if jobs is not None and jobs < 1:
        raise InputError(f"jobs {jobs}: expected 1 or more")
    by_name = {part.name: part for part in parts if part.indenter or part.places(design)}
    unique = by_name.values()
    tasks = [ExportTask((p,), part_formats(p, kinds), design, tolerance_mm) for p in unique]
    if not any(task.formats for task in tasks):
        raise InputError(f"format {', '.join(kinds)}: applies to none of {', '.join(by_name)}")
    if any(part.indenter is None for part in by_name.values()):
        feasibility.check_feasible(design)
    # The sensor's parts in the registry's order, if complete.
    whole_sensor = [part.name for part in parts_of_group("sensor", design)]
    complete = set(whole_sensor) <= set(by_name)
    sensor = tuple(by_name[name] for name in whole_sensor) if complete else ()
    if sensor and (together := tuple(k for k in kinds if k in ("step", *DRAWING_FORMATS))):
        tasks.insert(0, ExportTask(sensor, together, design, tolerance_mm))
    check_writable(out_dir, folder=True)
    verdict = judge() if judge else judge_design(design, "design", None, unique, cached)
    verdict.require(force)
    if verdict.failed:
        tasks = [replace(task, document=BUILD_WARNING) for task in tasks]
    tell = progress or (lambda count, total, step: None)
    results = _load_or_make(tasks, cached, jobs, tell)
    if sensor and "glb" in kinds:
        results.append(_assembly_glb(sensor, design, results))
    # A fixed order, independent of that of arguments and workers.
    results.sort(key=lambda result: EXPORT_FORMATS.index(_kind(result[0])))
    results.sort(key=lambda result: (result[0].part != ASSEMBLY_NAME, result[0].part))
    files = [_rounded_entry(entry) for entry, _ in results]
    contents = {entry.file: data for entry, data in results}
    pages = _pages(design, list(unique), files, verdict)
    entries = {
        "verdict": verdict.headline,
        "files": [asdict(entry) for entry in files],
        "pages": [{"file": name, "sha256": sha256(data).hexdigest()} for name, data in pages],
    }
    manifest = (json.dumps(entries, indent=2) + "\n").encode()
    contents |= {**dict(pages), MANIFEST_FILE: manifest}
    make_folder(out_dir, *{Path(name).parent.as_posix() for name in contents})
    paths = {out_dir / name: data for name, data in contents.items()}
    write_files(paths, _unchanged_files(out_dir) - {*paths}, RunFailed)
    tell(len(tasks), len(tasks), "done")
    return files


def _pages(
    design: Design, parts: Sequence[Part], files: Sequence[PartFile], verdict: DesignVerdict
) -> list[tuple[str, bytes]]:
    """Return the pages beside the parts' files: the order, the warning, the index."""
    pages = []
    if verdict.is_whole:
        bill = bom_lines(design).headed(verdict.headline)
        pages.append((BOM_FILE, bill.csv().encode()))
    if verdict.failed:
        text = "\n".join(str(row.value) for row in verdict.findings())
        pages.append((WARNING_FILE, f"{text}\n".encode()))
    with suppress(MissingLibrary):
        page = index.render_index(parts, files, [name for name, _ in pages], verdict)
        pages.append((index.INDEX_FILE, page.encode()))
    return pages


def _unchanged_files(folder: Path) -> set[Path]:
    """Return unchanged files of an earlier export, so that no folder mixes two designs."""
    unchanged = set()
    with suppress(OSError, ValueError, KeyError, TypeError):  # no manifest, or a foreign one
        manifest = json.loads((folder / MANIFEST_FILE).read_text())
        for entry in (*manifest["files"], *manifest.get("pages", ())):
            path = folder / entry["file"]
            inside = path.resolve().is_relative_to(folder.resolve())
            if (
                inside
                and path.is_file()
                and sha256(path.read_bytes()).hexdigest() == entry["sha256"]
            ):
                unchanged.add(path)
    return unchanged


def _load_or_make(
    tasks: Sequence[ExportTask], cached: bool, jobs: int | None, tell: Progress
) -> list[FileData]:
    """Return all files except assembly.glb, from the cache or the kernel."""
    cached_files: list[FileData] = []
    missing: list[ExportTask] = []
    for task in tasks:
        stored: dict[str, FileData | None] = dict.fromkeys(task.formats)
        if cached:
            stored = {k: EXPORT_STORE.read(file_cache_key(task, k)) for k in task.formats}
        cached_files += [file for file in stored.values() if file is not None]
        if absent := tuple(kind for kind, file in stored.items() if file is None):
            missing.append(replace(task, formats=absent))
    from_cache = len(tasks) - len(missing)
    tell(from_cache, len(tasks), missing[0].name if missing else "cache")

    def store_files(index: int, files: list[FileData]) -> None:
        for result in files if cached else ():
            EXPORT_STORE.write(file_cache_key(missing[index], _kind(result[0])), result)

    # Several processes only for many parts.
    shared = min(count_workers(), MAX_JOBS) if len(missing) >= MIN_SHARED_TASKS else 1
    results = run_each(
        make, missing, [task.name for task in missing], None,
        lambda count, _, step: tell(from_cache + count, len(tasks), step),
        on_result=store_files, workers=jobs or shared,
    )  # fmt: skip
    return cached_files + [file for several in results for file in several]


def file_cache_key(task: ExportTask, kind: str) -> dict[str, Any]:
    """Return the cache key of a file: all its inputs."""
    design, alone = task.design, len(task.parts) == 1
    context: Any = None if alone else [part.places(design) for part in task.parts]
    if kind in DRAWING_FORMATS:
        # The wiring drawing depends on the whole design.
        sections = {name: getattr(design, name) for name in DRAWING_SECTIONS}
        context = [sections, design.unverified()] if alone else design
        context = [context, task.document]
    return cad_cache_key(
        "fabricate.cad.export.part_files",
        parts=[part_key(part, design) for part in task.parts],
        beside=context,
        format=kind,
        tolerance_mm=task.tolerance_mm if kind in MESH_FORMATS else None,
    )


def _assembly_glb(sensor: Sequence[Part], design: Design, results: Sequence[FileData]) -> FileData:
    """Assemble the parts' own GLB files."""
    by_part = {entry.part: (entry, data) for entry, data in results if _kind(entry) == "glb"}
    bodies, sizes, deviations_mm = {}, [], []
    for part in sensor:
        places, (entry, data) = part.places(design), by_part[part.name]
        bodies[part.name] = meshes.read_part(data), places
        sizes.append((entry.volume_mm3, entry.bounding_box_mm, places))
        deviations_mm.append(entry.mesh_deviation_mm or 0.0)
    return assembly_file(ASSEMBLY_NAME, "glb", meshes.glb_bytes(bodies), sizes, max(deviations_mm))


def _kind(entry: PartFile) -> str:
    return entry.file.rpartition(".")[2]


def _rounded_entry(entry: PartFile) -> PartFile:
    """Round lengths and volumes to significant digits."""
    box: Any = tuple(tuple(round(v, FILE_DIGITS) + 0.0 for v in c) for c in entry.bounding_box_mm)
    volume_mm3, off_mm = round(entry.volume_mm3, FILE_DIGITS), entry.mesh_deviation_mm
    off_mm = None if off_mm is None else round(off_mm, FILE_DIGITS)
    return replace(entry, volume_mm3=volume_mm3, bounding_box_mm=box, mesh_deviation_mm=off_mm)
