"""Numerical model of the sensor: dimensions, indenters, cameras, frames and linear elasticity.

No solvers, images or devices: shared by estimators and simulators.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from deltact_fab.door import open_door

if TYPE_CHECKING:
    # isort: off
    # fmt: off
    from .elasticity.block import BlockWindow, FaceCells, FreeBlock, interpolate_block
    from .elasticity.edge_compliance import MAX_LINEAR_POISSON, brick_gradients
    from .elasticity.layer import flat_punch_n_per_mm
    from .elasticity.material import GelMaterial
    from .levels import GEL_LEVELS, find_level
    from .occlusion import folded_pixels, nearest_surface
    from .optics.camera import CameraModel, Medium, Pinhole, StageFrame, axes_mm
    from .optics.checkerboard import Checkerboard
    from .optics.fisheye import Fisheye, LayeredPath
    from .optics.flat import FlatField, camera_toml, load_camera, restore_camera
    from .optics.lattice import FaceMotion, LatticeSampler, SeenFace, SurfaceLattice
    from .optics.rectified import Rectified
    from .shapes.bounded import Bounded, ShapeError, bounded_number
    from .shapes.imaging import CAMERA_GAMMA, ImageSensor, Printer
    from .shapes.indenter import (
        INDENTER_KINDS, describe_indenters, parse_indenter, restore_indenter,
    )
    from .shapes.own import OwnShape
    from .shapes.prism import PrismTip
    from .shapes.rigid import Indenter, PlainTip, PosedTip, Tip
    from .shapes.sensor import SensorDimensions, SkinDimensions
    from .shapes.tips import EllipsoidTip, RidgeTip, SphereTip
    from .shapes.turned import ProfilePiece, TurnedTip
    # fmt: on
else:
    __getattr__, __dir__ = open_door(__name__)
