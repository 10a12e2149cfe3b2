"""One step of the refinement in machine code; the same figures as `kernel_cv2`, to rounding.

Importing it needs numba, which the extra `fast` brings. The loops over a row are many and small:
only so does the compiler find that each may run on eight nodes at once.
"""

from __future__ import annotations

from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]
NAME = "numba"
_OUTER, _INNER = 7, 5  # the window: a box of a box
_REACH = (_OUTER + _INNER) // 2 - 1  # cells to each side of its own
_SUMS = 5
_BYTE = np.uint32(255)
_compiled = numba.njit(cache=True, fastmath={"contract", "reassoc", "nsz"}, error_model="numpy")


def reference(image: Array) -> Array:
    """A cell's four pixels apart, a cell more on each side: (rows + 2, 4, cols + 2) float32."""
    wide = np.pad(image, 2, mode="edge").astype(np.float32) - 128
    parts = [wide[i::2, j::2] for i in (0, 1) for j in (0, 1)]
    return np.ascontiguousarray(np.stack(parts, axis=1))


def target(image: Array) -> Array:
    """From each pixel on, three of its row in one word: (rows, cols) uint32."""
    words = np.empty(image.shape, np.uint32)
    _pack(image, words)
    return words


def step(
    words: Array, reference: Array, nodes: Array, size_px: tuple[int, int], flow: Array, last: bool
) -> tuple[Array, Array, Array]:
    """See `kernel_cv2.step`."""
    rows, cols = flow.shape[1:]
    out = np.empty_like(flow)
    correlation, left = np.empty((2, rows if last else 0, cols), np.float32)
    _step(words, reference, nodes, size_px[0], size_px[1], flow, last, out, correlation, left)
    return out, correlation, left


@_compiled
def _pack(image: Any, words: Any) -> None:
    rows, cols = image.shape
    for i in range(rows):
        for j in range(cols - 2):
            words[i, j] = (
                np.uint32(image[i, j])
                | (np.uint32(image[i, j + 1]) << np.uint32(8))
                | (np.uint32(image[i, j + 2]) << np.uint32(16))
            )
        words[i, cols - 2 :] = 0


@_compiled
def _step(
    words: Any, reference: Any, nodes: Any, height: int, width: int, flow: Any, last: bool,
    out: Any, correlation: Any, left: Any,
) -> None:  # fmt: skip
    rows, cols = flow.shape[1], flow.shape[2]
    seen_rows, seen_cols = height // 2, width // 2
    lines, stride = words.reshape(-1), words.shape[1]
    at = np.zeros(cols, np.uint32)
    found = np.zeros((3, cols), np.uint32)
    where = np.zeros((3, cols), np.float32)
    d = np.zeros((4, cols), np.float32)
    new = np.zeros((_SUMS, cols), np.float32)
    old = np.zeros((_OUTER, _SUMS, cols), np.float32)
    outer = np.zeros((_SUMS, cols), np.float32)
    old_outer = np.zeros((_INNER, _SUMS, cols), np.float32)
    column = np.zeros((_SUMS, cols + 2 * _REACH), np.float32)
    box = np.zeros((_SUMS, cols), np.float32)
    moved = np.zeros((2, cols + 2), np.float32)
    smooth = np.zeros((3, 2, cols), np.float32)
    n_sums = _SUMS if last else _SUMS - 1
    for i in range(rows + _REACH):
        if i < seen_rows:
            _address(flow[0, i], flow[1, i], i, seen_cols, height, width, stride, where, at)
            _gather(lines, stride, at, seen_cols, found)
            _difference(found, where, reference[i + 1], seen_cols, d)
            _sum(d, reference, i + 1, seen_cols, last, new)
        elif i == seen_rows:
            new[:] = 0
        for k in range(n_sums):
            _down(
                new[k], old[i % _OUTER, k], outer[k], old_outer[i % _INNER, k],
                column[k, _REACH : _REACH + cols],
            )  # fmt: skip
        i0 = i - _REACH
        if i0 < 0:
            continue
        for k in range(n_sums):
            _across(column[k], cols, box[k])
        _solve(box, nodes[:, i0], flow[:, i0], cols, moved)
        if last:
            _judge(box, nodes[:, i0], flow[:, i0], moved, cols, correlation[i0], left[i0])
        for k in range(2):
            moved[k, 0], moved[k, cols + 1] = moved[k, 1], moved[k, cols]
            _soften(moved[k], cols, smooth[i0 % 3, k])
            if i0 == 0:
                smooth[2, k] = smooth[0, k]
            else:
                _blend(smooth[(i0 + 1) % 3, k], smooth[(i0 + 2) % 3, k], smooth[i0 % 3, k],
                       out[k, i0 - 1])  # fmt: skip
    end = rows - 1
    for k in range(2):
        _blend(smooth[(end + 2) % 3, k], smooth[end % 3, k], smooth[end % 3, k], out[k, end])


