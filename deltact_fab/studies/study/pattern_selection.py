"""`study run pattern-selection`: which of the paper's 17 patterns is tracked best, as a comparison.

All patterns are pressed by the same presses of 5 indenters, whose gel is solved once; the frames of
a press are drawn and tracked as a stream (`stream`) by the published tracker. Realisations are
added until the questions are decided, for patterns that a question still needs, or until the CPU
time is used up; the same command then goes on from the stored jobs.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

from deltact_fab.bench import Protocol, RunEstimate, load_protocol
from deltact_fab.common import InputError, Note, did_you_mean
from deltact_fab.estimate import FlowTracker
from deltact_fab.fabricate import SeriesEntry, list_series
from deltact_fab.present import Claim, StudyResult
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
from .scene import PressScene, describe_bench, flag_setting

SELECTION_STUDY = "pattern-selection"
SELECTION_SHEAR_MM = 0.949
"""By hand: five steps between frames, of 10 mm; one position has 136 of the paper's 3600 frames."""
SELECTION_CPU_MIN = 120.0  # by hand: an hour on two cores
SELECTION_NOTES = (
    "The paper stacks its indenters' errors and calls the result the average error: if that is a "
    "sum of five, its mean errors are a fifth.",
    "A realisation is another seed of pattern, print and noise, shared by all patterns; intervals "
    "are over realisations, of one gel and these presses.",
    "The paper does not give its gel, the indenters' sizes, its positions, or the threshold for "
    "renewing the reference: 18 grey levels in the program that its group has published.",
)
SELECTION_LEFT_OUT = (
    Note("images and records", "rendered and tracked as a stream, not stored"),
    Note("the paper's full path", "4 positions and drags of 10 mm: --protocol pattern-selection"),
)


def run(request: StudyRequest) -> StudyResult:
    """Run the study. `request.options`: names in "pattern" and "indenter" restrict it.

    Raises InputError for unknown names or CPU minutes, RunFailed if every job failed.
    """
    minutes = request.options.get("cpu_minutes")
    minutes = SELECTION_CPU_MIN if minutes is None else minutes
    if not 0 < minutes < math.inf:  # NaN fails too
        raise InputError(f"--cpu-minutes: {minutes:g}; expected a finite number above 0")
    selection = Selection.from_request(request)
    selection.scene.solve_gels(request)
    trial = SelectionTrial(selection, request, 60 * minutes)
    trial.run()
    entries, specimen = selection.entries, selection.protocol.specimen
    covers = f"{trial.realisations} realisations of {len(entries)} patterns, {selection.words}"
    return StudyResult(
        study=SELECTION_STUDY,
        title="Which pattern is tracked best",
        simulated=True,
        seed=request.seed,
        scale=None,
        answer=(f"{trial.realisations} realisations, {trial.cpu_s / 60:.0f} CPU min.",),
        claims=trial.claims,
        headlines=error_headlines(entries, trial.errors),
        tables=error_tables(entries, trial.errors, trial.questions),
        figures=(error_chart(entries, trial.errors, covers),),
        notes=(*SELECTION_NOTES, *trial.losses, modulus_remark(specimen.modulus_mpa)),
        left_out=SELECTION_LEFT_OUT,
        extra={"cpu_min": trial.cpu_s / 60},
        settings={
            "presses": selection.words,
            "tracker": f"{FlowTracker.PAPER}: as published by the paper's group",
            "CPU time": f"{trial.cpu_s / 60:.1f} min for all jobs, {trial.spent_s / 60:.1f} in "
            "this call, without the gel",
            "gel": f"{specimen.gel_model}, {specimen.modulus_mpa:g} MPa, friction "
            f"{specimen.friction:g}",
            **describe_bench(selection.scene.rig, selection.scene.sensor),
            **flag_setting(trial.gels, "presses"),
        },
    )


