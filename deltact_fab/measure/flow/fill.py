"""What neighbours say of a flow: where its own match is lost, and how much of it is noise."""

from __future__ import annotations

import cv2
import numpy as np

from ...aliases import Array
from ..compose import shrunk

CELL = 4  # nodes to a side of a cell
WINDOWS = (5, 13, 33, 97)  # cells to a side
ENOUGH = 0.15  # share of a window that must be known before it is believed alone
_BOTH = np.ones((1, 2), np.float32)
NOISE_NODES = 13  # to a side of the window over which noise is told from motion
SLOPES = 0.3  # cells^2: how far known cells must lie apart before their slope is believed


def filled(flow: Array, known: Array, kept: Array) -> Array:
    """The flow, (h, w, 2) float32, where it is kept; elsewhere what its known neighbours say.

    known, kept: (h, w) bool. Around each cell a plane is fitted to the known nodes (normalised
    convolution of the first order, Knutsson and Westin 1993), over the smallest window that knows
    enough and wider ones for the rest. With nothing known the flow is 0.
    """
    if kept.all():
        return flow
    h, w = kept.shape
    weight = known.astype(np.float32)
    n, u, v = (shrunk(part, CELL) for part in (weight, *(f * weight for f in cv2.split(flow))))
    # A node is interpolated between its cell and the next ones.
    some = (shrunk((~kept).astype(np.float32), CELL) > 0).astype(np.uint8)
    gone = cv2.dilate(some, np.ones((3, 3), np.uint8)) > 0
    x, y = np.meshgrid(*(np.arange(s) - s / 2 for s in n.shape[::-1]))
    sums = np.dstack(
        [n, n * x, n * y, n * x * x, n * x * y, n * y * y, u, u * x, u * y, v, v * x, v * y]
    )
    found, done = np.zeros((*n.shape, 2), np.float32), np.zeros(np.count_nonzero(gone))
    at = x[gone], y[gone]
    told = np.zeros((2, done.size))
    for window in WINDOWS:
        side = min(window, 2 * max(n.shape) - 1)
        near = cv2.blur(sums, (side, side), borderType=cv2.BORDER_CONSTANT)[gone].T
        share = np.clip(near[0] / ENOUGH, 0, 1) * (1 - done)
        told += share * _planes(*at, near)
        done += share
        if done.min(initial=1.0) > 0.999:
            break
    found[gone] = (told / np.maximum(done, 1e-6)).T
    out = cv2.resize(found, None, fx=CELL, fy=CELL, interpolation=cv2.INTER_LINEAR)[:h, :w]
    return cv2.copyTo(flow, kept.view(np.uint8), np.ascontiguousarray(out))


def denoised(flow: Array, deviation_px: Array, kept: Array) -> Array:
    """The flow (h, w, 2) float32 with less of its noise, which is white beside the motion.

    Wiener's filter as Lee (1980) made it local: of what a node has over the mean of its window only
    the share stays that is more than the noise, `deviation_px` (h, w) where it is `kept`.
    """
    window, rim = (NOISE_NODES, NOISE_NODES), cv2.BORDER_REFLECT
    smooth = cv2.blur(flow, window, borderType=rim)
    fine = flow - smooth
    power = cv2.blur(cv2.transform(fine * fine, _BOTH), window, borderType=rim)
    noise = cv2.blur(deviation_px * deviation_px * kept, window, borderType=rim)
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
