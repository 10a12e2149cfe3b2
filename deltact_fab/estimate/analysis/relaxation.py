"""How a gel's force fades at rest: a run's rests, and the series that makes them flat.

With the shear modulus G(t) = G (1 + sum g exp(-t / tau)) and everything else fixed by the way of
the tip, the force is the steady one and, for each branch, g q, where q' + q / tau = dF/dt and F is
what the slow gel would give on the same way (the Boltzmann integral; Christensen, Theory of
Viscoelasticity, 1982, 1.2). A way that is straight in time over s seconds leaves of it
    q = F (1 - exp(-s / tau)) tau / s,
which fades with tau when the tip rests: long ramps leave less than short ones. Exact where the
contact does not change while the force fades, as with an incompressible gel that sticks.

The force that was measured has the past of the whole press in it, ramps and earlier stops. For a
series it is undone sample by sample, which gives the slow gel's force; within each rest that one is
constant, and what is measured over it is what the series left. Least squares over all rests, in the
three forces, of the times and shares; each rest's steady force is free. A rest counts in blocks
that grow with the wait, else the many samples of a minute would drown its first second.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from deltact_fab.bench import Run
from deltact_fab.common import Field, InputError, SolverError

from .runs import PRESSING_KINDS, settle_s

BIN_S = 0.02  # samples are averaged over it: one of 1 kHz has seven times the noise
ARRIVED_MM = 0.01  # a stage that reports this near its end has arrived
MIN_REST_BINS = 25  # of a rest that says anything


@dataclass(frozen=True, eq=False)
class ForceHistory:
    """All forces of one press, averaged: force_n (n, 3) at t_s (n,), BIN_S apart, from its tare."""

    press: str
    t_s: Field
    force_n: Field


@dataclass(frozen=True, eq=False)
class ForceRest:
    """One stop of a press. at: its bins in the way, a slice. kind: press or shear."""

    history: ForceHistory
    step_id: str
    kind: str
    depth_mm: float
    bins: slice

    @property
    def wait_s(self) -> Field:
        """(n,) since the first of them, at most 0.1 s after the tip came to rest."""
        t = self.history.t_s[self.bins]
        return np.asarray(t - t[0])

    @property
    def force_n(self) -> Field:
        """(n, 3) on the sensor."""
        return self.history.force_n[self.bins]


def find_rests(run: Run) -> list[ForceRest]:
    """Find the rests of all presses and drags that settled, in order.

    Raises InputError for a run without a force stream or without a stop that rests long enough.
    """
    longest_s = max(settle_s(run, kind) for kind in PRESSING_KINDS)
    if not longest_s:
        raise InputError(f"{run.folder}: its protocol has no settle_s: no stop rests")
    steps = run.steps()
    rests: list[ForceRest] = []
    for press, press_steps in steps[steps["kind"].isin(PRESSING_KINDS)].groupby(
        "press", sort=False
    ):
        samples = run.force(str(press))
        if not len(samples):
            raise InputError(f"{run.folder}: press {press}: no force was recorded")
        history = _bin_forces(str(press), samples)
        pose = run.pose(str(press))
        settled = set(run.frames(str(press)).query("settled")["step_id"])
        for step in press_steps[press_steps["step_id"].isin(settled)].itertuples():
            rest = _find_rest(history, step, samples, pose, settle_s(run, str(step.kind)))
            if rest is not None:
                rests.append(rest)
    if not rests:
        raise InputError(
            f"{run.folder}: no stop rests for {MIN_REST_BINS * BIN_S:g} s or more: settle_s = "
            f"{longest_s:g}"
        )
    return rests


def _bin_forces(press: str, samples: pd.DataFrame) -> ForceHistory:
    t = samples["t_press_s"].to_numpy()
    bins = np.floor((t - t[0]) / BIN_S).astype(int)
    counts = np.bincount(bins)
    middle = t[0] + (np.arange(len(counts)) + 0.5) * BIN_S
    filled = counts > 0
    forces = []
    for name in ("fx_n", "fy_n", "fz_n"):
        sums = np.bincount(bins, samples[name].to_numpy())
        forces.append(np.interp(middle, middle[filled], sums[filled] / counts[filled]))
    return ForceHistory(press, middle, np.stack(forces, axis=1))


def _find_rest(
    history: ForceHistory, step: object, samples: pd.DataFrame, pose: pd.DataFrame, rests_s: float
) -> ForceRest | None:
    """From the first report of the stage at its end; without reports, from the plan's time."""
    row = step._asdict()  # type: ignore[attr-defined]
    origin_s = float((samples["t_s"] - samples["t_press_s"]).iloc[0])
    start_s = row["t_start_s"] + row["planned_s"] - origin_s
    reports = pose[pose["step_id"] == row["step_id"]]
    if len(reports):
        distance = reports[["x_mm", "y_mm", "z_mm"]].to_numpy() - [
            row["x_mm"],
            row["y_mm"],
            row["z_mm"],
        ]
        travelling = np.flatnonzero(np.linalg.norm(distance, axis=1) > ARRIVED_MM)
        first = int(travelling[-1]) + 1 if len(travelling) else 0
        if first == len(reports):
            return None  # it was cut short
        start_s = max(start_s, float(reports["t_press_s"].iloc[first - 1 if first else 0]))
    first, last = np.searchsorted(history.t_s, [start_s + BIN_S, start_s + rests_s])
    if last - first < MIN_REST_BINS:
        return None
    return ForceRest(
        history, row["step_id"], row["kind"], -float(row["z_mm"]), slice(int(first), int(last))
    )


