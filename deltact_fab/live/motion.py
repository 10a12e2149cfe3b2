"""What one image says of the pattern in its picture: how far it went, and how it was strained.

It needs images alone. In mm it is told where the scale of the face is known.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from ..aliases import Array
from ..measure.dots import DotObservation
from ..measure.face import FaceFlow
from ..measure.pipeline import Result
from ..optics import CameraModel

CELL_PX = 8
SMOOTH_PX = 12.0  # of the flow that strain is taken of
RIM_CELLS = 3  # two of these sigmas: there the flow is smoothed with what is not known


@dataclass(frozen=True)
class Motion:
    """From rest. largest_px, median_px: length of the motion where it is known, None where none is.

    largest_mm: as much on the face, None where its scale is not known: in_px. area_change, shear:
    (n,) wherever the strain of the picture is known: the share by which it grew, and the difference
    of its principal stretches; a turn changes neither. markers, markers_held: of the first image,
    and those of them that are found; None of a dense pattern.
    """

    largest_px: float | None
    median_px: float | None
    largest_mm: float | None
    area_change: Array
    shear: Array
    in_px: bool
    markers: int | None = None
    markers_held: int | None = None

    @classmethod
    def of(cls, result: Result, camera: CameraModel, in_px: bool) -> Motion:
        """Of a result with "observation", or of markers; camera: of the tracked images."""
        counts: tuple[int, ...] = ()
        if result.markers is not None:
            shift, matrix = _of_markers(result.markers)
            counts = len(result.markers.found), len(shift)
        else:
            assert result.observation is not None, "`everything` asks for it"
            flow = FaceFlow.of(result.observation, camera, CELL_PX)
            shift_px = flow.shift_mm / np.float32(camera.mm_per_px)
            shift, matrix = shift_px[flow.known], _of_flow(shift_px, flow.known)
        size = np.hypot(*shift.T)
        most, middle = (float(size.max()), float(np.median(size))) if len(size) else (None, None)
        (a, b), (c, d) = matrix[:, 0].T, matrix[:, 1].T
        mm = None if in_px or most is None else most * camera.mm_per_px
        return cls(most, middle, mm, a * d - b * c - 1, np.hypot(a - d, b + c), in_px, *counts)


def _of_flow(shift_px: Array, known: Array) -> Array:
    """The maps from rest (n, 2, 2) where they are known, of points (h, w) CELL_PX apart."""
    weight = known.astype(np.float32)
    moved, seen = (
        cv2.GaussianBlur(a, (0, 0), SMOOTH_PX / CELL_PX)
        for a in (shift_px * weight[..., None], weight)
    )
    side = 2 * RIM_CELLS + 1
    rim = cv2.copyMakeBorder(known.view(np.uint8), *(RIM_CELLS,) * 4, cv2.BORDER_CONSTANT)
    sure = cv2.erode(rim, np.ones((side, side)))[(slice(RIM_CELLS, -RIM_CELLS),) * 2] > 0
    smooth = moved / np.maximum(seen, np.float32(1e-3))[..., None]
    down, across = np.gradient(smooth, CELL_PX, axis=(0, 1))
    return np.asarray(np.stack((across, down), axis=-1)[sure] + np.eye(2))


def _of_markers(dots: DotObservation) -> tuple[Array, Array]:
    """The motion of those that are found, and the maps around those whose neighbours tell."""
    from ..measure.dots.skin import Skin

    shift, now = dots.displacement_px[dots.found], dots.position_px[dots.found]
    rest = now - shift
    if len(rest) < 4 or np.linalg.matrix_rank(rest - rest.mean(0), tol=1.0) < 2:
        return shift, np.empty((0, 2, 2))
    matrix, _, told = Skin(rest).fit(rest, now)
    return shift, matrix[told]
