"""Choice of level, mesh and steps for a tolerance, by measured rules.

The constants are read from the tables in docs/evidence/gel.md. The model may use half of a
tolerance, the mesh the other half.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

from deltact_fab.common import InputError
from deltact_fab.sensor import (
    GEL_LEVELS,
    MAX_LINEAR_POISSON,
    EllipsoidTip,
    GelMaterial,
    Indenter,
    SkinDimensions,
    SphereTip,
)

from .finite.material import MAX_FINITE_POISSON
from .finite.mesh import CELL_GROWTH, unknowns
from .level import (
    FINITE_LEVEL,
    LINEAR_LEVEL,
    TABULATED_LEVEL,
    Choice,
    GelLevel,
    Reach,
    contact_radius_mm,
    is_mirrored,
    section_half_mm,
)
from .linear.validity import DEPTH_LIMIT, linear_refusal, model_error

# By hand: defaults and range of a tolerance; tighter costs time.
FORCE_TOLERANCE = 0.03  # relative, of the force
MIN_TOLERANCE, MAX_TOLERANCE = 0.001, 0.5
IN_PLANE_MM = 0.05  # rms over the face, at FORCE_TOLERANCE
# Measured (docs/evidence/gel.md), at FORCE_TOLERANCE.
FRICTION_FORCE = 0.5  # x min(friction, 1) x (depth/thickness)^1.6
CELLS_ACROSS = 3.0  # contact radius over cell size
DRAGGED_CELLS = 0.85  # x cells of a path that moves in plane: its steps use more of the tolerance
MIN_LAYERS = 8  # least cells over the thickness
EDGE_CELL_MM = 0.5  # largest cell where an edge is sharp
SHARP_EDGE_MM = 0.75  # radius below which an edge is sharp
STEP_ERROR = 3.5  # x friction's part of the force, over the number of increments
SHEAR_STEP = 0.08  # of the contact radius, when dragged
HIDDEN_RADII = 1.5  # x contact radius: larger cells may miss the tip
# By hand: limits of work and of extrapolating the rules above.
MAX_GRID_MM = 0.5  # of the linear level
MAX_EDGE_CELL_MM = 0.9  # at any tolerance
STEP_OF_THICKNESS = 0.12  # longest step, where friction needs no shorter one
STEP_SHARE = 0.4  # of the tolerance, for the step error
MIN_INCREMENTS, MAX_INCREMENTS = 4, 40  # least at FORCE_TOLERANCE, fewer above it, never below 2
MAX_GROWTH = 1.5  # of cells away from the contact, at any tolerance
MAX_DOFS = 120_000
MIN_CELL_MM = 0.15
# The tabulated level; measured (docs/evidence/gel.md).
RIM_MM = 8.0  # least distance of the tip from the face's rim
TABLE_FORCE, TABLE_IN_PLANE = 0.1, 0.2  # of the linear level's model error, that a table leaves
MAX_TABLE_SLOPE = 0.5  # by hand: depth over that at which the tip's sides turn vertical
TABLE_DEPTHS = 1.0, 1.25, 1.6, 2.0, 2.5, 3.15, 4.0, 5.0, 6.3, 8.0  # definition: ISO 3, series R10


def select_level(
    skin: SkinDimensions,
    material: GelMaterial,
    indenter: Indenter,
    reach: Reach,
    tolerance: float = FORCE_TOLERANCE,
    *,
    level: GelLevel = "auto",
    friction: float | None = None,
    observe_shear: bool = True,
    spacing_mm: float | None = None,
    most_unknowns: int | None = None,
) -> Choice:
    """Choose the cheapest level and mesh within the tolerance, or the mesh of a named level.

    tolerance: of the force, 0.001 to 0.5; in plane IN_PLANE_MM in proportion. The mesh is for the
    deepest point of the reach. observe_shear False with a reach of one point in plane neglects
    friction where that changes the force by less than the model's share.
    most_unknowns: limit of a finite-strain mesh chosen here; its cells are enlarged to meet it.
    Level tabulated: what is outside of the table gets the hyperelastic level, with the reason.
    Raises InputError for a depth, a material or a spacing that the level does not support, and
    names the level that does.
    """
    if level != "auto" and level not in GEL_LEVELS:
        raise InputError(f"gel: level {level!r}: valid: auto, {', '.join(GEL_LEVELS)}")
    reach.require_on(skin)
    depth, thickness = reach.deepest_mm, skin.thickness_mm
    mu = material.friction if friction is None else friction
    effect = friction_force_rel(mu, max(depth, 0.0) / thickness)
    if not (observe_shear or reach.moves) and effect <= Choice.model_share * tolerance:
        mu = 0.0
    force, in_plane = model_error(skin, indenter, depth, material.poisson)
    refusal = linear_refusal(skin, material, indenter, depth)
    reason = "requested"
    if level == "auto":
        goal = Choice.model_share * tolerance
        error_text = f"error about {force:.1%} of force, {in_plane:.2g} mm in plane"
        near = force <= goal and in_plane <= goal / FORCE_TOLERANCE * IN_PLANE_MM
        level = FINITE_LEVEL if refusal or not near else LINEAR_LEVEL
        reason = error_text if level == LINEAR_LEVEL else f"linear: {refusal or error_text}"
    elif level == LINEAR_LEVEL and refusal:
        raise InputError(f"gel: level linear: {refusal}; use level hyperelastic")
    elif level == TABULATED_LEVEL:
        refused = table_refusal(skin, material, indenter, reach)
        if not refused:
            return _table_choice(
                skin, material, indenter, depth, tolerance, friction=friction,
                observe_shear=observe_shear, spacing_mm=spacing_mm, most_unknowns=most_unknowns,
            )  # fmt: skip
        level, reason = FINITE_LEVEL, f"{TABULATED_LEVEL}: {refused}"
    if level == LINEAR_LEVEL:
        h = spacing_mm or linear_grid_mm(skin, indenter, depth)
        return Choice(
            level, h, max(0.1, min(0.25, depth / 4)), (False, False),
            focus_mm(skin, indenter, reach, h), mu, force, in_plane,
            f"linear ({reason}): grid {h:.3g} mm",
        )  # fmt: skip
    mirrors = mirrors_of(indenter, reach)
    growth = min(CELL_GROWTH ** math.sqrt(tolerance / FORCE_TOLERANCE), MAX_GROWTH)
    h, basis = (
        (spacing_mm, "requested") if spacing_mm else cell_mm(skin, indenter, reach, tolerance)
    )
    required = h
    if spacing_mm is None and most_unknowns is not None:
        h = _affordable_mm(skin, indenter, reach, mirrors, h, most_unknowns, growth)
        if h > required:
            basis = f"{most_unknowns} unknowns; tolerance requires {required:.3g} mm by its {basis}"
    if not (math.isfinite(h) and 0.02 <= h <= thickness / 2):
        raise InputError(f"gel: cells must be 0.02 to {thickness / 2:g} mm (got {h:g} mm)")
    radius = contact_radius_mm(indenter, depth) if depth > 0 else math.inf
    if h > HIDDEN_RADII * radius:
        raise InputError(
            f"gel: at depth {depth:g} mm {indenter.name} has a contact radius of {radius:.2g} mm, "
            f"not resolved by cells of {h:.3g} mm; use at most {HIDDEN_RADII * radius:.2g} mm"
        )
    step = step_mm(indenter, depth, thickness, tolerance, mu, reach.moves)
    planes = " and ".join(n for n, m in zip("xy", mirrors, strict=True) if m)
    part = {0: "whole block", 1: f"half block, mirror {planes}", 2: "quarter block"}[sum(mirrors)]
    return Choice(
        level, h, step, mirrors, focus_mm(skin, indenter, reach, h), mu, 0.0, 0.0,
        f"hyperelastic ({reason}): cells {h:.3g} mm ({basis}), steps {step:.3g} mm, {part}"
        + ("" if mu > 0 or material.friction == 0 else ", friction neglected"),
        required, growth,
    )  # fmt: skip


def table_refusal(
    skin: SkinDimensions, material: GelMaterial, indenter: Indenter, reach: Reach
) -> str | None:
    """Return the reason why the tabulated level does not support a press, or None."""
    ends, depth = table_half_mm(skin), reach.deepest_mm
    if reach.moves:
        return "the tip moves in plane"
    sides = zip((reach.x_mm, reach.y_mm), ends, strict=True)
    if any(max(-low, high) > end + 1e-9 for (low, high), end in sides):
        return f"the tip is nearer than {RIM_MM:g} mm to the rim"
    tip, *further = indenter.tips
    if further or not isinstance(tip, SphereTip | EllipsoidTip) or any(tip.lowest_mm):
        return f"{indenter.name} is not a single ball or ellipsoid"
    if not 0 < depth <= MAX_TABLE_SLOPE * indenter.equator_mm:
        limit = MAX_TABLE_SLOPE * indenter.equator_mm
        return f"depth {depth:g} mm is not within 0 to {limit:g} mm for {indenter.name}"
    return linear_refusal(skin, material, indenter, depth)


def table_half_mm(skin: SkinDimensions) -> tuple[float, float]:
    """Return the half sides (x, y) of the part of the face that has a table."""
    x, y = skin.opening_half_mm
    return x - RIM_MM, y - RIM_MM


def table_depth_mm(skin: SkinDimensions, indenter: Indenter, depth_mm: float) -> float:
    """Return the depth of the table that serves a press: the next of a series, if possible.

    So presses of all depths share a few tables.
    """
    decade = 10.0 ** math.floor(math.log10(depth_mm))
    depth = next(d for s in (*TABLE_DEPTHS, 10.0) if (d := s * decade) >= depth_mm * (1 - 1e-9))
    limit = min(DEPTH_LIMIT * skin.thickness_mm, MAX_TABLE_SLOPE * indenter.equator_mm)
    return max(min(depth, limit), depth_mm)


def _table_choice(
    skin: SkinDimensions, material: GelMaterial, indenter: Indenter, depth_mm: float,
    tolerance: float, **options: Any,
) -> Choice:  # fmt: skip
    """Choose mesh and steps of a table: all its places have the cells of its corner."""
    deepest = table_depth_mm(skin, indenter, depth_mm)
    x, y = table_half_mm(skin)
    reach = Reach((x, x), (y, y), deepest)
    options["level"] = FINITE_LEVEL
    corner = select_level(skin, material, indenter, reach, tolerance, **options)
    middle, h = Reach(deepest_mm=deepest), corner.spacing_mm
    # Whole cells on both sides, all on the face: below the tip each place has the same cells.
    reach_mm = focus_mm(skin, indenter, middle, h)[1::2]
    halves = [max(min(math.ceil(half / h), RIM_MM // h), 1) * h for half in reach_mm]
    force, in_plane = model_error(skin, indenter, depth_mm, material.poisson)
    return replace(
        corner, level=TABULATED_LEVEL, mirrors=mirrors_of(indenter, middle),
        focus=(-halves[0], halves[0], -halves[1], halves[1]), model_force_rel=TABLE_FORCE * force,
        model_in_plane_mm=TABLE_IN_PLANE * in_plane,
        reason=f"tabulated (requested): to {deepest:g} mm; {corner.reason}",
    )  # fmt: skip


def _affordable_mm(
    skin: SkinDimensions, indenter: Indenter, reach: Reach, mirrors: tuple[bool, bool],
    spacing_mm: float, max_unknowns: int, growth: float,
) -> float:  # fmt: skip
    """Smallest cells from spacing_mm on whose mesh has at most max_unknowns."""
    h, largest = spacing_mm, skin.thickness_mm / 2
    while h < largest:
        focus = focus_mm(skin, indenter, reach, h)
        if unknowns(skin, h, focus, mirrors, growth) <= max_unknowns:
            break
        h = min(h * 1.03, largest)
    return h if h == spacing_mm else float(f"{h:.3g}")


def friction_force_rel(friction: float, part: float) -> float:
    """Relative force that friction adds to a press to a fraction of the thickness."""
    return FRICTION_FORCE * min(friction, 1.0) * part**1.6


def poisson_limit(level: GelLevel) -> float:
    """Largest Poisson's ratio that a level supports."""
    return MAX_LINEAR_POISSON if level == LINEAR_LEVEL else MAX_FINITE_POISSON