@_compiled
def _address(
    ux: Any, uy: Any, i: int, n: int, height: int, width: int, stride: int, where: Any, at: Any
) -> None:
    right, bottom, top = np.float32(width - 2), np.float32(height - 2), np.float32(2 * i)
    zero, one = np.float32(0), np.float32(1)
    ax, ay, seen = where[0], where[1], where[2]
    for j in range(n):
        x, y = np.float32(2 * j) + ux[j], top + uy[j]
        ok = (x >= zero) & (x <= right) & (y >= zero) & (y <= bottom)
        x, y = min(max(x, zero), right), min(max(y, zero), bottom)
        xi, yi = np.int32(x), np.int32(y)
        ax[j], ay[j] = x - np.float32(xi), y - np.float32(yi)
        seen[j] = one if ok else zero
        at[j] = np.uint32(yi * stride + xi)


@_compiled
def _gather(lines: Any, stride: int, at: Any, n: int, found: Any) -> None:
    below, lowest = lines[stride:], lines[2 * stride :]
    a, b, c = found[0], found[1], found[2]
    for j in range(n):
        k = at[j]
        a[j], b[j], c[j] = lines[k], below[k], lowest[k]


@_compiled
def _difference(found: Any, where: Any, r: Any, n: int, d: Any) -> None:
    """Reference less current image at a row's cells, (4, cols); 0 outside."""
    a, b, c = found[0], found[1], found[2]
    ax, ay, seen = where[0], where[1], where[2]
    d0, d1, d2, d3 = d[0], d[1], d[2], d[3]
    r0, r1, r2, r3 = r[0, 1:], r[1, 1:], r[2, 1:], r[3, 1:]
    off = np.float32(128)
    for j in range(n):
        fx, fy, m = ax[j], ay[j], seen[j]
        p0 = np.float32(np.int32(a[j] & _BYTE))
        p1 = np.float32(np.int32((a[j] >> np.uint32(8)) & _BYTE))
        p2 = np.float32(np.int32(a[j] >> np.uint32(16)))
        q0 = np.float32(np.int32(b[j] & _BYTE))
        q1 = np.float32(np.int32((b[j] >> np.uint32(8)) & _BYTE))
        q2 = np.float32(np.int32(b[j] >> np.uint32(16)))
        s0 = np.float32(np.int32(c[j] & _BYTE))
        s1 = np.float32(np.int32((c[j] >> np.uint32(8)) & _BYTE))
        s2 = np.float32(np.int32(c[j] >> np.uint32(16)))
        p0, p1 = p0 + fx * (p1 - p0), p1 + fx * (p2 - p1)
        q0, q1 = q0 + fx * (q1 - q0), q1 + fx * (q2 - q1)
        s0, s1 = s0 + fx * (s1 - s0), s1 + fx * (s2 - s1)
        d0[j] = m * (r0[j] + off - (p0 + fy * (q0 - p0)))
        d1[j] = m * (r1[j] + off - (p1 + fy * (q1 - p1)))
        d2[j] = m * (r2[j] + off - (q0 + fy * (s0 - q0)))
        d3[j] = m * (r3[j] + off - (q1 + fy * (s1 - q1)))


