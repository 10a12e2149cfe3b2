"""Frames: the only package that converts between image, sensor and stage.

A camera looks along +z at the inside of the pattern: image x = +x, image y = +y, no flip. What
draws, records and analyses knows a `CameraModel`. `Pinhole` is the simple one. `Fisheye` is the
lens as it is, behind air, acrylic and gel, and `Rectified` the view of the face out of its image.
"""

from .camera import CameraModel, Medium, Pinhole, StageFrame, axes_mm
from .fisheye import Fisheye, half_angle_rad, reached_mm
from .flat import FlatField, as_toml, camera_from_dict, load_camera
from .lattice import FaceMotion, LatticeSampler, PointSampler, SeenFace, SurfaceLattice
from .rectified import Rectified, aliased_share, raw_mm_per_px
