"""One step of the refinement in machine code; the same figures as `kernel_cv2`, to rounding.

Importing it needs numba, which the extra `fast` brings.
"""

from __future__ import annotations

from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]
NAME = "numba"
_REACH = 3  # cells that a window reaches to each side of its own
_SUMS = 5


def cells(planes: Array) -> Array:
    """Reference planes (12, rows, cols) as the loop reads them: (rows, 12, cols)."""
    return np.ascontiguousarray(planes.transpose(1, 0, 2))


def target(image: Array) -> Array:
    """Four pixels of a row from each one on, in one word: (rows, stride - 3) uint32."""
    words = np.zeros((image.shape[0], image.shape[1]), np.uint32)
    wide = image.astype(np.uint32)
    words[:, :-3] = wide[:, :-3] | wide[:, 1:-2] << 8 | wide[:, 2:-1] << 16 | wide[:, 3:] << 24
    return words


def step(
    words: Array, reference: Array, nodes: Array, size_px: tuple[int, int], flow: Array, last: bool
) -> tuple[Array, Array]:
    """See `kernel_cv2.step`."""
    rows, cols = flow.shape[1:]
    shape = (rows, cols) if last else (0, 0)
    correlation, variance = np.zeros(shape, np.float32), np.zeros(shape, np.float32)
    _step(
        words.reshape(-1), words.shape[1], reference, nodes, size_px[0], size_px[1],
        flow[0], flow[1], last, correlation, variance,
    )  # fmt: skip
    return correlation, variance


@numba.njit(cache=True, fastmath={"contract", "reassoc", "nsz"}, error_model="numpy")
def _step(
    words: Any, stride: int, reference: Any, nodes: Any, height: int, width: int,
    ux: Any, uy: Any, last: bool, correlation: Any, variance: Any,
) -> None:  # fmt: skip
    rows, cols = ux.shape
    seen_rows, seen_cols = height // 2, width // 2
    right, bottom = np.float32(width - 2), np.float32(height - 2)
    zero, one = np.float32(0), np.float32(1)
    at = np.empty(cols, np.int64)
    a, b, c = np.empty(cols, np.uint32), np.empty(cols, np.uint32), np.empty(cols, np.uint32)
    ax, ay, seen = (
        np.empty(cols, np.float32),
        np.empty(cols, np.float32),
        np.zeros(cols, np.float32),
    )
    ring = np.zeros((2 * _REACH + 1, _SUMS, cols), np.float32)
    column = np.zeros((_SUMS, cols + 2 * _REACH), np.float32)
    box = np.empty((_SUMS, cols), np.float32)
    for i in range(rows + _REACH):
        into = ring[i % (2 * _REACH + 1)]
        if i < seen_rows:
            for j in range(seen_cols):
                x, y = np.float32(2 * j) + ux[i, j], np.float32(2 * i) + uy[i, j]
                ok = (x >= zero) & (x <= right) & (y >= zero) & (y <= bottom)
                x, y = min(max(x, zero), right), min(max(y, zero), bottom)
                xi, yi = np.int32(x), np.int32(y)
                ax[j], ay[j] = x - np.float32(xi), y - np.float32(yi)
                seen[j] = one if ok else zero
                at[j] = np.int64(yi) * stride + np.int64(xi)
            for j in range(seen_cols):
                k = at[j]
                a[j], b[j], c[j] = words[k], words[k + stride], words[k + 2 * stride]
            r = reference[i]
            for j in range(seen_cols):
                fx, fy, m = ax[j], ay[j], seen[j]
                p0, p1, p2 = (
                    np.float32(a[j] & 255),
                    np.float32((a[j] >> 8) & 255),
                    np.float32((a[j] >> 16) & 255),
                )
                q0, q1, q2 = (
                    np.float32(b[j] & 255),
                    np.float32((b[j] >> 8) & 255),
                    np.float32((b[j] >> 16) & 255),
                )
                s0, s1, s2 = (
                    np.float32(c[j] & 255),
                    np.float32((c[j] >> 8) & 255),
                    np.float32((c[j] >> 16) & 255),
                )
                p0, p1 = p0 + fx * (p1 - p0), p1 + fx * (p2 - p1)
                q0, q1 = q0 + fx * (q1 - q0), q1 + fx * (q2 - q1)
                s0, s1 = s0 + fx * (s1 - s0), s1 + fx * (s2 - s1)
                off = np.float32(128)
                d0 = m * (r[0, j] + off - (p0 + fy * (q0 - p0)))
                d1 = m * (r[1, j] + off - (p1 + fy * (q1 - p1)))
                d2 = m * (r[2, j] + off - (q0 + fy * (s0 - q0)))
                d3 = m * (r[3, j] + off - (q1 + fy * (s1 - q1)))
                into[0, j] = d0 * r[4, j] + d1 * r[5, j] + d2 * r[6, j] + d3 * r[7, j]
                into[1, j] = d0 * r[8, j] + d1 * r[9, j] + d2 * r[10, j] + d3 * r[11, j]
                into[2, j] = d0 + d1 + d2 + d3
                into[3, j] = d0 * r[0, j] + d1 * r[1, j] + d2 * r[2, j] + d3 * r[3, j]
                into[4, j] = d0 * d0 + d1 * d1 + d2 * d2 + d3 * d3
        else:
            into[:] = 0
        i0 = i - _REACH
        if i0 < 0:
            continue
        for k in range(_SUMS if last else _SUMS - 1):
            for j in range(cols):
                column[k, _REACH + j] = (
                    ring[0, k, j] + ring[1, k, j] + ring[2, k, j] + ring[3, k, j]
                    + ring[4, k, j] + ring[5, k, j] + ring[6, k, j]
                )  # fmt: skip
            line = column[k]
            for j in range(cols):
                box[k, j] = (
                    line[j] + line[j + 1] + line[j + 2] + line[j + 3]
                    + line[j + 4] + line[j + 5] + line[j + 6]
                )  # fmt: skip
        n = nodes[i0]
        if last:
            for j in range(cols):
                i11, i12, i22 = n[0, j], n[1, j], n[2, j]
                dx = i11 * box[0, j] + i12 * box[1, j] - n[3, j] * box[2, j] - n[5, j] * box[3, j]
                dy = i12 * box[0, j] + i22 * box[1, j] - n[4, j] * box[2, j] - n[6, j] * box[3, j]
                power = n[8, j]
                shared = box[3, j] - n[7, j] * box[2, j]
                rest = max(box[4, j] - box[2, j] * box[2, j] * n[9, j], zero)
                seen_power = max(power - np.float32(2) * shared + rest, n[10, j])
                correlation[i0, j] = min(
                    max((power - shared) / np.sqrt(power * seen_power), -one), one
                )
                explained = (i22 * dx * dx - np.float32(2) * i12 * dx * dy + i11 * dy * dy) / (
                    i11 * i22 - i12 * i12
                )
                variance[i0, j] = max(rest - shared * shared / power - explained, zero)
                ux[i0, j] += min(max(dx, -one), one)
                uy[i0, j] += min(max(dy, -one), one)
        else:
            for j in range(cols):
                i11, i12, i22 = n[0, j], n[1, j], n[2, j]
                dx = i11 * box[0, j] + i12 * box[1, j] - n[3, j] * box[2, j] - n[5, j] * box[3, j]
                dy = i12 * box[0, j] + i22 * box[1, j] - n[4, j] * box[2, j] - n[6, j] * box[3, j]
                ux[i0, j] += min(max(dx, -one), one)
                uy[i0, j] += min(max(dy, -one), one)
