"""Gel identification from presses: Poisson's ratio, thickness, and force not yet relaxed.

Poisson's ratio and thickness change the response to pressure and shear differently, so wrong design
values cost some per cent of force at uncalibrated places. The pair is chosen that predicts unseen
positions best, all three forces weighted alike. On two gels of another solver it found the true
pair (docs/evidence/strangers.md).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from deltact_fab.bench import Run
from deltact_fab.common import Array, Progress

from ...measure.face import FaceFlow
from ...measure.force.inverse import Inverse
from ...measure.regression import MIN_PRESSES
from ...measure.sensor_id import SensorModel
from .dataset import ForceData, point_flows
from .judge import predict_left_out

POISSON_STEP, THICKNESS_STEP = 1.25, 0.01  # of 1/2 - nu (factor), of the thickness; by hand: cost
SEARCH_STEPS = (4, 2, 1)  # of successive pattern searches; by hand: an inverse per pair tried
# By hand: both axes, and the valley of gels that look alike, thinner and softer.
SEARCH_DIRECTIONS = ((1, 0), (-1, 0), (0, 1), (0, -1), (1, -1), (-1, 1))
MAX_SEARCH_STEPS = 8  # from the design's values; by hand: farther is no plausible casting error
COMPRESSIBILITY_RANGE = (0.002, 0.1)  # of 1/2 - nu; by hand: silicones, and the solver's limits
MAX_SEARCH_FRAMES = 120  # spread over all; by hand: more cost time and hardly change the pair
# Decision 0026: 95 % of the bootstrap draws must favour the pair, and the error fall by a tenth,
# for the best of many pairs is a little better by chance. By hand: 400 draws settle the 95 %.
BOOTSTRAP_DRAWS, GEL_CONFIDENCE, MAX_ERROR_SHARE = 400, 0.95, 0.9
UNRELAXED_SHARES = np.arange(0.02, 0.31, 0.02).tolist()  # by hand: candidates up to a third
UNRELAXED_TIMES_S = (0.3, 1.0, 3.0, 10.0, 30.0, 100.0)  # by hand: candidates of decay times
FORCE_SLICE = slice(0, 3)

GelErrors = Callable[[SensorModel], Array]


@dataclass(frozen=True)
class IdentifiedGel:
    """Poisson's ratio and thickness, each with its bootstrap interval at GEL_CONFIDENCE.

    error_share: force error on unseen positions over that with the design's gel, geometric mean of
    the three components.
    """

    poisson: float
    poisson_between: tuple[float, float]
    thickness_mm: float
    thickness_between_mm: tuple[float, float]
    error_share: float

    @property
    def line(self) -> str:
        (a, b), (c, d) = self.poisson_between, self.thickness_between_mm
        return (
            f"Gel fitted to the presses: Poisson's ratio {self.poisson:.3f} ({a:.3f} to {b:.3f}), "
            f"thickness {self.thickness_mm:.2f} mm ({c:.2f} to {d:.2f}); force error "
            f"{self.error_share:.2f} of that with the design's gel"
        )


def identify_gel(
    runs: Sequence[Run], data: ForceData, view: SensorModel, progress: Progress | None = None
) -> IdentifiedGel | None:
    """Identify the gel by the features that depend on it; None if the presses do not determine it.

    None unless `is_identifiable`, or if the error falls by less than a tenth, or if bootstrapped
    presses favour the design's gel.
    """
    if not is_identifiable(data):
        return None
    rows = np.unique(np.linspace(0, len(data) - 1, min(MAX_SEARCH_FRAMES, len(data))).astype(int))
    subset = replace(data, points=data.points.iloc[rows], wrench=data.wrench[rows])
    return search_gel(view, error_function(list(point_flows(runs, subset)), subset), progress)


def is_identifiable(data: ForceData) -> bool:
    """True if points can determine a gel: MIN_PRESSES, three positions, no constant force."""
    few = data.points["press"].nunique() < MIN_PRESSES or data.points["position"].nunique() < 3
    return not few and bool((np.ptp(data.wrench[:, FORCE_SLICE], axis=0) > 0).all())


def error_function(flows: Sequence[FaceFlow], data: ForceData) -> GelErrors:
    """Return a function of a view: `squared_errors` of points with these flows."""

    def errors(view: SensorModel) -> Array:
        features = Inverse(view)
        X = np.array([features.compute(flow) for flow in flows])
        columns = {features.name: X}
        return squared_errors(replace(data, features=columns, sets={features.name: features}))

    return errors


def squared_errors(data: ForceData) -> Array:
    """Squared errors on unseen positions, summed by press (presses, 3), N^2."""
    residual = (predict_left_out(data, Inverse.name, "position")[0] - data.wrench)[:, FORCE_SLICE]
    _, press = np.unique(data.points["press"].to_numpy(), return_inverse=True)
    sums = np.zeros((press.max() + 1, 3))
    np.add.at(sums, press, residual**2)
    return sums


@dataclass(frozen=True)
class UnrelaxedForces:
    """Relative excess of labels taken before the gel relaxed: share x exp(-wait / time_s)."""

    share: float
    time_s: float

    @property
    def line(self) -> str:
        return (
            f"Labels taken without waiting were {self.share:.1%} too high (decay time "
            f"{self.time_s:g} s); all were corrected to the longest wait"
        )

    def relaxed_wrenches(self, data: ForceData) -> ForceData:
        """Return points with wrenches as they would be after the longest wait of fitted ones."""
        excess = 1 + self.share * np.exp(-data.points["wait_s"].to_numpy(float) / self.time_s)
        smallest = excess[data.has_role("fit")].min()
        return replace(data, wrench=data.wrench * (smallest / excess)[:, None])


def fit_unrelaxed(data: ForceData) -> UnrelaxedForces | None:
    """Fit the excess of early labels; None if all waited alike, or the excess is not certain."""
    wait_s = data.points["wait_s"].to_numpy(float)
    if not is_identifiable(data) or not wait_s.min() >= 0 or wait_s.max() <= 2 * wait_s.min():
        return None
    candidates = [UnrelaxedForces(0.0, 1.0)]
    candidates += [UnrelaxedForces(g, s) for s in UNRELAXED_TIMES_S for g in UNRELAXED_SHARES]
    errors = np.stack([squared_errors(c.relaxed_wrenches(data)) for c in candidates])
    best = int(np.log(errors.sum(axis=1)).sum(axis=1).argmin())
    scores = _bootstrap_scores(errors)
    certain = (scores[:, best] < scores[:, 0]).mean() >= GEL_CONFIDENCE
    return candidates[best] if best and certain else None


def _bootstrap_scores(errors: Array) -> Array:
    """Scores (BOOTSTRAP_DRAWS, n) of errors (n, presses, 3) with presses resampled."""
    n = errors.shape[1]
    counts = np.random.default_rng(0).multinomial(n, np.full(n, 1 / n), BOOTSTRAP_DRAWS)
    return np.asarray(np.log(np.einsum("dp,gpc->dgc", counts, errors)).sum(axis=2))


def search_gel(
    view: SensorModel, errors: GelErrors, progress: Progress | None = None
) -> IdentifiedGel | None:
    """Search the pair of least errors, from the view's on; None if not determined."""
    evaluated: dict[tuple[int, int], Array] = {}

    def gel_values(pair: Array | tuple[int, int]) -> tuple[float, float]:
        compressibility = (0.5 - view.poisson) * POISSON_STEP ** float(pair[0])
        return 0.5 - compressibility, view.skin.thickness_mm * (1 + THICKNESS_STEP * float(pair[1]))

    def score(pair: tuple[int, int]) -> float:
        poisson, thickness_mm = gel_values(pair)
        low, high = COMPRESSIBILITY_RANGE
        out_of_range = max(map(abs, pair)) > MAX_SEARCH_STEPS or not low <= 0.5 - poisson <= high
        if out_of_range and pair != (0, 0):
            return np.inf
        if pair not in evaluated:
            try:
                trial_view = view.with_gel(poisson, thickness_mm)
            except ValueError:
                return np.inf  # thinner than its proud part
            evaluated[pair] = errors(trial_view)
            if progress:
                progress(len(evaluated), max(30, len(evaluated)), "the gel that fits the presses")
        return float(np.log(evaluated[pair].sum(axis=0)).sum())

    best = (0, 0)
    if not np.isfinite(score(best)):
        return None  # too few other positions to leave one out
    for step in SEARCH_STEPS:
        while True:
            neighbours = [(best[0] + step * i, best[1] + step * j) for i, j in SEARCH_DIRECTIONS]
            candidate = min(neighbours, key=score)
            if score(candidate) >= score(best):
                break
            best = candidate
    # The winning pair of each bootstrap draw.
    pairs = list(evaluated)
    scores = _bootstrap_scores(np.stack([evaluated[pair] for pair in pairs]))
    better = scores[:, pairs.index(best)] < scores[:, pairs.index((0, 0))]
    gain = float(np.exp((score(best) - score((0, 0))) / 6))  # of squares, of three components
    if gain > MAX_ERROR_SHARE or better.mean() < GEL_CONFIDENCE:
        return None
    winners, tail = np.array(pairs)[scores.argmin(axis=1)], (1 - GEL_CONFIDENCE) / 2
    # Half a step more on either side: nothing was tried between steps.
    low, high = np.quantile(winners, [tail, 1 - tail], axis=0) + [[-0.5], [0.5]]
    (b, c), (a, d), (poisson, thickness_mm) = gel_values(low), gel_values(high), gel_values(best)
    return IdentifiedGel(poisson, (a, b), thickness_mm, (c, d), gain)
