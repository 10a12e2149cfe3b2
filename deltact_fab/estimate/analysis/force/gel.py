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
from .judge import left_out

AWAY, THICKER = 1.25, 0.01  # a step: factor of 1/2 - Poisson's ratio, share of the thickness
STEPS = (4, 2, 1)  # of a search round the best pair, one after the other
WAYS = ((1, 0), (-1, 0), (0, 1), (0, -1), (1, -1), (-1, 1))  # a thinner, softer gel looks alike
FARTHEST = 8  # steps of either from what was believed
AWAY_RANGE = (0.002, 0.1)  # of 1/2 - Poisson's ratio
FRAMES = 120  # that are looked at, spread over all
DRAWS, SURE = 400, 0.95
WORTH = 0.9  # of the error: the best of many pairs is a little better by chance
SHARES, TIMES_S = np.arange(0.02, 0.31, 0.02).tolist(), (0.3, 1.0, 3.0, 10.0, 30.0, 100.0)
FORCES = slice(0, 3)

Errors = Callable[[SensorModel], Array]


@dataclass(frozen=True)
class FoundGel:
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
) -> FoundGel | None:
    """By the features that rest on the gel; None where the presses do not tell it.

    They do not where `can_tell` denies it, where it gains less than a tenth, or where redrawn
    presses would as soon keep what is believed.
    """
    if not can_tell(data):
        return None
    rows = np.unique(np.linspace(0, len(data) - 1, min(FRAMES, len(data))).astype(int))
    some = replace(data, points=data.points.iloc[rows], wrench=data.wrench[rows])
    return search(view, errors_of(list(point_flows(runs, some)), some), progress)


def can_tell(data: ForceData) -> bool:
    """Whether points can tell a gel: MIN_PRESSES, three positions, and no force the same always."""
    few = data.points["press"].nunique() < MIN_PRESSES or data.points["position"].nunique() < 3
    return not few and bool((np.ptp(data.wrench[:, FORCES], axis=0) > 0).all())


def errors_of(flows: Sequence[FaceFlow], data: ForceData) -> Errors:
    """Of a view: `squared_errors` of points with these flows."""

    def errors(view: SensorModel) -> Array:
        features = Inverse(view)
        X = np.array([features.of(flow) for flow in flows])
        known = {features.name: X}
        return squared_errors(replace(data, features=known, sets={features.name: features}))

    return errors


def squared_errors(data: ForceData) -> Array:
    """What each press adds to the squared errors of left-out positions (presses, 3)."""
    off = (left_out(data, Inverse.name, "position")[0] - data.wrench)[:, FORCES]
    _, of = np.unique(data.points["press"].to_numpy(), return_inverse=True)
    added = np.zeros((of.max() + 1, 3))
    np.add.at(added, of, off**2)
    return added


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

    def mended(self, data: ForceData) -> ForceData:
        """With wrenches as they would be after the longest wait."""
        more = 1 + self.share * np.exp(-data.points["wait_s"].to_numpy(float) / self.time_s)
        return replace(data, wrench=data.wrench * (more.min() / more)[:, None])


def early_labels(data: ForceData) -> UnrelaxedForces | None:
    """What the presses tell of it; None where all waited alike, or nothing is sure."""
    wait_s = data.points["wait_s"].to_numpy(float)
    if not can_tell(data) or not wait_s.min() >= 0 or wait_s.max() <= 2 * wait_s.min():
        return None
    tried = [UnrelaxedForces(0.0, 1.0)]
    tried += [UnrelaxedForces(share, time_s) for time_s in TIMES_S for share in SHARES]
    each = np.stack([squared_errors(one.mended(data)) for one in tried])
    best = int(np.log(each.sum(axis=1)).sum(axis=1).argmin())
    scores = _redrawn(each)
    return tried[best] if best and (scores[:, best] < scores[:, 0]).mean() >= SURE else None


def _redrawn(each: Array) -> Array:
    """Scores (DRAWS, n) of errors (n, presses, 3) with presses drawn again."""
    n = each.shape[1]
    drawn = np.random.default_rng(0).multinomial(n, np.full(n, 1 / n), DRAWS)
    return np.asarray(np.log(np.einsum("dp,gpc->dgc", drawn, each)).sum(axis=2))


def search(view: SensorModel, errors: Errors, progress: Progress | None = None) -> FoundGel | None:
    """The pair under which the errors are least, from the believed one on; None: not told."""
    seen: dict[tuple[int, int], Array] = {}

    def at(pair: Array | tuple[int, int]) -> tuple[float, float]:
        away = (0.5 - view.poisson) * AWAY ** float(pair[0])
        return 0.5 - away, view.skin.thickness_mm * (1 + THICKER * float(pair[1]))

    def score(pair: tuple[int, int]) -> float:
        poisson, thickness_mm = at(pair)
        low, high = AWAY_RANGE
        beyond = max(map(abs, pair)) > FARTHEST or not low <= 0.5 - poisson <= high
        if beyond and pair != (0, 0):
            return np.inf
        if pair not in seen:
            try:
                tried = view.with_gel(poisson, thickness_mm)
            except ValueError:
                return np.inf  # thinner than what stands proud of it
            seen[pair] = errors(tried)
            if progress:
                progress(len(seen), max(30, len(seen)), "the gel that fits the presses")
        return float(np.log(seen[pair].sum(axis=0)).sum())

    best = (0, 0)
    if not np.isfinite(score(best)):
        return None  # some position cannot be left out: the others are too few
    for step in STEPS:
        while True:
            near = [(best[0] + step * i, best[1] + step * j) for i, j in WAYS]
            found = min(near, key=score)
            if score(found) >= score(best):
                break
            best = found
    # Presses drawn again: which pair would have been taken.
    pairs = list(seen)
    scores = _redrawn(np.stack([seen[pair] for pair in pairs]))
    better = scores[:, pairs.index(best)] < scores[:, pairs.index((0, 0))]
    gain = float(np.exp((score(best) - score((0, 0))) / 6))  # of squares, of three components
    if gain > WORTH or better.mean() < SURE:
        return None
    taken = np.array(pairs)[scores.argmin(axis=1)]
    # Half a step more on either side, for between steps nothing was tried.
    low, high = np.quantile(taken, [(1 - SURE) / 2, (1 + SURE) / 2], axis=0) + [[-0.5], [0.5]]
    (b, c), (a, d), (poisson, thickness_mm) = at(low), at(high), at(best)
    return FoundGel(poisson, (a, b), thickness_mm, (c, d), gain)
