"""One step of the refinement with cv2 and numpy, where numba is absent."""

from __future__ import annotations

import cv2
import numpy as np

from ...aliases import Array
from ..compose import landing_px

NAME = "cv2"
# A box of 6 of a box of 5 of a box of 2: its transfer function has hardly a negative part, which
# steps would amplify.
WINDOW = np.array([1, 3, 5, 7, 9, 10, 9, 7, 5, 3, 1], np.float32)
# Independent noise in the pixels weighs so much more, squared, than one pixel does.
OWN_WEIGHT = float(np.sum(WINDOW**2) ** 2 / np.sum(WINDOW) ** 2)
MIN_VARIANCE = 0.25  # grey levels^2: less is no texture
ROUNDING = 1 / 6  # variance of the difference of two images of whole grey levels
MAX_STEP_PX = 1.0
MIN_CONTRAST = 0.05  # of the current image to the reference
_ROWS = 32
_SOFT = np.array([0.25, 0.5, 0.25], np.float32)


def reference(image: Array) -> Array:
    """What a step needs to know of the reference image, by cell: (14, rows, cols) float32.

    Value, x gradient and y gradient (central differences) of each of four pixels, then the sum of
    the values and of their squares.
    """
    gray = image.astype(np.float32) - 128
    gradients = (
        cv2.Sobel(gray, -1, dx, 1 - dx, ksize=1, scale=0.5, borderType=cv2.BORDER_REPLICATE)
        for dx in (1, 0)
    )
    parts = [a[i::2, j::2] for a in (gray, *gradients) for i in (0, 1) for j in (0, 1)]
    return np.stack([*parts, sum(parts[:4]), sum(r * r for r in parts[:4])])


def target(image: Array) -> Array:
    """The four pixels of the cell that begins at each pixel, less 128: (rows, cols, 4) float32."""
    wide = cv2.copyMakeBorder(image, 0, 1, 0, 1, cv2.BORDER_REPLICATE)
    corners = cv2.merge([wide[:-1, :-1], wide[:-1, 1:], wide[1:, :-1], wide[1:, 1:]])
    return np.subtract(corners, 128, dtype=np.float32)


def around(cells: Array) -> Array:
    """Weighted sums over the window, with nothing outside."""
    return np.asarray(cv2.sepFilter2D(cells, -1, WINDOW, WINDOW, borderType=cv2.BORDER_CONSTANT))