@dataclass(frozen=True)
class Series:
    """Shares (k,) of the steady force that fade, and the times_s (k,) in which they do.

    As `[specimen] prony`.
    """

    shares: tuple[float, ...]
    times_s: tuple[float, ...]

    @property
    def pairs(self) -> tuple[tuple[float, float], ...]:
        """(g, tau_s), as a protocol writes them."""
        return tuple(zip(self.shares, self.times_s, strict=True))


MAX_BRANCHES = 3
BRANCH_GAIN = 0.9  # a further branch is taken when it makes the blocks' residual this much smaller
REST_BLOCKS = 40  # of a rest, each as much later as the one before
LONGEST_TIME = 2.0  # x the longest rest: slower branches cannot be told from a steady force
START_TIME_S, START_SHARE = 2.0, 0.1  # where the search starts
SHARE_RANGE = (1e-4, 10.0)
SHORTEST_TIME_S = 2 * BIN_S
UNCERTAIN_TIME = 0.5  # a branch over this x the longest rest is poorly determined


@dataclass(frozen=True, eq=False)
class RelaxationFit:
    """Relaxation of a gel as fitted to its rests.

    series: what was found. rms_n: of the residual. steady_n (rests, 3): each rest's end.

    unsure: times of branches so slow that the rests are too short to tell them well. blocks_n: as
    rms_n, of the blocks that it was fitted to.
    """

    series: Series
    rms_n: float
    steady_n: Field
    unsure: tuple[float, ...]
    blocks_n: float

    def excess(self, rest: ForceRest, wait_s: Field) -> Field:
        """(m, 3) of what the force of a rest has over its steady value at wait_s (m,) into it."""
        return _excess_force(rest, _branch_forces(rest.history, self.series), self.series, wait_s)


def fit_relaxation(rests: Sequence[ForceRest]) -> RelaxationFit:
    """Fit the series of rests, with the fewest branches, up to MAX_BRANCHES, that improve the fit.

    Raises SolverError where the search does not converge.
    """
    best = _fit_best(rests, [(START_TIME_S,)])
    if best is None:
        raise SolverError("relaxation: no search for a series converged")
    while len(best.series.shares) < MAX_BRANCHES:
        larger = _fit_best(rests, _split_starts(best.series.times_s, rests))
        if larger is None or larger.blocks_n > BRANCH_GAIN * best.blocks_n:
            break
        best = larger
    return best


def _split_starts(times_s: Sequence[float], rests: Sequence[ForceRest]) -> list[tuple[float, ...]]:
    """Starts with one branch more: below, between and above those that were found.

    Sums of exponentials have valleys of their own; from one start the search ends in any of them.
    """
    ends = [SHORTEST_TIME_S, *times_s, LONGEST_TIME * _longest_s(rests)]
    gaps = [float(np.sqrt(a * b)) for a, b in itertools.pairwise(ends)]
    return [tuple(sorted((*times_s, gap))) for gap in gaps]


def _longest_s(rests: Sequence[ForceRest]) -> float:
    return max(float(rest.wait_s[-1]) for rest in rests)


