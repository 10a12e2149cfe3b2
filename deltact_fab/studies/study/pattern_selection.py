"""`study run pattern-selection`: the paper's 17 patterns under 5 indenters (Pattern Selection).

Simulated: the gel of a press is solved once, and its frames are drawn and tracked as a stream
(`stream`) under every pattern, by the paper's tracker and by ours. Recorded: a run is one tactile
base, as in the paper, and its error is taken at the dots.

A smaller scale keeps the step between frames, which a tracker has to bridge, and the presses: all
depths, both axes.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

from deltact_fab.bench import Protocol, Run, expand_protocol, load_protocol, open_run
from deltact_fab.common import MM_PER_INCH, InputError, Note, count_workers, did_you_mean, validate
from deltact_fab.estimate import FlowTracker, TrackingPlan, read_frames
from deltact_fab.fabricate import PatternRecipe, SeriesEntry, list_series
from deltact_fab.present import StudyResult
from deltact_fab.sensor import parse_indenter

from .grid import Grid, GridJob
from .pattern_errors import FLOW_NAMES, PatternErrors, PressErrors
from .pattern_tables import charts, claims, headlines, tables
from .press_jobs import RecordedTrackingJob, TrackingJob, cost_s, track_press, track_recorded
from .registry import StudyRequest, modulus_remark
from .scene import PressScene, flag_setting

SELECTION_STUDY, SELECTION_TITLE = "pattern-selection", "Which pattern is tracked best"
TRACKERS_SETTING = (
    "the paper's text: Farneback 5/13/10; the reference is renewed if the warped-back image "
    f"differs by more than {FlowTracker.RENEW_SHARE:g} of the difference of unrelated views; flows "
    "summed and composed; its group's: as published; ours: fused, anchored"
)
SELECTION_NOTES = (
    "The paper stacks its indenters' errors and calls the result the average error: if that is a "
    "sum of five, its mean errors are a fifth.",
    "Intervals are over indenters (jackknife, 95 %), not over prints of a pattern, seeds or gels.",
    "A claim is decided if summed and composed flows agree and both intervals exclude its "
    "contrary; more positions (--scale) and prints of a pattern (--seed) may decide others.",
)
SELECTION_LEFT_OUT = (
    Note("images and records", "rendered and tracked as a stream, not stored"),
    Note("forces", "not in the protocol's channels"),
)
NO_LENS = Note("the lens", "this rig uses a pinhole camera")


def run(request: StudyRequest) -> StudyResult:
    """Run the study. `request.options`: names in "pattern" and "indenter" restrict it.

    Raises InputError for unknown names, RunFailed if every job failed.
    """
    return _recorded(request) if request.runs else _simulated(request)


def _simulated(request: StudyRequest) -> StudyResult:
    selection = Selection.from_request(request)
    part, protocol, rig = selection.part, selection.protocol, selection.scene.rig.virtual
    request.say(
        f"{len(selection.entries)} patterns x {len(protocol.tips)} indenters: {part.words}; "
        f"{part.longest_step_mm:.3f} mm between frames at most"
    )
    selection.scene.solve_gels(request)
    jobs = selection.jobs(count_workers(request.executor))
    grid = request.solve(jobs)
    errors = PatternErrors(selection.entries, _cells(grid))
    specimen, printer = protocol.specimen, rig.printer
    result = _base_result(request, errors, grid, part.words, True)
    # All jobs of a press share its gel.
    gels = {j.arguments.press: grid.results[j.name]["gel"] for j in jobs if j.name in grid.results}
    return replace(
        result,
        scale=request.scale,
        extra={"part": part._asdict()},
        settings={
            "path": part.words,
            "step between frames": f"{part.longest_step_mm:.3f} mm at most",
            "trackers": TRACKERS_SETTING,
            "gel": f"{specimen.gel_model}, {specimen.modulus_mpa:g} MPa, friction "
            f"{specimen.friction:g}",
            "printer": f"{printer.dpi} dpi, {printer.levels} levels, spread {printer.spread_um:g} "
            f"um, misregistration {printer.misregistration_um:g} um",
            "camera": "; ".join(f"{k} {v}" for k, v in vars(rig.camera).items()),
            **flag_setting(list(gels.values()), "presses"),
        },
        notes=(*result.notes, _bench_note(selection), modulus_remark(specimen.modulus_mpa)),
        left_out=SELECTION_LEFT_OUT if rig.lens else (*SELECTION_LEFT_OUT, NO_LENS),
    )


def _recorded(request: StudyRequest) -> StudyResult:
    pairs = run_jobs(request.runs, tuple(FLOW_NAMES))
    grid = request.solve([job for _, job in pairs])
    printed = {printed.name: printed for printed, _ in pairs}
    errors = PatternErrors(list(printed.values()), _cells(grid))
    runs = [open_run(folder) for folder in request.runs]
    simulated = any(run.simulated for run in runs)
    return replace(
        _base_result(request, errors, grid, f"{len(runs)} recorded runs", simulated),
        settings={"runs": ", ".join(run.folder.name for run in runs), "trackers": TRACKERS_SETTING},
    )


def run_jobs(folders: Sequence[Path], methods: Sequence[str]) -> list[tuple[SeriesEntry, GridJob]]:
    """Return (pattern, job) for each press of the runs.

    Runs of one pattern are replicates. Raises InputError for a run that is unfinished, without
    images, dots or a dense pattern, or named twice.
    """
    jobs: list[tuple[SeriesEntry, GridJob]] = []
    for n, folder in enumerate(folders):
        if folder.resolve() in [earlier.resolve() for earlier in folders[:n]]:
            raise InputError(f"--from {folder}: named twice; runs of one pattern are replicates")
        run = open_run(folder)
        frames = read_frames(run, "the pattern selection")
        if run.pattern["recipe"]["law"] == TrackingPlan.DOTS_ONLY_LAW:
            raise InputError(f"{folder}: the pattern has only dots; expected a dense one")
        if "dots" not in run.meta["protocol"]["channels"] or not len(run.dots_mm()):
            raise InputError(
                f"{folder}: no dots recorded to measure the error at; expected a pattern with dots "
                "and the channel 'dots'"
            )
        printed = pattern_of_run(run)
        for press, part in frames.groupby("press", sort=False):
            inputs = [run.meta, run.pattern, part[["file", "sha256"]].to_numpy().tolist()]
            content = hashlib.sha256(json.dumps(inputs, sort_keys=True).encode()).hexdigest()
            arguments = RecordedTrackingJob(
                str(folder.resolve()), str(press), str(part["indenter"].iloc[0]), printed.name,
                tuple(methods), content,
            )  # fmt: skip
            job = GridJob(f"{folder}: {press}", track_recorded, arguments, float(len(part)))
            jobs.append((printed, job))
    return jobs


def pattern_of_run(run: Run) -> SeriesEntry:
    """Pattern of a run: one of the paper's by d and r, else named by the run."""
    recipe = validate(
        PatternRecipe, run.pattern["recipe"], f"{run.folder / 'pattern.json'}: recipe"
    )
    key = recipe.law, recipe.patch_mm, recipe.r
    for entry in list_series():
        if key == (entry.recipe.law, entry.recipe.patch_mm, entry.recipe.r):
            return entry
    if recipe.law == "algorithm1":
        return SeriesEntry(f"d{recipe.patch_mm:g}-r{recipe.r:g}".replace(".", "p"), recipe)
    return SeriesEntry(run.folder.name, recipe)


