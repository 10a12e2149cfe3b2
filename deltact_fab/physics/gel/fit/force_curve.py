"""Force against depth of one indenter, for every modulus.

With Poisson's ratio and friction fixed, all stresses of a neo-Hookean gel scale with its modulus.
`physics.gel.path` solves at finite strain, on cells for the deepest point; a monotone cubic of log
force over log depth interpolates between solved depths. At depths where the contact is less than
some cells wide, the linear level's force is used, times a factor that goes from 1 at touch to the
first solved ratio as sqrt(d): the effect of finite strain grows with the contact's radius.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from deltact_fab.common import Field, InputError, Point2, Progress, SolverError
from deltact_fab.sensor import GelMaterial, Indenter, SkinDimensions

from ..level import contact_radius_mm
from ..linear.validity import DEPTH_LIMIT
from ..path.knots import KnotPose, ObservedChannels
from ..path.open import choose_level, open_path

# By hand: more and finer steps cost solves, fewer blur the curve.
CURVE_STEP_MM = 0.5  # between solved depths
DEEPEST_SHARE = 0.95  # of the thickness: deepest press
CONTACT_CELLS = 3.0  # contact radius over cell size from which finite strain is used
LINEAR_PARTS = (1 / 32, 1 / 16, 1 / 8, 1 / 4, 1 / 2, 3 / 4)  # of the first solved depth
LINEAR_SPACING_MM = 0.2  # of the linear grid


@dataclass(frozen=True, eq=False)
class ForceCurve:
    """Forces on the sensor along one press: depth_mm (n,) rising from 0, force_n (n, 3)."""

    depth_mm: Field
    force_n: Field

    def normal_n(self, depth_mm: Field) -> Field:
        """Return -Fz (n,) at depths (n,) up to the last solved one; 0 out of contact.

        Below the first solved depth it is a power law.
        """
        depth = np.clip(depth_mm, 0, self.depth_mm[-1])
        curve, start, power = self._power_law
        touched = depth > 0
        t = np.log(np.where(touched, depth, 1.0))
        inner, shallow = np.maximum(t, start), np.minimum(t - start, 0.0)
        return np.where(touched, np.exp(curve(inner) + power * shallow), 0.0)

    @cached_property
    def _power_law(self) -> tuple[Any, float, float]:
        """Monotone cubic of log force over log depth, its start, the exponent below it."""
        from scipy.interpolate import PchipInterpolator

        x, y = np.log(self.depth_mm[1:]), np.log(-self.force_n[1:, 2])
        # The exponent of the first interval; the one-sided slope of PCHIP is noisier.
        return PchipInterpolator(x, y), float(x[0]), float((y[1] - y[0]) / (x[1] - x[0]))


def cells_mm(
    skin: SkinDimensions, indenter: Indenter, poisson: float, at_mm: Point2, deepest_mm: float
) -> float:
    """Cell size that the default tolerance requires for a press.

    Raises InputError where no finite-strain mesh is possible.
    """
    pose = KnotPose((*at_mm, -deepest_mm), 0.0, 1.0)
    material = GelMaterial(1.0, poisson)
    return choose_level(skin, material, indenter, [pose], level="hyperelastic").spacing_mm


def force_curve(
    skin: SkinDimensions,
    material: GelMaterial,
    indenter: Indenter,
    at_mm: Point2,
    deepest_mm: float,
    spacing_mm: float,
    progress: Progress | None = None,
) -> ForceCurve:
    """Solve the press at at_mm to deepest_mm.

    spacing_mm: cells below the indenter. Solved depths are multiples of CURVE_STEP_MM, or of less
    in a thin gel, so the last one may lie up to a step deeper. A series in `material.prony` is
    ignored: a slow press. Raises InputError for values out of range, and the solver's errors.
    """
    thickness = skin.thickness_mm
    step = min(CURVE_STEP_MM, thickness / 24)
    if not (math.isfinite(deepest_mm) and 0 < deepest_mm <= DEEPEST_SHARE * thickness):
        raise InputError(
            f"force curve: the depth must be above 0 and up to {DEEPEST_SHARE * thickness:g} mm, "
            f"{DEEPEST_SHARE:.0%} of the gel's thickness (got {deepest_mm:g} mm)"
        )
    unit = GelMaterial(1.0, material.poisson, material.friction)
    # Number of steps to the first solved depth, and the linear level's forces below it.
    reach = math.floor(DEPTH_LIMIT * thickness / step + 1e-9)
    first = max(1, min(reach, round(_first_solvable_mm(indenter, spacing_mm) / step)))
    light = _linear_forces(skin, unit, indenter, at_mm, first * step)
    if light is None:
        first = 1  # finite strain from the first step on, where the linear level is invalid
    # A second solved depth gives the slope at the first, for shallow data.
    last = max(first + 1, math.ceil(deepest_mm / step - 1e-9))
    limit = math.floor(DEEPEST_SHARE * thickness / step + 1e-9)
    depths = [step * k for k in range(first, min(last, limit) + 1)]
    if deepest_mm > depths[-1] * (1 + 1e-9):
        depths.append(deepest_mm)
    poses = [KnotPose((*at_mm, -d), 0.0, 1.0) for d in depths]
    # Cells for any depth, so that a deeper press gives the same forces on the way.
    route = [*poses, KnotPose((*at_mm, -DEEPEST_SHARE * thickness), 0.0, 1.0)]
    choice = choose_level(skin, unit, indenter, route, level="hyperelastic", spacing_mm=spacing_mm)
    # The poses are no further apart than one increment of the solver.
    solver = open_path(
        skin, unit, indenter, poses, ObservedChannels(), replace(choice, step_mm=step)
    )
    label = f"{indenter.name}, friction {unit.friction:g}"
    knots = solver.solve_all(progress and (lambda count, total, _: progress(count, total, label)))
    forces = np.array([knot.force_n for knot in knots])
    shallow, small = np.empty(0), np.empty((0, 3))
    if light is not None:
        shallow, normal, linear_n = light
        grows = 1 + (-forces[0, 2] / linear_n - 1) * np.sqrt(shallow / depths[0])
        small = (normal * grows)[:, None] * (forces[0] / -forces[0, 2])
    depth = np.concatenate([[0.0], shallow, depths])
    force = np.concatenate([np.zeros((1, 3)), small, forces])
    return ForceCurve(depth, force * material.modulus_mpa)


def _first_solvable_mm(indenter: Indenter, h: float) -> float:
    """Depth from which the contact is CONTACT_CELLS cells wide, or 60 % of the tips' width."""
    goal = min(CONTACT_CELLS * h, 0.6 * contact_radius_mm(indenter, math.inf))
    low, high = 0.0, 2 * indenter.equator_mm
    for _ in range(12):
        middle = (low + high) / 2
        low, high = (low, middle) if contact_radius_mm(indenter, middle) >= goal else (middle, high)
    return high


def _linear_forces(
    skin: SkinDimensions, unit: GelMaterial, indenter: Indenter, at_mm: Point2, first_mm: float
) -> tuple[Field, Field, float] | None:
    """Return shallower depths, their linear normal forces, and the force at the first solved one.

    None where the linear level refuses that depth.
    """
    depths = [part * first_mm for part in (*LINEAR_PARTS, 1.0)]
    poses = [KnotPose((*at_mm, -d), 0.0, 1.0) for d in depths]
    # Too light a touch hides between the grid's nodes: skip to deeper ones.
    for skipped in range(len(LINEAR_PARTS) - 1):
        try:
            choice = choose_level(
                skin, unit, indenter, poses[skipped:],
                level="linear", friction=0.0, spacing_mm=LINEAR_SPACING_MM,
            )  # fmt: skip
            solver = open_path(skin, unit, indenter, poses[skipped:], ObservedChannels(), choice)
            normal = np.array([-knot.force_n[2] for knot in solver.solve_all()])
        except (InputError, SolverError):
            continue
        return np.array(depths[skipped:-1]), normal[:-1], float(normal[-1])
    return None