def step(
    corners: Array, reference: Array, nodes: Array, size_px: tuple[int, int], flow: Array,
    light: Array, gain: float,
) -> tuple[Array, Array]:  # fmt: skip
    """One step of every node, then one pass of 1 2 1 over the flow.

    corners: of `target`; reference: of `reference`; nodes (rows, 10, cols), see `fused`; size_px
    (height, width) of the image within its padding; flow (2, rows, cols) float32 px. light
    (2, rows, cols) float32: what a change of light makes of reference less current image there,
    light[0] + light[1] * reference; it stands in where the current image does not show a pixel, so
    that the pixel does not pull. gain: how much more noise the chain of steps passes than one fit.
    Returns the new flow and, if gain is positive, (3, rows, cols) over what the current image shows
    of the windows: correlation and deviation in px of the flow that was given, and the squared
    length of the step over the contrast, px^2.
    """
    last = gain > 0
    height, width = size_px
    rows, cols = flow.shape[1:]
    inner = np.s_[: height // 2, : width // 2]
    x = flow[0][inner] + np.arange(0, width - 1, 2, dtype=np.float32)
    y = flow[1][inner] + np.arange(0, height - 1, 2, dtype=np.float32)[:, None]
    hidden = (x < 0) | (x > width - 2) | (y < 0) | (y > height - 2)
    found = cv2.split(cv2.remap(corners, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE))
    sums = np.zeros((8 if last else 4, rows, cols), np.float32)
    part = [s[inner] for s in sums]
    r = [plane[inner] for plane in reference]
    offset, slope = (a[inner][hidden] for a in light)
    for k, d in enumerate(found):
        cv2.subtract(r[k], d, d)
        d[hidden] = offset + slope * r[k][hidden]
        cv2.accumulateProduct(d, r[4 + k], part[0])
        cv2.accumulateProduct(d, r[8 + k], part[1])
        cv2.accumulate(d, part[2])
        cv2.accumulateProduct(d, r[k], part[3])
        if last:
            cv2.accumulateSquare(d, part[4])
    if last and hidden.any():
        np.multiply(hidden, np.float32(4), out=part[5])
        np.multiply(hidden, r[12], out=part[6])
        np.multiply(hidden, r[13], out=part[7])
    n_sums = 8 if last and sums[5].any() else min(5, len(sums))
    for k in range(n_sums):
        sums[k] = around(sums[k])
    step_px, told = np.empty_like(flow), np.empty((3, rows if last else 0, cols), np.float32)
    for i in range(0, rows, _ROWS):  # what lies between stays in the cache
        cut = np.s_[i : i + _ROWS]
        node = nodes[cut].transpose(1, 0, 2)
        step_px[:, cut] = _solved(sums[:4, cut], node)
        if last:
            told[:, cut] = _judged(sums[:, cut], node, light[:, cut], step_px[:, cut], gain)
    step_px += flow
    for u in step_px:
        cv2.sepFilter2D(u, -1, _SOFT, _SOFT, u, borderType=cv2.BORDER_REPLICATE)
    return step_px, told


def _solved(sums: Array, node: Array) -> Array:
    sx, sy, sd, sr = sums
    i11, i12, i22, ex, ey, fx, fy = node[:7]
    dx = i11 * sx + i12 * sy - ex * sd - fx * sr
    dy = i12 * sx + i22 * sy - ey * sd - fy * sr
    return np.clip((dx, dy), -MAX_STEP_PX, MAX_STEP_PX)


def _judged(
    sums: Array, node: Array, light: Array, step_px: Array, gain: float
) -> tuple[Array, Array, Array]:
    _, _, sd, sr, squares, hidden_n, hidden_r, hidden_rr = sums
    a, b = light
    sd = sd - a * hidden_n - b * hidden_r
    sr = sr - a * hidden_r - b * hidden_rr
    squares = squares - a * a * hidden_n - 2 * a * b * hidden_r - b * b * hidden_rr
    i11, i12, i22, *_, all_mean, all_power, weights = node
    dx, dy = step_px
    n_seen = np.maximum(weights - hidden_n, OWN_WEIGHT)
    total = weights * all_mean
    mean = (total - hidden_r) / n_seen
    power = all_power + total * all_mean - hidden_rr - n_seen * mean * mean
    power = np.maximum(power, MIN_VARIANCE * n_seen)
    shared = sr - mean * sd
    rest = np.maximum(squares - sd * sd / n_seen, 0)
    current_power = np.maximum(power - 2 * shared + rest, MIN_VARIANCE * n_seen)
    correlation = np.clip((power - shared) / np.sqrt(power * current_power), -1, 1)
    correlation[hidden_n >= weights - OWN_WEIGHT] = 0
    explained = (i22 * dx * dx - 2 * i12 * dx * dy + i11 * dy * dy) / (i11 * i22 - i12 * i12)
    left = np.maximum(rest - shared * shared / power - explained, 0)
    noise = left / np.maximum(weights - hidden_n - 4 * OWN_WEIGHT, OWN_WEIGHT) + ROUNDING
    spread = (i11 + i22) * weights / n_seen
    contrast = np.maximum((power - shared) / power, MIN_CONTRAST)
    ahead = (dx * dx + dy * dy) / (contrast * contrast)
    return correlation, np.sqrt(gain**2 * OWN_WEIGHT * noise * spread), ahead


def stands(
    flow: Array, correlation: Array, deviation: Array, textured: Array,
    least: tuple[float, float, float, float], shape: tuple[int, int],
) -> tuple[Array, Array]:  # fmt: skip
    """Nodes whose own flow stands, and those of them that are fit to agree, both (hh, ww) bool.

    flow (hh, ww, 2) px, correlation and deviation (hh, ww): of `Refined`. textured (hh, ww) bool.
    least: the correlation and det F that are kept above, the deviation in px that agrees below, and
    how far from the edge of the image, px. shape: of the image (h, w).
    """
    least_correlation, least_det, most_deviation, border_px = least
    kept = (correlation > least_correlation) & (det_f(flow) > least_det) & within(flow, shape, 0.0)
    agreeing = kept & textured & (deviation < most_deviation) & within(flow, shape, border_px)
    return np.asarray(kept), np.asarray(agreeing)


def det_f(flow: Array) -> Array:
    """det(I + grad u) of a flow on the half grid: a node's area now, its area before being 1."""
    ux, uy = cv2.split(flow)
    xx, xy, yx, yy = (
        cv2.Sobel(u, cv2.CV_32F, *axis, ksize=1, scale=0.25, borderType=cv2.BORDER_REPLICATE)
        for u in (ux, uy)
        for axis in ((1, 0), (0, 1))
    )
    return np.asarray((1 + xx) * (1 + yy) - xy * yx)


def within(flow: Array, shape: tuple[int, int], margin_px: float) -> Array:
    """Which nodes land inside the image and so far from its edge, (hh, ww) bool."""
    h, w = shape
    landing = landing_px(flow * np.float32(0.5))
    # Node j lies at pixel 2 j + 1/2.
    low = (margin_px / 2 - 0.25,) * 2
    high = ((w - 1 - margin_px) / 2 - 0.25, (h - 1 - margin_px) / 2 - 0.25)
    return cv2.inRange(landing, np.array(low), np.array(high)).view(bool)