def linear_grid_mm(skin: SkinDimensions, indenter: Indenter, depth_mm: float) -> float:
    """Largest grid whose error is small compared with the linear level's model error."""
    across = contact_radius_mm(indenter, depth_mm) / CELLS_ACROSS if depth_mm > 0 else MAX_GRID_MM
    # A grid 1.5 times as coarse, for the error estimate, must fit the face too, once rounded.
    h = min(max(across, MIN_CELL_MM), MAX_GRID_MM, skin.length_mm / 24.2)
    return float(f"{h:.3g}")


def cell_mm(
    skin: SkinDimensions, indenter: Indenter, reach: Reach, tolerance: float
) -> tuple[float, str]:
    share = math.sqrt(tolerance / FORCE_TOLERANCE)  # bricks are of second order
    depth = max(reach.deepest_mm, 0.0)
    radius = contact_radius_mm(indenter, depth) if depth > 0 else indenter.tips[0].radius_mm
    h = radius / CELLS_ACROSS * share * (DRAGGED_CELLS if reach.moves else 1.0)
    basis = f"contact radius {radius:.2g} mm"
    edge = indenter.edge_radius_mm
    sharp = min(share * EDGE_CELL_MM, MAX_EDGE_CELL_MM)
    if edge < SHARP_EDGE_MM and sharp < h:
        h, basis = sharp, f"edge radius {edge:.2g} mm"
    thin = skin.thickness_mm / MIN_LAYERS
    if thin < h:
        h, basis = thin, f"thickness {skin.thickness_mm:g} mm"
    return float(f"{max(h, MIN_CELL_MM):.3g}"), basis


