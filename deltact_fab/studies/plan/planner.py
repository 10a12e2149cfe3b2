"""Planner of presses for a goal: what the plans of all kinds share.

The number of presses is the smallest that meets the goal with SURE_CHANCE within the time, or, if
none does, the smallest that comes within WORSE_FACTOR of the best that the time allows.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from deltact_fab.bench import Protocol, RunEstimate
from deltact_fab.common import Check, InputError, format_duration, toml_literal, toml_text, validate
from deltact_fab.sensor import GelMaterial
from deltact_fab.simulate import RunRequest

from .candidates import Candidate, GelFeatures
from .pilot import Pilot, settle_time_s
from .prediction import SURE_CHANCE, ErrorPrediction

DEFAULT_TIPS = ("sphere:10", "sphere:15", "sphere:22")  # of `force-calibration-small`
REFERENCE_EVERY = 8  # by hand: a reference per eight presses
PRESS_COUNTS = (4, 6, 8, 10, 12, 16, 20, 24, 32, 40, 48, 64, 80, 96, 128)
"""Numbers of presses, or of places, that are tried; by hand: neighbours differ less than the
chance's noise."""
WORSE_FACTOR = 1.03  # by hand: of the error, for which more presses are not worth their time
PRESS_FEED_MM_S, FRAME_RATE_HZ = 0.5, 3.0
"""Definition: the default feeds of [motion]; the tip then moves 0.25 mm at most between frames."""


@dataclass(frozen=True)
class PlanGoal:
    """Goal of a plan.

    name: of the protocol. range_n: largest normal force. size, unit: of the figure to reach.
    time_s: longest run. tips: empty for those of the pilot, else DEFAULT_TIPS. specimen: keys of a
    protocol's [specimen] that are set. unattended: with one tip only.
    """

    name: str
    rig: str
    range_n: float
    size: float
    unit: str
    time_s: float
    tips: tuple[str, ...] = ()
    specimen: dict[str, Any] = field(default_factory=dict)
    unattended: bool = False
    seed: int = 0

    def __str__(self) -> str:
        return f"{self.size:g} {self.unit}"


@dataclass(frozen=True)
class PlanDesign:
    """Presses of a plan, without references: their prediction, protocol and cost.

    counts: numbers by their noun.
    """

    counts: dict[str, int]
    prediction: ErrorPrediction
    protocol: Protocol
    estimate: RunEstimate


