"""One step of the refinement with cv2 and numpy, where numba is absent."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]
NAME = "cv2"
MAX_STEP_PX = 1.0
_WINDOW = (7, 7)


def cells(planes: Array) -> Array:
    """Reference planes (12, rows, cols) float32 as the step reads them."""
    return np.ascontiguousarray(planes)


def target(image: Array) -> Array:
    """The four pixels of the cell that begins at each pixel: (rows, cols, 4) float32."""
    padded = cv2.copyMakeBorder(image, 0, 1, 0, 1, cv2.BORDER_REPLICATE).astype(np.float32)
    return cv2.merge([padded[:-1, :-1], padded[:-1, 1:], padded[1:, :-1], padded[1:, 1:]])


def step(
    corners: Array,
    reference: Array,
    nodes: Array,
    size_px: tuple[int, int],
    flow: Array,
    last: bool,
) -> tuple[Array, Array]:
    """One step of every node, in place.

    corners: of `target`; reference: of `cells`; nodes (rows, 11, cols), see `fused._nodes`;
    size_px (height, width) of the image within its padding; flow (2, rows, cols) float32 px.
    Returns the correlation and the sum of squares of what the fit leaves, each (rows, cols), of
    the flow that was given; empty unless `last`.
    """
    height, width = size_px
    rows, cols = flow.shape[1:]
    seen_rows, seen_cols = height // 2, width // 2
    x = flow[0, :seen_rows, :seen_cols] + np.arange(0, 2 * seen_cols, 2, dtype=np.float32)
    y = flow[1, :seen_rows, :seen_cols] + np.arange(0, 2 * seen_rows, 2, dtype=np.float32)[:, None]
    seen = (x >= 0) & (x <= width - 2) & (y >= 0) & (y <= height - 2)
    mask = seen.astype(np.float32)
    found = cv2.split(cv2.remap(corners, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE))
    sums = np.zeros((5, rows, cols), np.float32)
    part = [s[:seen_rows, :seen_cols] for s in sums]
    for k in range(4):
        r, gx, gy = (reference[k + 4 * q, :seen_rows, :seen_cols] for q in range(3))
        d: Array = cv2.subtract(r, found[k])
        d += np.float32(128)
        d *= mask
        cv2.accumulateProduct(d, gx, part[0])
        cv2.accumulateProduct(d, gy, part[1])
        cv2.accumulate(d, part[2])
        cv2.accumulateProduct(d, r, part[3])
        if last:
            cv2.accumulateSquare(d, part[4])
    sx, sy, sd, sr, sdd = (
        cv2.boxFilter(s, -1, _WINDOW, normalize=False, borderType=cv2.BORDER_CONSTANT) for s in sums
    )
    i11, i12, i22, ex, ey, fx, fy, mean, power, one_over, least = nodes.transpose(1, 0, 2)
    dx = i11 * sx + i12 * sy - ex * sd - fx * sr
    dy = i12 * sx + i22 * sy - ey * sd - fy * sr
    flow[0] += np.clip(dx, -MAX_STEP_PX, MAX_STEP_PX)
    flow[1] += np.clip(dy, -MAX_STEP_PX, MAX_STEP_PX)
    if not last:
        return sums[:0], sums[:0]
    shared = sr - mean * sd
    rest = np.maximum(sdd - sd * sd * one_over, 0)
    seen_power = np.maximum(power - 2 * shared + rest, least)
    correlation = np.clip((power - shared) / np.sqrt(power * seen_power), -1, 1)
    explained = (i22 * dx * dx - 2 * i12 * dx * dy + i11 * dy * dy) / (i11 * i22 - i12 * i12)
    return correlation, np.maximum(rest - shared * shared / power - explained, 0)
