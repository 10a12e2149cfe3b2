"""Putting flows together: sampling, composition and inverse warping.

A flow F is (h, w, 2) float32 in px: the material at pixel x of its first image lies at x + F(x) in
its second. All flows of one sequence share the image size.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import cv2
import numpy as np

from ..aliases import Array

_NO_MAP2: Any = None  # cv2's type stubs do not know that remap takes one map of two channels


@lru_cache(maxsize=4)
def pixel_grid(height_px: int, width_px: int) -> Array:
    """Pixel centres (h, w, 2) float32 as (x, y), read-only."""
    x, y = np.meshgrid(
        np.arange(width_px, dtype=np.float32), np.arange(height_px, dtype=np.float32)
    )
    grid = np.ascontiguousarray(np.stack((x, y), axis=-1))
    grid.setflags(write=False)
    return grid


def landing_px(flow: Array) -> Array:
    """x + F(x), (h, w, 2) float32: where each pixel of the first image went."""
    landed: Array = pixel_grid(*flow.shape[:2]) + flow
    return landed


def inside(points_px: Array, height_px: int, width_px: int) -> Array:
    """Which points (..., 2) lie within the image, edges of the outer pixels' centres included."""
    x, y = points_px[..., 0], points_px[..., 1]
    within: Array = (x >= 0) & (x <= width_px - 1) & (y >= 0) & (y <= height_px - 1)
    return within


def sample(field: Array, points_px: Array) -> Array:
    """Bilinear samples of an image or a float32 field (h, w[, c]) at (a, b, 2) float32 points.

    Points outside read the nearest pixel of the border.
    """
    return cv2.remap(field, points_px, _NO_MAP2, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)


def shrunk(image: Array, side: int) -> Array:
    """Means over cells of side x side pixels, (ceil(h / side), ceil(w / side)[, c]).

    The last cells continue what they have.
    """
    h, w = image.shape[:2]
    down, right = -h % side, -w % side
    if down or right:
        image = cv2.copyMakeBorder(image, 0, down, 0, right, cv2.BORDER_REPLICATE)
    return cv2.resize(image, None, fx=1 / side, fy=1 / side, interpolation=cv2.INTER_AREA)


def compose(first: Array, second: Array) -> Array:
    """F(x) = first(x) + second(x + first(x)): the second flow is read where the first one lands.

    first: flow from image 0 to image k; second: from image k to image n; both (h, w, 2) float32.
    Returns the flow from 0 to n, at pixels of image 0. Where the first flow leaves the image the
    second is continued from the border: mask those pixels.
    """
    return np.add(first, sample(second, landing_px(first)))
