"""A contact of the cheapest level that keeps to a tolerance, or of the level that is named."""

from __future__ import annotations

import math

import numpy as np

from ..aliases import Field
from ..elasticity.material import GelMaterial
from ..errors import InputError
from ..levels import FINITE, LEVELS
from ..shapes import Indenter, SkinDimensions
from .level import Choice, GelContact, Level, Reach
from .level_selection import pick


def open_contact(
    skin: SkinDimensions,
    material: GelMaterial,
    indenter: Indenter,
    *,
    level: Level = "auto",
    tolerance: float = 0.03,
    friction: float | None = None,
    observe_shear: bool = True,
    reach: Reach,
    lattice_mm: float = 0.25,
    spacing_mm: float | None = None,
) -> GelContact:
    """The contact that keeps to a tolerance, or that of a named level.

    tolerance: of the force, relative; with the default goes `level_selection.IN_PLANE_MM` rms in
    plane.
    friction: None takes the material's. observe_shear: False leaves friction out where the path
    does not shear and it changes the force by little; see `level_selection.pick`.
    lattice_mm: largest distance of lattice nodes. spacing_mm: of the grid or mesh, None: chosen.
    Raises InputError where the level cannot do it, naming what can.
    """
    if level != "auto" and level not in LEVELS:
        raise InputError(f"gel: level {level!r}: valid: auto, {', '.join(LEVELS)}")
    if not (math.isfinite(lattice_mm) and 0.02 <= lattice_mm <= skin.length_mm / 8):
        raise InputError(
            f"gel: lattice_mm must be 0.02 to {skin.length_mm / 8:g} mm: {lattice_mm} fails"
        )
    mu = material.friction if friction is None else friction
    choice = pick(
        skin, material, indenter, reach, tolerance,
        level=level, friction=mu, observe_shear=observe_shear, spacing_mm=spacing_mm,
    )  # fmt: skip
    return contact_of(skin, material, indenter, choice, lattice_mm)


def contact_of(
    skin: SkinDimensions,
    material: GelMaterial,
    indenter: Indenter,
    choice: Choice,
    lattice_mm: float = 0.25,
) -> GelContact:
    """The contact that a choice describes; lattice_mm as in `open_contact`."""
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
