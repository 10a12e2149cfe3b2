"""Plan of a force calibration: presses to fit and to validate, and what they will reach.

The number of presses is the smallest that meets the goal with SURE_CHANCE within the time, or, if
none does, the smallest that comes within WORSE_FACTOR of the best that the time allows.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from deltact_fab.bench import Protocol, RunEstimate
from deltact_fab.common import (
    Array,
    Check,
    InputError,
    Progress,
    format_duration,
    toml_literal,
    toml_text,
    validate,
)
from deltact_fab.sensor import GelMaterial
from deltact_fab.simulate import RunRequest

from .candidates import (
    QUADRANT_SIGNS,
    VALIDATION_PLACES,
    Candidate,
    GelFeatures,
    solve_features,
    spread_candidates,
)
from .components import ASSUMED_ERRORS
from .exchange import Exchange, force_regressors
from .pilot import Pilot, settle_time_s
from .prediction import (
    SURE_CHANCE,
    ErrorPrediction,
    PlannedStops,
    drift_share,
    predict_errors,
    validation_presses,
)

DEFAULT_TIPS = ("sphere:10", "sphere:15", "sphere:22")  # of `force-calibration-small`
VALIDATION_RATIO = 5 / 3  # by hand: of the upper limit of a validated error, over the error
REPLICATED_EVERY, REFERENCE_EVERY = 8, 8  # by hand: a repeat, and a reference, per eight presses
FIT_COUNTS = (4, 6, 8, 10, 12, 16, 20, 24, 32, 40, 48, 64, 80, 96, 128)
"""Numbers of presses that are tried; by hand: neighbours differ less than the chance's noise."""
WORSE_FACTOR = 1.03  # by hand: of the error, for which more presses are not worth their time
PRESS_FEED_MM_S, FRAME_RATE_HZ = 0.5, 3.0
"""Definition: the default feeds of [motion]; the tip then moves 0.25 mm at most between frames."""
RANGE_SHARE = 0.9  # by hand: of the range, below which the gel's depth is what limits the force
_SECONDS_PER_HOUR = 3600.0  # definition


@dataclass(frozen=True)
class ForceGoal:
    """Goal of a force calibration.

    range_n: largest normal force. error_n: rms error of the normal force at a place that was not
    pressed. time_s: longest run. tips: empty for those of the pilot, else DEFAULT_TIPS.
    specimen: keys of a protocol's [specimen] that are set. unattended: with one tip only.
    """

    name: str
    rig: str
    range_n: float
    error_n: float
    time_s: float
    tips: tuple[str, ...] = ()
    specimen: dict[str, Any] = field(default_factory=dict)
    unattended: bool = False
    seed: int = 0


@dataclass(frozen=True)
class ForceDesign:
    """Chosen presses: candidates to fit and how often, their prediction, protocol and cost."""

    fit: dict[int, int]
    prediction: ErrorPrediction
    protocol: Protocol
    estimate: RunEstimate

    @property
    def presses(self) -> int:
        """Number of presses to fit, repeats included."""
        return sum(self.fit.values())