def _fit_best(
    rests: Sequence[ForceRest], starts: Sequence[tuple[float, ...]]
) -> RelaxationFit | None:
    """None where no search converged: a branch too many has nowhere to go."""
    fits = [fitted for start in starts if (fitted := _fit_from(rests, start)) is not None]
    return min(fits, key=lambda fitted: fitted.blocks_n, default=None)


def _fit_from(rests: Sequence[ForceRest], times_s: Sequence[float]) -> RelaxationFit | None:
    from scipy.optimize import least_squares

    count, longest = len(times_s), _longest_s(rests)
    low = np.log([SHORTEST_TIME_S] * count + [SHARE_RANGE[0]] * count)
    high = np.log([LONGEST_TIME * longest] * count + [SHARE_RANGE[1]] * count)
    start = np.clip(np.log([*times_s, *[START_SHARE / count] * count]), low + 1e-6, high - 1e-6)

    def residuals(p: Field) -> Field:
        misfits = _steady_and_misfit(rests, _series(p))[-1]
        return np.concatenate([_block_means(part).ravel() for part in misfits])

    solution = least_squares(residuals, start, bounds=(low, high), x_scale="jac")
    if solution.status <= 0:
        return None
    series = _series(solution.x)
    steady, misfit = _steady_and_misfit(rests, series)
    rms, blocks = (
        float(np.sqrt(np.mean(np.concatenate([average(part).ravel() for part in misfit]) ** 2)))
        for average in (np.asarray, _block_means)
    )
    unsure = tuple(tau for tau in series.times_s if tau > UNCERTAIN_TIME * longest)
    return RelaxationFit(series, rms, np.array(steady), unsure, blocks)


def _block_means(misfit_n: Field) -> Field:
    """(b, 3) means of (n, 3) over blocks that grow."""
    starts = np.unique(np.geomspace(1, len(misfit_n), REST_BLOCKS + 1).astype(int)) - 1
    starts = starts[:-1]
    counts = np.diff([*starts, len(misfit_n)])
    return np.asarray(np.add.reduceat(misfit_n, starts, axis=0) / counts[:, None])


def _series(p: Field) -> Series:
    count = len(p) // 2
    order = np.argsort(p[:count])
    taus, shares = np.exp(p[:count][order]), np.exp(p[count:][order])
    return Series(tuple(shares.tolist()), tuple(taus.tolist()))


def _steady_and_misfit(
    rests: Sequence[ForceRest], series: Series
) -> tuple[list[Field], list[Field]]:
    """Of every rest: its steady force (3,), misfit (n, 3)."""
    slow: dict[int, Field] = {}
    steady, misfit = [], []
    for rest in rests:
        if id(rest.history) not in slow:
            slow[id(rest.history)] = _branch_forces(rest.history, series)
        excess = _excess_force(rest, slow[id(rest.history)], series, rest.wait_s)
        end = (rest.force_n - excess).mean(axis=0)
        steady.append(end)
        misfit.append(rest.force_n - excess - end)
    return steady, misfit


def _excess_force(rest: ForceRest, slow: Field, series: Series, wait_s: Field) -> Field:
    """(m, 3) that a series leaves at wait_s (m,) into a rest; slow: `_branches` of its way."""
    first = np.array(series.shares)[:, None] * slow[rest.bins.start]
    return np.asarray(np.exp(-wait_s[:, None] / np.array(series.times_s)) @ first)


def _branch_forces(history: ForceHistory, series: Series) -> Field:
    """q (n, k, 3) of the slow gel's force, which is the measured one with the series undone."""
    from scipy.signal import lfilter

    x = BIN_S / np.array(series.times_s)
    keep, gain = np.exp(-x), -np.expm1(-x) / x
    # As polynomials in the delay: F = S (1 + sum g gain (1 - z) / (1 - keep z)).
    denominator = np.poly(keep)
    numerator = denominator + sum(
        g * a * np.polymul([1.0, -1.0], np.poly(np.delete(keep, k)))
        for k, (g, a) in enumerate(zip(series.shares, gain, strict=True))
    )
    steady = lfilter(denominator, numerator, history.force_n, axis=0)
    return np.stack(
        [lfilter([a, -a], [1.0, -e], steady, axis=0) for a, e in zip(gain, keep, strict=True)],
        axis=1,
    )