@_compiled
def _sum(d: Any, reference: Any, i: int, n: int, last: bool, new: Any) -> None:
    """gx D, gy D, D, R D and D^2 over each cell of a row; gradients are central differences."""
    d0, d1, d2, d3 = d[0], d[1], d[2], d[3]
    r0, r1, r2, r3 = reference[i, 0], reference[i, 1], reference[i, 2], reference[i, 3]
    up2, up3, down0, down1 = (
        reference[i - 1, 2], reference[i - 1, 3], reference[i + 1, 0], reference[i + 1, 1],
    )  # fmt: skip
    s0, s1, s2, s3, s4 = new[0], new[1], new[2], new[3], new[4]
    half = np.float32(0.5)
    for j in range(n):
        k = j + 1
        s0[j] = half * (
            d0[j] * (r1[k] - r1[k - 1])
            + d1[j] * (r0[k + 1] - r0[k])
            + d2[j] * (r3[k] - r3[k - 1])
            + d3[j] * (r2[k + 1] - r2[k])
        )
    for j in range(n):
        k = j + 1
        s1[j] = half * (
            d0[j] * (r2[k] - up2[k])
            + d1[j] * (r3[k] - up3[k])
            + d2[j] * (down0[k] - r0[k])
            + d3[j] * (down1[k] - r1[k])
        )
    for j in range(n):
        k = j + 1
        s2[j] = d0[j] + d1[j] + d2[j] + d3[j]
        s3[j] = d0[j] * r0[k] + d1[j] * r1[k] + d2[j] * r2[k] + d3[j] * r3[k]
    if last:
        for j in range(n):
            s4[j] = d0[j] * d0[j] + d1[j] * d1[j] + d2[j] * d2[j] + d3[j] * d3[j]


@_compiled
def _down(new: Any, old: Any, outer: Any, old_outer: Any, column: Any) -> None:
    """The window's sums down the columns, carried on by one row."""
    for j in range(len(new)):
        s = outer[j] + (new[j] - old[j])
        old[j] = new[j]
        outer[j] = s
        column[j] += s - old_outer[j]
        old_outer[j] = s


@_compiled
def _across(v: Any, n: int, box: Any) -> None:
    two, three, four, five = np.float32(2), np.float32(3), np.float32(4), np.float32(5)
    for j in range(n):
        box[j] = (
            (v[j] + v[j + 10])
            + two * (v[j + 1] + v[j + 9])
            + three * (v[j + 2] + v[j + 8])
            + four * (v[j + 3] + v[j + 7])
            + five * (v[j + 4] + v[j + 5] + v[j + 6])
        )


@_compiled
def _solve(box: Any, node: Any, flow: Any, n: int, moved: Any) -> None:
    one = np.float32(1)
    b0, b1, b2, b3 = box[0], box[1], box[2], box[3]
    i11, i12, i22, ex, ey, fx, fy = (
        node[0], node[1], node[2], node[3], node[4], node[5], node[6],
    )  # fmt: skip
    ux, uy, mx, my = flow[0], flow[1], moved[0], moved[1]
    for j in range(n):
        dx = i11[j] * b0[j] + i12[j] * b1[j] - ex[j] * b2[j] - fx[j] * b3[j]
        mx[j + 1] = ux[j] + min(max(dx, -one), one)
    for j in range(n):
        dy = i12[j] * b0[j] + i22[j] * b1[j] - ey[j] * b2[j] - fy[j] * b3[j]
        my[j + 1] = uy[j] + min(max(dy, -one), one)


@_compiled
def _judge(box: Any, node: Any, flow: Any, moved: Any, n: int, correlation: Any, left: Any) -> None:
    zero, one, two = np.float32(0), np.float32(1), np.float32(2)
    for j in range(n):
        dx, dy = moved[0, j + 1] - flow[0, j], moved[1, j + 1] - flow[1, j]
        i11, i12, i22, power = node[0, j], node[1, j], node[2, j], node[8, j]
        shared = box[3, j] - node[7, j] * box[2, j]
        rest = max(box[4, j] - box[2, j] * box[2, j] * node[9, j], zero)
        current = max(power - two * shared + rest, node[10, j])
        correlation[j] = min(max((power - shared) / np.sqrt(power * current), -one), one)
        explained = (i22 * dx * dx - two * i12 * dx * dy + i11 * dy * dy) / (i11 * i22 - i12 * i12)
        left[j] = max(rest - shared * shared / power - explained, zero)


@_compiled
def _soften(v: Any, n: int, out: Any) -> None:
    quarter, half = np.float32(0.25), np.float32(0.5)
    for j in range(n):
        out[j] = quarter * (v[j] + v[j + 2]) + half * v[j + 1]


@_compiled
def _blend(above: Any, middle: Any, below: Any, out: Any) -> None:
    quarter, half = np.float32(0.25), np.float32(0.5)
    for j in range(len(out)):
        out[j] = quarter * (above[j] + below[j]) + half * middle[j]
