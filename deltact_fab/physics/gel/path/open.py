"""Opening of a press: choice of level, mesh and mirror image, contact and solver."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from deltact_fab.common import Field, Point, Point2, cache_key
from deltact_fab.sensor import GelMaterial, Indenter, SkinDimensions

from ..level import FINITE_LEVEL, LINEAR_LEVEL, TABULATED_LEVEL, Choice, GelContact, Reach
from ..level_selection import FORCE_TOLERANCE, select_level, table_depth_mm
from .knots import Increments, KnotPose, ObservedChannels, mirror_of
from .solver import PathSolver

LEVEL_MODULES = {
    LINEAR_LEVEL: "physics.gel.linear.gel",
    FINITE_LEVEL: "physics.gel.finite.gel",
    TABULATED_LEVEL: "physics.gel.path.open",
}
"""Code that a solution of a level depends on."""


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
    linear = choice.level == LINEAR_LEVEL
    key = cache_key(
        LEVEL_MODULES[choice.level],
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
        if choice.level == TABULATED_LEVEL:
            tips = [tip for tip, _ in images]
            return _open_tabulated(skin, unit, indenter, tips, observed, choice)
        return open_contact(skin, unit, indenter, choice, observed.lattice_mm)

    return PathSolver(gel, poses, key, observed, mirror, skin.thickness_mm, coarser, keeps_states)


def _open_tabulated(
    skin: SkinDimensions, unit: GelMaterial, indenter: Indenter, tips_mm: Sequence[Point],
    observed: ObservedChannels, choice: Choice,
) -> GelContact:  # fmt: skip
    """Open a press at a place with the presses of its table, which are solved when needed."""
    from ..linear.gel import LinearGel
    from ..tabulated import TableNode, TabulatedGel, table_weights

    place = tips_mm[0][:2]
    depth = table_depth_mm(skin, indenter, max(-z for _, _, z in tips_mm))
    options: dict[str, Any] = {"level": LINEAR_LEVEL, "friction": choice.friction}
    linear = select_level(skin, unit, indenter, Reach(deepest_mm=depth), **options)
    levels = choice, replace(linear, step_mm=choice.step_mm)
    nodes = []
    for node, weight in table_weights(skin, place).items():
        scene = skin, unit, indenter, node, depth, observed
        nodes.append(TableNode(weight, node, *(open_table_press(*scene, c) for c in levels)))
    contact = open_contact(skin, unit, indenter, linear, observed.lattice_mm)
    assert isinstance(contact, LinearGel)
    return TabulatedGel(choice, contact, nodes, place)


def open_table_press(
    skin: SkinDimensions, material: GelMaterial, indenter: Indenter, place_mm: Point2,
    depth_mm: float, observed: ObservedChannels, choice: Choice, coarser: PathSolver | None = None,
    keeps_states: bool = False,
) -> PathSolver:  # fmt: skip
    """Open a press of a table; choice: of its press in the middle, or linear."""
    x, y = place_mm
    poses = Increments(choice.step_mm, 1.0).poses([(x, y, 0.0), (x, y, -depth_mm)])
    if choice.level != LINEAR_LEVEL:
        low_x, high_x, low_y, high_y = choice.focus
        mirrors = choice.mirrors[0] and x == 0, choice.mirrors[1] and y == 0
        focus = low_x + x, high_x + x, low_y + y, high_y + y
        choice = replace(choice, level=FINITE_LEVEL, mirrors=mirrors, focus=focus)
    channels = replace(observed, fields="none" if observed.fields == "none" else "all")
    return open_path(skin, material, indenter, poses, channels, choice, coarser, keeps_states)


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

    assert choice.level == LINEAR_LEVEL, "a table is of a press: see open_path"
    return LinearGel(skin, material, indenter, choice, x, y)


def _lattice(half_mm: float, spacing_mm: float) -> Field:
    """Lattice nodes from -half to half, 0 included."""
    n = max(1, math.ceil(half_mm / spacing_mm - 1e-9))
    return np.linspace(-half_mm, half_mm, 2 * n + 1)
