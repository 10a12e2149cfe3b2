"""The bonded layer: a closed form, without the block's free sides."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from .linear import Errors, LinearLevel, PressScales, large_strain

if TYPE_CHECKING:
    from ..elasticity.face import FaceOperator
    from ..elasticity.material import GelMaterial
    from ..shapes import SkinDimensions

SIDE_FORCE = 2.6  # x contact radius/thickness x sum over sides of exp(-SIDE_DECAY distance/thick.)
SIDE_DECAY = 3.0
SIDE_IN_PLANE = 0.24  # x the same with its own decay x depth
SIDE_IN_PLANE_DECAY = 1.2


def _face(skin: SkinDimensions, material: GelMaterial, spacing_mm: float) -> FaceOperator:
    from ..elasticity.layer import BondedLayer

    return BondedLayer.for_skin(skin, material, spacing_mm=spacing_mm)


def _errors(touch: PressScales) -> Errors:
    force, in_plane = large_strain(touch)
    wide = touch.wide_mm / touch.thickness_mm
    away = [side / touch.thickness_mm for side in touch.sides_mm]
    force += SIDE_FORCE * wide * sum(math.exp(-SIDE_DECAY * s) for s in away)
    near = sum(math.exp(-SIDE_IN_PLANE_DECAY * s) for s in away)
    return force, in_plane + SIDE_IN_PLANE * wide * near * touch.depth_mm


LEVELS = {
    "layer": LinearLevel(
        "the layer level ignores the free sides of the block and large strain: its in-plane "
        "motion is off by some tenths of a millimetre from 2 mm of depth on",
        _face,
        _errors,
        rank=1,
    )
}