class Planner(ABC):
    """Planner of one kind of goal.

    measure: of the promise. title: of the predicted figure. candidates: presses to choose from.
    sure_chance: of meeting a goal, below which the report names the nearest.
    Raises InputError for a goal that contradicts the pilot, or that no press on this face serves.
    """

    measure: str
    title: str
    candidates: Sequence[Candidate]
    sure_chance = SURE_CHANCE
    sensors = 0  # a side, of a comparison

    def __init__(self, goal: PlanGoal, pilot: Pilot) -> None:
        self.goal, self.pilot = goal, pilot
        self.specimen = _merge_specimen(goal.specimen, pilot.specimen)
        tips = goal.tips or pilot.tips or DEFAULT_TIPS
        self.tips = tips[:1] if goal.unattended and not goal.tips else tips
        if goal.unattended and len(self.tips) > 1:
            raise InputError(f"--tip: {', '.join(tips)}; --unattended needs one, nobody changes it")
        first = {"name": goal.name, "specimen": self.specimen} | _FIRST_PRESS
        self.request = self._request(validate(Protocol, first, goal.name))
        if self.request.view is None:
            raise InputError(f"{self.request.rig_path}: no camera; a plan needs images")
        self.view, material = self.request.view, self.request.protocol.specimen
        self.gel = GelFeatures(
            self.request.design.skin,
            GelMaterial(pilot.modulus_mpa or material.modulus_mpa, material.poisson,
                        material.friction),
            material.depth_margin_mm,
        )  # fmt: skip

    @abstractmethod
    def design(self, count: int) -> PlanDesign:
        """Design a plan with a number of presses or places, and predict its figure."""

    def plan(self) -> tuple[PlanDesign, PlanDesign | None]:
        """Choose the number of presses; also the smallest plan that is too long but meets the goal.

        Raises InputError for a time that no plan keeps to.
        """
        designs: list[PlanDesign] = []
        for count in PRESS_COUNTS:
            design = self.design(count)
            meets = design.prediction.chance(self.goal.size) >= self.sure_chance
            if design.estimate.seconds > self.goal.time_s:
                if not designs:
                    raise self.refuse_time(design)
                if meets:
                    return _choose_best(designs), design
                continue
            if meets:
                return design, None
            designs.append(design)
        return _choose_best(designs), None

    def refuse_time(self, design: PlanDesign) -> InputError:
        """Return the error of a time that is too short for the smallest design."""
        return InputError(
            f"--time {format_duration(self.goal.time_s)}: the smallest plan, "
            f"{format_counts(design.counts)}, takes {format_duration(design.estimate.seconds)}"
        )

    @cached_property
    def largest_force_n(self) -> float:
        """Largest normal force of the candidates, in the middle of the face."""
        deepest = {
            p.indenter: p.depth_mm for p in sorted(self.candidates, key=lambda p: p.depth_mm)
        }
        return max(
            -float(self.gel.wrenches(tip, [(0.0, 0.0, 0.0), (0.0, 0.0, -depth_mm)])[0, 2])
            for tip, depth_mm in deepest.items()
        )

    @cached_property
    def settle_s(self) -> dict[str, float]:
        """Waits before the frames at rest, at a depth, and at the end of a drag."""
        prony = self.relaxation[0]
        depth_mm = max(press.depth_mm for press in self.candidates)
        drag_mm = max(float(np.hypot(*press.drag_mm)) for press in self.candidates)
        ramps_s = {"press": depth_mm / PRESS_FEED_MM_S, "shear": drag_mm / PRESS_FEED_MM_S}
        waits = {kind: settle_time_s(prony, max(s, 1e-3)) for kind, s in ramps_s.items()}
        return {"rest": settle_time_s((), 1.0), **waits}

    @property
    def relaxation(self) -> tuple[Sequence[tuple[float, float]], str]:
        """Prony series of the gel, and its source."""
        if self.pilot.prony is not None:
            return self.pilot.prony, "pilot"
        prony = self.specimen.get("prony") or ()
        return prony, "the specimen's prony" if prony else "assumed: a gel that does not creep"

    def _protocol(self, presses: Sequence[Mapping[str, Any]]) -> Protocol:
        """Return the protocol of presses, without a promise."""
        depth_mm = max(press.depth_mm for press in self.candidates)
        return validate(Protocol, {
            "name": self.goal.name,
            "description": f"{self.measure} to {self.goal.range_n:g} N, by protocol plan.",
            "channels": ["image", "force", "shear"],
            "order": "random",
            "order_seed": self.goal.seed,
            "press": sorted(presses, key=lambda press: self.tips.index(press["indenter"])),
            "reference": {"every": REFERENCE_EVERY, "depth_mm": round(depth_mm / 2, 2)},
            "capture": {"rate_hz": FRAME_RATE_HZ, "settle_s": self.settle_s},
            "specimen": self.specimen,
        }, self.goal.name)  # fmt: skip

    def _request(self, protocol: Protocol) -> RunRequest:
        """Request a run of a protocol that is not written yet."""
        with TemporaryDirectory() as folder:
            file = Path(folder, f"{self.goal.name}.toml")
            file.write_text(protocol_text(protocol), encoding="utf-8")
            return RunRequest(str(file), self.goal.rig, unattended=self.goal.unattended)

    def estimate(self, protocol: Protocol) -> RunEstimate:
        """Estimate duration and disk of a protocol."""
        return self._request(protocol).estimate()

    def checks(self, design: PlanDesign) -> list[Check]:
        """Return the rows of `protocol check` for a design."""
        return self._request(design.protocol).checks()

    def promised(self, design: PlanDesign) -> Protocol:
        """Return the protocol of a design, with its promise."""
        prediction, goal = design.prediction, self.goal
        low, high = prediction.interval
        promise = {
            "measure": self.measure, "unit": goal.unit, "goal": goal.size,
            "error": round(prediction.error, 6), "interval": [round(low, 6), round(high, 6)],
            "chance": round(prediction.chance(goal.size), 3), "seed": goal.seed,
            "rests_on": self.basis(), "digest": design.protocol.digest, "sensors": self.sensors,
        }  # fmt: skip
        data = design.protocol.model_dump(mode="json", exclude_unset=True) | {"promise": promise}
        return validate(Protocol, data, goal.name)

    def redesign(self, design: PlanDesign, name: str, pattern: str) -> PlanDesign:
        """Return the same presses on a sensor of another pattern, as a protocol of another name."""
        data = design.protocol.model_dump(mode="json", exclude_unset=True)
        data |= {"name": name, "specimen": data["specimen"] | {"pattern": pattern}}
        return replace(design, protocol=validate(Protocol, data, name))

    def basis(self) -> list[str]:
        """Return each error component with its source."""
        return [self.component_line(name) for name in self.pilot.components.basis]

    def component_line(self, name: str, unit: str = "%") -> str:
        """Format a component: its interval and source."""
        factor = 100 if unit.startswith("%") else 1
        sizes = [factor * size for size in self.pilot.components.interval(name)]
        middle, low, high = map(format_size, sizes)
        return f"{name} {middle} {unit} [{low} to {high}]: {self.pilot.components.basis[name]}"

    def details(self, design: PlanDesign) -> list[str]:
        """Return the lines of a report that only this kind of plan has."""
        return []

    def nearest(self, design: PlanDesign, longer: PlanDesign | None) -> str:
        """Return the nearest goal that can be met, and the time that the goal takes."""
        goal, prediction = self.goal, design.prediction
        text = (
            f"goal {goal}: not with chance {self.sure_chance:g} within "
            f"{format_duration(goal.time_s)}; {format_size(prediction.reached())} {goal.unit} is"
        )
        if longer is not None:
            return f"{text}, or {goal} in {format_duration(longer.estimate.seconds)}"
        text += "; more presses change little"
        if prediction.error <= goal.size:
            text += ", a pilot of more places and presses decides"
        return text


