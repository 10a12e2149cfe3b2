"""The whole chain in one go: parts, pattern, calibration, run, tracking, shape, force, report.

Independent tasks run in parallel, in two processes.
"""

from __future__ import annotations

import json
import shutil
import time
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from deltact_fab.common import InputError, MissingLibrary, run_each
from deltact_fab.simulate import RunRequest, run_experiment

if TYPE_CHECKING:
    from deltact_fab.estimate import RunMeasurement, ShapeResult

ProgressBar = Callable[[str], AbstractContextManager[Callable[[int, int, str], None]]]
DemoTask = Callable[[Path, int], Any]
DEMO_MARKER = "demo.json"
DEMO_RIG = "usb"
DEMO_PROTOCOL, DEMO_CALIBRATION = "demo", "demo-calibration"
FORCE_MODEL = "inverse-placed"
"""Model that is independent of the indenter, which differs in the calibration."""


def run(out: Path, seed: int, bar: ProgressBar, say: Callable[[str], None]) -> Path:
    """Make everything under `out` and return the report's path.

    A folder of an earlier demo is replaced; any other folder that is not empty is refused.
    Raises MissingLibrary without the extra `report`.
    """
    from deltact_fab.common import require_pages

    require_pages()
    started = time.monotonic()
    _prepare_folder(out)
    first = {
        "calibration (simulated)": _calibrate,
        "indentation (simulated)": _indent,
        "parts": _export_parts,
        "pattern": _make_pattern,
    }
    calibrated, summary, parts, sticker = _parallel("parts, pattern, runs", first, out, seed, bar)
    say(parts["said"])
    say(f"pattern: {sticker}")
    for line in calibrated:
        say(f"calibration: {line}")
    say(
        f"run: {summary['frames']} frames through a USB camera and a fisheye, "
        f"{summary['rig_seconds']:.0f} s simulated in {summary['wall_seconds']:.0f} s"
    )
    then = {"tracking": _track, "shape and force": _measure}
    tracking, (shape, forces) = _parallel("tracking, shape, force", then, out, seed, bar)

    from deltact_fab.present import write_run_page

    page = write_run_page(out / "run", out / "report.html", tracking, forces, parts, shape)
    seconds = time.monotonic() - started
    (out / DEMO_MARKER).write_text(json.dumps({"seed": seed, "finished": True}) + "\n")
    say(f"report: {page} ({seconds:.0f} s in total)")
    say(f"simulated, seed {seed}; calibrated on sphere:25, measured on other indenters:")
    say(f"tracking error: {tracking.verdict.line}")
    say(f"shape: {shape.line}")
    if forces.force is not None:
        say(f"force error: {forces.force.line}")
    return page


def _parallel(
    title: str, tasks: Mapping[str, DemoTask], out: Path, seed: int, bar: ProgressBar
) -> list[Any]:
    """Run the tasks and return their results in order."""
    jobs = [(work, out, seed) for work in tasks.values()]
    with bar(title) as tick:
        tick(0, len(tasks), ", ".join(tasks))
        return run_each(_run_task, jobs, list(tasks), progress=tick)


def _run_task(task: tuple[DemoTask, Path, int]) -> Any:
    """Run one task, in a separate process."""
    work, out, seed = task
    return work(out, seed)


def _calibration_files(out: Path) -> tuple[Path, Path]:
    """Return the files of the force and depth calibrations."""
    folder = out / "calibration" / "analysis"
    return folder / "calibration.toml", folder / "depth.toml"


def _calibrate(out: Path, seed: int) -> tuple[str, str]:
    """Press a ball in the middle and calibrate force and depth; return two lines of results."""
    from deltact_fab.common import write_whole
    from deltact_fab.estimate import calibrate_depth, calibrate_force, write_force_calibration

    folder, (force_file, depth_file) = out / "calibration", _calibration_files(out)
    # Other noise than in the measured run.
    run_experiment(RunRequest(DEMO_CALIBRATION, DEMO_RIG, folder, seed=seed + 1))
    force = calibrate_force([folder], (FORCE_MODEL,), seed)
    write_force_calibration(force.calibration, force_file)
    depth = calibrate_depth(folder, force_file)
    write_whole(depth_file, depth.toml().encode())
    return (
        f"force by {force.best.name!r} from {len(force.data)} settled points of sphere:25 in "
        f"the middle, too few to validate: {force_file}",
        f"depth from the same points, gain {depth.model.gain:.3f}: {depth_file}",
    )


def _indent(out: Path, seed: int) -> dict[str, Any]:
    return run_experiment(RunRequest(DEMO_PROTOCOL, DEMO_RIG, out / "run", seed=seed))


def _track(out: Path, seed: int) -> Any:
    from deltact_fab.estimate import analyse_tracking

    result = analyse_tracking(out / "run")
    result.save(out / "run" / "analysis")
    return result


def _measure(out: Path, seed: int) -> tuple[ShapeResult, RunMeasurement]:
    from deltact_fab.bench import open_run
    from deltact_fab.estimate import analyse_shape, measure_run

    shape = analyse_shape(out / "run", _calibration_files(out)[1])
    shape.save(out / "run" / "analysis")
    return shape, measure_run(open_run(out / "run"), _calibration_files(out))


def _prepare_folder(out: Path) -> None:
    if not out.exists():
        out.mkdir(parents=True)
    elif (out / DEMO_MARKER).is_file():
        shutil.rmtree(out)
        out.mkdir()
    elif any(out.iterdir()):
        raise InputError(f"--out {out}: must be a new or empty folder, or that of an earlier demo")
    (out / DEMO_MARKER).write_text(json.dumps({"finished": False}) + "\n")


def _export_parts(out: Path, seed: int) -> dict[str, Any]:
    """Export the parts; return one row per part, and a summary."""
    from deltact_fab.fabricate import export_parts, load_design, select_parts

    try:
        files = export_parts(load_design(), select_parts(["sensor"]), None, 0.01, out / "cad")
    except MissingLibrary as error:
        note = f"not exported: {error}"
        return {"parts": [], "note": f"The parts were {note}", "said": f"cad: {note}"}
    rows = []
    for part in dict.fromkeys(f.part for f in files):
        part_files = [f for f in files if f.part == part]
        off_mm = [f.mesh_deviation_mm for f in part_files if f.mesh_deviation_mm is not None]
        rows.append(
            {
                "part": part,
                "formats": ", ".join(Path(f.file).suffix[1:] for f in part_files),
                "material": part_files[0].material,
                "process": part_files[0].process,
                "quantity": part_files[0].quantity,
                "volume_mm3": part_files[0].volume_mm3 or None,
                "mesh_deviation_mm": max(off_mm, default=None),
            }
        )
    return {"parts": rows, "note": "", "said": f"cad: {len(files)} files in {out / 'cad'}"}


def _make_pattern(out: Path, seed: int) -> str:
    from deltact_fab.fabricate import load_recipe, make_pattern

    folder = out / "pattern"
    folder.mkdir()
    sticker = make_pattern(load_recipe("dense-with-dots"), folder / "dense-with-dots.png")
    recipe = sticker.recipe
    dots = recipe.dots.columns * recipe.dots.rows if recipe.dots is not None else 0
    return f"{recipe.n} x {recipe.n} patches of {recipe.patch_mm} mm, {dots} dots: {sticker.image}"
