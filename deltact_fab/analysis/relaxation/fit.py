"""The series that makes a run's rests flat: shares and times of relaxation with their residual.

The force that was measured has the past of the whole press in it, ramps and earlier stops. For a
series it is undone sample by sample, which gives the slow gel's force; within each rest that one is
constant, and what is measured over it is what the series left. Least squares over all rests, in the
three forces, of the times and shares; each rest's steady force is free.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...errors import SolverError
from .rests import BIN_S, Rest, Way
from .series import Series

Field = NDArray[np.float64]

MOST_BRANCHES = 3
WORTH = 0.97  # a further branch is taken when it makes the residual this much smaller
LONGEST = 2.0  # x the longest rest: slower branches cannot be told from a steady force
SHARES = (1e-4, 10.0)
SHORTEST_S = 2 * BIN_S
STILL_RESTS = 0.5  # a branch over this x the longest rest is told badly


@dataclass(frozen=True, eq=False)
class Fitted:
    """series: what was found. rms_n: of what it leaves over. steady_n (rests, 3): each rest's end.

    left_n: per rest (n, 3), what the force has too much by the series. unsure: branches so slow
    that the rests are too short to tell them well.
    """

    series: Series
    rms_n: float
    steady_n: Field
    left_n: tuple[Field, ...]
    unsure: tuple[float, ...]


def fit(rests: Sequence[Rest], branches: int | None = None) -> Fitted:
    """The series of rests; branches None: the fewest, up to MOST_BRANCHES, that are worth it.

    Raises SolverError where the search does not converge.
    """
    if branches is not None:
        return _fit(rests, branches)
    best = _fit(rests, 1)
    for count in range(2, MOST_BRANCHES + 1):
        more = _fit(rests, count)
        if more.rms_n > WORTH * best.rms_n:
            break
        best = more
    return best


def _fit(rests: Sequence[Rest], count: int) -> Fitted:
    from scipy.optimize import least_squares

    longest = max(float(rest.wait_s[-1]) for rest in rests)
    low = np.log([SHORTEST_S] * count + [SHARES[0]] * count)
    high = np.log([LONGEST * longest] * count + [SHARES[1]] * count)
    first = np.geomspace(0.3, max(0.5 * longest, 0.6), count + 2)[1:-1]
    start = np.clip(np.log([*first, *[0.05] * count]), low + 1e-6, high - 1e-6)

    def residuals(p: Field) -> Field:
        _, _, off = _told(rests, _series(p))
        return np.concatenate([part.ravel() for part in off])

    found = least_squares(residuals, start, bounds=(low, high), x_scale="jac")
    if found.status <= 0:
        raise SolverError(f"relaxation: {count} branches: the fit did not converge")
    series = _series(found.x)
    steady, left, off = _told(rests, series)
    rms = float(np.sqrt(np.mean(np.concatenate([part.ravel() for part in off]) ** 2)))
    unsure = tuple(tau for tau in series.times_s if tau > STILL_RESTS * longest)
    return Fitted(series, rms, np.array(steady), tuple(left), unsure)


def _series(p: Field) -> Series:
    count = len(p) // 2
    order = np.argsort(p[:count])
    taus, shares = np.exp(p[:count][order]), np.exp(p[count:][order])
    return Series(tuple(shares.tolist()), tuple(taus.tolist()))


def _told(rests: Sequence[Rest], series: Series) -> tuple[list[Field], list[Field], list[Field]]:
    """Of every rest: its steady force (3,), what is left over it (n, 3), and the misfit (n, 3)."""
    slow: dict[int, Field] = {}
    steady, left, off = [], [], []
    for rest in rests:
        if id(rest.way) not in slow:
            slow[id(rest.way)] = _branches(rest.way, series)
        q = slow[id(rest.way)][rest.at.start]  # (k, 3)
        t = rest.wait_s - rest.wait_s[0]
        fading = np.exp(-t[:, None] / np.array(series.times_s))
        own = fading @ (np.array(series.shares)[:, None] * q)
        end = (rest.force_n - own).mean(axis=0)
        steady.append(end)
        left.append(own)
        off.append(rest.force_n - own - end)
    return steady, left, off


def _branches(way: Way, series: Series) -> Field:
    """q (n, k, 3) of the slow gel's force, which is the measured one with the series undone."""
    from scipy.signal import lfilter

    x = BIN_S / np.array(series.times_s)
    keep, gain = np.exp(-x), -np.expm1(-x) / x
    # As polynomials in the delay: F = S (1 + sum g gain (1 - z) / (1 - keep z)).
    poles = [np.array([1.0, -e]) for e in keep]
    whole = np.array([1.0])
    for pole in poles:
        whole = np.convolve(whole, pole)
    top = whole.copy()
    for k, (g, a) in enumerate(zip(series.shares, gain, strict=True)):
        part = g * a * np.array([1.0, -1.0])
        for j, pole in enumerate(poles):
            if j != k:
                part = np.convolve(part, pole)
        top += part
    steady = lfilter(whole, top, way.force_n, axis=0)
    return np.stack(
        [lfilter([a, -a], [1.0, -e], steady, axis=0) for a, e in zip(gain, keep, strict=True)],
        axis=1,
    )
