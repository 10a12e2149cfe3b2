"""The gel that presses tell: Poisson's ratio and thickness, beside what the design believes, and
how much of its force had not relaxed when a label was taken.

Both change how the face answers pressure and shear at once, so a belief that is off puts the
force off by some per cent wherever it was not calibrated. Presses at known places tell them: the
pair is taken under which left-out positions are predicted best, all three forces alike.
On gels of another solver, two of them, it found the true pair (docs/evidence/strangers.md).
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

POISSON_STEP, THICKNESS_STEP = (
    1.25,
    0.01,
)  # a step: factor of 1/2 - Poisson's ratio, share of the thickness
SEARCH_STEPS = (4, 2, 1)  # of a search round the best pair, one after the other
SEARCH_DIRECTIONS = (
    (1, 0),
    (-1, 0),
    (0, 1),
    (0, -1),
    (1, -1),
    (-1, 1),
)  # a thinner, softer gel looks alike
MAX_SEARCH_STEPS = 8  # steps of either from what was believed
COMPRESSIBILITY_RANGE = (0.002, 0.1)  # of 1/2 - Poisson's ratio
MAX_SEARCH_FRAMES = 120  # that are looked at, spread over all
BOOTSTRAP_DRAWS, BOOTSTRAP_CONFIDENCE = 400, 0.95
MAX_ERROR_SHARE = 0.9  # of the error: the best of many pairs is a little better by chance
UNRELAXED_SHARES, UNRELAXED_TIMES_S = (
    np.arange(0.02, 0.31, 0.02).tolist(),
    (0.3, 1.0, 3.0, 10.0, 30.0, 100.0),
)
FORCE_SLICE = slice(0, 3)

GelErrors = Callable[[SensorModel], Array]


@dataclass(frozen=True)
class IdentifiedGel:
    """Poisson's ratio and thickness, each with the interval of a share SURE of redrawn presses.

    error_share: the force's error of left-out positions over that with what was believed, mean
    (geometric) of the three components.
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
            f"Fitted to the presses, the gel has a Poisson's ratio of {self.poisson:.3f} "
            f"({a:.3f} to {b:.3f}) and is {self.thickness_mm:.2f} mm thick ({c:.2f} to {d:.2f}); "
            f"with it the force's error is {self.error_share:.2f} of that with the design's"
        )


def identify_gel(
    runs: Sequence[Run], data: ForceData, view: SensorModel, progress: Progress | None = None
) -> IdentifiedGel | None:
    """By the features that rest on the gel; None where the presses do not tell it.

    They do not where `can_tell` denies it, where it gains less than a tenth, or where redrawn
    presses would as soon keep what is believed.
    """
    if not is_identifiable(data):
        return None
    rows = np.unique(np.linspace(0, len(data) - 1, min(MAX_SEARCH_FRAMES, len(data))).astype(int))
    subset = replace(data, points=data.points.iloc[rows], wrench=data.wrench[rows])
    return search_gel(view, error_function(list(point_flows(runs, subset)), subset), progress)


def is_identifiable(data: ForceData) -> bool:
    """Whether points can tell a gel: MIN_PRESSES, three positions, and no force the same always."""
    few = data.points["press"].nunique() < MIN_PRESSES or data.points["position"].nunique() < 3
    return not few and bool((np.ptp(data.wrench[:, FORCE_SLICE], axis=0) > 0).all())


def error_function(flows: Sequence[FaceFlow], data: ForceData) -> GelErrors:
    """Of a view: `squared_errors` of points with these flows."""

    def errors(view: SensorModel) -> Array:
        features = Inverse(view)
        X = np.array([features.compute(flow) for flow in flows])
        columns = {features.name: X}
        return squared_errors(replace(data, features=columns, sets={features.name: features}))

    return errors


def squared_errors(data: ForceData) -> Array:
    """What each press adds to the squared errors of left-out positions (presses, 3)."""
    residual = (predict_left_out(data, Inverse.name, "position")[0] - data.wrench)[:, FORCE_SLICE]
    _, press = np.unique(data.points["press"].to_numpy(), return_inverse=True)
    sums = np.zeros((press.max() + 1, 3))
    np.add.at(sums, press, residual**2)
    return sums


