"""Frames: the only package that converts between image, sensor and stage.

A camera looks along +z at the inside of the pattern: image x = +x, image y = +y, no flip. What
draws, records and analyses knows a `CameraModel`; one model draws and rectifies.
"""

from .camera import CameraModel, Medium, axes_mm
from .fisheye import Fisheye
from .lattice import LatticeSampler, PointSampler, SurfaceLattice
from .motion import FaceMotion
from .pinhole import Pinhole
from .rectified import Rectified
from .snell import half_angle_rad, reached_mm
from .stage import StageFrame
from .stored import as_toml, camera_from_dict, load_camera

__all__ = [
    "CameraModel",
    "FaceMotion",
    "Fisheye",
    "LatticeSampler",
    "Medium",
    "Pinhole",
    "PointSampler",
    "Rectified",
    "StageFrame",
    "SurfaceLattice",
    "as_toml",
    "axes_mm",
    "camera_from_dict",
    "half_angle_rad",
    "load_camera",
    "reached_mm",
]
