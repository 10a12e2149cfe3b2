"""Force relaxation at rest: the rests of a run, and a Prony series fitted to them.

With the shear modulus G(t) = G (1 + sum g exp(-t / tau)) and everything else fixed by the path of
the tip, the force is the steady one plus, for each branch, g q, where q' + q / tau = dF/dt and F is
the force of the fully relaxed gel on the same path (the Boltzmann integral; Christensen, Theory of
Viscoelasticity, 1982, 1.2). A ramp linear in time over s seconds leaves
    q = F (1 - exp(-s / tau)) tau / s,
which decays with tau at rest: long ramps leave less than short ones. Exact where the contact does
not change while the force relaxes, as with an incompressible gel that sticks.

The measured force contains the history of the whole press, ramps and earlier stops. For a given
series it is inverted sample by sample to the force of the relaxed gel, which is constant within
each rest; the rest of the measured force is the excess of the series. Least squares over all rests,
in the three forces, for times and shares; each rest's steady force is free. Samples of a rest are
averaged in blocks that grow with the wait, else a minute would outweigh its first second.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from deltact_fab.bench import Run, open_run
from deltact_fab.common import Field, InputError, SolverError
from deltact_fab.sensor import Indenter

from .runs import PRESS_KINDS, settle_s

BIN_S = 0.02  # by hand: shorter bins are noisier, longer ones blur the fastest branch
_POSITION_COLUMNS = ("x_mm", "y_mm", "z_mm")
SKIN_SIZES = ("thickness_mm", "width_mm", "length_mm")
ARRIVED_MM = 0.01  # from its end, a stage has arrived; by hand: above a step, far below a press
MIN_REST_BINS = 25  # of a usable rest; by hand: shorter ones determine no branch


@dataclass(frozen=True, eq=False)
class ForceHistory:
    """Binned forces of one press: force_n (n, 3) at t_s (n,), BIN_S apart, from its tare on."""

    press: str
    t_s: Field
    force_n: Field


@dataclass(frozen=True, eq=False)
class ForceRest:
    """One stop of a press. bins: its slice of the history. kind: press or shear."""

    history: ForceHistory
    step_id: str
    kind: str
    depth_mm: float
    bins: slice

    @property
    def wait_s(self) -> Field:
        """Time (n,) since the first bin, at most 0.1 s after the tip came to rest."""
        t = self.history.t_s[self.bins]
        return np.asarray(t - t[0])

    @property
    def force_n(self) -> Field:
        """Force (n, 3) on the sensor."""
        return self.history.force_n[self.bins]

    @classmethod
    def find_all(cls, run: Run) -> list[ForceRest]:
        """Find the rests of all presses and drags that settled, in order.

        Raises InputError for a run without a force stream or a stop that rests long enough.
        """
        longest_s = max(settle_s(run, kind) for kind in PRESS_KINDS)
        if not longest_s:
            raise InputError(f"{run.folder}: no settle_s in its protocol, so no rests")
        steps = run.steps()
        rests: list[ForceRest] = []
        pressing = steps[steps["kind"].isin(PRESS_KINDS)]
        for press, press_steps in pressing.groupby("press", sort=False):
            samples = run.force(str(press))
            if not len(samples):
                raise InputError(f"{run.folder}: press {press}: no force recorded")
            history = _bin_forces(str(press), samples)
            pose = run.pose(str(press))
            settled = set(run.frames(str(press)).query("settled")["step_id"])
            for step in press_steps[press_steps["step_id"].isin(settled)].itertuples():
                rest = _find_rest(history, step, samples, pose, settle_s(run, str(step.kind)))
                if rest is not None:
                    rests.append(rest)
        if not rests:
            needed = f"no stop of {MIN_REST_BINS * BIN_S:g} s or more"
            raise InputError(f"{run.folder}: settle_s = {longest_s:g}: {needed}")
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
    """Return a step's rest, from the stage's first report at its end (else the planned time)."""
    row = step._asdict()  # type: ignore[attr-defined]
    origin_s = float((samples["t_s"] - samples["t_press_s"]).iloc[0])
    start_s = row["t_start_s"] + row["planned_s"] - origin_s
    reports = pose[pose["step_id"] == row["step_id"]]
    if len(reports):
        offset = reports[list(_POSITION_COLUMNS)].to_numpy() - [
            row[name] for name in _POSITION_COLUMNS
        ]
        travelling = np.flatnonzero(np.linalg.norm(offset, axis=1) > ARRIVED_MM)
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
    """Prony series: shares (k,) of the steady force that decay, with time constants times_s (k,).

    As `[specimen] prony`.
    """

    shares: tuple[float, ...]
    times_s: tuple[float, ...]

    @property
    def pairs(self) -> tuple[tuple[float, float], ...]:
        """(g, tau_s), as a protocol writes them."""
        return tuple(zip(self.shares, self.times_s, strict=True))


# By hand, in this block: more branches and finer blocks fit noise, fewer miss a decade of time.
MAX_BRANCHES = 3
BRANCH_GAIN = 0.9  # residual of the blocks, over that with one branch less, to accept a branch
REST_BLOCKS = 40  # per rest, equally spaced in the logarithm of the wait
LONGEST_TIME = 2.0  # x the longest rest: slower branches look like a steady force
START_TIME_S, START_SHARE = 2.0, 0.1  # start of the search
SHARE_RANGE = (1e-4, 10.0)  # bounds of the search
SHORTEST_TIME_S = 2 * BIN_S
UNCERTAIN_TIME = 0.5  # x the longest rest: slower branches are poorly determined


@dataclass(frozen=True, eq=False)
class RelaxationFit:
    """Relaxation of a gel, fitted to its rests.

    rms_n: of the residual. steady_n (rests, 3): fully relaxed force of each rest.

    unsure: times of branches too slow for the rests to determine well. blocks_n: as rms_n, of the
    block means that it was fitted to.
    """

    series: Series
    rms_n: float
    steady_n: Field
    unsure: tuple[float, ...]
    blocks_n: float

    def excess(self, rest: ForceRest, wait_s: Field) -> Field:
        """Force (m, 3) of a rest above its steady value, at wait_s (m,) into it."""
        return _excess_force(rest, _branch_forces(rest.history, self.series), self.series, wait_s)

    @classmethod
    def from_rests(cls, rests: Sequence[ForceRest]) -> RelaxationFit:
        """Fit the series of rests, with the fewest branches that improve the fit.

        Up to MAX_BRANCHES. Raises SolverError where the search does not converge.
        """
        best = _fit(rests, [(START_TIME_S,)])
        if best is None:
            raise SolverError("relaxation: the fit of the series did not converge")
        while len(best.series.shares) < MAX_BRANCHES:
            larger = _fit(rests, _split_starts(best.series.times_s, rests))
            if larger is None or larger.blocks_n > BRANCH_GAIN * best.blocks_n:
                break
            best = larger
        return best


def _split_starts(times_s: Sequence[float], rests: Sequence[ForceRest]) -> list[tuple[float, ...]]:
    """Return starts with one branch more: below, between and above the present ones.

    Sums of exponentials have local minima; several starts are needed.
    """
    ends = [SHORTEST_TIME_S, *times_s, LONGEST_TIME * _longest_s(rests)]
    gaps = [float(np.sqrt(a * b)) for a, b in itertools.pairwise(ends)]
    return [tuple(sorted((*times_s, gap))) for gap in gaps]


def _longest_s(rests: Sequence[ForceRest]) -> float:
    return max(float(rest.wait_s[-1]) for rest in rests)


def _fit(rests: Sequence[ForceRest], starts: Sequence[tuple[float, ...]]) -> RelaxationFit | None:
    """Best fit of several starts; None if none converged, as with one branch too many."""
    fits = [fitted for start in starts if (fitted := _fit_from(rests, start)) is not None]
    return min(fits, key=lambda fitted: fitted.blocks_n, default=None)


def _fit_from(rests: Sequence[ForceRest], times_s: Sequence[float]) -> RelaxationFit | None:
    from scipy.optimize import least_squares

    count, longest = len(times_s), _longest_s(rests)
    low = np.log([SHORTEST_TIME_S] * count + [SHARE_RANGE[0]] * count)
    high = np.log([LONGEST_TIME * longest] * count + [SHARE_RANGE[1]] * count)
    start = np.clip(np.log([*times_s, *[START_SHARE / count] * count]), low + 1e-6, high - 1e-6)

    def residuals(p: Field) -> Field:
        misfits = _evaluate(rests, _series(p))[-1]
        return np.concatenate([_block_means(part).ravel() for part in misfits])

    solution = least_squares(residuals, start, bounds=(low, high), x_scale="jac")
    if solution.status <= 0:
        return None
    series = _series(solution.x)
    steady, misfit = _evaluate(rests, series)
    rms, blocks = (
        float(np.sqrt(np.mean(np.concatenate([average(part).ravel() for part in misfit]) ** 2)))
        for average in (np.asarray, _block_means)
    )
    unsure = tuple(tau for tau in series.times_s if tau > UNCERTAIN_TIME * longest)
    return RelaxationFit(series, rms, np.array(steady), unsure, blocks)


def _block_means(misfit_n: Field) -> Field:
    """Means (b, 3) of (n, 3) over blocks of growing length."""
    starts = np.unique(np.geomspace(1, len(misfit_n), REST_BLOCKS + 1).astype(int)) - 1
    starts = starts[:-1]
    counts = np.diff([*starts, len(misfit_n)])
    return np.asarray(np.add.reduceat(misfit_n, starts, axis=0) / counts[:, None])


def _series(p: Field) -> Series:
    count = len(p) // 2
    order = np.argsort(p[:count])
    taus, shares = np.exp(p[:count][order]), np.exp(p[count:][order])
    return Series(tuple(shares.tolist()), tuple(taus.tolist()))


def _evaluate(rests: Sequence[ForceRest], series: Series) -> tuple[list[Field], list[Field]]:
    """Return every rest's steady force (3,) and misfit (n, 3)."""
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
    """Excess force (m, 3) at wait_s (m,) into a rest; slow: `_branch_forces` of its history."""
    first = np.array(series.shares)[:, None] * slow[rest.bins.start]
    return np.asarray(np.exp(-wait_s[:, None] / np.array(series.times_s)) @ first)


