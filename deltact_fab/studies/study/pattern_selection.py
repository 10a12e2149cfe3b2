"""`study run pattern-selection`: which of the paper's 17 patterns is tracked best, as a comparison.

Simulated: all patterns under the same presses of 5 indenters, whose gel is solved once; the frames
of a press are drawn and tracked as a stream (`stream`) by the published tracker. Realisations are
added until the questions are decided, for patterns that a question still needs, or until the CPU
time is used up; the same command then goes on from the stored jobs.

A smaller scale keeps the step between frames, which a tracker has to bridge, and the presses: all
depths, both axes.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

from deltact_fab.bench import Protocol, expand_protocol, load_protocol
from deltact_fab.common import MM_PER_INCH, InputError, Note, did_you_mean
from deltact_fab.estimate import FlowTracker
from deltact_fab.fabricate import SeriesEntry, list_series
from deltact_fab.present import StudyResult
from deltact_fab.sensor import parse_indenter

from .grid import GridJob
from .pattern_questions import (
    Question,
    error_chart,
    error_headlines,
    error_tables,
    next_look,
    paper_questions,
    press_means,
)
from .press_jobs import TrackingJob, cost_s, seed_groups, track_press
from .registry import StudyRequest, modulus_remark
from .scene import PressScene, flag_setting

SELECTION_STUDY, SELECTION_TITLE = "pattern-selection", "Which pattern is tracked best"
SELECTION_CPU_MIN = 120.0  # by hand: an hour on two cores
AT_DOTS = "mean_at_dots_mm"  # the paper's error, Eq. 7
SELECTION_NOTES = (
    "The paper stacks its indenters' errors and calls the result the average error: if that is a "
    "sum of five, its mean errors are a fifth.",
    "A realisation is another seed of pattern, print and noise, shared by all patterns; intervals "
    "are over realisations, of one gel and these presses.",
)
SELECTION_LEFT_OUT = (
    Note("images and records", "rendered and tracked as a stream, not stored"),
    Note("forces", "not in the protocol's channels"),
)
NO_LENS = Note("the lens", "this rig uses a pinhole camera")


def run(request: StudyRequest) -> StudyResult:
    """Run the study. `request.options`: names in "pattern" and "indenter" restrict it.

    Raises InputError for unknown names or CPU minutes, RunFailed if every job failed.
    """
    selection = Selection.from_request(request)
    minutes = request.options.get("cpu_minutes")
    minutes = SELECTION_CPU_MIN if minutes is None else minutes
    if not 0 < minutes < math.inf:  # NaN fails too
        raise InputError(f"--cpu-minutes: {minutes:g}; expected a finite number above 0")
    part, protocol, rig = selection.part, selection.protocol, selection.scene.rig.virtual
    request.say(
        f"{len(selection.entries)} patterns x {len(protocol.tips)} indenters: {part.words}; "
        f"{part.longest_step_mm:.3f} mm between frames at most"
    )
    selection.scene.solve_gels(request)
    trial = SelectionTrial(selection, request, 60 * minutes)
    trial.run()
    specimen, printer = protocol.specimen, rig.printer
    covers = f"{part.words}, {trial.realisations} realisations of {len(selection.entries)} patterns"
    return StudyResult(
        study=SELECTION_STUDY,
        title=SELECTION_TITLE,
        simulated=True,
        seed=request.seed,
        scale=request.scale,
        answer=(f"Simulated: {covers} or fewer, {trial.cpu_s / 60:.0f} CPU min.",),
        claims=tuple(q.claim(trial.pattern_cpu_s, trial.realisations) for q in trial.questions),
        headlines=error_headlines(selection.entries, trial.errors),
        tables=error_tables(selection.entries, trial.errors, trial.questions, covers),
        figures=(error_chart(selection.entries, trial.errors, covers),),
        notes=(
            *SELECTION_NOTES,
            *trial.losses,
            _bench_note(selection),
            modulus_remark(specimen.modulus_mpa),
        ),
        left_out=SELECTION_LEFT_OUT if rig.lens else (*SELECTION_LEFT_OUT, NO_LENS),
        extra={
            "part": part._asdict(), "errors_mm": trial.finite_errors, "cpu_min": trial.cpu_s / 60,
        },
        settings={
            "path": part.words,
            "step between frames": f"{part.longest_step_mm:.3f} mm at most",
            "tracker": f"{FlowTracker.PAPER}: as published by the paper's group",
            "CPU time": f"{trial.cpu_s / 60:.1f} min for all jobs, {trial.spent_s / 60:.1f} in "
            "this call, without the gel",
            "gel": f"{specimen.gel_model}, {specimen.modulus_mpa:g} MPa, friction "
            f"{specimen.friction:g}",
            "printer": f"{printer.dpi} dpi, {printer.levels} levels, spread {printer.spread_um:g} "
            f"um, misregistration {printer.misregistration_um:g} um",
            "camera": "; ".join(f"{k} {v}" for k, v in vars(rig.camera).items()),
            **flag_setting(trial.gels, "presses"),
        },
    )  # fmt: skip


class SelectionTrial:
    """Trial that adds realisations until its questions are decided or the CPU time is used up.

    errors: by pattern and realisation, mm. spent_s: CPU time of this call's jobs, cpu_s of all.
    """

    def __init__(self, selection: Selection, request: StudyRequest, budget_s: float) -> None:
        self.selection, self.request, self.budget_s = selection, request, budget_s
        self.questions: list[Question] = paper_questions(selection.entries)
        self.errors: dict[str, dict[int, float]] = {e.name: {} for e in selection.entries}
        self.realisations, self.spent_s, self.cpu_s = 0, 0.0, 0.0
        self.losses: list[str] = []
        self.gels: list[dict[str, object]] = []
        self._declared_s = 0.0

    def run(self) -> None:
        """Run until decided or out of CPU time; patterns without a question have one look."""
        names = [entry.name for entry in self.selection.entries]
        while names:
            seeds = range(self.realisations, next_look(self.realisations))
            for group in seed_groups([self.request.seed + k for k in seeds], len(names)):
                if not self._add_realisations(names, group):
                    return
            for question in self.questions:
                question.look(self.errors)
            needed = set().union(*(question.patterns for question in self.questions))
            names = [name for name in names if name in needed]

    @property
    def finite_errors(self) -> dict[str, dict[int, float | None]]:
        """Errors as plain data, None where a pattern cannot be tracked."""
        return {name: {seed: e if math.isfinite(e) else None for seed, e in by_seed.items()}
                for name, by_seed in self.errors.items()}  # fmt: skip

    @property
    def pattern_cpu_s(self) -> float:
        """Measured CPU time of a realisation of one pattern."""
        return self.cpu_s / max(1, sum(map(len, self.errors.values())))

    def _add_realisations(self, names: Sequence[str], seeds: tuple[int, ...]) -> bool:
        """Track a group of realisations; False if CPU time or a job is missing."""
        jobs = self.selection.jobs(seeds, names)
        # Declared costs are scaled by what the jobs so far took.
        pace = self.cpu_s / self._declared_s if self._declared_s else 1.0
        left_s, affordable = self.budget_s - self.spent_s, []
        for job in jobs:
            price_s = 0.0 if job.is_stored else pace * job.cost
            if price_s <= left_s:
                affordable.append(job)
                left_s -= price_s
        grid = self.request.solve(affordable)
        self.spent_s += grid.new_cpu_s
        self.cpu_s += grid.cpu_s
        self._declared_s += sum(job.cost for job in affordable if job.name in grid.results)
        if len(grid.results) < len(jobs):
            return False
        self.realisations += len(seeds)
        results = [grid[job.name] for job in jobs]
        for name, seed, error_mm in press_means(results, AT_DOTS):
            self.errors[name][seed] = error_mm
        self.losses += [line for result in results for line in result["refused"]]
        self.gels = self.gels or [{"flags": result["flags"]} for result in results]
        return True


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
"""By hand: 136 of 3600 frames per indenter, and all depths and axes."""


@dataclass(frozen=True)
class Selection:
    """Scene of one study: presses and patterns. name: of its protocol."""

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
        series = {entry.name: entry for entry in list_series()}
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

    def jobs(self, seeds: tuple[int, ...], names: Sequence[str]) -> list[GridJob]:
        """Jobs of some realisations, one per press."""
        recipes = {entry.name: entry.recipe for entry in self.entries if entry.name in names}
        cost = cost_s(self.part.frames_an_indenter // self.part.positions, len(names) * len(seeds))
        words = f"seeds {seeds[0]} to {seeds[-1]}, {len(names)} patterns"
        return [
            replace(self.scene, seed=0).job(
                f"{press}, {words}", self.name, press, track_press, TrackingJob, cost,
                patterns=recipes, seeds=seeds, method=FlowTracker.PAPER,
            )
            for press in self.scene.presses(self.name)
        ]  # fmt: skip


def _select_names(option: str, requested: list[str], choices: list[str]) -> list[str]:
    """Return the requested choices in order, all if none. Raises InputError."""
    for name in requested:
        if name not in choices:
            raise InputError(f"{option}: {name!r}: unknown; {did_you_mean(name, choices)}")
    return [name for name in choices if not requested or name in requested]
