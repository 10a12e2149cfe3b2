"""One step of the refinement with its quality figures, compiled.

Many small loops over a row let the compiler vectorise each over eight nodes.
"""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np

from deltact_fab.common import Array, compile_loop

from .nodes import MIN_VARIANCE, OWN_WEIGHT

_ROUNDING_VARIANCE = 1 / 6  # exact: of the difference of two images of whole grey levels
_MAX_STEP_PX = 1.0  # by hand: larger steps leave the range of the linearisation
_LAST_STEP = 1.25  # of the fitted one: shows finer motion, as a third step would; decision 0015
_MIN_CONTRAST = 0.05  # of the current image to the reference; by hand: bounds `ahead_px2`
_OUTER_BOX, _INNER_BOX = 6, 5  # decision 0015: a box of 6 of a box of 5 of a box of 2
_REACH_CELLS = 5  # exact: of that window, to each side of its centre
_N_SUMS, _N_LAST_SUMS = 4, 8  # exact: of a step, and of the last
_BYTE_MASK = np.uint32(255)
_SMOOTH_KERNEL = np.array([0.25, 0.5, 0.25], np.float32)  # decision 0015


_compiled = compile_loop(error_model="numpy", nogil=True)


def step(
    image: Array, pixels: Array, normal: Array, phase: Array, size_px: tuple[int, int],
    flow: Array, light: Array, gain: float,
) -> tuple[Array, Array]:  # fmt: skip
    """One step of every node, then one pass of 1 2 1 over the flow.

    image: (h, w) uint8, the current one, padded by 4 px. pixels, normal, phase, size_px: of the
    reference, see `nodes`. flow: (2, rows, cols) float32 px. light: (2, rows, cols) float32, effect
    of changed light on reference less current image, light[0] + light[1] * reference; it replaces
    pixels that the current image does not show. gain: noise of the chain of steps over that of one
    fit. Returns the new flow and, if gain is positive, (3, rows, cols): correlation and deviation
    (px) of the input flow, and `RefinedFlow.ahead_px2`.
    """
    last = gain > 0
    rows, cols = flow.shape[1:]
    out = np.empty_like(flow)
    quality = np.empty((3, rows if last else 0, cols), np.float32)
    # Each word holds a pixel and the next three of its row.
    words: Array = np.ndarray((image.size - 3,), np.uint32, image, strides=(1,))
    _step(
        words, image.shape[1], pixels, normal, phase, size_px[0], size_px[1], flow, light, gain,
        out, quality
    )  # fmt: skip
    new, kernel = np.empty_like(out), _SMOOTH_KERNEL
    for plane, into in zip(out, new, strict=True):
        cv2.sepFilter2D(plane, -1, kernel, kernel, into, borderType=cv2.BORDER_REPLICATE)
    return new, quality


@_compiled
def _step(
    words: Any, stride: int, reference: Any, nodes: Any, phase: Any, height: int, width: int,
    flow: Any, light: Any, gain: float, out: Any, quality: Any
) -> None:  # fmt: skip
    rows, cols = flow.shape[1], flow.shape[2]
    seen_rows, seen_cols = height // 2, width // 2
    last = gain > 0
    n_sums = _N_LAST_SUMS if last else _N_SUMS
    index = np.zeros(cols, np.uint32)
    pixels = np.zeros((3, cols), np.uint32)
    frac = np.zeros((3, cols), np.float32)
    d = np.zeros((4, cols), np.float32)
    new = np.zeros((n_sums, cols), np.float32)
    previous = np.zeros((n_sums, cols), np.float32)
    old = np.zeros((_OUTER_BOX, n_sums, cols), np.float32)
    outer = np.zeros((n_sums, cols), np.float32)
    old_outer = np.zeros((_INNER_BOX, n_sums, cols), np.float32)
    column = np.zeros((n_sums, cols + 2 * _REACH_CELLS), np.float32)
    box = np.zeros((n_sums, cols), np.float32)
    moments = np.zeros((4, cols), np.float32)
    for i in range(rows + _REACH_CELLS):
        if i < seen_rows:
            _locate(flow[0, i], flow[1, i], i, phase, seen_cols, height, width, stride, frac, index)
            _gather(words, stride, index, seen_cols, pixels)
            _difference(pixels, frac, reference[i + 1], seen_cols, d)
            _fill_hidden(frac[2], light[:, i], reference[i + 1], seen_cols, d)
            _sum(d, reference, i + 1, seen_cols, new)
            if last:
                _sum_last(d, frac[2], reference[i + 1], seen_cols, new)
        elif i == seen_rows:
            new[:] = 0
        for k in range(n_sums):
            _down(
                new[k], previous[k], old[i % _OUTER_BOX, k], outer[k], old_outer[i % _INNER_BOX, k],
                column[k, _REACH_CELLS : _REACH_CELLS + cols]
            )  # fmt: skip
        i0 = i - _REACH_CELLS
        if i0 < 0:
            continue
        for k in range(n_sums):
            _across(column[k], cols, box[k])
        _solve(box, nodes, flow, i0, cols, last, out)
        if last:
            _remove_hidden(box, light[0, i0], light[1, i0], cols)
            _estimate_quality(box, nodes, flow, i0, cols, out, moments, gain,
                   quality[0, i0], quality[1, i0], quality[2, i0])  # fmt: skip