def _branch_forces(history: ForceHistory, series: Series) -> Field:
    """Branch terms q (n, k, 3) of the relaxed gel's force, obtained by inverting the series."""
    from scipy.signal import lfilter

    keep, gain = _decays(series)
    steady = _relaxed_force(history, series)
    return np.stack(
        [lfilter([a, -a], [1.0, -e], steady, axis=0) for a, e in zip(gain, keep, strict=True)],
        axis=1,
    )


def _relaxed_force(history: ForceHistory, series: Series) -> Field:
    """Force (n, 3) of the relaxed gel on the path of a history."""
    from scipy.signal import lfilter

    keep, gain = _decays(series)
    # As polynomials in the delay: F = S (1 + sum g gain (1 - z) / (1 - keep z)).
    denominator = np.poly(keep)
    numerator = denominator + sum(
        g * a * np.polymul([1.0, -1.0], np.poly(np.delete(keep, k)))
        for k, (g, a) in enumerate(zip(series.shares, gain, strict=True))
    )
    return np.asarray(lfilter(denominator, numerator, history.force_n, axis=0))


def _decays(series: Series) -> tuple[Field, Field]:
    """Decay of each branch over a bin, and its mean over a bin."""
    x = BIN_S / np.array(series.times_s)
    return np.exp(-x), -np.expm1(-x) / x