def _cells(grid: Grid) -> list[PressErrors]:
    """Errors of all jobs, in order."""
    return [cell for value in grid.results.values() for cell in value["cells"]]


def _base_result(
    request: StudyRequest, errors: PatternErrors, grid: Grid, covers: str, simulated: bool
) -> StudyResult:
    """Result fields shared by simulated and recorded runs."""
    losses = [
        f"{cell.pattern} under {cell.press}: {line}" for cell in errors.cells
        for line in cell.left_out
    ]  # fmt: skip
    return StudyResult(
        study=SELECTION_STUDY,
        title=SELECTION_TITLE,
        simulated=simulated,
        seed=request.seed,
        scale=None,
        answer=(f"{'Simulated: ' if simulated else ''}{covers}.",),
        claims=claims(errors),
        headlines=headlines(errors),
        tables=tables(errors, covers),
        figures=charts(errors, covers),
        notes=(*SELECTION_NOTES, *losses),
    )


def _bench_note(selection: Selection) -> str:
    """Note on the differences to the paper's bench."""
    printer, optics = selection.scene.rig.virtual.printer, selection.scene.sensor.optics
    least_mm = min(e.recipe.patch_mm for e in selection.entries if e.recipe.patch_mm)
    dots, pixels = least_mm / (MM_PER_INCH / printer.dpi), least_mm / optics.mm_per_px
    return (
        f"Differences to the paper's bench: a printer model ({printer.dpi} dpi, "
        f"{printer.spread_um:g} um spread: the smallest patch, {least_mm:g} mm, is {dots:.1f} "
        f"printer dots and {pixels:.1f} pixels), no motion blur, constant light. The paper does "
        "not give its gel, the indenters' sizes, its positions, or the size of the threshold for "
        "renewing the reference: 18 grey levels in the program that its group has published."
    )


class PathPart(NamedTuple):
    """Part of a full protocol's path that a reduced one covers.

    words: one line. longest_step_mm: of the tip between two frames.
    """

    words: str
    positions: int
    frames_an_indenter: int
    frames_share: float
    longest_step_mm: float


