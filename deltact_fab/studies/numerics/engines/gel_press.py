"""Presses of the gel at finite strain, and their check figures.

Each figure has an independent check: a finer mesh; work of the indenter on a frictionless path
against the stored energy; force at the base; mirror images; the friction cone.
A row of evidence depends on this module's imports: the linear level is in `gel`.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from deltact_fab.common import Field, Point
from deltact_fab.physics import FinitePress, FiniteState, SolverName, follow_path
from deltact_fab.sensor import GelMaterial, SkinDimensions, parse_indenter

from ..engine import Flagged

FocusBox = tuple[float, float, float, float]
SPHERE_INDENTER = "sphere:15"
DEFAULT_FOCUS: FocusBox = (-7.5, 7.5, -7.5, 7.5)  # by hand: the contact with margin, mm
FINER_MESH_RATIO = 1.5  # by hand: smaller shows less error, larger costs ratio^3 or more


@dataclass(frozen=True)
class GelCase:
    """One indenter on one gel with its mesh or grid; hashable, so solutions are cached."""

    indenter: str = SPHERE_INDENTER
    spacing_mm: float = 1.5
    friction: float = 0.0
    nu: float = 0.49
    side_mm: tuple[float, float] = (36.0, 34.0)
    thickness_mm: float = 12.0
    focus: FocusBox | None = DEFAULT_FOCUS
    mirrors: tuple[bool, bool] = (True, True)
    solver: SolverName = "auto"

    def skin(self) -> SkinDimensions:
        """Skin with half of its thickness proud."""
        proud = self.thickness_mm / 2
        return SkinDimensions(*self.side_mm, self.thickness_mm, min(2.0, proud / 2), proud)

    def material(self) -> GelMaterial:
        """Gel of the default modulus, which only scales the forces."""
        return GelMaterial(poisson=self.nu, friction=self.friction)

    def press(self) -> FinitePress:
        """Solver of the case, without history."""
        return FinitePress.on_block(
            self.skin(), self.material(), parse_indenter(self.indenter), self.spacing_mm,
            self.focus, self.mirrors, self.solver,
        )  # fmt: skip

    def finer(self) -> GelCase:
        return replace(self, spacing_mm=self.spacing_mm / FINER_MESH_RATIO)


@dataclass(frozen=True, eq=False)
class FiniteSolution:
    press: FinitePress
    states: tuple[FiniteState, ...]

    @property
    def last(self) -> FiniteState:
        return self.states[-1]

    @property
    def normal_n(self) -> float:
        """Final force on the whole indenter, positive when pressed."""
        return -self.last.force_n[2] * self.press.mesh.copies

    def note(self) -> str:
        """Summary: force, penetration, strain, iterations."""
        d = [s.diagnostics for s in self.states]
        return (
            f"{self.normal_n:.4g} N, {d[-1].penetration_mm:.2g} mm inside, "
            f"stretch {d[-1].most_stretch:.3g}, least J {min(x.least_j for x in d):.2g}, "
            f"{sum(x.iterations for x in d)} iterations, {sum(x.cuts for x in d)} cuts"
        )


@functools.cache
def solve_press(scene: GelCase, step_mm: float, *tips: Point) -> FiniteSolution:
    """Solve from above the first tip through all tips in steps. Raises the solver's errors."""
    press = scene.press()
    states = [press.rest((tips[0][0], tips[0][1], 0.0))]
    for tip in tips:
        states += follow_path(press, states[-1], tip, step_mm)
    return FiniteSolution(press, tuple(states))


def require_trusted(solution: FiniteSolution) -> FiniteSolution:
    """Return the solution. Raises Flagged if its last state is untrusted."""
    if not solution.last.trusted:
        d = solution.last.diagnostics
        reason = f"{d.penetration_mm:.2g} mm inside at depth {solution.last.tip_mm[2]:g} mm"
        lagged = "; jumped, with the friction of the pressures before" if d.lagged else ""
        raise Flagged(f"not trusted: {reason}{lagged}")
    return solution


def down(depth_mm: float) -> Point:
    """Tip position in the middle, at this depth."""
    return (0.0, 0.0, depth_mm)


# -- figures ---------------------------------------------------------------------------------------


def imbalance(solution: FiniteSolution) -> float:
    """Largest force residual at the base over the force, but across mirror planes."""
    mirrors = (*solution.press.mesh.mirrors, False)
    worst = 0.0
    for s in solution.states:
        size = math.hypot(*s.force_n)
        if size > 0:
            residual_n = [
                f + b for f, b, m in zip(s.force_n, s.base_force_n, mirrors, strict=True) if not m
            ]
            worst = max(worst, math.hypot(*residual_n) / size)
    return worst


def cone_excess(solution: FiniteSolution) -> float:
    """Largest excess of shear over friction x pressure in the last state, over the bound."""
    bound = solution.press.friction * solution.last.pressure_mpa
    size = np.linalg.norm(solution.last.shear_mpa, axis=2)
    return float((size - bound).max() / bound.max())


def energy_nmm(press: FinitePress, state: FiniteState) -> float:
    """Energy stored in the gel and the contact penalty, N mm."""
    u, tip = state.displacement_mm, np.array(state.tip_mm)
    bulk = press.bulk.evaluate(u, False).energy_nmm
    return bulk + press.surface.evaluate(u, tip, tangent=False).energy_nmm


def work_error_percent(solution: FiniteSolution) -> float:
    """Work of a frictionless press (Simpson's rule) over the stored energy, less 1, %."""
    depth = np.array([s.tip_mm[2] for s in solution.states])
    force = np.array([-s.force_n[2] for s in solution.states])
    n = len(depth) - 1
    if n % 2:
        raise ValueError("an even number of steps is needed")
    weight = np.full(n + 1, 2.0)
    weight[1::2], weight[[0, -1]] = 4.0, 1.0
    work = float(weight @ force) * (depth[-1] - depth[0]) / n / 3
    return 100 * (work / energy_nmm(solution.press, solution.last) - 1)


# -- checks of a case: the bounded figure, and a note ----------------------------------------------


def mesh_error_percent(
    scene: GelCase, step_mm: float, tips: tuple[Point, ...], scratch: Path
) -> tuple[float, str]:
    """Force of the mesh over that of the finer mesh, less 1, %."""
    solution = require_trusted(solve_press(scene, step_mm, *tips))
    fine = solve_press(scene.finer(), step_mm, *tips)
    return 100 * (solution.normal_n / fine.normal_n - 1), solution.note()


def evaluate_law(
    measure: Callable[[FiniteSolution], float], scene: GelCase, step_mm: float,
    tips: tuple[Point, ...], scratch: Path,
) -> tuple[float, str]:  # fmt: skip
    """`cone_excess`, `imbalance` or `work_error_percent` of a path."""
    solution = require_trusted(solve_press(scene, step_mm, *tips))
    return measure(solution), solution.note()


def one_increment(scene: GelCase, depth_mm: float, scratch: Path) -> tuple[float, str]:
    """Force of a press in one step over that in ten, less 1."""
    single = solve_press(scene, depth_mm, down(depth_mm))
    many = solve_press(scene, depth_mm / 10, down(depth_mm))
    return single.normal_n / many.normal_n - 1, single.note()


def expect_refusal(call: Callable[[], Any], scratch: Path) -> float:
    """Make a call that must be refused; NaN if it is not."""
    call()
    return math.nan


def rms_mm(vectors_mm: Field) -> float:
    """Root mean square length of in-plane vectors (ny, nx, 2)."""
    return math.sqrt(float((vectors_mm**2).sum(axis=-1).mean()))
