"""Plan of a mean error over the face, and what its interval will be.

The figure of a press is the mean error of its frames, as `analyze compare` takes it. Places are the
units: every tip presses once at each, the tips being fixed, and the half width of the mean's 95 %
interval over n places is Student's,

    h = t(n - 1) s / sqrt(n),    s^2 ~ (place^2 + repeat^2 / tips) chi^2(n - 1) / (n - 1).

Depths differ between places, so their effect counts as one of place. In % the figures are taken by
their logarithms: the mean is then the geometric one.
"""

from __future__ import annotations

from functools import cached_property
from typing import ClassVar

import numpy as np

from deltact_fab.common import Array, InputError

from .candidates import DEPTH_LEVELS, Candidate, spread_candidates
from .components import COMPONENT_DRAWS, PRIOR_FACTOR
from .pilot import Pilot
from .planner import PRESS_COUNTS, PlanDesign, PlanGoal, Planner
from .prediction import ErrorPrediction

ASSUMED_FIGURES = {
    "tracking": {"figure": 0.00082, "repeat": 0.028, "place": 0.17, "tip": 0.032, "press": 0.07,
                 "sensor": 0.094},
    "depth": {"figure": 0.097, "repeat": 0.049, "place": 0.25, "tip": 0.32, "press": 0.048,
              "sensor": 0.1},
    "noise": {"figure": 7.6e-5, "press": 0.025, "sensor": 0.062},
    "force": {"figure": 0.031, "press": 0.54, "sensor": 0.44},
    "time": {"figure": 50.0, "press": 0.05, "sensor": 0.02},
}  # fmt: skip
"""Mean of a press in the measure's unit; spreads of logarithms. Measured on simulated sensors,
`benchmarks/plan_spreads.py`; time by hand, as it is the machine's."""
INTERVAL_TAIL = 0.975  # definition: of a 95 % interval


class MeanPlanner(Planner):
    """Planner of the mean error of tracking or depth, to the half width of its interval."""

    groups: ClassVar[tuple[str, ...]] = ("repeat", "place", "tip")

    def __init__(self, goal: PlanGoal, pilot: Pilot, quantity: str) -> None:
        super().__init__(goal, pilot)
        self.quantity, self.measure = quantity, f"mean {quantity} error"
        self.title = f"{self.measure}, half of its interval"
        if quantity == "depth" and not self.request.rig.simulated:
            raise InputError(
                f"--rig {goal.rig}: no truth of the depth; a virtual rig has it, and "
                "`plan tracking` needs dots alone"
            )
        parts = spread_candidates(
            self.gel, self.tips, goal.range_n, self.view, goal.seed, max(PRESS_COUNTS)
        )
        self.candidates = [*parts[0], *parts[1]]

    def design(self, count: int) -> PlanDesign:
        """Design a plan with a number of places."""
        presses = [press.as_dict() for press in self.presses[: count * len(self.tips)]]
        protocol, counts = self._protocol(presses), {f"presses at {count} places": len(presses)}
        return PlanDesign(counts, self.predict(count), protocol, self.estimate(protocol))

    @cached_property
    def presses(self) -> list[Candidate]:
        """Presses, place by place: one by each tip, at a level and in a quadrant of the place."""
        rng, step = np.random.default_rng(self.goal.seed), len(DEPTH_LEVELS)
        size = len(self.tips) * step
        blocks = np.tile(np.arange(step), (len(self.candidates) // size // step, 1))
        levels, quadrants = (rng.permuted(blocks, axis=1).ravel().tolist() for _ in range(2))
        return [
            self.candidates[place * size + tip * step + level].mirrored(quadrant)
            for place, (level, quadrant) in enumerate(zip(levels, quadrants, strict=True))
            for tip in range(len(self.tips))
        ]

    @property
    def relative(self) -> bool:
        """True for a goal in %."""
        return self.goal.unit == "%"

    @cached_property
    def draws(self) -> dict[str, Array]:
        """Draws of the components, by name, as shares of the figure."""
        return dict(zip(self.pilot.components.basis, self.pilot.components.draws.T, strict=True))

    def sizes(self, shares: Array) -> Array:
        """Convert shares of the mean figure, or differences of logarithms, to the goal's unit."""
        return 100 * np.expm1(shares) if self.relative else shares * self._levels

    @cached_property
    def _levels(self) -> Array:
        """Draws of the mean figure."""
        if self.pilot.figure is not None:
            return np.full(COMPONENT_DRAWS, self.pilot.figure)
        normal = np.random.default_rng([self.goal.seed, 0]).standard_normal(COMPONENT_DRAWS)
        return np.asarray(ASSUMED_FIGURES[self.quantity]["figure"] * PRIOR_FACTOR**normal)

    def predict(self, count: int) -> ErrorPrediction:
        """Predict half widths of the interval over a number of places."""
        from scipy.special import stdtrit

        free = count - 1
        variance = self.draws["place"] ** 2 + self.draws["repeat"] ** 2 / len(self.tips)
        chi2 = np.random.default_rng([self.goal.seed, count]).chisquare(free, COMPONENT_DRAWS)
        reach = stdtrit(free, INTERVAL_TAIL) * np.sqrt(variance * chi2 / free / count)
        return ErrorPrediction(np.sort(self.sizes(reach)))

    def basis(self) -> list[str]:
        lines = [self.component_line(name) for name in self.draws if name != "tip"]
        if not self.relative:
            source = "assumed" if self.pilot.figure is None else "pilot"
            lines.append(f"mean {np.median(self._levels):.2g} {self.goal.unit}: {source}")
        return lines

    def details(self, design: PlanDesign) -> list[str]:
        return [f"tips not pressed differ: {self.component_line('tip')}"]
