"""One press: level and mesh picked, its error estimated, refined if need be (`error_control`)."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
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
    TimeLimit,
)
from deltact_fab.sensor import (
    GelMaterial,
    Indenter,
    SkinDimensions,
)

from . import time_limit
from .error_control import MeshConvergence, RefinedPress
from .finite.mesh import unknowns
from .level import FINITE_LEVEL, Choice, GelLevel, contact_radius_mm, unusual_material
from .level_selection import FORCE_TOLERANCE, MAX_TOLERANCE, MIN_TOLERANCE
from .path.knots import Increments, KnotPose, ObservedChannels
from .path.open import choose_level, open_path
from .path.solver import PathSolver

CPU_LIMIT_S = 120.0
PRESS_OBSERVED = ObservedChannels(fields="last", lacking=True)
RESULT_KEYS = (
    "force_n", "depth_mm", "contact_area_mm2", "contact_area_error_mm2", "stick_area_mm2",
    "stick_area_error_mm2", "centroid_mm", "max_stretch", "model", "converged",
    "error_estimate", "within_tolerance", "seconds", "picked", "peak_in_plane_mm", "flags",
)  # fmt: skip
"""Of a result; a refusal has `reason` besides, and None where there is no figure."""


@dataclass(frozen=True, eq=False)
class PressResult:
    """The outcome. result: plain data with the keys of `gel press --json`.

    tips_mm (n, 3), forces_n (n, 3): the way, at rest first. x_mm (nx,), y_mm (ny,) and
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
) -> PressResult:
    """Press to a depth, then shear.

    tolerance: of the force; IN_PLANE_MM in proportion goes with it. Meshes are refined until the
    estimate is within it, as far as `error_control` allows, unless spacing_mm names one.
    progress: told the increments done and to do of the mesh under way, and which that is.
    limit_s: of CPU time (`time_limit`), loading libraries included; the best mesh by then is the
    answer, flagged `limit`.
    Raises InputError for numbers that make no press; a refusal or a failure of the solver is in
    the result, `converged` False and `force_n` None.
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

    def solver(choice: Choice, like: PathSolver | None) -> PathSolver:
        poses = path(choice.step_mm)
        return open_path(skin, material, indenter, poses, PRESS_OBSERVED, choice, like, True)

    def unknowns_of(choice: Choice) -> int:
        return unknowns(skin, choice.spacing_mm, choice.focus, choice.mirrors, choice.growth)

    radius_mm = contact_radius_mm(indenter, depth_mm) if depth_mm > 0 else math.inf
    edge_mm = indenter.edge_radius_mm
    ladder = MeshConvergence(solver, unknowns_of, radius_mm, edge_mm, tolerance, progress)
    picked: Choice | None = None
    refined: RefinedPress | None = None
    try:
        with time_limit.within(limit_s):
            picked = choose(model)
            refined = ladder.refine(picked, free=spacing_mm is None)
            linear = model == "auto" and picked.level != FINITE_LEVEL
            if linear and not (refined.limited or ladder.meets_tolerance(refined.estimate)):
                picked = choose(FINITE_LEVEL)
                refined = ladder.refine(picked, free=spacing_mm is None)
    except TimeLimit:
        if refined is None:
            error = f"--limit-s {limit_s:g}: no mesh was solved in that CPU time; more is needed"
            level = picked.level if picked else model
            return refused_press(depth_mm, level, error, time.perf_counter() - started)
        refined = replace(refined, limited=True)
    except DeltactFabError as error:
        level = picked.level if picked else model
        return refused_press(depth_mm, level, str(error), time.perf_counter() - started)
    fine, choice, last = refined.run, refined.run.choice, refined.run.last
    u = last.displacement_mm
    assert u is not None, "the last field is observed"
    tips = [(x, y, 0.0), *((px, py, -pz) for px, py, pz in (p.tip_mm for p in fine.poses))]
    flags = [*_flags(refined, ladder, depth_mm, limit_s)]
    if odd := unusual_material(material.modulus_mpa):
        flags.append(Note("modulus", odd))
    forces = material.modulus_mpa * np.array([(0.0, 0.0, 0.0), *(k.force_n for k in fine.knots)])
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
    return PressResult(result, np.array(tips), forces, *fine.axes_mm, u.astype(np.float64))


def _require(
    at_mm: Point2, depth_mm: float, shear_mm: Point2, tolerance: float, limit_s: float
) -> None:
    """Raises InputError for numbers that make no press."""
    if not (math.isfinite(depth_mm) and depth_mm >= 0):
        raise InputError(f"--depth {depth_mm}: a depth in mm, 0 or more, is needed")
    if not all(math.isfinite(v) for v in (*at_mm, *shear_mm)):
        raise InputError(f"--at {at_mm}, shear {shear_mm}: finite mm are needed")
    if not (math.isfinite(tolerance) and MIN_TOLERANCE <= tolerance <= MAX_TOLERANCE):
        raise InputError(
            f"--tolerance {tolerance}: {MIN_TOLERANCE} to {MAX_TOLERANCE} of the force is needed"
        )
    if not limit_s > 0:
        raise InputError(f"--limit-s {limit_s}: more than 0 seconds are needed")


def _flags(
    refined: RefinedPress, ladder: MeshConvergence, depth_mm: float, limit_s: float
) -> Iterator[Note]:
    """What a reader of the result must know: the solver's own flags at the corners, and more."""
    estimate, solver = refined.estimate, refined.run
    corner_flags: dict[str, Note] = {}
    for pose, knot in zip(solver.poses, solver.knots, strict=True):
        if pose.part == 1.0:  # on the way in, the first increments are coarse by intention
            corner_flags.update({flag.id: flag for flag in knot.flags})
    yield from corner_flags.values()
    if depth_mm > 0 and refined.zones.contact_area_mm2 == 0:
        yield Note("contact lost", f"at depth {depth_mm:g} mm nothing is touched")
    if refined.limited:
        text = (
            f"{limit_s:g} CPU seconds do not reach to the tolerance; cells of "
            f"{refined.run.choice.spacing_mm:.3g} mm are the finest that were solved"
        )
        yield Note("limit", text)
    if not ladder.meets_tolerance(estimate):
        text = (
            f"estimated error {estimate['force_rel']:.2g} of force, "
            f"{estimate['displacement_mm']:.2g} mm in plane; {ladder.tolerance:g} and "
            f"{ladder.in_plane_mm:.2g} mm were asked"
        )
        yield Note("tolerance", text)


def refused_press(
    depth_mm: float, level: GelLevel, reason: str, seconds: float = 0.0
) -> PressResult:
    """What stands for a press that was not solved, with the level that was taken or asked for."""
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
    return PressResult(result, none, none, np.empty(0), np.empty(0), np.empty((0, 0, 3)))
