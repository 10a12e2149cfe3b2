"""What one image says of the pattern in its picture: how far it went.

It needs images alone. In mm it is told where the scale of the face is known.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..measure.face import FaceFlow
from ..measure.pipeline import Result
from ..optics import CameraModel

CELL_PX = 8


@dataclass(frozen=True)
class Motion:
    """From rest. largest_px, median_px: length of the motion where it is known, None where none is.

    largest_mm: as much on the face, None where its scale is not known: in_px. markers,
    markers_held: of the first image, and those of them that are found; None of a dense pattern.
    """

    largest_px: float | None
    median_px: float | None
    largest_mm: float | None
    in_px: bool
    markers: int | None = None
    markers_held: int | None = None

    @classmethod
    def of(cls, result: Result, camera: CameraModel, in_px: bool) -> Motion:
        """Of a result with "observation", or of markers; camera: of the tracked images."""
        counts: tuple[int, ...] = ()
        if (dots := result.markers) is not None:
            shift_px = dots.displacement_px[dots.found]
            counts = len(dots.found), len(shift_px)
        else:
            assert result.observation is not None, "`measurement_of` asks for it"
            flow = FaceFlow.of(result.observation, camera, CELL_PX)
            shift_px = flow.shift_mm[flow.known] / np.float32(camera.mm_per_px)
        size = np.hypot(*shift_px.T)
        most, middle = (float(size.max()), float(np.median(size))) if len(size) else (None, None)
        mm = None if in_px or most is None else most * camera.mm_per_px
        return cls(most, middle, mm, in_px, *counts)
