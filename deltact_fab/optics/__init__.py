"""Frames: the only package that converts between image, sensor and stage.

A camera looks along +z at the inside of the pattern: image x = +x, image y = +y, no flip. What
draws, records and analyses knows a `CameraModel`; one model draws and rectifies.
"""

from .camera import CameraModel, Medium
from .lattice import LatticeSampler, PointSampler, SurfaceLattice
from .pinhole import Pinhole
from .snell import half_angle_rad, reached_mm
from .stage import StageFrame
from .stored import camera_from_dict

__all__ = [
    "CameraModel",
    "LatticeSampler",
    "Medium",
    "Pinhole",
    "PointSampler",
    "StageFrame",
    "SurfaceLattice",
    "camera_from_dict",
    "half_angle_rad",
    "reached_mm",
]
