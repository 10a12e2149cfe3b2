"""The pattern selection from recorded runs of a bench, each of one tactile base.

The paper's error needs the dots only, and no truth; simulated runs can be used too.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from .. import record
from ..analysis.frames import recorded
from ..analysis.tracking_error.follow import ONLY_DOTS, scene_of
from ..analysis.tracking_error.run import analyse_press
from ..errors import InputError
from ..patterns.series import recipes
from ..record import Run
from .grid import GridJob
from .pattern_errors import PrintedPattern
from .pattern_press import packed


def jobs_of(
    folders: Sequence[Path], methods: Sequence[str]
) -> list[tuple[PrintedPattern, str, GridJob]]:
    """(pattern, indenter, job) for each press of the runs.

    Runs of one pattern are replicates. Raises InputError for a run that is not finished, has no
    images, dots or dense pattern, or is named twice.
    """
    found: list[tuple[PrintedPattern, str, GridJob]] = []
    for n, folder in enumerate(folders):
        if folder.resolve() in [one.resolve() for one in folders[:n]]:
            raise InputError(f"--from {folder}: named twice; runs of one pattern are replicates")
        run = record.open(folder)
        frames = recorded(run, "the pattern selection")
        if run.pattern["recipe"]["law"] == ONLY_DOTS:
            raise InputError(f"{folder}: the pattern has only dots; expected a dense one")
        if "dots" not in run.meta["protocol"]["channels"] or not len(run.dots_mm()):
            raise InputError(
                f"{folder}: no dots were recorded, at which the error is measured; expected "
                "a pattern with dots and the channel 'dots'"
            )
        printed = printed_of(run)
        for press, part in frames.groupby("press", sort=False):
            what = [run.meta, run.pattern, part[["file", "sha256"]].to_numpy().tolist()]
            told = {
                "folder": str(folder.resolve()),
                "press": str(press),
                "name": printed.name,
                "methods": list(methods),
                "content": hashlib.sha256(json.dumps(what, sort_keys=True).encode()).hexdigest(),
            }
            indenter = str(part["indenter"].iloc[0])
            job = GridJob(f"{folder}: {press}", follow, told, float(len(part)))
            found.append((printed, indenter, job))
    return found


def printed_of(run: Run) -> PrintedPattern:
    """The pattern of a run: one of the paper's by its d and r, else by the run's name."""
    recipe = run.pattern["recipe"]
    d_mm, r = recipe.get("patch_mm"), recipe.get("r")
    for entry in recipes():
        if recipe["law"] == entry.recipe.law and (d_mm, r) == (
            entry.recipe.patch_mm,
            entry.recipe.r,
        ):
            return PrintedPattern.of(entry)
    if recipe["law"] == "algorithm1":
        return PrintedPattern(f"d{d_mm:g}-r{r:g}".replace(".", "p"), d_mm, r)
    return PrintedPattern(run.folder.name, None, None)


def follow(given: dict[str, Any]) -> dict[str, Any]:
    """One press of a run, as `pattern_press.follow` returns one of a simulated gel."""
    run, name = record.open(given["folder"]), given["name"]
    scene = scene_of(run, given["methods"])
    found = analyse_press(given["folder"], given["press"], scene)
    rows = {m: [row for row in found.rows if row["method"] == m] for m in given["methods"]}
    tips = run.frames(given["press"])[["x_mm", "y_mm", "z_mm"]].to_numpy(float)
    here = {name: (found.tallies, rows, found.dots.figures(), found.left_out)}
    return packed(tips[1:].tolist(), tips[0, :2].tolist(), here)
