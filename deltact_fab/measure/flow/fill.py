"""What a lost part of the pattern most probably does: it goes on as its neighbours do."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]
CELL = 4  # nodes to a side of a cell
WINDOWS = (5, 13, 33, 97)  # cells to a side
ENOUGH = 0.15  # share of a window that must be known before it is believed alone
SLOPES = 2.0  # cells^2: how far known cells must lie apart before their slope is believed


def filled(flow: Array, known: Array, kept: Array) -> Array:
    """The flow, (h, w, 2) float32, where it is kept; elsewhere what its known neighbours say.

    known, kept: (h, w) bool. Around each cell a plane is fitted to the known nodes (normalised
    convolution of the first order, Knutsson and Westin 1993), over the smallest window that knows
    enough and wider ones for the rest. Planes, not means: beside a dent the flow is steep, and a
    mean leaves the pattern out of reach of the next match. With nothing known the flow is 0.
    """
    if kept.all():
        return flow
    h, w = kept.shape
    size = -(-w // CELL), -(-h // CELL)

    def cells(nodes: Array) -> Array:
        return cv2.resize(nodes, size, interpolation=cv2.INTER_AREA)

    weight = known.astype(np.float32)
    n = cells(weight).astype(np.float64)
    u, v = (cells(part * weight) for part in cv2.split(flow))
    x, y = np.meshgrid(*(np.arange(s) - s / 2 for s in size))
    sums = [n, n * x, n * y, n * x * x, n * x * y, n * y * y, u, u * x, u * y, v, v * x, v * y]
    lost = cells((~kept).astype(np.float32)) > 0
    found, done = np.zeros((2, *n.shape)), np.zeros(n.shape)
    for window in WINDOWS:
        side = min(window, 2 * max(size) - 1)
        near = np.stack(
            [cv2.blur(s, (side, side), borderType=cv2.BORDER_CONSTANT)[lost] for s in sums]
        )
        share = np.clip(near[0] / ENOUGH, 0, 1) * (1 - done[lost])
        found[:, lost] += share * _planes(x[lost], y[lost], near)
        done[lost] += share
        if done[lost].min() > 0.999:
            break
    found /= np.maximum(done, 1e-6)
    wide = cv2.resize(cv2.merge([*found.astype(np.float32)]), (size[0] * CELL, size[1] * CELL))
    out = np.ascontiguousarray(wide[:h, :w])
    np.copyto(out, flow, where=kept[..., None])
    return out


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
