"""One press: choice of level and mesh, error estimate, refinement if needed (`error_control`)."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from deltact_fab.common import (
    DeltactFabError,
    Field,
    InputError,
    Note,
    Point,
    Point2,
    Progress,
    SolverError,
    TimeLimit,
)
from deltact_fab.sensor import GelMaterial, Indenter, SkinDimensions

from . import time_limit
from .error_control import MeshConvergence, Opener, RefinedPress
from .finite.mesh import unknowns
from .level import (
    FINITE_LEVEL,
    TABULATED_LEVEL,
    Choice,
    GelLevel,
    contact_radius_mm,
    unusual_material,
)
from .level_selection import FORCE_TOLERANCE, MAX_TOLERANCE, MIN_TOLERANCE, table_depth_mm
from .path.knots import Increments, KnotPose, ObservedChannels
from .path.open import choose_level, open_path, open_table_press
from .path.solver import PathSolver

TABLE_TOLERANCE = 0.9  # of a press's tolerance; by hand: the rest is for lighter presses
CPU_LIMIT_S = 120.0  # by hand: ends a press that no mesh meets; longer refines more
PRESS_CHANNELS = ObservedChannels(fields="last", lacking=True)
RESULT_KEYS = (
    "force_n", "depth_mm", "contact_area_mm2", "contact_area_error_mm2", "stick_area_mm2",
    "stick_area_error_mm2", "centroid_mm", "max_stretch", "model", "converged",
    "error_estimate", "within_tolerance", "seconds", "picked", "peak_in_plane_mm", "flags",
)  # fmt: skip
"""Keys of a result; a refusal also has `reason`, and None for missing values."""


@dataclass(frozen=True, eq=False)
class PressOutcome:
    """Result of a press: plain data with the keys of `gel press --json`, and arrays.

    tips_mm (n, 3), forces_n (n, 3): along the path, from rest. x_mm (nx,), y_mm (ny,) and
    displacement_mm (ny, nx, 3): the face at its end. All empty when refused or not converged.
    """

    result: dict[str, Any]
    tips_mm: Field
    forces_n: Field
    x_mm: Field
    y_mm: Field
    displacement_mm: Field


def press_gel(
    skin: SkinDimensions,
    material: GelMaterial,
    indenter: Indenter,
    at_mm: Point2,
    depth_mm: float,
    shear_mm: Point2 = (0.0, 0.0),
    model: GelLevel = "auto",
    tolerance: float = FORCE_TOLERANCE,
    spacing_mm: float | None = None,
    progress: Progress | None = None,
    limit_s: float = CPU_LIMIT_S,
) -> PressOutcome:
    """Press to a depth, then shear.

    tolerance: of the force, with IN_PLANE_MM in proportion. Meshes are refined until the estimate
    is within it, as far as `error_control` allows, unless spacing_mm is given.
    progress: called with increments done, total, and the name of the current mesh.
    limit_s: of CPU time (`time_limit`), loading libraries included; the best mesh by then is
    returned, flagged `limit`.
    Raises InputError for invalid numbers; a refusal or a failure of the solver is in the result,
    `converged` False and `force_n` None.
    """
    _require(at_mm, depth_mm, shear_mm, tolerance, limit_s)
    started = time.perf_counter()
    x, y = at_mm
    corners: list[Point] = [(x, y, 0.0), (x, y, -depth_mm)]
    if shear_mm != (0.0, 0.0):
        corners.append((x + shear_mm[0], y + shear_mm[1], -depth_mm))

    def path(step_mm: float) -> tuple[KnotPose, ...]:
        return Increments(step_mm, step_mm).poses(corners) or (KnotPose(corners[-1], 0.0, 1.0),)

    def choose(level: GelLevel) -> Choice:
        return choose_level(
            skin, material, indenter, path(math.inf), tolerance, level=level, spacing_mm=spacing_mm
        )

    def solver(choice: Choice, coarser: PathSolver | None) -> PathSolver:
        poses = path(choice.step_mm)
        return open_path(skin, material, indenter, poses, PRESS_CHANNELS, choice, coarser, True)

    def unknowns_of(choice: Choice) -> int:
        return unknowns(skin, choice.spacing_mm, choice.focus, choice.mirrors, choice.growth)

    def ladder_to(depth_mm: float, opener: Opener, tolerance: float) -> MeshConvergence:
        radius_mm = contact_radius_mm(indenter, depth_mm) if depth_mm > 0 else math.inf
        edge_mm = indenter.edge_radius_mm
        return MeshConvergence(opener, unknowns_of, radius_mm, edge_mm, tolerance, progress)

    ladder = ladder_to(depth_mm, solver, tolerance)

    def middle(choice: Choice, coarser: PathSolver | None) -> PathSolver:
        deepest, place = table_depth_mm(skin, indenter, depth_mm), (0.0, 0.0)
        scene = skin, material, indenter, place, deepest, PRESS_CHANNELS
        return open_table_press(*scene, choice, coarser, True)

    def refine(choice: Choice) -> RefinedPress:
        if choice.level != TABULATED_LEVEL:
            return ladder.refine(choice, free=spacing_mm is None)
        deepest = table_depth_mm(skin, indenter, depth_mm)
        table = ladder_to(deepest, middle, TABLE_TOLERANCE * tolerance).refine(
            replace(choice, level=FINITE_LEVEL), free=spacing_mm is None
        )
        run = solver(replace(table.run.choice, level=TABULATED_LEVEL), None)
        return _press_from_table(run, table, deepest / depth_mm)

    picked: Choice | None = None
    refined: RefinedPress | None = None

    def refuse(reason: str) -> PressOutcome:
        level = picked.level if picked else model
        return refused_press(depth_mm, level, reason, time.perf_counter() - started)

    try:
        with time_limit.within(limit_s):
            for answer in _solve_levels(choose, refine, ladder, model):
                picked, refined = answer  # the last counts, also when the time ends
    except TimeLimit:
        if refined is None:
            return refuse(
                f"--limit-s {limit_s:g}: no mesh was solved in that CPU time (nu "
                f"{material.poisson:g}, {depth_mm:g} mm deep in {skin.thickness_mm:g} mm); "
                "increase it"
            )
        refined = replace(refined, limited=True)
    except DeltactFabError as error:
        return refuse(str(error))
    assert refined is not None, "the last level has answered"
    fine, choice, last = refined.run, refined.run.choice, refined.run.last
    u = last.displacement_mm
    assert u is not None, "the last field is observed"
    tips = [(x, y, 0.0), *((px, py, -pz) for px, py, pz in (p.tip_mm for p in fine.poses))]
    flags = [*_flags(refined, ladder, depth_mm, limit_s, model)]
    flags += (Note("modulus", text) for text in [unusual_material(material.modulus_mpa)] if text)
    forces = material.modulus_mpa * _path_forces_n(refined)
    result = {
        "force_n": forces[-1].tolist(),
        "depth_mm": depth_mm,
        **vars(refined.zones),
        "max_stretch": last.most_stretch,
        "model": choice.level,
        "converged": True,
        "error_estimate": refined.estimate,
        "within_tolerance": ladder.meets_tolerance(refined.estimate),
        "seconds": time.perf_counter() - started,
        "picked": {
            "spacing_mm": choice.spacing_mm,
            "step_mm": choice.step_mm,
            "mirrors": list(choice.mirrors),
            "dofs": fine.dofs,
            "why": choice.reason,
        },
        "peak_in_plane_mm": float(np.hypot(u[..., 0], u[..., 1]).max()),
        "flags": [flag.labelled for flag in flags],
    }
    return PressOutcome(result, np.array(tips), forces, *fine.axes_mm, u.astype(np.float64))


def _solve_levels(
    choose: Callable[[GelLevel], Choice], refine: Callable[[Choice], RefinedPress],
    ladder: MeshConvergence, model: GelLevel,
) -> Iterator[tuple[Choice, RefinedPress | None]]:  # fmt: skip
    """Solve on the level picked, and at finite strain if another does not answer well enough."""
    picked, cheaper = choose(model), None
    yield picked, None
    if model == "auto" and picked.level != FINITE_LEVEL:
        with suppress(SolverError):
            cheaper = refine(picked)
            yield picked, cheaper
            if cheaper.limited or ladder.meets_tolerance(cheaper.estimate):
                return
        picked = choose(FINITE_LEVEL)
        yield picked, cheaper
    refined = refine(picked)
    yield picked, refined if cheaper is None else ladder.better(refined, cheaper)


def _press_from_table(run: PathSolver, table: RefinedPress, depth_ratio: float) -> RefinedPress:
    """Solve a press by a table whose press in the middle is refined.

    depth_ratio: of the table over the press.
    """
    run.choice = replace(table.run.choice, level=TABULATED_LEVEL)
    run.solve_all()
    # An error of force is that of cells under a contact that is smaller in a lighter press.
    estimate = {**table.estimate, "force_rel": table.estimate["force_rel"] * depth_ratio}
    correction = np.linalg.norm(table.force_n) / np.linalg.norm(table.run.last.force_n)
    force_n = correction * np.array(run.last.force_n)
    return RefinedPress(run, force_n, estimate, run.last.zones, table.limited)


def _path_forces_n(refined: RefinedPress) -> Field:
    """Forces (n, 3) from rest on; the end's correction is in proportion along the path."""
    forces = np.array([(0.0, 0.0, 0.0), *(k.force_n for k in refined.run.knots)])
    if forces[-1].any():
        forces *= np.linalg.norm(refined.force_n) / np.linalg.norm(forces[-1])
        forces[-1] = refined.force_n
    return forces


