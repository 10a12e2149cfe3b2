"""Difference between two sides of an experiment over their units, and equivalence within a margin.

A unit is what is made or mounted anew: a sensor, a print, a batch of gel. Presses on one unit are
repeats of it, and any number of them is one unit (Hurlbert, Ecological Monographs 54, 1984, 187).
Sides without a common unit are compared by Welch's t (Biometrika 34, 1947, 28), sides of the same
units by the differences within each. Sides are equal within a margin if two one-sided tests at 5 %
find so (Schuirmann, J. Pharmacokinetics and Biopharmaceutics 15, 1987, 657; ASTM E2935), which is
if the 90 % interval lies within the margin. Units are taken as independent and normal, for
percentages on the logarithm of their figures.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar, Literal, Self

import numpy as np
from numpy.typing import NDArray

from deltact_fab.common import InputError

DECISION_ERROR_RATE = 0.05
"""Definition: of a decision. A difference has a 95 % interval; of two one-sided tests each is at
5 %, which is a 90 % interval. Repeated decisions share it."""
DECISION_CHANCE = 0.8  # by hand: the usual power of a planned comparison
RATIO_QUANTILES = 64  # by hand: a chance is then exact to 0.001
MAX_UNITS = 1000  # by hand: nobody makes more sensors to compare two kinds

Outcome = Literal["a smaller", "b smaller", "equal", "undecided"]


@dataclass(frozen=True)
class UnitDifference:
    """Mean of side a less that of side b over units.

    relative: on the scale of natural logarithms. standard_error, freedom: of the value, and its
    degrees of freedom. counts: units of each side. paired: the same units on both sides.
    """

    LIMIT: ClassVar = MAX_UNITS

    value: float
    standard_error: float
    freedom: float
    counts: tuple[int, int]
    paired: bool
    relative: bool

    @classmethod
    def from_units(cls, a: Mapping[str, float], b: Mapping[str, float], relative: bool) -> Self:
        """Compare figures by unit. Raises InputError for fewer than two a side, for sides that
        share some units and not all, and for figures that have no logarithm.
        """
        shared = a.keys() & b.keys()
        if shared and (alone := sorted(a.keys() ^ b.keys())):
            raise InputError(
                f"{sorted(shared)[0]} is on both sides and {alone[0]} is not; give all units on "
                "both sides, or none"
            )
        if min(len(a), len(b)) < 2:
            raise InputError(
                f"{len(a)} and {len(b)} units: the spread between units needs two a side"
            )
        if relative and (unfit := [f for f in (*a.values(), *b.values()) if not f > 0]):
            raise InputError(f"a figure of {unfit[0]:g} has no percentage; give a margin in units")
        x, y = (
            np.log([*side.values()]) if relative else np.array([*side.values()]) for side in (a, b)
        )
        if shared:
            y = np.array([math.log(b[unit]) if relative else b[unit] for unit in a])
            n, spread = len(x), float(np.std(x - y, ddof=1))
            return cls(float(np.mean(x - y)), spread / math.sqrt(n), n - 1, (n, n), True, relative)
        parts = [float(np.var(side, ddof=1)) / len(side) for side in (x, y)]
        total = sum(parts)
        weights = sum(p**2 / (len(side) - 1) for p, side in zip(parts, (x, y), strict=True))
        freedom = total**2 / weights if weights else min(len(x), len(y)) - 1
        difference = float(x.mean() - y.mean())
        return cls(difference, math.sqrt(total), freedom, (len(x), len(y)), False, relative)

    @property
    def spread(self) -> float:
        """Standard deviation between units of a side; of the differences of paired ones."""
        n, m = self.counts
        return self.standard_error * math.sqrt(n if self.paired else 1 / (1 / n + 1 / m))

    def interval(self, level: float = 1 - DECISION_ERROR_RATE) -> tuple[float, float]:
        """Interval of the difference by Student's t."""
        from scipy.special import stdtrit

        reach = float(stdtrit(self.freedom, (1 + level) / 2)) * self.standard_error
        return self.value - reach, self.value + reach

    def outcome(self, margin: float) -> Outcome:
        """Decision; a difference counts as one where it is certain, also within the margin."""
        low, high = self.interval()
        if low > 0 or high < 0:
            return "b smaller" if low > 0 else "a smaller"
        return "equal" if self.is_equal(margin) else "undecided"

    def is_equal(self, margin: float, error_rate: float = DECISION_ERROR_RATE) -> bool:
        """True if the two one-sided tests find the sides equal within +- margin."""
        low, high = self.interval(1 - 2 * error_rate)
        return bool(-margin < low and high < margin)

    def units_needed(self, margin: float, error_rate: float = DECISION_ERROR_RATE) -> int | None:
        """Units a side that decide with DECISION_CHANCE, were this difference the true one.

        The fewer of those that find it, and of those that find the sides equal; None above
        MAX_UNITS.
        """

        def enough(n: int) -> bool:
            chances = (
                chance_of_difference(
                    self.value, self.spread, n, paired=self.paired, error_rate=error_rate
                ),
                chance_of_equality(
                    self.value, self.spread, n, margin, paired=self.paired, error_rate=error_rate
                ),
            )
            return max(chances) >= DECISION_CHANCE

        low, high = 1, MAX_UNITS
        if not enough(high):
            return None
        while high - low > 1:
            middle = (low + high) // 2
            low, high = (low, middle) if enough(middle) else (middle, high)
        return high


