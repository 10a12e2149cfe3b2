"""What a lost part of the pattern most probably does: it goes on as its neighbours do."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]
CELL = 4  # nodes to a side of a cell
WINDOWS = (5, 9, 17, 33, 65, 129)  # cells to a side
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
    weight = known.astype(np.float32)
    size = -(-w // CELL), -(-h // CELL)
    parts = cv2.merge([weight, *(u * weight for u in cv2.split(flow))])
    cells = cv2.resize(parts, size, interpolation=cv2.INTER_AREA).astype(np.float64)
    n, u = cells[..., :1], cells[..., 1:]
    xy = np.stack(np.meshgrid(*(np.arange(s) - s / 2 for s in size)), -1)
    x, y = xy[..., :1], xy[..., 1:]
    sums = np.concatenate((n, n * xy, n * x * x, n * x * y, n * y * y, u, u * x, u * y), -1)
    found = np.zeros((*n.shape[:2], 2))
    done = np.zeros(n.shape)
    for window in WINDOWS:
        part, near = _plane(_box(sums, window), x, y)
        share = np.clip(near / (ENOUGH * window**2), 0, 1) * (1 - done)
        found += share * part
        done += share
        if done.min() > 0.999:
            break
    found /= np.maximum(done, 1e-6)
    wide = cv2.resize(found.astype(np.float32), (size[0] * CELL, size[1] * CELL))
    out = np.ascontiguousarray(wide[:h, :w])
    np.copyto(out, flow, where=kept[..., None])
    return out


def _plane(sums: Array, x: Array, y: Array) -> tuple[Array, Array]:
    """The fitted plane's value at each cell, (rows, cols, 2), and its weight, (rows, cols, 1)."""
    n = sums[..., :1]
    mean = sums[..., 1:] / np.maximum(n, 1e-9)
    mx, my, mu = mean[..., 0:1], mean[..., 1:2], mean[..., 5:7]
    xx = mean[..., 2:3] - mx * mx + SLOPES
    xy = mean[..., 3:4] - mx * my
    yy = mean[..., 4:5] - my * my + SLOPES
    xu, yu = mean[..., 7:9] - mx * mu, mean[..., 9:11] - my * mu
    across = (yy * xu - xy * yu) * (x - mx) + (xx * yu - xy * xu) * (y - my)
    return mu + across / (xx * yy - xy * xy), n


def _box(sums: Array, window: int) -> Array:
    side = min(window, 2 * max(sums.shape[:2]) - 1)
    boxes = (
        cv2.boxFilter(np.ascontiguousarray(sums[..., k]), -1, (side, side), normalize=False,
                      borderType=cv2.BORDER_CONSTANT)
        for k in range(sums.shape[2])
    )  # fmt: skip
    return np.stack(list(boxes), -1)