def thin_protocol(full: Protocol, scale: float) -> Protocol:
    """Reduce a protocol to about `scale` times its frames, 0 < scale <= 1.

    Keeps as few positions as possible, the first ones, and as many steps of their drags as fit, at
    least one; the step between frames is unchanged.
    """
    if scale >= 1 or full.shear is None or full.shear.amplitude_mm is None:
        return full
    target = scale * frames_per_indenter(full)
    count = math.ceil(scale * len(full.places_mm) - 1e-9)
    rate_hz = full.capture.rate_hz
    assert rate_hz is not None, "the paper's protocol films its drags"
    step_mm = full.motion.shear_feed_mm_min / 60 / rate_hz
    longest = int(full.shear.amplitude_mm / step_mm)
    fewer = full.narrowed(places_mm=full.places_mm[:count])
    if frames_per_indenter(fewer) <= target:
        return fewer
    one_step, two_steps = (frames_per_indenter(_with_drag(fewer, n * step_mm)) for n in (1, 2))
    steps = round((target - one_step) / (two_steps - one_step)) + 1
    return _with_drag(fewer, min(max(steps, 1), longest) * step_mm)


def _with_drag(protocol: Protocol, amplitude_mm: float) -> Protocol:
    """Return the protocol with drags of this length, rounded to 1 um."""
    assert protocol.shear is not None
    shear = protocol.shear.model_copy(update={"amplitude_mm": round(amplitude_mm, 3)})
    return protocol.model_copy(update={"shear": shear})


def frames_per_indenter(protocol: Protocol) -> int:
    """Number of frames per indenter."""
    first = protocol.narrowed(tips=protocol.tips[:1])
    return sum(step.frames for step in expand_protocol(first))


def covered_part(full: Protocol, protocol: Protocol) -> PathPart:
    """Part of the full protocol's path that a reduced one covers."""
    frames, of_frames = frames_per_indenter(protocol), frames_per_indenter(full)
    positions, share = len(protocol.places_mm), frames / of_frames
    words = (
        f"{positions} of {len(full.places_mm)} positions, "
        f"{' and '.join(f'{d:g}' for d in protocol.stops_mm)} mm deep, "
    )
    if protocol.shear and full.shear:
        words += (
            f"shear +-{protocol.shear.amplitude_mm or 0:g} of {full.shear.amplitude_mm or 0:g} mm "
            f"in {' and '.join(protocol.shear.axes)}, "
        )
    words += f"{frames} of {of_frames} frames ({share:.1%})"
    return PathPart(words, positions, frames, share, longest_step_mm(protocol))


def longest_step_mm(protocol: Protocol) -> float:
    """Longest motion of the tip between two frames of a press or drag, mm."""
    longest, position_mm = 0.0, (0.0, 0.0, 0.0)
    for step in expand_protocol(protocol):
        if step.frames and step.kind in ("press", "shear"):
            longest = max(longest, math.dist(position_mm, step.target_mm) / step.frames)
        position_mm = step.target_mm
    return longest


SELECTION_SCALE = 0.04
"""By hand: 136 of 3600 frames per indenter; 40 minutes on two cores with the gel solved."""
MAX_PATTERNS_PER_JOB = 4
"""By hand: each takes some 80 MB; decision 0040: fewer share the cost of a frame's geometry."""


@dataclass(frozen=True)
class Selection:
    """Scene of one study: presses, patterns, trackers. name: of its protocol."""

    scene: PressScene
    name: str
    part: PathPart
    entries: tuple[SeriesEntry, ...]

    @classmethod
    def from_request(cls, request: StudyRequest) -> Selection:
        """Build from a request. Raises InputError for a real rig or unknown names."""
        full, source = load_protocol(str(request.options.get("protocol") or SELECTION_STUDY))
        indenters = _select_names(
            "--indenter",
            [parse_indenter(name).name for name in request.options.get("indenter") or ()],
            list(full.tips),
        )
        series = {entry.name: entry for entry in list_series(request.seed)}
        names = _select_names("--pattern", list(request.options.get("pattern") or ()), list(series))
        protocol = thin_protocol(full, SELECTION_SCALE if request.scale is None else request.scale)
        protocol = protocol.narrowed(tips=indenters)
        scene = PressScene.load(request, {protocol.name: (protocol, source)})
        entries = tuple(series[name] for name in names)
        return cls(scene, protocol.name, covered_part(full, protocol), entries)

    @property
    def protocol(self) -> Protocol:
        """Protocol of the presses."""
        return self.scene.protocols[self.name]

    def jobs(self, workers: int = 1) -> list[GridJob]:
        """One job per press and group of patterns, which share its geometry; a group per worker."""
        count = len(self.entries)
        parts = min(max(workers, math.ceil(count / MAX_PATTERNS_PER_JOB)), count)
        frames = self.part.frames_an_indenter // self.part.positions
        patterns = [
            {entry.name: entry.recipe for entry in self.entries[k::parts]} for k in range(parts)
        ]
        return [
            self.scene.job(
                f"{press} ({k} of {parts})", self.name, press, track_press, TrackingJob,
                cost_s(frames, len(group)), patterns=group, methods=tuple(FLOW_NAMES),
            )
            for press in self.scene.presses(self.name)
            for k, group in enumerate(patterns, start=1)
        ]  # fmt: skip


def _select_names(option: str, requested: list[str], choices: list[str]) -> list[str]:
    """Return the requested choices in order, all if none. Raises InputError."""
    for name in requested:
        if name not in choices:
            raise InputError(f"{option}: {name!r}: unknown; {did_you_mean(name, choices)}")
    return [name for name in choices if not requested or name in requested]
