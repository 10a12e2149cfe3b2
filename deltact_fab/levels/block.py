"""The block with free sides: the layer, and finite elements for its sides."""

from __future__ import annotations

from typing import TYPE_CHECKING

from .linear import LinearLevel, large_strain

if TYPE_CHECKING:
    from ..elasticity.face import FaceOperator
    from ..elasticity.material import GelMaterial
    from ..shapes import SkinDimensions


def _face(skin: SkinDimensions, material: GelMaterial, spacing_mm: float) -> FaceOperator:
    from ..elasticity.block import FreeBlock

    return FreeBlock(skin, material, spacing_mm=spacing_mm)


def _refusal(material: GelMaterial) -> str | None:
    if material.poisson > 0.4999:
        return f"poisson <= .4999 is needed: {material.poisson:g} fails"
    return None


LEVELS = {
    "block": LinearLevel(
        "the block level ignores large strain: its in-plane motion is off by some tenths of a "
        "millimetre from 2 mm of depth on",
        _face,
        large_strain,
        _refusal,
        rank=2,
    )
}