def _require(
    at_mm: Point2, depth_mm: float, shear_mm: Point2, tolerance: float, limit_s: float
) -> None:
    """Raise InputError for invalid numbers."""
    if not (math.isfinite(depth_mm) and depth_mm >= 0):
        raise InputError(f"--depth {depth_mm}: expected a depth in mm, 0 or more")
    if not all(math.isfinite(v) for v in (*at_mm, *shear_mm)):
        raise InputError(f"--at {at_mm}, shear {shear_mm}: expected finite mm")
    if not (math.isfinite(tolerance) and MIN_TOLERANCE <= tolerance <= MAX_TOLERANCE):
        raise InputError(
            f"--tolerance {tolerance}: expected {MIN_TOLERANCE} to {MAX_TOLERANCE} of the force"
        )
    if not limit_s > 0:
        raise InputError(f"--limit-s {limit_s}: expected more than 0 seconds")


def _flags(
    refined: RefinedPress, ladder: MeshConvergence, depth_mm: float, limit_s: float, model: GelLevel
) -> Iterator[Note]:
    """Yield warnings about the result: the solver's flags at the corners, and its errors."""
    estimate, solver = refined.estimate, refined.run
    corner_flags: dict[str, Note] = {}
    for pose, knot in zip(solver.poses, solver.knots, strict=True):
        if pose.part == 1.0:  # the first increments of a line are coarse by intention
            corner_flags.update({flag.id: flag for flag in knot.flags})
    yield from corner_flags.values()
    if solver.choice.level != model == TABULATED_LEVEL:
        yield Note("not tabulated", solver.choice.reason)
    if depth_mm > 0 and refined.zones.contact_area_mm2 == 0:
        yield Note("contact lost", f"no contact at depth {depth_mm:g} mm")
    if refined.limited:
        text = (
            f"tolerance not reached in {limit_s:g} CPU seconds; finest solved cells: "
            f"{refined.run.choice.spacing_mm:.3g} mm"
        )
        yield Note("limit", text)
    if not ladder.meets_tolerance(estimate):
        text = (
            f"estimated error {estimate['force_rel']:.2g} of force, "
            f"{estimate['displacement_mm']:.2g} mm in plane; requested {ladder.tolerance:g} and "
            f"{ladder.in_plane_mm:.2g} mm"
        )
        yield Note("tolerance", text)


def refused_press(depth_mm: float, level: GelLevel, reason: str, seconds: float) -> PressOutcome:
    """Result of a press that was not solved, with the chosen or requested level."""
    result = dict.fromkeys(RESULT_KEYS) | {
        "depth_mm": depth_mm if math.isfinite(depth_mm) else None,
        "model": None if level == "auto" else level,
        "converged": False,
        "within_tolerance": False,
        "seconds": seconds,
        "flags": [],
        "reason": reason,
    }
    none = np.empty((0, 3))
    return PressOutcome(result, none, none, np.empty(0), np.empty(0), np.empty((0, 0, 3)))