@dataclass(frozen=True)
class UnrelaxedForces:
    """How much more force a label had that was taken at once: share x exp(-wait / time_s)."""

    share: float
    time_s: float

    @property
    def line(self) -> str:
        return (
            f"Labels taken at once were {self.share:.1%} too high, fading in {self.time_s:g} s; "
            "all were brought to the longest wait"
        )

    def relaxed_wrenches(self, data: ForceData) -> ForceData:
        """With wrenches as they would be after the longest wait."""
        excess = 1 + self.share * np.exp(-data.points["wait_s"].to_numpy(float) / self.time_s)
        return replace(data, wrench=data.wrench * (excess.min() / excess)[:, None])


def fit_unrelaxed_forces(data: ForceData) -> UnrelaxedForces | None:
    """What the presses tell of it; None where all waited alike, or nothing is sure."""
    wait_s = data.points["wait_s"].to_numpy(float)
    if not is_identifiable(data) or not wait_s.min() >= 0 or wait_s.max() <= 2 * wait_s.min():
        return None
    candidates = [UnrelaxedForces(0.0, 1.0)]
    candidates += [
        UnrelaxedForces(share, time_s) for time_s in UNRELAXED_TIMES_S for share in UNRELAXED_SHARES
    ]
    errors = np.stack(
        [squared_errors(candidate.relaxed_wrenches(data)) for candidate in candidates]
    )
    best = int(np.log(errors.sum(axis=1)).sum(axis=1).argmin())
    scores = _bootstrap_scores(errors)
    return (
        candidates[best]
        if best and (scores[:, best] < scores[:, 0]).mean() >= BOOTSTRAP_CONFIDENCE
        else None
    )


def _bootstrap_scores(errors: Array) -> Array:
    """Scores (DRAWS, n) of errors (n, presses, 3) with presses drawn again."""
    n = errors.shape[1]
    counts = np.random.default_rng(0).multinomial(n, np.full(n, 1 / n), BOOTSTRAP_DRAWS)
    return np.asarray(np.log(np.einsum("dp,gpc->dgc", counts, errors)).sum(axis=2))


def search_gel(
    view: SensorModel, errors: GelErrors, progress: Progress | None = None
) -> IdentifiedGel | None:
    """The pair under which the errors are least, from the believed one on; None: not told."""
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
                return np.inf  # thinner than what stands proud of it
            evaluated[pair] = errors(trial_view)
            if progress:
                progress(len(evaluated), max(30, len(evaluated)), "the gel that fits the presses")
        return float(np.log(evaluated[pair].sum(axis=0)).sum())

    best = (0, 0)
    if not np.isfinite(score(best)):
        return None  # some position cannot be left out: the others are too few
    for step in SEARCH_STEPS:
        while True:
            neighbours = [(best[0] + step * i, best[1] + step * j) for i, j in SEARCH_DIRECTIONS]
            candidate = min(neighbours, key=score)
            if score(candidate) >= score(best):
                break
            best = candidate
    # Presses drawn again: which pair would have been taken.
    pairs = list(evaluated)
    scores = _bootstrap_scores(np.stack([evaluated[pair] for pair in pairs]))
    better = scores[:, pairs.index(best)] < scores[:, pairs.index((0, 0))]
    gain = float(np.exp((score(best) - score((0, 0))) / 6))  # of squares, of three components
    if gain > MAX_ERROR_SHARE or better.mean() < BOOTSTRAP_CONFIDENCE:
        return None
    winners = np.array(pairs)[scores.argmin(axis=1)]
    # Half a step more on either side, for between steps nothing was tried.
    low, high = np.quantile(
        winners, [(1 - BOOTSTRAP_CONFIDENCE) / 2, (1 + BOOTSTRAP_CONFIDENCE) / 2], axis=0
    ) + [[-0.5], [0.5]]
    (b, c), (a, d), (poisson, thickness_mm) = gel_values(low), gel_values(high), gel_values(best)
    return IdentifiedGel(poisson, (a, b), thickness_mm, (c, d), gain)
