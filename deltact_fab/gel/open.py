"""A contact of the level that was chosen."""

from __future__ import annotations

import math

import numpy as np

from ..aliases import Field
from ..elasticity.material import GelMaterial
from ..levels import FINITE
from ..shapes import Indenter, SkinDimensions
from .level import Choice, GelContact


def contact_of(
    skin: SkinDimensions,
    material: GelMaterial,
    indenter: Indenter,
    choice: Choice,
    lattice_mm: float = 0.25,
) -> GelContact:
    """The contact that a choice describes. lattice_mm: largest distance of lattice nodes."""
    x, y = (_lattice(half, lattice_mm) for half in skin.opening_half_mm)
    if choice.level == FINITE:
        from .finite.gel import FiniteGel

        return FiniteGel(skin, material, indenter, choice, x, y)
    from .linear.gel import LinearGel

    return LinearGel(skin, material, indenter, choice, x, y)


def _lattice(half_mm: float, spacing_mm: float) -> Field:
    """From -half to half; 0 is a node."""
    n = max(1, math.ceil(half_mm / spacing_mm - 1e-9))
    return np.linspace(-half_mm, half_mm, 2 * n + 1)
