"""Flow composition: sampling, concatenation, and filling of gaps from neighbours.

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
    """Return x + F(x), (h, w, 2) float32: position of each pixel of the first image."""
    landed: Array = pixel_grid(*flow.shape[:2]) + flow
    return landed


def is_inside(points_px: Array, height_px: int, width_px: int) -> Array:
    """True for points (..., 2) within the image, the centres of the outer pixels included."""
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

    Incomplete cells at the end are padded with the border pixel.
    """
    h, w = image.shape[:2]
    down, right = -h % side, -w % side
    if down or right:
        image = cv2.copyMakeBorder(image, 0, down, 0, right, cv2.BORDER_REPLICATE)
    return cv2.resize(image, None, fx=1 / side, fy=1 / side, interpolation=cv2.INTER_AREA)


def compose(first: Array, second: Array) -> Array:
    """Return F(x) = first(x) + second(x + first(x)).

    first: flow from image 0 to image k; second: from image k to image n; both (h, w, 2) float32.
    The result is the flow from 0 to n, at pixels of image 0. Where the first flow leaves the image
    the second is read at the border: mask those pixels.
    """
    return np.add(first, sample(second, landing_px(first)))


CELL_NODES = 4  # nodes along a cell; by hand: larger cells are faster and blur the filled motion
FILL_WINDOW_CELLS = (5, 13, 33, 97)  # by hand: smallest window first, each 2.5 to 3 times larger
MIN_KNOWN_SHARE = 0.15  # of a window to rely on it alone; by hand: less fits planes to few nodes
_SUM_UV = np.ones((1, 2), np.float32)
SMOOTH_CELLS, WIDE_CELLS, ROUGH_CELLS = 7, 15, 5  # triangular windows of `denoise`; decision 0061
NOISE_LEFT = np.float32(0.2)  # of its power, by means over SMOOTH_CELLS; 0.13 of white noise
ROUGH_FACTOR = np.float32(1.5)  # by hand: more loses contacts, less keeps the rims of bubbles
SLOPE_RIDGE = 0.3  # ridge on the plane's slopes; by hand: more turns planes into means


def fill_gaps(flow: Array, reliable: Array, valid: Array) -> Array:
    """Replace the flow, (h, w, 2) float32, where it is not valid, by planes through its neighbours.

    reliable, valid: (h, w) bool, nodes to fit to and nodes to keep. Around each cell a plane is
    fitted to the reliable nodes (normalised convolution of the first order, Knutsson and Westin
    1993), over the smallest window with enough of them. Without any the flow is 0.
    """
    if valid.all():
        return flow
    weight = reliable.astype(np.float32)
    weighted = (f * weight for f in cv2.split(flow))
    n, u, v = (shrink(part, CELL_NODES) for part in (weight, *weighted))
    # A node is interpolated between its cell and the next ones.
    gap_mask = (shrink((~valid).astype(np.float32), CELL_NODES) > 0).astype(np.uint8)
    gaps = cv2.dilate(gap_mask, np.ones((3, 3), np.uint8)) > 0
    x, y = np.meshgrid(*(np.arange(s) - s / 2 for s in n.shape[::-1]))
    sums = np.dstack(
        [n, n * x, n * y, n * x * x, n * x * y, n * y * y, u, u * x, u * y, v, v * x, v * y]
    )
    values, total = (np.zeros((*n.shape, 2), np.float32), np.zeros(np.count_nonzero(gaps)))
    gap_xy = x[gaps], y[gaps]
    sums_uv = np.zeros((2, total.size))
    for window in FILL_WINDOW_CELLS:
        side = min(window, 2 * max(n.shape) - 1)
        near = cv2.blur(sums, (side, side), borderType=cv2.BORDER_CONSTANT)[gaps].T
        share = np.clip(near[0] / MIN_KNOWN_SHARE, 0, 1) * (1 - total)
        sums_uv += share * _planes(*gap_xy, near)
        total += share
        if total.min(initial=1.0) > 0.999:
            break
    values[gaps] = (sums_uv / np.maximum(total, 1e-6)).T
    filled = np.ascontiguousarray(_expand(values, valid.shape))
    return cv2.copyTo(flow, valid.view(np.uint8), filled)


def denoise(flow: Array, deviation_px: Array, valid: Array) -> tuple[Array, Array]:
    """Return the flow (h, w, 2) float32 with its white noise reduced; its roughness (h, w) px^2.

    Wiener filter (Lee 1980) on two scales: a cell's difference from the means around is scaled by
    the share of the power there that exceeds the cell's own noise, `deviation_px` (h, w) where it
    is `valid`. Roughness is the squared error to expect where the flow is rougher than its noise:
    a wrong match, or motion finer than a fit's window.
    """
    cells, noise = (shrink(a, CELL_NODES) for a in (flow, deviation_px * deviation_px * valid))
    smooth = _smooth(cells, SMOOTH_CELLS)
    fine = flow - _expand(smooth, valid.shape)
    signal = _signal(shrink(fine * fine, CELL_NODES), noise, SMOOTH_CELLS)
    broad = _smooth(smooth, WIDE_CELLS)
    rest = smooth - broad
    broad += rest * _signal(rest * rest, NOISE_LEFT * noise, WIDE_CELLS)
    rough, window = cells - _smooth(cells, ROUGH_CELLS), (ROUGH_CELLS, ROUGH_CELLS)
    excess = cv2.stackBlur(cv2.transform(rough * rough, _SUM_UV) - noise, window)
    fine *= _expand(signal, valid.shape)
    fine += _expand(broad, valid.shape)
    return fine, _expand(ROUGH_FACTOR * np.maximum(excess, 0), valid.shape)


def _smooth(cells: Array, side: int) -> Array:
    """Means over a window, and those of what they leave: a curved flow keeps its height."""
    mean = cv2.stackBlur(cells, (side, side))
    return mean + cv2.stackBlur(cells - mean, (side, side))


def _signal(squares: Array, noise: Array, side: int) -> Array:
    """Return the share of the power over a window that exceeds the noise (h, w), (h, w, 2)."""
    power = cv2.stackBlur(cv2.transform(squares, _SUM_UV), (side, side))
    share = np.maximum(1 - noise / np.maximum(power, np.float32(1e-12)), 0)
    return cv2.merge((share, share))


def _expand(cells: Array, shape: tuple[int, ...]) -> Array:
    """Interpolate cells at the nodes of a grid of that shape."""
    nodes = cv2.resize(cells, None, fx=CELL_NODES, fy=CELL_NODES, interpolation=cv2.INTER_LINEAR)
    return nodes[: shape[0], : shape[1]]


def _planes(x: Array, y: Array, sums: Array) -> Array:
    """Return the values (2, n) at (x, y), each (n,), of the planes fitted to sums (12, n)."""
    mx, my, xx, xy, yy, *moments = sums[1:] / np.maximum(sums[0], 1e-12)
    xx, xy, yy = xx - mx * mx + SLOPE_RIDGE, xy - mx * my, yy - my * my + SLOPE_RIDGE
    dx, dy = x - mx, y - my
    a, b = (yy * dx - xy * dy), (xx * dy - xy * dx)
    u, ux, uy, v, vx, vy = moments
    det = xx * yy - xy * xy
    return np.stack(
        [m + (a * (mmx - mx * m) + b * (mmy - my * m)) / det
         for m, mmx, mmy in ((u, ux, uy), (v, vx, vy))]
    )  # fmt: skip