class ForcePlanner:
    """Planner of a force calibration; solves the candidates when it is built.

    Raises InputError for a goal that contradicts the pilot, or that no press on this face serves.
    """

    def __init__(self, goal: ForceGoal, pilot: Pilot, progress: Progress | None = None) -> None:
        self.goal, self.pilot = goal, pilot
        self.specimen = _merge_specimen(goal.specimen, pilot.specimen)
        tips = goal.tips or pilot.tips or DEFAULT_TIPS
        self.tips = tips[:1] if goal.unattended and not goal.tips else tips
        if goal.unattended and len(self.tips) > 1:
            raise InputError(f"--tip: {', '.join(tips)}; --unattended needs one, nobody changes it")
        first = {"name": goal.name, "specimen": self.specimen} | _FIRST_PRESS
        request = self._request(validate(Protocol, first, goal.name))
        if request.view is None:
            raise InputError(f"{request.rig_path}: no camera; a force calibration needs images")
        material = request.protocol.specimen
        self.gel = GelFeatures(
            request.design.skin,
            GelMaterial(pilot.modulus_mpa or material.modulus_mpa, material.poisson,
                        material.friction),
            material.depth_margin_mm,
        )  # fmt: skip
        self.candidates, spares = spread_candidates(
            self.gel, self.tips, goal.range_n, request.view, goal.seed
        )
        self.validation = _spread_validation(
            spares, validation_presses(VALIDATION_RATIO), goal.seed
        )
        self._rows, self._prior_mm2 = force_regressors(
            solve_features(self.gel, [*self.candidates, *self.validation], progress)
        )

    @property
    def largest_force_n(self) -> float:
        """Largest normal force of the candidates."""
        return float(-self._rows[..., -1, 0].min())

    @cached_property
    def _codes(self) -> tuple[Array, Array, Array]:
        """Codes of place, tip and level of the candidates and of those to validate."""
        presses = [*self.candidates, *self.validation]
        folded = np.abs([press.at_mm for press in presses])  # mirror images are one place
        places = np.unique(folded, axis=0, return_inverse=True)[1]
        tips = np.array([self.tips.index(press.indenter) for press in presses])
        return places.ravel(), tips, np.array([press.level for press in presses])

    def exchange(self, hours: float) -> Exchange:
        """Return the exchange for a run of so many hours."""
        m = len(self.candidates)
        places, tips, levels = (codes[:m] for codes in self._codes)
        squares = drift_share(self.pilot.components, hours)
        return Exchange(self._rows[:m], places, tips, levels, squares, self._prior_mm2)

    def design(self, count: int) -> ForceDesign:
        """Design a plan with a number of presses to fit, and predict its error."""
        hours = self.seconds(count + count // REPLICATED_EVERY) / _SECONDS_PER_HOUR
        rng = np.random.default_rng([self.goal.seed, count])
        chosen = self.exchange(hours).design(count, rng)
        fit = Counter(chosen)
        for index in rng.permutation(sorted(fit))[: count // REPLICATED_EVERY].tolist():
            fit[index] += 1
        protocol = self._protocol(fit)
        estimate = self._request(protocol).estimate()
        indices = [index for index, n in fit.items() for _ in range(n)]
        prediction = predict_errors(
            self._stops(indices), self._stops(range(len(self.candidates), len(self._rows))),
            self.pilot.components, self._prior_mm2, estimate.seconds / _SECONDS_PER_HOUR,
            self.goal.seed,
        )  # fmt: skip
        return ForceDesign(dict(fit), prediction, protocol, estimate)

    def plan(self) -> tuple[ForceDesign, ForceDesign | None]:
        """Choose the number of presses; also the smallest plan that is too long but meets the goal.

        Raises InputError for a time that no plan keeps to.
        """
        designs: list[ForceDesign] = []
        for count in FIT_COUNTS:
            design = self.design(count)
            meets = design.prediction.chance(self.goal.error_n) >= SURE_CHANCE
            if design.estimate.seconds > self.goal.time_s:
                if not designs:
                    shortest = format_duration(design.estimate.seconds)
                    raise InputError(
                        f"--time {format_duration(self.goal.time_s)}: the smallest plan, {count} "
                        f"presses to fit and {len(self.validation)} to validate, takes {shortest}"
                    )
                if meets:
                    return self._best(designs), design
                continue
            if meets:
                return design, None
            designs.append(design)
        return self._best(designs), None

    @staticmethod
    def _best(designs: Sequence[ForceDesign]) -> ForceDesign:
        """Return the smallest design that is nearly as good as the best."""
        least_n = min(design.prediction.reached_n() for design in designs)
        return next(d for d in designs if d.prediction.reached_n() <= WORSE_FACTOR * least_n)

    def _stops(self, indices: Sequence[int]) -> PlannedStops:
        places, tips, _ = self._codes
        normal = self._rows[list(indices)][:, :, -1]
        return PlannedStops(-normal, places[list(indices)], tips[list(indices)])

    @cached_property
    def settle_s(self) -> dict[str, float]:
        """Waits before the frames at rest, at a depth, and at the end of a drag."""
        prony = self.relaxation[0]
        depth_mm = max((press.depth_mm for press in self.candidates), default=1.0)
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

    def seconds(self, count: int) -> float:
        """Estimated duration of a plan with a number of presses to fit."""
        start_s, per_press_s = self._pace
        return start_s + count * per_press_s

    @cached_property
    def _pace(self) -> tuple[float, float]:
        """Seconds of a plan without presses to fit, and more for each of these."""
        few, many = (dict.fromkeys(range(n), 1) for n in (0, REFERENCE_EVERY))
        a, b = (self._request(self._protocol(fit)).estimate().seconds for fit in (few, many))
        return a, (b - a) / REFERENCE_EVERY

    def _protocol(self, fit: Mapping[int, int]) -> Protocol:
        """Return the protocol of candidates to fit, with their repeats, without a promise."""
        depth_mm = max(press.depth_mm for press in self.candidates)
        presses = [
            self.candidates[k].mirrored(turn).as_dict() | ({"repeats": n} if n > 1 else {})
            for turn, (k, n) in enumerate(fit.items())
        ]
        presses += [press.as_dict() | {"role": "validate"} for press in self.validation]
        presses.sort(key=lambda press: self.tips.index(press["indenter"]))
        return validate(Protocol, {
            "name": self.goal.name,
            "description": f"Force calibration to {self.goal.range_n:g} N, by protocol plan.",
            "channels": ["image", "force", "shear"],
            "order": "random",
            "order_seed": self.goal.seed,
            "press": presses,
            "reference": {"every": REFERENCE_EVERY, "depth_mm": round(depth_mm / 2, 2)},
            "capture": {"rate_hz": FRAME_RATE_HZ, "settle_s": self.settle_s},
            "specimen": self.specimen,
        }, self.goal.name)  # fmt: skip

    def _request(self, protocol: Protocol, out: Path = Path()) -> RunRequest:
        """Request a run of a protocol that is not written yet."""
        with TemporaryDirectory() as folder:
            file = Path(folder, f"{self.goal.name}.toml")
            file.write_text(protocol_text(protocol), encoding="utf-8")
            return RunRequest(str(file), self.goal.rig, out, unattended=self.goal.unattended)

    def checks(self, design: ForceDesign) -> list[Check]:
        """Return the rows of `protocol check` for a design."""
        return self._request(design.protocol).checks()

    def promised(self, design: ForceDesign) -> Protocol:
        """Return the protocol of a design, with its promise."""
        prediction, goal = design.prediction, self.goal
        low, high = prediction.interval_n
        promise = {
            "measure": "normal force", "unit": "N", "goal": goal.error_n,
            "error": round(prediction.error_n, 4), "interval": [round(low, 4), round(high, 4)],
            "chance": round(prediction.chance(goal.error_n), 3), "seed": goal.seed,
            "rests_on": self.basis(), "digest": design.protocol.digest,
        }  # fmt: skip
        data = design.protocol.model_dump(mode="json", exclude_unset=True) | {"promise": promise}
        return validate(Protocol, data, goal.name)

    def basis(self) -> list[str]:
        """Return each error component with its source."""
        lines = []
        for name in ASSUMED_ERRORS:
            value, low, high = self.pilot.components.interval(name)
            unit, factor = (" N", 1) if name == "repeat" else (" %", 100)
            unit += " per h" if name == "drift" else ""
            span = f"{factor * value:.2g}{unit} [{factor * low:.2g} to {factor * high:.2g}]"
            lines.append(f"{name} {span}: {self.pilot.components.basis[name]}")
        return lines


_FIRST_PRESS = {
    "press": [{"indenter": "sphere:10", "depth_mm": 0.5}],
    "channels": ["image", "force"],
    "capture": {"settle_s": 1.0},
}  # by hand: a protocol that is not written, for the files that the goal names


def _spread_validation(spares: Sequence[Candidate], count: int, seed: int) -> list[Candidate]:
    """Choose presses to validate: a place each, tips and levels in turn, in any quadrant."""
    quadrants = np.random.default_rng([seed, len(spares)]).integers(len(QUADRANT_SIGNS), size=count)
    step = len(spares) // VALIDATION_PLACES
    places = range(min(count, VALIDATION_PLACES))
    return [spares[k * step + k % step].mirrored(int(quadrants[k])) for k in places]


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
