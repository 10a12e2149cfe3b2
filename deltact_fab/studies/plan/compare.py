"""Plan of a comparison of two patterns over several sensors, and what difference it will find.

Both sides get the same presses. The figure of a sensor deviates by its own spread and by that of
its presses about those of the other sensors, sensor^2 + press^2 / presses; Welch's test of the two
sides then finds a difference with the power of `analyze compare`, averaged over what is not certain
of the spread.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import ClassVar

import numpy as np

from deltact_fab.common import Array
from deltact_fab.estimate import Comparison, UnitDifference

from .mean import MeanPlanner
from .pilot import Pilot
from .planner import PlanDesign, PlanGoal, format_size
from .prediction import ErrorPrediction

CHANCE_GAIN = 0.02  # by hand: of the chance; more presses that gain less change nothing
MAX_SENSOR_PRESSES = 24  # by hand: half an hour for each sensor
SIDE_SIZES = (3, 5, 7, 10, 14, 20, 28, 40, 56, 80)  # by hand: sensors a side, for the report
_SPREAD_QUANTILES = 64  # by hand: a chance is then within 0.002 of that by all draws


@dataclass(frozen=True)
class DifferencePrediction(ErrorPrediction):
    """Differences that each draw of the spread finds with Comparison.MIN_CHANCE.

    power: chance to find a difference, over all draws.
    """

    power: Callable[[float], float]

    def chance(self, goal: float) -> float:
        return self.power(goal)

    def reached(self, chance: float = Comparison.MIN_CHANCE) -> float:
        from scipy.optimize import brentq

        low, high = self.figures[0] / 2, 10 * self.figures[-1]
        return float(brentq(lambda goal: self.power(goal) - chance, low, high, xtol=1e-4 * low))


class ComparePlanner(MeanPlanner):
    """Planner of a comparison, to the chance to find a difference.

    sensors: a side; None for the fewest that are sure enough. presses: on each; None for as many as
    matter.
    """

    sure_chance = Comparison.MIN_CHANCE
    groups: ClassVar[tuple[str, ...]] = ("press", "sensor")

    def __init__(
        self, goal: PlanGoal, pilot: Pilot, quantity: str, sensors: int | None = None,
        presses: int | None = None,
    ) -> None:  # fmt: skip
        super().__init__(goal, pilot, quantity)
        self.measure = f"difference of {quantity}"
        self.title = f"{self.measure} that is found with chance {self.sure_chance:g}"
        self._presses = presses
        self.enough = self._enough_sensors()
        self.sensors = sensors or self.enough

    def spreads(self, presses: float) -> Array:
        """Draws of the spread between sensors of so many presses, on the scale of the goal."""
        shares = np.sqrt(self.draws["sensor"] ** 2 + self.draws["press"] ** 2 / presses)
        return shares if self.relative else shares * self._levels

    def chance(self, sensors: int, presses: float, goal: float | None = None) -> float:
        """Chance to find the goal's difference, or another."""
        size = self.goal.size if goal is None else goal
        effect = math.log1p(size / 100) if self.relative else size
        middles = (np.arange(_SPREAD_QUANTILES) + 0.5) / _SPREAD_QUANTILES
        chances = [
            Comparison.chance(effect, float(spread), sensors, paired=False)
            for spread in np.quantile(self.spreads(presses), middles)
        ]
        return float(np.mean(chances))

    def enough_presses(self, sensors: int) -> int:
        """Number of presses a sensor above which the chance gains less than CHANCE_GAIN."""
        target = self.chance(sensors, math.inf) - CHANCE_GAIN
        numbers = range(1, MAX_SENSOR_PRESSES)
        return 1 + bisect_left(numbers, target, key=lambda n: self.chance(sensors, n))

    def _enough_sensors(self) -> int:
        """Fewest sensors a side that are sure enough, at most UnitDifference.LIMIT."""
        return 2 + bisect_left(
            range(2, UnitDifference.LIMIT), self.sure_chance,
            key=lambda n: self.chance(n, self._presses or self.enough_presses(n)),
        )  # fmt: skip

    def plan(self) -> tuple[PlanDesign, None]:
        presses = self._presses or self.enough_presses(self.sensors)
        for places in range(math.ceil(presses / len(self.tips)), 0, -1):
            design = self.design(places)
            if design.estimate.seconds <= self.goal.time_s:
                return design, None
        raise self.refuse_time(design)

    def predict(self, count: int) -> DifferencePrediction:
        """Predict the difference that sensors with presses at so many places find."""
        from scipy.optimize import brentq

        def excess(ratio: float) -> float:
            return Comparison.chance(ratio, 1.0, self.sensors, paired=False) - self.sure_chance

        presses = count * len(self.tips)
        sizes = brentq(excess, 0.0, 100.0) * np.sort(self.spreads(presses))
        figures = 100 * np.expm1(sizes) if self.relative else sizes
        return DifferencePrediction(figures, partial(self.chance, self.sensors, presses))

    def basis(self) -> list[str]:
        return [f"{self.sensors} sensors a side, each with its own print and gel", *super().basis()]

    def details(self, design: PlanDesign) -> list[str]:
        presses, enough = sum(design.counts.values()), self.enough_presses(self.sensors)
        sizes = [size for size in SIDE_SIZES if size < self.enough]
        chances = [f"{n}: {self.chance(n, presses):.2f}"
                   for n in sorted({*sizes, self.sensors, self.enough})]  # fmt: skip
        endless = self.chance(self.sensors, math.inf)
        return [
            f"chance to find {self.goal} by sensors a side: {', '.join(chances)}",
            f"more than {enough} presses a sensor change nothing ({endless:.2f})",
        ]

    def nearest(self, design: PlanDesign, longer: PlanDesign | None) -> str:
        goal, size = self.goal, design.prediction.reached()
        return (
            f"goal {goal}: not with chance {self.sure_chance:g} by {self.sensors} sensors a side; "
            f"{format_size(size)} {goal.unit} is, or {goal} by {self.enough}"
        )