@_compiled
def _locate(
    ux: Any, uy: Any, i: int, phase: Any, n: int, height: int, width: int, stride: int, frac: Any,
    index: Any
) -> None:  # fmt: skip
    right, bottom, top = np.float32(width - 2), np.float32(height - 2), np.float32(2 * i)
    zero, unit, two = np.float32(0), np.float32(1), np.float32(2)
    px, py, qx, qy = phase[0, 0], phase[1, 0], phase[0, 1], phase[1, 1]
    ax, ay, mask = frac[0], frac[1], frac[2]
    for j in range(n):
        x, y = np.float32(2 * j) + ux[j], top + uy[j]
        ok = (x >= zero) & (x <= right) & (y >= zero) & (y <= bottom)
        x, y = min(max(x, zero), right), min(max(y, zero), bottom)
        xi, yi = np.int32(x), np.int32(y)
        fx, fy = x - np.float32(xi), y - np.float32(yi)  # see `nodes.phase`
        gx, gy = fx * (unit - fx), fy * (unit - fy)
        ax[j] = fx + gx * (unit - two * fx) * (px + qx * gx)
        ay[j] = fy + gy * (unit - two * fy) * (py + qy * gy)
        mask[j] = unit if ok else zero
        index[j] = np.uint32(yi * stride + xi)


@_compiled
def _gather(words: Any, stride: int, index: Any, n: int, pixels: Any) -> None:
    below, lowest = words[stride:], words[2 * stride :]
    a, b, c = pixels[0], pixels[1], pixels[2]
    for j in range(n):
        k = index[j]
        a[j], b[j], c[j] = words[k], below[k], lowest[k]


@_compiled
def _difference(pixels: Any, frac: Any, r: Any, n: int, d: Any) -> None:
    """Compute reference less current image at a row's cells, (4, cols); 0 outside."""
    a, b, c = pixels[0], pixels[1], pixels[2]
    ax, ay, mask = frac[0], frac[1], frac[2]
    d0, d1, d2, d3 = d[0], d[1], d[2], d[3]
    r0, r1, r2, r3 = r[0, 1:], r[1, 1:], r[2, 1:], r[3, 1:]
    offset = np.float32(128)
    for j in range(n):
        fx, fy, m = ax[j], ay[j], mask[j]
        p0 = np.float32(np.int32(a[j] & _BYTE_MASK))
        p1 = np.float32(np.int32((a[j] >> np.uint32(8)) & _BYTE_MASK))
        p2 = np.float32(np.int32((a[j] >> np.uint32(16)) & _BYTE_MASK))
        q0 = np.float32(np.int32(b[j] & _BYTE_MASK))
        q1 = np.float32(np.int32((b[j] >> np.uint32(8)) & _BYTE_MASK))
        q2 = np.float32(np.int32((b[j] >> np.uint32(16)) & _BYTE_MASK))
        s0 = np.float32(np.int32(c[j] & _BYTE_MASK))
        s1 = np.float32(np.int32((c[j] >> np.uint32(8)) & _BYTE_MASK))
        s2 = np.float32(np.int32((c[j] >> np.uint32(16)) & _BYTE_MASK))
        p0, p1 = p0 + fx * (p1 - p0), p1 + fx * (p2 - p1)
        q0, q1 = q0 + fx * (q1 - q0), q1 + fx * (q2 - q1)
        s0, s1 = s0 + fx * (s1 - s0), s1 + fx * (s2 - s1)
        d0[j] = m * (r0[j] + offset - (p0 + fy * (q0 - p0)))
        d1[j] = m * (r1[j] + offset - (p1 + fy * (q1 - p1)))
        d2[j] = m * (r2[j] + offset - (q0 + fy * (s0 - q0)))
        d3[j] = m * (r3[j] + offset - (q1 + fy * (s1 - q1)))


