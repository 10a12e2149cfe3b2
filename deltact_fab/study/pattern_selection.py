"""`study run pattern-selection`: the paper's 17 patterns under 5 indenters (Pattern Selection).

Simulated: the gel of a press is solved once, and its frames are drawn and tracked as a stream
(`stream`) under every pattern, by the paper's tracker and by ours. Recorded: a run is one tactile
base, as in the paper, and its error is taken at the dots.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from .. import record
from ..analysis.runs import recorded
from ..analysis.tracking_error.follow import ONLY_DOTS
from ..errors import InputError
from ..measure.flow import RENEW_SHARE
from ..patterns.series.job import recipes
from ..record import Run
from ..report.result import LeftOut, StudyResult
from ..shapes.indenter import parse
from ..units import MM_PER_INCH
from .grid import Grid, GridJob
from .pattern_errors import METHODS, PatternErrors, PressErrors, PrintedPattern, cells_of
from .pattern_press import KNOT_S, follow_recorded
from .pattern_scene import Selection
from .pattern_tables import charts, claims, headlines, tables
from .request import StudyRequest, modulus_remark
from .scene import flagged

NAME, TITLE = "pattern-selection", "Which pattern is tracked best"
TRACKERS = (
    "the paper's: Farneback 5/13/10, the reference renewed where the image warped back differs by "
    f"more than {RENEW_SHARE:g} of what unrelated views of the pattern differ by, flows summed "
    "and composed; ours: fused, anchored"
)
NOTES = (
    "The paper stacks its indenters' errors and calls the result the average error: read as a sum "
    "of five, its values would be means of a fifth.",
    "Intervals are over indenters (jackknife, 95 %): not over prints of a pattern, seeds or gels.",
    "A claim is made where flows summed and composed agree and both intervals exclude it; more "
    "positions (--scale) and prints of a pattern (--seed) would decide others.",
)
LEFT_OUT = (
    LeftOut("images and records", "drawn, tracked and let go: a stream"),
    LeftOut("forces", "no channel asks for them"),
)
NO_LENS = LeftOut("the lens", "the rig draws through a pinhole")


def run(asked: StudyRequest) -> StudyResult:
    """The study. `asked.more`: "pattern" and "indenter", names of a part of them.

    Raises InputError for names that are not known, RunFailed where every job failed.
    """
    return _recorded(asked) if asked.runs else _simulated(asked)


def _simulated(asked: StudyRequest) -> StudyResult:
    of = Selection.of(asked)
    part, protocol, rig = of.part, of.protocol, of.scene.rig.virtual
    asked.say(
        f"{len(of.entries)} patterns x {len(protocol.indenters)} indenters: {part.words}; "
        f"{part.longest_step_mm:.3f} mm between frames at most"
    )
    of.scene.solve_gels(asked, KNOT_S)
    indenters = {parse(name).slug: name for name in protocol.indenters}
    jobs = [(indenters[job.given["press"].split("/")[0]], job) for job in of.jobs(asked.workers)]
    grid = asked.solve([job for _, job in jobs])
    printed = [PrintedPattern.of(entry) for entry in of.entries]
    errors = PatternErrors(printed, _cells(jobs, grid))
    specimen, printer = protocol.specimen, rig.printer
    found = _result(asked, errors, grid, part.words, True)
    # The jobs of one press have one gel.
    gels = {
        job.given["press"]: grid.found[job.name]["gel"] for _, job in jobs if job.name in grid.found
    }
    return replace(
        found,
        scale=asked.scale,
        more={"part": part._asdict()},
        settings={
            "path": part.words,
            "step between frames": f"{part.longest_step_mm:.3f} mm at most",
            "trackers": TRACKERS,
            "gel": f"{specimen.gel_model}, {specimen.modulus_mpa:g} MPa, friction "
            f"{specimen.friction:g}",
            "printer": f"{printer.dpi} dpi, {printer.levels} levels, spread {printer.spread_um:g} "
            f"um, misregistration {printer.misregistration_um:g} um",
            "camera": "; ".join(f"{k} {v}" for k, v in rig.camera),
            **flagged(list(gels.values()), "presses"),
        },
        notes=(*found.notes, _bench(of), modulus_remark(specimen.modulus_mpa)),
        left_out=LEFT_OUT if rig.lens else (*LEFT_OUT, NO_LENS),
    )


def _recorded(asked: StudyRequest) -> StudyResult:
    found = jobs_of(asked.runs, tuple(METHODS))
    jobs = [(indenter, job) for _, indenter, job in found]
    grid = asked.solve([job for _, job in jobs])
    printed = list(dict.fromkeys(printed for printed, _, _ in found))
    errors = PatternErrors(printed, _cells(jobs, grid))
    runs = [record.open(folder) for folder in asked.runs]
    simulated = any(run.simulated for run in runs)
    return replace(
        _result(asked, errors, grid, f"{len(runs)} recorded runs", simulated),
        settings={"runs": ", ".join(run.folder.name for run in runs), "trackers": TRACKERS},
    )


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
            job = GridJob(f"{folder}: {press}", follow_recorded, told, float(len(part)))
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


def _cells(jobs: Sequence[tuple[str, GridJob]], grid: Grid) -> list[PressErrors]:
    """What jobs found, each of a press of an indenter."""
    there = grid.found
    return [
        cell
        for indenter, job in jobs
        if job.name in there
        for cell in cells_of(there[job.name], job.given["press"], indenter)
    ]


def _result(
    asked: StudyRequest, errors: PatternErrors, grid: Grid, covers: str, simulated: bool
) -> StudyResult:
    """What both have."""
    lost = [
        f"{cell.pattern} under {cell.press}: {line}" for cell in errors.cells
        for line in cell.left_out
    ]  # fmt: skip
    return StudyResult(
        study=NAME,
        title=TITLE,
        simulated=simulated,
        seed=asked.seed,
        scale=None,
        answer=(f"{'Simulated: ' if simulated else ''}{covers}.",),
        claims=claims(errors),
        headlines=headlines(errors),
        tables=tables(errors, covers),
        figures=charts(errors, covers),
        notes=(*NOTES, *lost),
    )


def _bench(of: Selection) -> str:
    """What may part it from the paper's bench, in figures."""
    printer, optics = of.scene.rig.virtual.printer, of.scene.sensor.optics
    least_mm = min(e.recipe.patch_mm for e in of.entries if e.recipe.patch_mm)
    dots, pixels = least_mm / (MM_PER_INCH / printer.dpi), least_mm / optics.mm_per_px
    return (
        f"What parts it from the paper's bench: a printer model ({printer.dpi} dpi, "
        f"{printer.spread_um:g} um of spread: the smallest patch, {least_mm:g} mm, is {dots:.1f} "
        f"of its dots and {pixels:.1f} pixels), no motion blur, light that stays. The paper does "
        "not print its gel, its indenters' sizes, its positions, nor the threshold at which its "
        "reference is renewed."
    )
