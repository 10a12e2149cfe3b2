"""Exchange of candidate presses for the least mean predicted variance of a force model.

The model is the one that `calibrate force` fits: ordinary least squares of each force on its
features, with the prior of `Features.prior_scales`. Its errors are correlated within a place, a tip
and a press (`components`), so the variance of a coefficient is A S A, with A the inverse of the
normal equations and S = X' V X. The criterion averages the variance of all three forces over the
candidates, as in I-optimality, and an exchange swaps a press for the best candidate until nothing
improves (Fedorov, Theory of Optimal Experiments, 1972).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from deltact_fab.common import Array
from deltact_fab.estimate import SensorModel, make_features

from .components import FORCE_MODEL

FITTED_AXES = ("fx", "fy", "fz")
CURVATURE_MM2 = 0.03 / 8**2
"""Decision 0024: the centre gives some 3 % more force than a place 8 mm off; what the prior of the
place's term, which is 0, may be wrong by."""
MAX_PASSES = 30  # by hand: exchanges end after three or four
_LEAST_GAIN = 1e-9  # relative, of an exchange; by hand: above rounding
_TINY_RIDGE = 1e-12  # by hand: keeps the equations of a force that no press has solvable


def force_regressors(features: Array) -> tuple[Array, float]:
    """Regressors (m, 2, 3, 2) of the three forces, and the prior of the second coefficient in mm2.

    features (m, 2, 9): of the press and of its drag's end, in N.
    """
    model = make_features(FORCE_MODEL, SensorModel())
    columns = [[model.names.index(n) for n in model.explains[axis]] for axis in FITTED_AXES]
    return features[..., columns], max(model.prior_scales.values())


@dataclass(frozen=True)
class Exchange:
    """Choice of presses among m candidates.

    rows (m, r, c, k): regressors of r stops and c forces, the first one the force in N; its
    coefficient is about 1. places, tips, levels (m,): codes. mean_squares (4,): of the error
    components; drift as a share of the force of a press. prior_mm2: see `force_regressors`.
    """

    rows: Array
    places: Array
    tips: Array
    levels: Array
    mean_squares: Array
    prior_mm2: float

    @cached_property
    def _gram(self) -> Array:
        return np.einsum("mrck,mrcl->mckl", self.rows, self.rows)

    @cached_property
    def _load(self) -> Array:
        return np.einsum("mrc,mrck->mck", self.rows[..., 0], self.rows)

    @cached_property
    def _moments(self) -> tuple[Array, Array]:
        """Mean products of the regressors (c, k, k), and mean loads by tip (tips, c, k)."""
        stops = self.rows.shape[1]
        by_tip = [self._load[self.tips == tip].mean(axis=0) / stops for tip in self._tip_codes]
        return self._gram.mean(axis=0) / stops, np.array(by_tip)

    @cached_property
    def _tip_codes(self) -> Array:
        return np.unique(self.tips)

    def sums(self, chosen: Sequence[int]) -> tuple[Array, Array, Array, Array]:
        """Sums over presses: products, squared loads, loads by place and by tip."""
        index, shape = list(chosen), self._load.shape[1:]
        by_place = np.zeros((int(self.places.max()) + 1, *shape))
        by_tip = np.zeros((len(self._tip_codes), *shape))
        np.add.at(by_place, self.places[index], self._load[index])
        np.add.at(by_tip, np.searchsorted(self._tip_codes, self.tips[index]), self._load[index])
        squares = _outer(self._load[index]).sum(axis=0)
        return self._gram[index].sum(axis=0), squares, by_place, by_tip

    def criterion(self, chosen: Iterable[int]) -> float:
        """Mean predicted variance in N2 at a place that was not pressed, of all forces."""
        index = list(chosen)
        gram, squares, by_place, by_tip = self.sums(index)
        grouped = _outer(by_place).sum(axis=0)
        return float(self._variance(gram, grouped, squares, by_tip, len(index)))

    def _variance(
        self, gram: Array, grouped: Array, squares: Array, by_tip: Array, count: int
    ) -> Array:
        """Variance (...) of sums (..., c, k, k), loads by tip (..., tips, c, k)."""
        repeat, place, tip, drift = self.mean_squares
        moments, tip_moments = self._moments
        k = gram.shape[-1]
        prior = np.zeros(gram.shape)
        if k > 1:  # as in `ForceModel.fit`: in proportion to the mean square of the force
            stops = count * self.rows.shape[1]
            prior[..., 1, 1] = self.prior_mm2**2 * gram[..., 0, 0] / stops
        inverse = np.linalg.inv(gram + prior + _TINY_RIDGE * np.eye(k))
        spread = repeat * gram + place * grouped + drift * squares
        spread = spread + tip * np.einsum("...tck,...tcl->...ckl", by_tip, by_tip)
        if k > 1:
            curvature = np.zeros((k, k))
            curvature[1, 1] = CURVATURE_MM2**2
            spread = spread + prior @ curvature @ prior
        shared = np.einsum("tck,...ckl,...tcl->...", tip_moments, inverse, by_tip)
        trace = np.einsum("ckl,...clk->...", moments, inverse @ spread @ inverse)
        unseen = (place + tip + drift) * moments[:, 0, 0] + repeat
        return np.asarray(trace - 2 * tip * shared / len(self._tip_codes) + unseen.sum())

    def improve(self, chosen: Sequence[int]) -> list[int]:
        """Exchange presses for candidates of the same level until none improves the criterion."""
        design = list(chosen)
        best = self.criterion(design)
        for _ in range(MAX_PASSES):
            previous = best
            for position, index in enumerate(design):
                gram, squares, by_place, by_tip = self.sums(
                    design[:position] + design[position + 1 :]
                )
                options = np.flatnonzero(self.levels == self.levels[index])
                load, places = self._load[options], self.places[options]
                grouped = _outer(by_place).sum(axis=0) - _outer(by_place[places])
                grouped = grouped + _outer(by_place[places] + load)
                tips = np.tile(by_tip, (len(options), 1, 1, 1))
                tip_index = np.searchsorted(self._tip_codes, self.tips[options])
                tips[np.arange(len(options)), tip_index] += load
                gram, squares = gram + self._gram[options], squares + _outer(load)
                values = self._variance(gram, grouped, squares, tips, len(design))
                k = int(values.argmin())
                if values[k] < best - _LEAST_GAIN * abs(best):
                    design[position], best = int(options[k]), float(values[k])
            if previous - best <= _LEAST_GAIN * abs(previous):
                break
        return design

    def design(self, count: int, rng: np.random.Generator, starts: int = 8) -> list[int]:
        """Choose presses, all levels equally often: the best of some exchanges from random ones."""
        codes = np.unique(self.levels)
        shares = np.resize(codes[::-1], count)
        designs = []
        for _ in range(starts):
            start = [int(rng.choice(np.flatnonzero(self.levels == level))) for level in shares]
            designs.append(self.improve(start))
        return sorted(min(designs, key=self.criterion))


def _outer(load: Array) -> Array:
    """Products (..., k, k) of vectors (..., k) with themselves."""
    return np.asarray(load[..., :, None] * load[..., None, :])
