"""Putting flows together: sampling, composition, and what neighbours say where one is lost.

A flow F is (h, w, 2) float32 in px: the material at pixel x of its first image lies at x + F(x) in
its second. All flows of one sequence share the image size.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import cv2
import numpy as np

from deltact_fab.common import Array

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


def is_inside(points_px: Array, height_px: int, width_px: int) -> Array:
    """Which points (..., 2) lie within the image, edges of the outer pixels' centres included."""
    x, y = points_px[..., 0], points_px[..., 1]
    within: Array = (x >= 0) & (x <= width_px - 1) & (y >= 0) & (y <= height_px - 1)
    return within


def sample(field: Array, points_px: Array) -> Array:
    """Bilinear samples of an image or a float32 field (h, w[, c]) at (a, b, 2) float32 points.

    Points outside read the nearest pixel of the border.
    """
    return cv2.remap(field, points_px, _NO_MAP2, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)


def shrink(image: Array, side: int) -> Array:
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


CELL = 4  # nodes to a side of a cell
WINDOWS = (5, 13, 33, 97)  # cells to a side
ENOUGH = 0.15  # share of a window that must be known before it is believed alone
_BOTH = np.ones((1, 2), np.float32)
NOISE_NODES = 13  # to a side of the window over which noise is told from motion
SLOPES = 0.3  # cells^2: how far known cells must lie apart before their slope is believed


def fill_gaps(flow: Array, reliable: Array, valid: Array) -> Array:
    """The flow, (h, w, 2) float32, where it is kept; elsewhere what its known neighbours say.

    known, kept: (h, w) bool. Around each cell a plane is fitted to the known nodes (normalised
    convolution of the first order, Knutsson and Westin 1993), over the smallest window that knows
    enough and wider ones for the rest. With nothing known the flow is 0.
    """
    if valid.all():
        return flow
    h, w = valid.shape
    weight = reliable.astype(np.float32)
    n, u, v = (shrink(part, CELL) for part in (weight, *(f * weight for f in cv2.split(flow))))
    # A node is interpolated between its cell and the next ones.
    gap_mask = (shrink((~valid).astype(np.float32), CELL) > 0).astype(np.uint8)
    gaps = cv2.dilate(gap_mask, np.ones((3, 3), np.uint8)) > 0
    x, y = np.meshgrid(*(np.arange(s) - s / 2 for s in n.shape[::-1]))
    sums = np.dstack(
        [n, n * x, n * y, n * x * x, n * x * y, n * y * y, u, u * x, u * y, v, v * x, v * y]
    )
    values, total = (np.zeros((*n.shape, 2), np.float32), np.zeros(np.count_nonzero(gaps)))
    gap_xy = x[gaps], y[gaps]
    sums_uv = np.zeros((2, total.size))
    for window in WINDOWS:
        side = min(window, 2 * max(n.shape) - 1)
        near = cv2.blur(sums, (side, side), borderType=cv2.BORDER_CONSTANT)[gaps].T
        share = np.clip(near[0] / ENOUGH, 0, 1) * (1 - total)
        sums_uv += share * _planes(*gap_xy, near)
        total += share
        if total.min(initial=1.0) > 0.999:
            break
    values[gaps] = (sums_uv / np.maximum(total, 1e-6)).T
    out = cv2.resize(values, None, fx=CELL, fy=CELL, interpolation=cv2.INTER_LINEAR)[:h, :w]
    return cv2.copyTo(flow, valid.view(np.uint8), np.ascontiguousarray(out))


def denoise(flow: Array, deviation_px: Array, valid: Array) -> Array:
    """The flow (h, w, 2) float32 with less of its noise, which is white beside the motion.

    Wiener's filter as Lee (1980) made it local: of what a node has over the mean of its window only
    the share stays that is more than the noise, `deviation_px` (h, w) where it is `kept`.
    """
    window, rim = (NOISE_NODES, NOISE_NODES), cv2.BORDER_REFLECT
    smooth = cv2.blur(flow, window, borderType=rim)
    fine = flow - smooth
    power = cv2.blur(cv2.transform(fine * fine, _BOTH), window, borderType=rim)
    noise = cv2.blur(deviation_px * deviation_px * valid, window, borderType=rim)
    share = np.maximum(1 - noise / np.maximum(power, np.float32(1e-12)), 0)
    return np.asarray(smooth + fine * cv2.merge((share, share)))


def _planes(x: Array, y: Array, sums: Array) -> Array:
    """The values at (x, y), each (n,), of the planes fitted to sums (12, n): (2, n)."""
    mx, my, xx, xy, yy, *moments = sums[1:] / np.maximum(sums[0], 1e-12)
    xx, xy, yy = xx - mx * mx + SLOPES, xy - mx * my, yy - my * my + SLOPES
    dx, dy = x - mx, y - my
    a, b = (yy * dx - xy * dy), (xx * dy - xy * dx)
    u, ux, uy, v, vx, vy = moments
    det = xx * yy - xy * xy
    return np.stack(
        [m + (a * (mmx - mx * m) + b * (mmy - my * m)) / det
         for m, mmx, mmy in ((u, ux, uy), (v, vx, vy))]
    )  # fmt: skip