def chance_of_difference(
    effect: float,
    spread: float,
    units: int,
    *,
    paired: bool,
    error_rate: float = DECISION_ERROR_RATE,
) -> float:
    """Power of the t test for a true difference. units: a side; spread: between units."""
    if units < 2:
        return 0.0
    if spread == 0:
        return float(effect != 0)
    from scipy.special import nctdtr

    freedom, error, critical = _design(spread, units, paired, 1 - error_rate)
    below, above = (nctdtr(freedom, abs(effect) / error, end) for end in (-critical, critical))
    return float(np.mean(1 - np.nan_to_num(above) + np.nan_to_num(below)))  # nan: far in a tail


def chance_of_equality(
    effect: float,
    spread: float,
    units: int,
    margin: float,
    *,
    paired: bool,
    error_rate: float = DECISION_ERROR_RATE,
) -> float:
    """Power of the two one-sided tests, for a true difference; Phillips 1990, as a lower bound."""
    if units < 2 or abs(effect) >= margin:
        return 0.0
    if spread == 0:
        return 1.0
    from scipy.special import nctdtr

    freedom, error, critical = _design(spread, units, paired, 1 - 2 * error_rate)
    above = nctdtr(freedom, (effect - margin) / error, -critical)
    below = nctdtr(freedom, (effect + margin) / error, critical)
    return float(np.mean(np.maximum(np.nan_to_num(above) - np.nan_to_num(below), 0.0)))


def _design(
    spread: float, units: int, paired: bool, level: float
) -> tuple[float, float, NDArray[np.float64]]:
    """Degrees of freedom and standard error of t with so many units a side, and critical values.

    Welch's test has as many equally likely critical values as RATIO_QUANTILES: by its degrees of
    freedom, which follow from the ratio of two sample variances. For sides of equal spread that
    ratio is independent of their sum, so t has 2 (units - 1) degrees of freedom for each of them.
    """
    from scipy.special import betaincinv, stdtrit

    free, tail = units - 1, (1 + level) / 2
    if paired:
        return free, spread / math.sqrt(units), np.array([stdtrit(free, tail)])
    middles = (np.arange(RATIO_QUANTILES) + 0.5) / RATIO_QUANTILES
    share = betaincinv(free / 2, free / 2, middles)  # of one variance in the sum
    critical = stdtrit(free / (share**2 + (1 - share) ** 2), tail)
    return 2 * free, spread * math.sqrt(2 / units), np.asarray(critical)
