"""Which blob is which dot: by their neighbours, and by the colours around them where there are any.

What the order of nearness says is only a first guess. Every match has to stand the checks of
`skin` and `colours`, and one that does not is given up: a dot is right or it is lost.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from .colours import Rings
from .detect import Blobs
from .rule import DotRule
from .skin import Skin, mutual

Array = NDArray[Any]


class Identities:
    """Follows the dots of a skin through the blobs of frame after frame.

    first_px: (n, 2) places in the first frame, NaN for a dot that is not in it and is never
    reported; area_px: (n,) areas there. rings: what remembers the colours, None without any.
    `image` below is then the smoothed one that they are sampled in.
    """

    def __init__(
        self,
        skin: Skin,
        rule: DotRule,
        first_px: Array,
        area_px: Array,
        rings: Rings | None = None,
    ) -> None:
        self._skin, self._rule, self._rings = skin, rule, rings
        self._gate_px = rule.gate_pitch * skin.pitch_px
        self.first_px = first_px
        self._known = np.isfinite(first_px[:, 0])
        self._area_px = area_px
        self._seen = first_px.copy()
        self._shape = first_px.copy()  # the last places known of all dots, for a new start
        self._motion = np.zeros_like(first_px)
        self._blob = np.full(len(first_px), -1)  # of each dot found in the frame at hand

    def follow(self, blobs: Blobs, image: Array | None = None) -> tuple[Array, Array, int]:
        """(n, 2) places, NaN where lost; (n,) likeness of the colours; how many were refused."""
        n = len(self.first_px)
        position, ncc, refused = np.full((n, 2), np.nan), np.full(n, np.nan), 0
        if len(blobs):
            # 1. Dots seen in the last frame, by their last place and the motion around them
            expected = self._seen + self._motion
            rule = self._rule
            match = self._skin.grow(expected, blobs.centre_px, self._gate_px, rule.step_tolerance)
            self._take(position, np.flatnonzero(match >= 0), match[match >= 0], blobs)
            ncc, refused = self._check(position, blobs, image)
            ncc, more = self._find_lost(position, ncc, blobs, image)
            refused += more
        self._remember(position)
        return position, ncc, refused

    def _find_lost(
        self, position: Array, ncc: Array, blobs: Blobs, image: Array | None
    ) -> tuple[Array, int]:
        n, refused = len(position), 0
        # 2. Where the neighbours' affine motion puts a dot; what is found helps its neighbours
        for _ in range(6):
            lost = self._known & ~np.isfinite(position[:, 0])
            free = self._free(position, blobs)
            if not lost.any() or not len(free):
                return ncc, refused
            _, at, good = self._skin.fit(self.first_px, position)
            at[~(good & lost)] = np.nan
            who, which = mutual(at, blobs.centre_px[free], self._gate_px)
            if not len(who):
                break
            before = n - lost.sum()
            self._take(position, who, free[which], blobs)
            ncc, more = self._check(position, blobs, image)
            refused += more
            if np.isfinite(position[:, 0]).sum() <= before:
                break
        # 3. Dots that moved beyond any prediction
        lost = np.flatnonzero(self._known & ~np.isfinite(position[:, 0]))
        free = self._free(position, blobs)
        if len(lost) <= 0.1 * n or not len(free):
            return ncc, refused
        if self._rings is not None and image is not None:
            matrix = np.median(self._skin.affine(self.first_px, position), axis=0)
            who, which = self._rings.best(
                image,
                lost,
                blobs.centre_px[free],
                np.repeat(matrix[None], len(free), axis=0),
                self._rule.ncc_found,
            )
            self._take(position, lost[who], free[which], blobs)
        elif len(lost) == self._known.sum():
            who, which = self._as_a_whole(blobs.centre_px)
            self._take(position, who, which, blobs)
        else:
            return ncc, refused
        ncc, more = self._check(position, blobs, image)
        return ncc, refused + more

    def _as_a_whole(self, blobs: Array) -> tuple[Array, Array]:
        """All dots anew, by the one shift of their last places that explains far more than others.

        A grid that fills the view looks the same after a shift by a pitch: then none does.
        """
        from scipy.spatial import cKDTree

        nothing = np.zeros(0, int), np.zeros(0, int)
        known = np.flatnonzero(self._known)
        shape = self._shape[known]
        middle = shape[np.argmin(np.hypot(*(shape - np.median(shape, axis=0)).T))]
        shifts = blobs - middle
        places = shape[None] + shifts[:, None]
        hit = cKDTree(blobs).query(places.reshape(-1, 2))[0].reshape(len(shifts), -1)
        count = (hit < 0.5 * self._gate_px).sum(axis=1)
        first, *others = np.sort(count)[::-1]
        enough = max(4, self._rule.min_found_share * len(known))
        if first < enough or (others and others[0] > first - max(3, 0.03 * first)):
            return nothing
        expected = np.full_like(self._shape, np.nan)
        expected[known] = shape + shifts[np.argmax(count)]
        return mutual(expected, blobs, self._gate_px)

    def _take(self, position: Array, who: Array, which: Array, blobs: Blobs) -> None:
        position[who] = blobs.centre_px[which]
        self._blob[who] = which

    def _free(self, position: Array, blobs: Blobs) -> Array:
        taken = self._blob[np.isfinite(position[:, 0])]
        return np.setdiff1d(np.arange(len(blobs)), taken)

    def _check(self, position: Array, blobs: Blobs, image: Array | None) -> tuple[Array, int]:
        """Order, identity and area; what fails is set to NaN. Returns likeness and how many."""
        before = int(np.isfinite(position[:, 0]).sum())
        self._skin.keep_order(position)
        ncc = np.full(len(position), np.nan)
        if self._rings is not None and image is not None:
            have = np.flatnonzero(np.isfinite(position[:, 0]))
            if len(have):
                matrix = self._skin.affine(self.first_px, position)[have]
                ncc[have] = self._rings.alike(image, have, position[have], matrix)
            position[~(ncc >= self._rule.ncc_min)] = np.nan
        have = np.flatnonzero(np.isfinite(position[:, 0]))
        if len(have):
            swelling = np.abs(np.linalg.det(self._skin.affine(self.first_px, position)[have]))
            expected = self._area_px[have] * np.clip(swelling, 0.1, 10.0)
            ratio = blobs.area_px[self._blob[have]] / expected
            limit = self._rule.area_factor
            position[have[(ratio > limit) | (ratio < 1 / limit)]] = np.nan
        return ncc, before - int(np.isfinite(position[:, 0]).sum())

    def _remember(self, position: Array) -> None:
        near = (position - self._seen)[self._skin.near]
        have = np.isfinite(near[..., 0]).any(axis=1)
        self._motion = np.zeros_like(position)
        if have.any():
            self._motion[have] = np.nanmedian(near[have], axis=1)
        found = np.isfinite(position[:, 0])
        if found.any():
            _, at, good = self._skin.fit(self.first_px, position)
            self._shape = np.where(good[:, None], at, self._shape)
            self._shape[found] = position[found]
        self._seen = position
