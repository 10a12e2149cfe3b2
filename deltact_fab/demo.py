"""The whole chain in one go: parts, pattern, run on the virtual rig, tracking error, report."""

from __future__ import annotations

import json
import shutil
import time
from collections.abc import Callable
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any

from . import experiment
from .errors import InputError, MissingLibrary

Bar = Callable[[str], AbstractContextManager[Callable[[int, int, str], None]]]
MARKER = "demo.json"
RIG = "fisheye"


def run(out: Path, seed: int, bar: Bar, say: Callable[[str], None]) -> Path:
    """Make everything under `out` and return the report's path.

    A folder of an earlier demo is replaced; any other folder that is not empty is refused.
    """
    started = time.monotonic()
    _clear(out)
    parts = _parts(out / "cad", bar, say)
    with bar("pattern") as tick:
        tick(0, 1, "dense-with-dots")
        made = _pattern(out / "pattern")
        tick(1, 1, "dense-with-dots")
    say(f"pattern: {made}")
    run_folder = out / "run"
    with bar("indentation (simulated)") as tick:
        summary = experiment.run("smoke", RIG, run_folder, seed=seed, progress=tick)
    say(
        f"run: {summary['frames']} frames through the fisheye, {summary['rig_seconds']:.0f} s of "
        f"rig time in {summary['wall_seconds']:.0f} s"
    )

    from . import record
    from .analysis.measured import measured
    from .analysis.tracking_error import analyse
    from .numerics.scenes import costs
    from .report.page import write

    with bar("tracking error") as tick:
        result = analyse(run_folder, progress=tick)
    result.save(run_folder / "analysis")
    say(f"tracking error: {result.verdict.line}")
    layer_costs = [cost.as_dict() for cost in costs()]
    with bar("shape") as tick:
        found = measured(record.open(run_folder), progress=tick)
    page = write(run_folder, out / "report.html", result, found, parts, layer_costs)
    seconds = time.monotonic() - started
    (out / MARKER).write_text(json.dumps({"seed": seed, "finished": True}) + "\n")
    say(f"report: {page} ({seconds:.0f} s in all)")
    return page


def _clear(out: Path) -> None:
    if not out.exists():
        out.mkdir(parents=True)
    elif (out / MARKER).is_file():
        shutil.rmtree(out)
        out.mkdir()
    elif any(out.iterdir()):
        raise InputError(f"{out}: is not empty and not an earlier demo; name another --out folder")
    (out / MARKER).write_text(json.dumps({"finished": False}) + "\n")


def _parts(folder: Path, bar: Bar, say: Callable[[str], None]) -> dict[str, Any]:
    from .cad.design import load_design
    from .cad.export import FORMATS, export_parts
    from .cad.registry import select

    try:
        with bar("cad export") as tick:
            files = export_parts(load_design(), select(["sensor"]), FORMATS, 0.01, folder, tick)
    except MissingLibrary as why:
        say(f"cad: left out: {why}")
        return {"parts": [], "note": f"The parts were left out: {why}"}
    say(f"cad: {len(files)} files in {folder}")
    rows = []
    for part in dict.fromkeys(f.part for f in files):
        own = [f for f in files if f.part == part]
        rows.append(
            {
                "part": part,
                "formats": ", ".join(f.file.removeprefix(f"{part}.") for f in own),
                "material": own[0].material,
                "process": own[0].process,
                "quantity": own[0].quantity,
                "volume_mm3": own[0].volume_mm3,
                "mesh_deviation_mm": max((f.mesh_deviation_mm or 0.0 for f in own), default=None),
            }
        )
    return {"parts": rows, "note": ""}


def _pattern(folder: Path) -> str:
    from .patterns.raster import make
    from .patterns.recipe import load_recipe

    folder.mkdir()
    made = make(load_recipe("dense-with-dots"), folder / "dense-with-dots.png")
    recipe = made.recipe
    dots = recipe.dots.columns * recipe.dots.rows if recipe.dots is not None else 0
    return f"{recipe.n} x {recipe.n} patches of {recipe.patch_mm} mm, {dots} dots: {made.image}"