class SelectionTrial:
    """Trial that adds realisations until its questions are decided or the CPU time is used up.

    errors: by pattern and seed, mm. spent_s: CPU time of this call's jobs, cpu_s of all.
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
    def claims(self) -> tuple[Claim, ...]:
        """Claims with their prices, at the pace so far."""
        return tuple(
            question.claim(
                self._pace * sum(job.cost for job in self._jobs_of(question.patterns)),
                self.realisations,
            )
            for question in self.questions
        )

    def _jobs_of(self, names: Collection[str]) -> list[GridJob]:
        return self.selection.jobs((self.request.seed,), names) if names else []

    @property
    def _pace(self) -> float:
        """CPU time of the jobs so far over their declared costs."""
        return self.cpu_s / self._declared_s if self._declared_s else 1.0

    def _add_realisations(self, names: Sequence[str], seeds: tuple[int, ...]) -> bool:
        """Track a group of realisations; False if CPU time or a job is missing."""
        jobs = self.selection.jobs(seeds, names)
        left_s, affordable = self.budget_s - self.spent_s, []
        for job in jobs:
            price_s = 0.0 if job.is_stored else self._pace * job.cost
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
        for name, seed, error_mm in press_means(results, "mean_at_dots_mm"):
            self.errors[name][seed] = error_mm
        self.losses += [line for result in results for line in result["refused"]]
        self.gels = self.gels or [{"flags": result["flags"]} for result in results]
        return True


@dataclass(frozen=True)
class Selection:
    """Scene of one study: presses and patterns. name: of its protocol."""

    scene: PressScene
    name: str
    entries: tuple[SeriesEntry, ...]

    @classmethod
    def from_request(cls, request: StudyRequest) -> Selection:
        """Build from a request. Raises InputError for a real rig or unknown names."""
        chosen = request.options.get("protocol")
        protocol, source = load_protocol(str(chosen or SELECTION_STUDY))
        if not chosen and protocol.shear is not None:
            shear = protocol.shear.model_copy(update={"amplitude_mm": SELECTION_SHEAR_MM})
            protocol = protocol.narrowed(places_mm=protocol.places_mm[:1])
            protocol = protocol.model_copy(update={"shear": shear})
        indenters = _select_names(
            "--indenter",
            [parse_indenter(name).name for name in request.options.get("indenter") or ()],
            list(protocol.tips),
        )
        series = {entry.name: entry for entry in list_series()}
        names = _select_names("--pattern", list(request.options.get("pattern") or ()), list(series))
        protocol = protocol.narrowed(tips=indenters)
        scene = PressScene.load(request, {protocol.name: (protocol, source)})
        return cls(scene, protocol.name, tuple(series[name] for name in names))

    @property
    def protocol(self) -> Protocol:
        """Protocol of the presses."""
        return self.scene.protocols[self.name]

    @property
    def words(self) -> str:
        """Presses in words."""
        return press_words(self.protocol, self.scene)

    def jobs(self, seeds: tuple[int, ...], names: Collection[str]) -> list[GridJob]:
        """Jobs of some realisations, one per press."""
        recipes = {entry.name: entry.recipe for entry in self.entries if entry.name in names}
        presses = self.scene.presses(self.name)
        cost = cost_s(frames(self.protocol, self.scene) // len(presses), len(names) * len(seeds))
        words = f"seeds {seeds[0]} to {seeds[-1]}, {len(names)} patterns"
        return [
            replace(self.scene, seed=0).job(
                f"{press}, {words}", self.name, press, track_press, TrackingJob, cost,
                patterns=recipes, seeds=seeds, method=FlowTracker.PAPER,
            )
            for press in presses
        ]  # fmt: skip


def frames(protocol: Protocol, scene: PressScene) -> int:
    """Number of frames of a protocol."""
    return RunEstimate.from_protocol(protocol, 0, scene.rig.stage).frames


def press_words(protocol: Protocol, scene: PressScene) -> str:
    """Presses of a protocol in words."""
    shear, count = protocol.shear, len(protocol.places_mm)
    words = f"{len(protocol.tips)} indenters at {count} position{'s' * (count > 1)}, "
    words += f"{' and '.join(f'{depth:g}' for depth in protocol.stops_mm)} mm deep, "
    if shear and shear.amplitude_mm:
        words += f"shear +-{shear.amplitude_mm:g} mm in {' and '.join(shear.axes)}, "
    return f"{words}{frames(protocol, scene)} frames"


def _select_names(option: str, requested: list[str], choices: list[str]) -> list[str]:
    """Return the requested choices in order, all if none. Raises InputError."""
    for name in requested:
        if name not in choices:
            raise InputError(f"{option}: {name!r}: unknown; {did_you_mean(name, choices)}")
    return [name for name in choices if not requested or name in requested]
