"""The truth of one frame: where the pattern went, and which of its pixels an error is taken at."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...occlusion import in_dispute
from ...optics import CameraModel, Rectified
from .tally import MOVING_MM

DOT_MARGIN_PX = 3.0


@dataclass(frozen=True)
class TrueFrame:
    """Projected and in-plane motion of every rest pixel, and which of them move.

    moving: (h, w) bool, of the visible ones. peak_mm: of the visible pixels, None where none is.
    """

    flow_px: NDArray[np.float64]
    in_plane_mm: NDArray[np.float64]
    moving: NDArray[np.bool_]
    peak_mm: float | None

    @classmethod
    def of(
        cls,
        flow: NDArray[np.float64],
        in_plane: NDArray[np.float64],
        seen: NDArray[np.bool_],
        mm_per_px: float,
    ) -> TrueFrame:
        """flow, in_plane: (h, w, 2), px and mm, of what every pixel sees at rest.

        seen: (h, w) rest pixels that the camera sees.
        """
        h, w = seen.shape
        y, x = np.mgrid[:h, :w]
        to_x, to_y = x + flow[..., 0], y + flow[..., 1]
        visible = (to_x >= 0) & (to_x <= w - 1) & (to_y >= 0) & (to_y <= h - 1)
        # Where a steep flank hides what is behind it, no one point of the face is the true one.
        disputed = in_dispute(np.stack((to_x, to_y), -1), seen.shape)
        ends = np.rint(to_y[visible]).astype(int), np.rint(to_x[visible]).astype(int)
        visible[visible] = seen[visible] & seen[ends] & ~disputed[ends]
        length_mm = np.hypot(flow[..., 0], flow[..., 1]) * mm_per_px
        peak = float(length_mm[visible].max()) if visible.any() else None
        return cls(flow, in_plane, visible & (length_mm >= MOVING_MM), peak)


def seen_by(camera: CameraModel) -> NDArray[np.bool_]:
    """(h, w) the pixels that hold an image: a rectified view may go beyond what the lens saw."""
    if isinstance(camera, Rectified):
        return camera.seen()
    return np.ones((camera.height_px, camera.width_px), bool)


def off_dots(
    camera: CameraModel, dots_mm: NDArray[np.float64], diameter_mm: float
) -> NDArray[np.bool_]:
    """(h, w) rest pixels that lie on no dot, with a margin for its blurred edge."""
    import cv2

    radius_px = diameter_mm / 2 / camera.mm_per_px + DOT_MARGIN_PX
    mask = np.ones((camera.height_px, camera.width_px), np.uint8)
    for x, y in camera.rest_px(dots_mm):
        cv2.circle(mask, (round(x), round(y)), int(np.ceil(radius_px)), 0, -1)
    return mask.astype(bool)


def sampled(flow: NDArray[Any], px: NDArray[np.float64]) -> NDArray[np.float64]:
    """Flow (h, w, 2) at points (n, 2) px, bilinear; NaN where a point is NaN."""
    from scipy.ndimage import map_coordinates

    known = np.isfinite(px).all(axis=1)
    found = np.full(px.shape, np.nan)
    for k in (0, 1):
        found[known, k] = map_coordinates(
            flow[..., k], px[known, ::-1].T, np.float64, order=1, mode="nearest"
        )
    return found
