"""How fine a detail a flow resolves, and at what noise: the star of the DIC Challenge 2.0.

Its period rises along x: v = amplitude cos(2 pi y / p(x)), the rays meet left of the image's middle
row. Judged within half a period of that row, where the rays run along x.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from deltact_fab.common.aliases import Field

EDGE_PX = 16  # left out at the border
FLAT_PX = 119.0  # periods above it show noise
LOSS = 0.1
SMOOTHED = 15  # columns, so that the noise of one is not taken for a loss


class StarFigures(NamedTuple):
    """noise_px: standard deviation of v less the truth where the period is above 119 px, nan where
    none is that long.

    loss_px: the longest period with less than 90 % of the amplitude; nan where every one has it.
    """

    noise_px: float
    loss_px: float


@dataclass(frozen=True)
class Star:
    """The star over an image: periods of least_px at its left edge to most_px at its right one."""

    width_px: int
    height_px: int
    least_px: float = 10.0
    most_px: float = 300.0
    amplitude_px: float = 0.5

    def period_px(self, x: Field) -> Field:
        """Period at columns x."""
        slope = (self.most_px - self.least_px) / (self.width_px - 1)
        return np.asarray(np.clip(self.least_px + slope * x, self.least_px, self.most_px))

    def motion(self, x: Field, y: Field) -> Field:
        """Displacement (..., 2) px at points of the image, px."""
        middle = (self.height_px - 1) / 2
        v = self.amplitude_px * np.cos(2 * np.pi * (y - middle) / self.period_px(x))
        return np.stack((np.zeros_like(v), v), axis=-1)

    def amplitudes(self, flow_px: NDArray[Any]) -> tuple[Field, Field]:
        """Periods (n,) px in rising order and the shares (n,) of the amplitude found there.

        flow_px: (h, w, 2), which may be nan between the nodes of a grid with a step of up to 8 px.
        """
        periods, v, near = self._judged()
        given = np.nan_to_num(flow_px[..., 1])
        near &= np.isfinite(flow_px[..., 1])
        ones, inner = np.ones(SMOOTHED), slice(EDGE_PX, -EDGE_PX)
        found, whole = (
            np.convolve(np.sum(u * v * near, axis=0)[inner], ones, "valid") for u in (given, v)
        )
        return np.convolve(periods[inner], ones / SMOOTHED, "valid"), found / whole

    def figures(self, flow_px: NDArray[Any]) -> StarFigures:
        """Noise and resolution of a flow (h, w, 2) of the star."""
        period, v, near = self._judged()
        off = (flow_px[..., 1] - v)[near & (period > FLAT_PX) & np.isfinite(flow_px[..., 1])]
        periods, share = self.amplitudes(flow_px)
        lost = np.flatnonzero(share < 1 - LOSS)
        return StarFigures(
            float(off.std()) if off.size else np.nan,
            float(periods[lost[-1]]) if len(lost) else np.nan,
        )

    def _judged(self) -> tuple[Field, Field, NDArray[np.bool_]]:
        """Period (w,), v (h, w) of the truth, and where it is judged."""
        x = np.arange(float(self.width_px))
        xx, yy = np.meshgrid(x, np.arange(float(self.height_px)))
        near = np.abs(yy - (self.height_px - 1) / 2) <= self.period_px(xx) / 2
        near[:EDGE_PX] = near[-EDGE_PX:] = near[:, :EDGE_PX] = near[:, -EDGE_PX:] = False
        return self.period_px(x), self.motion(xx, yy)[..., 1], near