@_compiled
def _fill_hidden(mask: Any, light: Any, r: Any, n: int, d: Any) -> None:
    """Set cells that the current image does not show to the effect of the light."""
    n_seen = np.float32(0)
    for j in range(n):
        n_seen += mask[j]
    if n_seen == n:  # most rows
        return
    for j in range(n):
        if not mask[j]:
            for k in range(4):
                d[k, j] = light[0, j] + light[1, j] * r[k, j + 1]


@_compiled
def _sum(d: Any, reference: Any, i: int, n: int, new: Any) -> None:
    """Sum gx D, gy D, D and R D over each cell of a row; gradients are central differences."""
    d0, d1, d2, d3 = d[0], d[1], d[2], d[3]
    r0, r1, r2, r3 = reference[i, 0], reference[i, 1], reference[i, 2], reference[i, 3]
    up2, up3, down0, down1 = (
        reference[i - 1, 2], reference[i - 1, 3], reference[i + 1, 0], reference[i + 1, 1],
    )  # fmt: skip
    s0, s1, s2, s3 = new[0], new[1], new[2], new[3]
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


@_compiled
def _sum_last(d: Any, mask: Any, r: Any, n: int, new: Any) -> None:
    """Sum over each cell: D^2; number, R and R^2 of pixels that the current image does not show."""
    d0, d1, d2, d3 = d[0], d[1], d[2], d[3]
    r0, r1, r2, r3 = r[0, 1:], r[1, 1:], r[2, 1:], r[3, 1:]
    s4, s5, s6, s7 = new[4], new[5], new[6], new[7]
    unit, four = np.float32(1), np.float32(4)
    for j in range(n):
        s4[j] = d0[j] * d0[j] + d1[j] * d1[j] + d2[j] * d2[j] + d3[j] * d3[j]
    for j in range(n):
        s5[j] = (unit - mask[j]) * four
        s6[j] = (unit - mask[j]) * (r0[j] + r1[j] + r2[j] + r3[j])
    for j in range(n):
        s7[j] = (unit - mask[j]) * (r0[j] * r0[j] + r1[j] * r1[j] + r2[j] * r2[j] + r3[j] * r3[j])


@_compiled
def _down(new: Any, previous: Any, old: Any, outer: Any, old_outer: Any, column: Any) -> None:
    """Advance the window's running sums down the columns by one row."""
    for j in range(len(new)):
        two = new[j] + previous[j]
        previous[j] = new[j]
        s = outer[j] + (two - old[j])
        old[j] = two
        outer[j] = s
        column[j] += s - old_outer[j]
        old_outer[j] = s


@_compiled
def _across(v: Any, n: int, box: Any) -> None:
    three, five, seven, nine = np.float32(3), np.float32(5), np.float32(7), np.float32(9)
    ten = np.float32(10)
    for j in range(n):
        box[j] = (
            (v[j] + v[j + 10])
            + three * (v[j + 1] + v[j + 9])
            + five * (v[j + 2] + v[j + 8])
            + seven * (v[j + 3] + v[j + 7])
            + nine * (v[j + 4] + v[j + 6])
            + ten * v[j + 5]
        )


@_compiled
def _solve(box: Any, nodes: Any, flow: Any, i: int, n: int, last: bool, out: Any) -> None:
    max_step, part = np.float32(_MAX_STEP_PX), np.float32(_LAST_STEP if last else 1.0)
    b0, b1, b2, b3 = box[0], box[1], box[2], box[3]
    i11, i12, i22, ex, ey, fx, fy = (
        nodes[i, 0], nodes[i, 1], nodes[i, 2], nodes[i, 3], nodes[i, 4], nodes[i, 5], nodes[i, 6],
    )  # fmt: skip
    ux, uy, mx, my = flow[0, i], flow[1, i], out[0, i], out[1, i]
    for j in range(n):
        dx = i11[j] * b0[j] + i12[j] * b1[j] - ex[j] * b2[j] - fx[j] * b3[j]
        mx[j] = ux[j] + part * min(max(dx, -max_step), max_step)
    for j in range(n):
        dy = i12[j] * b0[j] + i22[j] * b1[j] - ey[j] * b2[j] - fy[j] * b3[j]
        my[j] = uy[j] + part * min(max(dy, -max_step), max_step)


