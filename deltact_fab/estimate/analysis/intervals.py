"""Confidence intervals of figures over a few seeds, positions or presses.

Errors within a group (one position's presses) are correlated, so only groups count as repeats.
The interval is the delete-one-group jackknife with Student's t of (groups - 1) degrees of freedom
(Efron, The Jackknife, the Bootstrap and Other Resampling Plans, 1982, ch. 3; for clusters
MacKinnon, Nielsen and Webb, J. Applied Econometrics 38, 2023, 671). Nominally 95 %, it holds the
truth in 91 to 97 % of cases at 3 groups and at 9, where the bootstrap of whole groups does in 71 to
91 % (`python -m benchmarks.intervals`); and it needs no seed.

For smooth statistics: mean, RMSE, R2, correlation, ratios of such. Not for a median or a maximum:
there it can be far too narrow.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Hashable, Sequence
from typing import Any, Literal, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deltact_fab.common import InputError

Groups = Sequence[Hashable] | NDArray[Any]
Statistic = Callable[[NDArray[np.float64]], float]
Scale = Literal["plain", "positive", "correlation"]

# Transform to the scale of the interval, infinite at its end; inverse; least and largest figure.
INTERVAL_SCALES: dict[
    Scale, tuple[Callable[[float], float], Callable[[float], float], float, float]
] = {
    "plain": (float, float, -math.inf, math.inf),
    "positive": (lambda v: math.log(v) if v else -math.inf, math.exp, 0.0, math.inf),
    "correlation": (
        lambda v: math.atanh(v) if abs(v) < 1 else math.copysign(math.inf, v), math.tanh, -1.0, 1.0,
    ),
}  # fmt: skip
INTERVAL_LEVEL = 0.95  # definition: of every interval of a figure
MIN_GROUPS = 4
"""Decision 0038: no interval below; the spread of fewer groups is too uncertain."""


class Interval(NamedTuple):
    """A figure, its interval (None, None below MIN_GROUPS), and its groups in words.

    groups: their number. noun: of one, singular.
    """

    value: float
    low: float | None
    high: float | None
    over: str
    groups: int = 0
    noun: str = "group"

    def format(self, unit: str) -> str:
        """Format as "0.08 N [0.06 to 0.12]"."""
        if self.low is None or self.high is None:
            return f"{self.value:.2f} {unit}"
        return f"{self.value:.2f} {unit} [{self.low:.2f} to {self.high:.2f}]"

    @classmethod
    def rmse(cls, errors: ArrayLike, groups: Groups, noun: str) -> Self:
        """Root mean square of errors (n,) or (n, k) with interval. noun: of a group, singular."""
        return cls.jackknife(
            errors, groups, lambda rows: math.sqrt(float(np.mean(rows**2))), noun, "positive"
        )

    @classmethod
    def mean(cls, values: ArrayLike, groups: Groups, noun: str, scale: Scale = "plain") -> Self:
        """Mean of values (n,) with interval. noun: of a group, as "seed"."""
        return cls.jackknife(values, groups, lambda rows: float(np.mean(rows)), noun, scale)

    @classmethod
    def ratio(cls, above: ArrayLike, below: ArrayLike, groups: Groups, noun: str) -> Self:
        """Ratio of the means of two paired samples (n,), with interval."""
        rows = np.column_stack((above, below))
        return cls.jackknife(
            rows, groups, lambda r: float(r[:, 0].mean() / r[:, 1].mean()), noun, "positive"
        )

    @classmethod
    def jackknife(
        cls, values: ArrayLike, groups: Groups, statistic: Statistic, noun: str,
        scale: Scale = "plain",
    ) -> Self:  # fmt: skip
        """Statistic of values with its jackknife interval over groups.

        values: (n, ...), samples (several columns for a ratio). groups: (n,), seed, position or
        press of each; of two kinds of groups take the one with the wider interval. statistic: of
        rows (m, ...), smooth in each group's contribution. noun: of a group, singular. scale:
        "positive" for a magnitude such as an RMSE (interval on its logarithm), "correlation" for
        one in -1 to 1 (Fisher's z). Raises InputError for values that are not finite or not as many
        as groups, and for a figure outside of the scale.
        """
        rows, names = np.asarray(values, dtype=np.float64), list(groups)
        if rows.ndim == 0 or len(rows) != len(names) or not names or not np.isfinite(rows).all():
            raise InputError(
                f"interval: finite values are needed, as many as groups: {rows.shape} values, "
                f"{len(names)} groups"
            )
        number = {name: index for index, name in enumerate(dict.fromkeys(names))}
        codes, count = np.array([number[name] for name in names]), len(number)
        forward, inverse, lowest, highest = INTERVAL_SCALES[scale]

        def scaled(rows: NDArray[np.float64]) -> float:
            figure = float(statistic(rows))
            if not lowest <= figure <= highest:  # NaN fails too
                raise InputError(
                    f"interval: the figure {figure:g} is outside of the scale {scale!r}"
                )
            return forward(figure)

        value = float(statistic(rows))
        plural = f"{noun}es" if noun.endswith("s") else f"{noun}s"
        over = f"{count} {plural}" if count > 1 else f"one {noun}"
        if count < MIN_GROUPS:
            return cls(value, None, None, f"{over}: no interval below four", count, noun)
        full, without = scaled(rows), np.array([scaled(rows[codes != g]) for g in range(count)])
        if math.isinf(full):  # an RMSE of 0, a correlation of 1: in every group
            return cls(value, value, value, over, count, noun)
        if np.isinf(without).any():  # one group decides: no interval on the transformed scale
            _, low, high, *_ = cls.jackknife(rows, names, statistic, noun)
            low, high = max(low or 0.0, lowest), min(high or 0.0, highest)
            return cls(value, low, high, over, count, noun)
        from scipy.special import stdtrit

        spread = math.sqrt((count - 1) / count * float(np.sum((without - without.mean()) ** 2)))
        reach = float(stdtrit(count - 1, (1 + INTERVAL_LEVEL) / 2)) * spread
        return cls(value, inverse(full - reach), inverse(full + reach), over, count, noun)
