"""How a camera sees a small displacement of the resting face: its shift, linear in all three."""

from __future__ import annotations

import numpy as np

from ...aliases import Array
from ...optics import CameraModel

STEP_MM = 1e-3


def sight(camera: CameraModel, x_mm: Array, y_mm: Array) -> Array:
    """Shift of the picture, mm of the resting face, for displacements of 1 mm: (ny, nx, 2, 3).

    At points x_mm (nx,), y_mm (ny,) of the face, at rest. Of a pinhole it is
    u_xy - (x, y) u_z / (n eye distance): off the axis, depth is seen as motion.
    """
    at = np.stack((*np.meshgrid(x_mm, y_mm), np.zeros((len(y_mm), len(x_mm)))), axis=-1)
    ways = STEP_MM * np.eye(3)
    moved = [camera.project_px(at + way) - camera.project_px(at - way) for way in ways]
    return np.stack(moved, axis=-1) * (camera.mm_per_px / (2 * STEP_MM))
