"""How fine a detail a flow resolves, and at what noise: the star of the DIC Challenge 2.0.

Judged within half a period of the middle row, where its rays run along x and its period is p(x).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .flow_frames import CAMERA, Field, Vectors, star, star_period_px

EDGE_PX = 16  # left out at the border
FLAT_PX = 119.0  # periods above it show noise
LOSS = 0.1
SMOOTHED = 15  # columns, so that the noise of one is not taken for a loss


class StarFigures(NamedTuple):
    """noise_px: standard deviation of v less the truth where the period is above 119 px.

    loss_px: the longest period with less than 90 % of the amplitude; nan where every one has it.
    """

    noise_px: float
    loss_px: float


def _judged() -> tuple[Field, Field, NDArray[np.bool_]]:
    """Period (w,), v (h, w) of the truth, and where it is judged."""
    x = np.arange(float(CAMERA.width_px))
    xx, yy = np.meshgrid(x, np.arange(float(CAMERA.height_px)))
    near = np.abs(yy - CAMERA.centre_px[1]) <= star_period_px(xx) / 2
    near[:EDGE_PX] = near[-EDGE_PX:] = near[:, :EDGE_PX] = near[:, -EDGE_PX:] = False
    return star_period_px(x), star(xx, yy)[..., 1], near


def amplitudes(flow_px: Vectors) -> tuple[Field, Field]:
    """Periods (n,) px in rising order and the shares (n,) of the star's amplitude found there.

    The flow may be nan between the nodes of a grid with a step of up to 8 px.
    """
    periods, v, near = _judged()
    given = np.nan_to_num(flow_px[..., 1])
    near &= np.isfinite(flow_px[..., 1])
    ones, inner = np.ones(SMOOTHED), slice(EDGE_PX, -EDGE_PX)
    found, whole = (
        np.convolve(np.sum(u * v * near, axis=0)[inner], ones, "valid") for u in (given, v)
    )
    return np.convolve(periods[inner], ones / SMOOTHED, "valid"), found / whole


def figures(flow_px: Vectors) -> StarFigures:
    """Noise and resolution of a flow (h, w, 2) of the star."""
    period, v, near = _judged()
    off = (flow_px[..., 1] - v)[near & (period > FLAT_PX) & np.isfinite(flow_px[..., 1])]
    periods, share = amplitudes(flow_px)
    lost = np.flatnonzero(share < 1 - LOSS)
    return StarFigures(float(off.std()), float(periods[lost[-1]]) if len(lost) else np.nan)
