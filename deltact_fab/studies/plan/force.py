"""Plan of a force calibration: presses to fit and to validate, and what they will reach."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Any

import numpy as np

from deltact_fab.common import Array, Progress

from .candidates import (
    QUADRANT_SIGNS,
    VALIDATION_PLACES,
    Candidate,
    solve_features,
    spread_candidates,
)
from .exchange import Exchange, force_regressors
from .pilot import SECONDS_PER_HOUR, Pilot
from .planner import PlanDesign, PlanGoal, Planner
from .prediction import PlannedStops, drift_share, predict_errors, validation_presses

VALIDATION_RATIO = 5 / 3  # by hand: of the upper limit of a validated error, over the error
REPLICATED_EVERY = 8  # by hand: a repeat per eight presses
_COMPONENT_UNITS = {"repeat": "N", "drift": "% per h"}


class ForcePlanner(Planner):
    """Planner of a force calibration, to an rms error of the normal force where none was pressed.

    Solves the candidates when it is built.
    """

    measure, title = "normal force", "normal force, place unseen"

    def __init__(self, goal: PlanGoal, pilot: Pilot, progress: Progress | None = None) -> None:
        super().__init__(goal, pilot)
        self.candidates, spares = spread_candidates(
            self.gel, self.tips, goal.range_n, self.view, goal.seed
        )
        self.validation = _spread_validation(
            spares, validation_presses(VALIDATION_RATIO), goal.seed
        )
        self._rows, self._prior_mm2 = force_regressors(
            solve_features(self.gel, [*self.candidates, *self.validation], progress)
        )

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

    def design(self, count: int) -> PlanDesign:
        """Design a plan with a number of presses to fit, and predict its error."""
        # All presses take about the same time.
        like = self._protocol(self._presses({0: count + count // REPLICATED_EVERY}))
        rng = np.random.default_rng([self.goal.seed, count])
        hours = self.estimate(like).seconds / SECONDS_PER_HOUR
        chosen = self.exchange(hours).design(count, rng)
        fit = Counter(chosen)
        for index in rng.permutation(sorted(fit))[: count // REPLICATED_EVERY].tolist():
            fit[index] += 1
        protocol = self._protocol(self._presses(fit))
        estimate = self.estimate(protocol)
        prediction = predict_errors(
            self._stops([*fit.elements()]),
            self._stops(range(len(self.candidates), len(self._rows))),
            self.pilot.components, self._prior_mm2, estimate.seconds / SECONDS_PER_HOUR,
            self.goal.seed,
        )  # fmt: skip
        counts = {"to fit": fit.total(), "only to validate": len(self.validation)}
        return PlanDesign(counts, prediction, protocol, estimate)

    def _stops(self, indices: Sequence[int]) -> PlannedStops:
        places, tips, _ = self._codes
        normal = self._rows[list(indices)][:, :, -1]
        return PlannedStops(-normal, places[list(indices)], tips[list(indices)])

    def _presses(self, fit: Mapping[int, int]) -> list[dict[str, Any]]:
        """Presses of candidates to fit, with their repeats, and those to validate."""
        presses = [
            self.candidates[k].mirrored(turn).as_dict() | ({"repeats": n} if n > 1 else {})
            for turn, (k, n) in enumerate(fit.items())
        ]
        return presses + [press.as_dict() | {"role": "validate"} for press in self.validation]

    def component_line(self, name: str, unit: str = "%") -> str:
        return super().component_line(name, _COMPONENT_UNITS.get(name, unit))

    def details(self, design: PlanDesign) -> list[str]:
        lines = ["other tips: not predicted by presses of one tip"]
        return lines if len(self.tips) == 1 else []


def _spread_validation(spares: Sequence[Candidate], count: int, seed: int) -> list[Candidate]:
    """Choose presses to validate: a place each, tips and levels in turn, in any quadrant."""
    quadrants = np.random.default_rng([seed, len(spares)]).integers(len(QUADRANT_SIGNS), size=count)
    step = len(spares) // VALIDATION_PLACES
    places = range(min(count, VALIDATION_PLACES))
    return [spares[k * step + k % step].mirrored(int(quadrants[k])) for k in places]
