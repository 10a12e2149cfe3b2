"""Opening of a press: choice of level, mesh and mirror image, contact and solver."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from deltact_fab.common import Field, cache_key
from deltact_fab.sensor import GelMaterial, Indenter, SkinDimensions

from ..level import FINITE_LEVEL, Choice, GelContact, Reach
from ..level_selection import FORCE_TOLERANCE, select_level
from .knots import KnotPose, ObservedChannels, mirror_of
from .solver import PathSolver


def choose_level(
    skin: SkinDimensions,
    material: GelMaterial,
    indenter: Indenter,
    poses: Sequence[KnotPose],
    tolerance: float = FORCE_TOLERANCE,
    **options: Any,
) -> Choice:
    """Choose level, mesh and steps of a press (or its mirror image); options: of `select_level`.

    Raises InputError where no level or mesh is possible.
    """
    mirror = mirror_of(poses, indenter)
    tips = [mirror.point(p.tip_mm) for p in poses]
    reach = Reach.around([(x, y, -z) for x, y, z in tips])
    return select_level(skin, material, indenter, reach, tolerance, **options)


def open_path(
    skin: SkinDimensions,
    material: GelMaterial,
    indenter: Indenter,
    poses: Sequence[KnotPose],
    observed: ObservedChannels,
    choice: Choice,
    coarser: PathSolver | None = None,
    keeps_states: bool = False,
) -> PathSolver:
    """Open the solver of a press on a choice; its forces are for a modulus of 1 MPa, and stored.

    The store's key is everything that a knot depends on except the modulus, to which forces are
    proportional. A linear grid has no focus, and only finite strain divides increments. Seconds
    matter only to a gel that creeps. coarser, keeps_states: see `PathSolver`.
    """
    unit = replace(material, modulus_mpa=1.0)
    mirror = mirror_of(poses, indenter)
    images = [(mirror.point(p.tip_mm), p.seconds) for p in poses]
    linear = choice.level != FINITE_LEVEL
    key = cache_key(
        f"physics.gel.{'linear' if linear else 'finite'}.gel",
        "physics.gel.path.solver",
        skin=[skin.width_mm, skin.length_mm, skin.thickness_mm],
        poisson=material.poisson,
        friction=choice.friction,
        prony=material.prony,
        indenter=repr(indenter),
        level=choice.level,
        spacing_mm=choice.spacing_mm,
        asked_mm=choice.goal_mm,
        growth=choice.growth,
        mirrors=choice.mirrors,
        focus=None if linear else choice.focus,
        step_mm=None if linear else choice.step_mm,
        poses=[[*tip, seconds] if material.prony else tip for tip, seconds in images],
        observed=observed,
    )

    def gel() -> GelContact:
        return open_contact(skin, unit, indenter, choice, observed.lattice_mm)

    return PathSolver(gel, poses, key, observed, mirror, skin.thickness_mm, coarser, keeps_states)


def open_contact(
    skin: SkinDimensions,
    material: GelMaterial,
    indenter: Indenter,
    choice: Choice,
    lattice_mm: float = 0.25,
) -> GelContact:
    """Make the contact of a choice. lattice_mm: largest spacing of the lattice."""
    x, y = (_lattice(half, lattice_mm) for half in skin.opening_half_mm)
    if choice.level == FINITE_LEVEL:
        from ..finite.gel import FiniteGel

        return FiniteGel(skin, material, indenter, choice, x, y)
    from ..linear.gel import LinearGel

    return LinearGel(skin, material, indenter, choice, x, y)


def _lattice(half_mm: float, spacing_mm: float) -> Field:
    """Lattice nodes from -half to half, 0 included."""
    n = max(1, math.ceil(half_mm / spacing_mm - 1e-9))
    return np.linspace(-half_mm, half_mm, 2 * n + 1)
