"""The random colours around each dot: an identity of its own on a dense pattern.

A regular grid looks the same after a shift by one pitch, the colours around its dots do not: a
ring of them is sampled, deformed by the local affine motion of the neighbours, and must correlate
with the ring of the first image.
"""

from __future__ import annotations

import cv2
import numpy as np

from ...aliases import Array
from ..compose import sample

MAX_ALIKE = 0.3  # median correlation of the rings of different dots


class Rings:
    """The rings of all dots, between two radii in pixels of an image reduced by `shrink`.

    Centres are places in the full image, (n, 2) px; images are reduced and smoothed ones.
    """

    def __init__(self, inner_px: float, outer_px: float, shrink: int) -> None:
        self._shrink = shrink
        radii = np.arange(min(inner_px, outer_px), outer_px + 1e-9, 2.0)
        self._ring = np.concatenate(
            [
                r * np.stack((np.cos(a), np.sin(a)), -1)
                for r in radii
                for a in [np.arange(max(8, int(np.pi * r))) * (2 * np.pi / max(8, int(np.pi * r)))]
            ]
        )
        # Orthonormal basis of 1, x, y on the ring.
        self._plane = np.linalg.qr(np.column_stack((np.ones(len(self._ring)), self._ring)))[0]
        self._first: Array | None = None

    def smooth(self, small: Array) -> Array:
        """Colours are compared at the scale of a patch, not of a pixel."""
        return cv2.GaussianBlur(small, (0, 0), 1.5 / self._shrink)

    def remember(self, image: Array, centre: Array, min_texture: float) -> bool:
        """Take the rings of the first image, (n, 2) centres with NaN; False if they tell nothing.

        min_texture: standard deviation in grey levels that half of the rings have at least. The
        skirts of the next dots have that too, but give all rings one look.
        """
        found = np.isfinite(centre[:, 0])
        unit = np.repeat(np.eye(2)[None], len(centre), axis=0)
        rings = self._sample(image, np.nan_to_num(centre), unit)
        self._first = None
        if np.median(rings.std(axis=1).mean(axis=1)[found]) < min_texture:
            return False
        first = _normalised(rings)
        if np.median(first[found] @ first[found].T) > MAX_ALIKE:
            return False
        first[~found] = 0.0
        self._first = first
        return True

    def alike(self, image: Array, dots: Array, centre: Array, affine: Array) -> Array:
        """(m,) correlation of m dots, by number, with their first rings; centre (m, 2)."""
        assert self._first is not None
        now = _normalised(self._sample(image, centre, affine))
        ncc: Array = np.einsum("nk,nk->n", now, self._first[dots])
        return ncc

    def best(
        self, image: Array, dots: Array, centre: Array, affine: Array, least: float
    ) -> tuple[Array, Array]:
        """Dots and places that are each other's best: rows of `dots` and of `centre`."""
        assert self._first is not None
        ncc = self._first[dots] @ _normalised(self._sample(image, centre, affine)).T
        rows, best = np.arange(len(dots)), np.argmax(ncc, axis=1)
        sure = (np.argmax(ncc, axis=0)[best] == rows) & (ncc[rows, best] >= least)
        return rows[sure], best[sure]

    def _sample(self, image: Array, centre: Array, affine: Array) -> Array:
        """(n, k, 3) colours on each dot's deformed ring, less their plane: shading has no say."""
        centre = (centre + 0.5) / self._shrink - 0.5
        points = centre[:, None, :] + self._ring @ affine.transpose(0, 2, 1)
        rings = sample(image, points.astype(np.float32)).astype(np.float64)
        return rings - self._plane @ (self._plane.T @ rings)


def _normalised(rings: Array) -> Array:
    """(n, k, 3) to (n, 3 k) of unit length."""
    flat = rings.reshape(len(rings), -1)
    return flat / np.maximum(np.linalg.norm(flat, axis=1, keepdims=True), 1e-9)