def step_mm(
    indenter: Indenter, depth_mm: float, thickness_mm: float, tolerance: float, friction: float,
    moves: bool,
) -> float:  # fmt: skip
    """Increments of a path; friction's part of the force lacks STEP_ERROR over their number."""
    if depth_mm <= 0:
        return STEP_OF_THICKNESS * thickness_mm
    shortfall = STEP_ERROR * friction_force_rel(friction, depth_mm / thickness_mm)
    min_steps = max(MIN_INCREMENTS * min(FORCE_TOLERANCE / tolerance, 1.0), 2.0)
    steps = min(max(shortfall / (STEP_SHARE * tolerance), min_steps), MAX_INCREMENTS)
    step = min(depth_mm / math.ceil(steps - 1e-9), STEP_OF_THICKNESS * thickness_mm)
    if moves and friction > 0:
        shear = SHEAR_STEP * contact_radius_mm(indenter, depth_mm) * tolerance / FORCE_TOLERANCE
        step = min(step, max(shear, depth_mm / MAX_INCREMENTS))
    return float(f"{step:.3g}")


def focus_mm(
    skin: SkinDimensions, indenter: Indenter, reach: Reach, spacing_mm: float
) -> tuple[float, float, float, float]:
    """Box that the indenter touches along the path, with a margin of two cells."""
    half = [p + 2 * spacing_mm for p in section_half_mm(indenter, max(reach.deepest_mm, 0.0))]
    return (
        reach.x_mm[0] - half[0], reach.x_mm[1] + half[0],
        reach.y_mm[0] - half[1], reach.y_mm[1] + half[1],
    )  # fmt: skip


def mirrors_of(indenter: Indenter, reach: Reach) -> tuple[bool, bool]:
    """Return for x = 0 and y = 0 whether path and indenter are both symmetric about it."""
    return (
        reach.x_mm == (0.0, 0.0) and is_mirrored(indenter, 0),
        reach.y_mm == (0.0, 0.0) and is_mirrored(indenter, 1),
    )
