"""Gaussian density of the displaced pattern (paper, Shape Reconstruction): 1 at rest, less where it
spreads.

The paper describes a splat: every displaced point contributes a Gaussian of SIGMA_PX. That equals
1 / det(I + grad u) of the flow u smoothed by the same Gaussian while the determinant is between 1/2
and 2; outside, and where the flow is interpolated, neither is reliable.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from deltact_fab.common import Array

from ..face import FaceFlow, fill_unknown

SIGMA_PX = 3.0  # of the full image, for any spacing of the flow; by hand: larger blurs contacts
DETERMINANT_RANGE = (0.5, 2.0)  # splat and Jacobian agree, measured in docs/evidence/shape.md
FILTER_RADIUS_MM = 0.6  # of the guided filter; by hand: larger smooths small contacts
FILTER_EPS = 2.5e-4  # variance (0.016^2) below which it smooths; by hand: three times flow noise


@dataclass(frozen=True)
class Density:
    """Gaussian density at the resting points of a FaceFlow.

    value (h, w) float32: 1 at rest. reliable (h, w) bool: within two sigmas every point is known
    and the determinant of the map is in DETERMINANT_RANGE (it neither folds nor tears).
    """

    value: Array
    reliable: Array

    @property
    def cover(self) -> float:
        """Share of the points whose density is reliable."""
        return float(np.count_nonzero(self.reliable)) / self.reliable.size

    @property
    def relative_depth(self) -> Array:
        """1 - density, (h, w) float32: positive where the pattern spreads, nearer to the camera."""
        return np.asarray(1 - self.value)


def jacobian_density(flow: FaceFlow, mm_per_px: float) -> Density:
    """Gaussian density as 1 / det(I + grad u) of the smoothed flow. mm_per_px: of the camera.

    Where the map folds, the determinant is clipped to 1/16: finite, and not reliable.
    """
    flow, sigma = fill_unknown(flow), _sigma_cells(flow, mm_per_px)
    det = _determinant(flow, sigma)
    sound = flow.known & (det >= DETERMINANT_RANGE[0]) & (det <= DETERMINANT_RANGE[1])
    side = 2 * int(np.ceil(2 * sigma)) + 1
    reliable = cv2.erode(sound.view(np.uint8), np.ones((side, side), np.uint8)) > 0
    return Density(1 / np.maximum(det, DETERMINANT_RANGE[0] / 8), np.asarray(reliable))


def _sigma_cells(flow: FaceFlow, mm_per_px: float) -> float:
    """Sigma in cells that gives SIGMA_PX in total, as each point is already a mean over its cell;
    at least a fifth of a cell."""
    pixels = flow.cell_mm / mm_per_px
    return float(np.sqrt(max(SIGMA_PX**2 - (pixels**2 - 1) / 12, (pixels / 5) ** 2))) / pixels


def _determinant(flow: FaceFlow, sigma: float) -> Array:
    """det(I + grad u), (h, w) float32, of the flow under a Gaussian of sigma cells."""
    radius = max(1, int(np.ceil(4 * sigma)))
    offsets = np.arange(-radius, radius + 1)
    smooth = np.exp(-0.5 * (offsets / sigma) ** 2)
    smooth /= smooth.sum()
    # The derivative of the Gaussian itself, exact for linear flow: differences of neighbours lose
    # 9 % of features of three cells.
    slope = offsets * smooth / (offsets**2 @ smooth) / flow.cell_mm
    # A margin of linear extrapolation.
    widths = ((radius, radius), (radius, radius), (0, 0))
    shift = np.pad(flow.shift_mm, widths, mode="reflect", reflect_type="odd")
    across, down = (
        cv2.sepFilter2D(shift, -1, kx, ky)[radius:-radius, radius:-radius]
        for kx, ky in ((slope, smooth), (smooth, slope))
    )
    det: Array = (1 + across[..., 0]) * (1 + down[..., 1]) - across[..., 1] * down[..., 0]
    return det


def relative_depth(density: Density, flow: FaceFlow) -> Array:
    """The paper's relative depth: 1 - density, filtered, (h, w) float32, without unit.

    The guided filter (He and Sun 2015) with the density as its own guide keeps edges. Off the axis
    a press moves the pattern outwards as a whole, so there it is no map of the depth (see `depth`).
    """
    radius = max(1, round(FILTER_RADIUS_MM / flow.cell_mm))
    image = np.ascontiguousarray(density.relative_depth, np.float32)
    return np.asarray(cv2.ximgproc.guidedFilter(image, image, radius, FILTER_EPS))