@_compiled
def _remove_hidden(box: Any, a: Any, b: Any, n: int) -> None:
    """Subtract the pixels that were replaced by `_fill_hidden` from the sums over D."""
    b2, b3, b4, b5, b6, b7 = box[2], box[3], box[4], box[5], box[6], box[7]
    hidden = np.float32(0)
    for j in range(n):
        hidden += b5[j]
    if hidden == 0:  # integers: exactly 0 in most rows
        return
    for j in range(n):
        b2[j] -= a[j] * b5[j] + b[j] * b6[j]
        b3[j] -= a[j] * b6[j] + b[j] * b7[j]
    for j in range(n):
        b4[j] -= a[j] * (a[j] * b5[j] + (b[j] + b[j]) * b6[j]) + b[j] * b[j] * b7[j]


@_compiled
def _estimate_quality(
    box: Any, nodes: Any, flow: Any, i: int, n: int, out: Any, moments: Any, gain: float,
    correlation: Any, deviation: Any, ahead: Any,
) -> None:  # fmt: skip
    zero, unit, two = np.float32(0), np.float32(1), np.float32(2)
    b2, b3, b4, b5, b6, b7 = box[2], box[3], box[4], box[5], box[6], box[7]
    power, shared, rest, raw = moments[0], moments[1], moments[2], moments[3]
    all_mean, all_power, weights = nodes[i, 7], nodes[i, 8], nodes[i, 9]
    floor, min_n = np.float32(MIN_VARIANCE), np.float32(OWN_WEIGHT)
    for j in range(n):
        n_seen = max(weights[j] - b5[j], min_n)
        total = weights[j] * all_mean[j]
        mean = (total - b6[j]) / n_seen
        squares = all_power[j] + total * all_mean[j] - b7[j]
        raw[j] = squares - n_seen * mean * mean
        power[j] = max(raw[j], floor * n_seen)
        shared[j] = b3[j] - mean * b2[j]
        rest[j] = max(b4[j] - b2[j] * b2[j] / n_seen, zero)
    for j in range(n):
        # Without power above the floors there is nothing to correlate, and the ratio is 0.
        current = max(raw[j] - two * shared[j] + rest[j], floor * max(weights[j] - b5[j], min_n))
        ratio = (raw[j] - shared[j]) / np.sqrt(power[j] * current)
        correlation[j] = min(max(ratio, -unit), unit) if b5[j] < weights[j] - min_n else zero
    i11, i12, i22 = nodes[i, 0], nodes[i, 1], nodes[i, 2]
    ux, uy, mx, my = flow[0, i], flow[1, i], out[0, i], out[1, i]
    fitted_n, back = np.float32(4 * OWN_WEIGHT), np.float32(1 / _LAST_STEP)
    factor, rounding = np.float32(gain * gain * OWN_WEIGHT), np.float32(_ROUNDING_VARIANCE)
    least_contrast = np.float32(_MIN_CONTRAST)
    for j in range(n):
        dx, dy = back * (mx[j] - ux[j]), back * (my[j] - uy[j])
        explained = (i22[j] * dx * dx - two * i12[j] * dx * dy + i11[j] * dy * dy) / (
            i11[j] * i22[j] - i12[j] * i12[j]
        )
        residual = max(rest[j] - shared[j] * shared[j] / power[j] - explained, zero)
        noise = residual / max(weights[j] - b5[j] - fitted_n, min_n) + rounding
        spread = (i11[j] + i22[j]) * weights[j] / max(weights[j] - b5[j], min_n)
        deviation[j] = np.sqrt(factor * noise * spread)
        contrast = max((power[j] - shared[j]) / power[j], least_contrast)
        ahead[j] = (dx * dx + dy * dy) / (contrast * contrast)
