"""A press by a tolerance: level, mesh and mirror image picked, its solver opened."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from ...elasticity.material import GelMaterial
from ...shapes import Indenter, SkinDimensions
from ..level import Choice, GelContact, Reach
from ..level_selection import TOLERANCE, pick
from .knots import KnotPose, ObservedChannels
from .mirror import to_solved
from .solver import PathSolver
from .store import key_of


def choose(
    skin: SkinDimensions,
    material: GelMaterial,
    indenter: Indenter,
    poses: Sequence[KnotPose],
    tolerance: float = TOLERANCE,
    **wishes: Any,
) -> Choice:
    """Level, mesh and steps of a press, of its image where that is solved; wishes: of `pick`.

    Raises InputError where no level or mesh can do it.
    """
    mirror = to_solved(poses, indenter)
    tips = [mirror.point(p.tip_mm) for p in poses]
    return pick(
        skin,
        material,
        indenter,
        Reach.around([(x, y, -z) for x, y, z in tips]),
        tolerance,
        **wishes,
    )


def open_path(
    skin: SkinDimensions,
    material: GelMaterial,
    indenter: Indenter,
    poses: Sequence[KnotPose],
    observed: ObservedChannels,
    choice: Choice,
    like: PathSolver | None = None,
    keeps_states: bool = False,
) -> PathSolver:
    """The solver of a press on what was chosen for it; forces for a modulus of 1 MPa, kept.

    like, keeps_states: see `PathSolver`.
    """
    unit = replace(material, modulus_mpa=1.0)
    mirror = to_solved(poses, indenter)
    solved = [replace(p, tip_mm=mirror.point(p.tip_mm)) for p in poses]

    def contact() -> GelContact:
        from ..open import contact_of

        return contact_of(skin, unit, indenter, choice, observed.lattice_mm)

    return PathSolver(
        contact,
        poses,
        key_of(skin, unit, indenter, choice, solved),
        observed,
        mirror,
        skin.thickness_mm,
        like,
        keeps_states,
    )