_FIRST_PRESS = {
    "press": [{"indenter": "sphere:10", "depth_mm": 0.5}],
    "channels": ["image", "force"],
    "capture": {"settle_s": 1.0},
}  # by hand: a protocol that is not written, for the files that the goal names


def format_size(size: float) -> str:
    """Format a figure with two digits, without an exponent from a hundred on."""
    return f"{size:.2g}" if size < 100 else f"{size:.0f}"


def format_counts(counts: Mapping[str, int]) -> str:
    """Format numbers with their nouns."""
    return ", ".join(f"{count} {noun}" for noun, count in counts.items())


def _choose_best(designs: Sequence[PlanDesign]) -> PlanDesign:
    """Return the smallest design that is nearly as good as the best."""
    smallest = min(design.prediction.reached() for design in designs)
    return next(d for d in designs if d.prediction.reached() <= WORSE_FACTOR * smallest)


def _merge_specimen(stated: dict[str, Any], recorded: dict[str, Any]) -> dict[str, Any]:
    """Merge the keys of a specimen with those of the pilot's. Raises InputError if they differ."""
    for key, value in stated.items():
        if recorded.get(key) not in (None, value):
            raise InputError(
                f"--{key}: {value!r}; the pilot's is {recorded[key]!r}: plan with a pilot of the "
                "same sensor, or without one"
            )
    return {key: value for key, value in {**recorded, **stated}.items() if value is not None}


def protocol_text(protocol: Protocol, about: Sequence[str] = ()) -> str:
    """Return the text of a protocol's file, a press per line."""
    data = protocol.model_dump(mode="json", exclude_unset=True)
    presses = data.pop("press", [])
    top = {key: value for key, value in data.items() if not isinstance(value, dict)}
    tables = {key: value for key, value in data.items() if isinstance(value, dict)}
    lines = "".join(f"    {toml_literal(press)},\n" for press in presses)
    return f"{toml_text(top, about)}press = [\n{lines}]\n\n{toml_text(tables)}"
