"""The uncertainty of a figure found over a few seeds, positions or presses.

Samples of one group (one position's presses) err together, so only whole groups count as repeats.
The interval is the delete-one-group jackknife with Student's t of (groups - 1) degrees of freedom
(Efron, The Jackknife, the Bootstrap and Other Resampling Plans, 1982, ch. 3; for clusters
MacKinnon, Nielsen and Webb, J. Applied Econometrics 38, 2023, 671). Nominally 95 %, it holds the
truth in 91 to 97 % of cases at 3 groups and at 9, where the bootstrap of whole groups does in 71 to
91 % (`python -m benchmarks.intervals`); and it needs no seed.

It is for figures that a group changes smoothly: mean, RMSE, R2, correlation, a ratio of such. It is
not for a median or a largest value: of those it can be far too narrow.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Hashable, Sequence
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import InputError
from ..report.result import Headline

Statistic = Callable[[NDArray[np.float64]], float]
Scale = Literal["plain", "positive", "correlation"]

_TO: dict[Scale, tuple[Callable[[float], float], Callable[[float], float]]] = {
    "plain": (float, float),
    "positive": (math.log, math.exp),
    "correlation": (math.atanh, math.tanh),
}
MIN_GROUPS = 4
"""Groups for an interval: the spread of fewer is itself not known."""
_LEAST: dict[Scale, float] = {"plain": -math.inf, "positive": 0.0, "correlation": -1.0}
_MOST: dict[Scale, float] = {"plain": math.inf, "positive": math.inf, "correlation": 1.0}


class Interval(NamedTuple):
    """A figure, its interval (None, None below MIN_GROUPS), and what it was drawn over."""

    value: float
    low: float | None
    high: float | None
    over: str


def headline(what: str, unit: str, found: Interval, factor: float = 1.0, **more: Any) -> Headline:
    """A figure that counts, with its interval; factor: to the unit, from the figure's own."""
    low, high = (None if end is None else factor * end for end in (found.low, found.high))
    return Headline(what, factor * found.value, unit, low, high, found.over, **more)


def over_groups(
    values: ArrayLike,
    groups: Sequence[Hashable] | NDArray[Any],
    statistic: Statistic,
    level: float = 0.95,
    scale: Scale = "plain",
) -> tuple[float | None, float | None]:
    """The interval (low, high) of statistic(values) over groups; (None, None) below MIN_GROUPS.

    values (n, ...): rows of samples, of any shape a row (several columns for a ratio). groups (n,):
    the seed, position or press of each; where two are repeated, take the one that errs more widely.
    statistic: of rows (m, ...), smooth in what a group contributes. scale: "positive" for a
    magnitude such as an RMSE (the interval is made of its logarithm and stays above 0),
    "correlation" for one in -1 to 1 (of Fisher's z).
    Raises InputError for values that are not finite or not as many as groups, and a figure that
    the scale does not allow.
    """
    rows, of = _checked(values, groups)
    count = int(of.max()) + 1
    if count < MIN_GROUPS:
        return None, None
    whole = _at(scale, statistic(rows))
    without = np.array([_at(scale, statistic(rows[of != group])) for group in range(count)])
    if math.isinf(whole):  # an RMSE of 0, a correlation of 1: so it is in every group
        exact = float(statistic(rows))
        return exact, exact
    if np.isinf(without).any():  # all hangs on one group, which its own scale cannot show
        low, high = over_groups(rows, of, statistic, level)
        return max(low or 0.0, _LEAST[scale]), min(high or 0.0, _MOST[scale])
    spread = math.sqrt((count - 1) / count * float(np.sum((without - without.mean()) ** 2)))
    from scipy.special import stdtrit

    reach = float(stdtrit(count - 1, (1 + level) / 2)) * spread
    back = _TO[scale][1]
    return back(whole - reach), back(whole + reach)


def rmse(errors: ArrayLike, groups: Sequence[Hashable] | NDArray[Any], each: str) -> Interval:
    """Root of the mean square of errors (n,) or (n, k), with its interval; each: "position"..."""
    return estimate(
        errors, groups, lambda rows: math.sqrt(float(np.mean(rows**2))), each, "positive"
    )


def mean(
    values: ArrayLike,
    groups: Sequence[Hashable] | NDArray[Any],
    each: str,
    scale: Scale = "plain",
) -> Interval:
    """Mean of values (n,), with its interval; each: what a group is, "seed", "position"..."""
    return estimate(values, groups, lambda rows: float(np.mean(rows)), each, scale)


def ratio(
    above: ArrayLike,
    below: ArrayLike,
    groups: Sequence[Hashable] | NDArray[Any],
    each: str,
    level: float = 0.95,
) -> Interval:
    """Mean of values (n,) over that of others, group by group, with its interval."""
    rows = np.column_stack((above, below))
    return estimate(
        rows, groups, lambda r: float(r[:, 0].mean() / r[:, 1].mean()), each, "positive", level
    )


def estimate(
    values: ArrayLike,
    groups: Sequence[Hashable] | NDArray[Any],
    statistic: Statistic,
    each: str,
    scale: Scale = "plain",
    level: float = 0.95,
) -> Interval:
    """Any statistic with its interval, as a headline takes it. As `over_groups`.

    each: what a group is, in the singular.
    """
    rows, of = _checked(values, groups)
    count = int(of.max()) + 1
    low, high = over_groups(rows, of, statistic, level, scale)
    several = f"{each}es" if each.endswith("s") else f"{each}s"
    over = f"{count} {several}" if count > 1 else f"one {each}"
    if count < MIN_GROUPS:
        over += ": no interval below four"
    return Interval(float(statistic(rows)), low, high, over)


def _checked(
    values: ArrayLike, groups: Sequence[Hashable] | NDArray[Any]
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    rows = np.asarray(values, dtype=np.float64)
    names = list(groups)
    if rows.ndim == 0 or len(rows) != len(names) or not names or not np.isfinite(rows).all():
        raise InputError(
            f"interval: finite values are needed, as many as groups: {rows.shape} values, "
            f"{len(names)} groups"
        )
    number = {name: index for index, name in enumerate(dict.fromkeys(names))}
    return rows, np.array([number[name] for name in names], dtype=np.int64)


def _at(scale: Scale, value: float) -> float:
    """A figure on its scale, infinite at the end of it."""
    value = float(value)
    if not _LEAST[scale] <= value <= _MOST[scale]:  # NaN fails too
        raise InputError(f"interval: the figure {value:g} is no {scale} one")
    if scale == "positive" and value == 0:
        return -math.inf
    if scale == "correlation" and abs(value) == 1:
        return math.copysign(math.inf, value)
    return _TO[scale][0](value)