@dataclass(frozen=True, eq=False)
class StraightPress:
    """Depth and normal force of one press of a run up to its first drag, and its gel.

    depth_mm, normal_n (n,): one row per report of the stage; the force is that of the relaxed gel
    where the specimen states a series. dragged: reports from the first drag on. options: place,
    gel and friction by the names of the options of `gel fit`.
    """

    name: str
    indenter: Indenter
    depth_mm: Field
    normal_n: Field
    dragged: int
    options: dict[str, Any]
    notes: list[str]

    @classmethod
    def from_run(cls, folder: Path, press: str | None = None) -> StraightPress:
        """Read a press; None: the only one. Raises InputError with the names of all presses."""
        run = open_run(folder)
        steps, specimen = run.steps(), run.meta["protocol"]["specimen"]
        steps = steps[steps["kind"].isin(PRESS_KINDS)]
        names = list(dict.fromkeys(steps["press"]))
        if not names or run.weights is not None or run.meta.get("air"):
            raise InputError(f"{folder}: no press of a stage on the face in this run")
        if press not in (names if press or len(names) > 1 else [None]):
            raise InputError(
                f"{folder}: --press: must be one of {', '.join(names)} (got {press or 'none'})"
            )
        press = press or names[0]
        samples, pose, steps = run.force(press), run.pose(press), steps[steps["press"] == press]
        if samples.empty:
            raise InputError(f"{folder}: press {press}: no force recorded")
        first, straight = steps.iloc[0], (steps["kind"] == "shear").cumsum() == 0
        rows = pose[pose["step_id"].isin(steps["step_id"][straight])]
        history, prony = _bin_forces(press, samples), specimen.get("prony", ())
        series = Series(tuple(share for share, _ in prony), tuple(time_s for _, time_s in prony))
        normal_n = -_relaxed_force(history, series)[:, 2]
        notes = [f"the run's specimen: modulus_mpa = {specimen['modulus_mpa']:g}"]
        if not prony:
            notes.append("no prony in the run's specimen: relaxation counts as modulus")
        if run.simulated and specimen["gel_model"] != "hyperelastic":
            notes.append(f"simulated with gel_model = {specimen['gel_model']!r}")
        return cls(
            f"{folder}: press {press}",
            run.indenter(first["indenter"]),
            -rows["z_mm"].to_numpy(float),
            np.asarray(np.interp(rows["t_press_s"], history.t_s, normal_n)),
            int(pose["step_id"].isin(steps["step_id"][~straight]).sum()),
            {
                "at_mm": (float(first["x_mm"]), float(first["y_mm"])),
                **{k: run.meta["sensor"]["skin"][k] for k in SKIN_SIZES},
                **{k: specimen[k] for k in ("poisson", "friction")},
            },
            notes,
        )
