"""One step of the refinement with cv2 and numpy, where numba is absent."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]
NAME = "cv2"
WINDOW = np.float32([1, 2, 3, 4, 5, 5, 5, 4, 3, 2, 1])  # a box of 7 of a box of 5
MAX_STEP_PX = 1.0
_SOFT = np.float32([0.25, 0.5, 0.25])


def reference(image: Array) -> Array:
    """Value and gradients of a cell's four pixels apart: (3, 4, rows, cols) float32."""
    gray = image.astype(np.float32) - 128
    gx, gy = gradients(gray)
    return np.stack([[a[i::2, j::2] for i in (0, 1) for j in (0, 1)] for a in (gray, gx, gy)])


def target(image: Array) -> Array:
    """The four pixels of the cell that begins at each pixel: (rows, cols, 4) float32."""
    wide = cv2.copyMakeBorder(image, 0, 1, 0, 1, cv2.BORDER_REPLICATE)
    corners = cv2.merge([wide[:-1, :-1], wide[:-1, 1:], wide[1:, :-1], wide[1:, 1:]])
    return np.asarray(corners, np.float32)


def gradients(gray: Array) -> tuple[Array, Array]:
    """Central differences of an image, along x and along y."""
    gx, gy = (
        cv2.Sobel(gray, -1, dx, 1 - dx, ksize=1, scale=0.5, borderType=cv2.BORDER_REPLICATE)
        for dx in (1, 0)
    )
    return gx, gy


def around(cells: Array) -> Array:
    """Weighted sums over the window, with nothing outside."""
    return cv2.sepFilter2D(cells, -1, WINDOW, WINDOW, borderType=cv2.BORDER_CONSTANT)


def step(
    corners: Array, reference: Array, nodes: Array, size_px: tuple[int, int], flow: Array,
    last: bool,
) -> tuple[Array, Array, Array]:  # fmt: skip
    """One step of every node, then one pass of 1 2 1 over the flow.

    corners: of `target`; reference: of `reference`; nodes (11, rows, cols), see `fused`; size_px
    (height, width) of the image within its padding; flow (2, rows, cols) float32 px. Returns the
    new flow and, if `last`, of the flow that was given the correlation and the weighted sum of
    squares of what the fit leaves, each (rows, cols).
    """
    height, width = size_px
    rows, cols = flow.shape[1:]
    seen_rows, seen_cols = height // 2, width // 2
    inner = np.s_[..., :seen_rows, :seen_cols]
    x = flow[0][inner] + np.arange(0, 2 * seen_cols, 2, dtype=np.float32)
    y = flow[1][inner] + np.arange(0, 2 * seen_rows, 2, dtype=np.float32)[:, None]
    seen = (x >= 0) & (x <= width - 2) & (y >= 0) & (y <= height - 2)
    mask = seen.astype(np.float32)
    found = cv2.split(cv2.remap(corners, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE))
    sums = np.zeros((5 if last else 4, rows, cols), np.float32)
    part = sums[inner]
    for current, r, gx, gy in zip(found, *reference[inner], strict=True):
        d: Array = cv2.subtract(r, current)
        d += np.float32(128)
        d *= mask
        cv2.accumulateProduct(d, gx, part[0])
        cv2.accumulateProduct(d, gy, part[1])
        cv2.accumulate(d, part[2])
        cv2.accumulateProduct(d, r, part[3])
        if last:
            cv2.accumulateSquare(d, part[4])
    sx, sy, sd, sr, *squares = map(around, sums)
    i11, i12, i22, ex, ey, fx, fy, mean, power, one_over, least = nodes
    dx = np.clip(i11 * sx + i12 * sy - ex * sd - fx * sr, -MAX_STEP_PX, MAX_STEP_PX)
    dy = np.clip(i12 * sx + i22 * sy - ey * sd - fy * sr, -MAX_STEP_PX, MAX_STEP_PX)
    moved = np.stack(
        [
            cv2.sepFilter2D(u + du, -1, _SOFT, _SOFT, borderType=cv2.BORDER_REPLICATE)
            for u, du in zip(flow, (dx, dy), strict=True)
        ]
    )
    if not last:
        return moved, sums[:0], sums[:0]
    shared = sr - mean * sd
    rest = np.maximum(squares[0] - sd * sd * one_over, 0)
    seen_power = np.maximum(power - 2 * shared + rest, least)
    correlation = np.clip((power - shared) / np.sqrt(power * seen_power), -1, 1)
    explained = (i22 * dx * dx - 2 * i12 * dx * dy + i11 * dy * dy) / (i11 * i22 - i12 * i12)
    return moved, correlation, np.maximum(rest - shared * shared / power - explained, 0)
