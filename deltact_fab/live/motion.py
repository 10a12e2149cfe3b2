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
RIM_CELLS = 3  # of two of these sigmas, where no strain is told


@dataclass(frozen=True)
class Strain:
    """Of the picture from rest, at points whose strain is known, (n,).

    area_change: share by which the picture of the pattern grew. shear: difference of the two
    principal stretches. Both are free of a turn. at_px: (n, 2) where they are.
    """

    area_change: Array
    shear: Array
    at_px: Array


@dataclass(frozen=True)
class Motion:
    """From rest. largest_px, median_px: length of the motion where it is known, None where none is.

    largest_mm: as much on the face, None where its scale is not known: in_px. markers,
    markers_held: of the first image, and of those now found; None of a dense pattern.
    """

    largest_px: float | None
    median_px: float | None
    largest_mm: float | None
    strain: Strain
    in_px: bool
    markers: int | None = None
    markers_held: int | None = None

    @classmethod
    def of(cls, result: Result, camera: CameraModel, in_px: bool) -> Motion:
        """Of a result with "observation", or of markers; camera: of the tracked images."""
        counts: tuple[int, ...] = ()
        if result.markers is not None:
            dots = result.markers
            shift, strain = dots.displacement_px[dots.found], _of_markers(dots)
            counts = len(dots.found), len(shift)
        else:
            assert result.observation is not None, "`measurement_of` asks for it"
            flow = FaceFlow.of(result.observation, camera, CELL_PX)
            moved_px = flow.shift_mm / np.float32(camera.mm_per_px)
            shift, strain = moved_px[flow.known], _of_flow(moved_px, flow.known)
        size = np.hypot(*shift.T)
        most = float(size.max()) if len(size) else None
        return cls(
            most,
            float(np.median(size)) if len(size) else None,
            None if in_px or most is None else most * camera.mm_per_px,
            strain,
            in_px,
            *counts,
        )


def _of_flow(shift_px: Array, known: Array) -> Strain:
    """shift_px (h, w, 2), known (h, w), at points CELL_PX apart."""
    weight, sigma = known.astype(np.float32), SMOOTH_PX / CELL_PX
    shift, seen = (
        cv2.GaussianBlur(a, (0, 0), sigma) for a in (shift_px * weight[..., None], weight)
    )
    shift = shift / np.maximum(seen, np.float32(1e-3))[..., None]
    side = 2 * RIM_CELLS + 1
    sure = cv2.erode(
        known.view(np.uint8), np.ones((side, side), np.uint8),
        borderType=cv2.BORDER_CONSTANT, borderValue=(0,),
    ) > 0  # fmt: skip
    down, across = np.gradient(shift, CELL_PX, axis=(0, 1))
    matrix = np.stack((across, down), axis=-1)[sure] + np.eye(2)
    rows, columns = np.nonzero(sure)
    return _strain(matrix, (np.stack((columns, rows), axis=-1) + 0.5) * CELL_PX)


def _of_markers(dots: DotObservation) -> Strain:
    """Of the affine motion around each marker that is found."""
    from ..measure.dots.skin import Skin

    now = dots.position_px[dots.found]
    rest = now - dots.displacement_px[dots.found]
    if len(rest) < 4 or np.linalg.matrix_rank(rest - rest.mean(0), tol=1.0) < 2:
        return _strain(np.empty((0, 2, 2)), np.empty((0, 2)))
    matrix, _, told = Skin(rest).fit(rest, now)
    return _strain(matrix[told], rest[told])


def _strain(matrix: Array, at_px: Array) -> Strain:
    """Of maps (n, 2, 2) from rest."""
    (a, b), (c, d) = matrix[:, 0].T, matrix[:, 1].T
    return Strain(a * d - b * c - 1, np.hypot(a - d, b + c), at_px)
