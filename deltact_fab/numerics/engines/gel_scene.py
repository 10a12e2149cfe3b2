"""One indenter pressed along a path into a block of the finite-strain gel, solved once, and what
is read off the states: force, balance, the cone of friction, energy.

Each figure of a case is held against something independent: a finer mesh; the work of the indenter
along a frictionless path against the energy stored; what the base carries; mirror images; the cone.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from ...aliases import Point
from ...elasticity.material import GelMaterial
from ...gel.finite import FinitePress, FiniteState, block_mesh
from ...gel.finite.linear import Name
from ...shapes import SkinDimensions
from ...shapes.indenter import parse
from ..engine import Flagged

Box = tuple[float, float, float, float]
SPHERE = "sphere:15"
FOCUS: Box = (-7.5, 7.5, -7.5, 7.5)
FINER = 1.5  # ratio of the mesh that a force is held against


@dataclass(frozen=True)
class GelCase:
    """One indenter on one gel with its mesh or grid; hashable: what is solved is solved once."""

    indenter: str = SPHERE
    spacing_mm: float = 1.5
    friction: float = 0.0
    nu: float = 0.49
    side_mm: tuple[float, float] = (36.0, 34.0)
    thickness_mm: float = 12.0
    focus: Box | None = FOCUS
    mirrors: tuple[bool, bool] = (True, True)
    solver: Name = "auto"

    def skin(self) -> SkinDimensions:
        """Half of it stands proud."""
        proud = self.thickness_mm / 2
        return SkinDimensions(*self.side_mm, self.thickness_mm, min(2.0, proud / 2), proud)

    def material(self) -> GelMaterial:
        """Of the default modulus: another one scales the forces and nothing else."""
        return GelMaterial(poisson=self.nu, friction=self.friction)

    def press(self) -> FinitePress:
        """The scene's solver, without history."""
        mesh = block_mesh(self.skin(), self.spacing_mm, self.focus, self.mirrors)
        return FinitePress(mesh, self.material(), parse(self.indenter), solver=self.solver)

    def finer(self) -> GelCase:
        """The same on a finer mesh."""
        return replace(self, spacing_mm=self.spacing_mm / FINER)


@dataclass(frozen=True, eq=False)
class FiniteSolution:
    """A path: its solver and all states, the one at rest first."""

    press: FinitePress
    states: tuple[FiniteState, ...]

    @property
    def last(self) -> FiniteState:
        """The end of the path."""
        return self.states[-1]

    @property
    def normal_n(self) -> float:
        """Force of the whole indenter at the end, positive when pressed."""
        return -self.last.force_n[2] * self.press.mesh.copies

    def note(self) -> str:
        """Force, penetration and what it took."""
        d = [s.diagnostics for s in self.states]
        return (
            f"{self.normal_n:.4g} N, {d[-1].penetration_mm:.2g} mm inside, "
            f"stretch {d[-1].most_stretch:.3g}, least J {min(x.least_j for x in d):.2g}, "
            f"{sum(x.iterations for x in d)} iterations, {sum(x.cuts for x in d)} cuts"
        )


@cache
def solved(scene: GelCase, step_mm: float, *tips: Point) -> FiniteSolution:
    """From above the first tip through all tips in steps. Raises what the solver raises."""
    press = scene.press()
    states = [press.rest((tips[0][0], tips[0][1], 0.0))]
    for tip in tips:
        states += press.path(states[-1], tip, step_mm)
    return FiniteSolution(press, tuple(states))


def trusted(found: FiniteSolution) -> FiniteSolution:
    """Raises Flagged where the last state is marked as not to be trusted."""
    if not found.last.trusted:
        d = found.last.diagnostics
        why = f"{d.penetration_mm:.2g} mm inside at depth {found.last.tip_mm[2]:g} mm"
        lagged = "; jumped, with the friction of the pressures before" if d.lagged else ""
        raise Flagged(f"not trusted: {why}{lagged}")
    return found


def down(depth_mm: float) -> Point:
    """The tip in the middle, at this depth."""
    return (0.0, 0.0, depth_mm)


# -- figures ---------------------------------------------------------------------------------------


def imbalance(found: FiniteSolution) -> float:
    """What the base does not carry, over the force; across a mirror the mirror carries too."""
    mirrors = (*found.press.mesh.mirrors, False)
    worst = 0.0
    for s in found.states:
        size = math.hypot(*s.force_n)
        if size > 0:
            left = [
                f + b for f, b, m in zip(s.force_n, s.base_force_n, mirrors, strict=True) if not m
            ]
            worst = max(worst, math.hypot(*left) / size)
    return worst


def cone_excess(found: FiniteSolution) -> float:
    """Shear beyond friction x pressure at a contact point, over the largest bound, end of path."""
    bound = found.press.friction * found.last.pressure_mpa
    size = np.linalg.norm(found.last.shear_mpa, axis=2)
    return float((size - bound).max() / bound.max())


def energy_nmm(press: FinitePress, state: FiniteState) -> float:
    """Stored in the gel and in the contact's penalty."""
    u, tip = state.displacement_mm, np.array(state.tip_mm)
    bulk = press.bulk.evaluate(u, False).energy_nmm
    return bulk + press.surface.evaluate(u, tip, tangent=False).energy_nmm


def work_error_percent(found: FiniteSolution) -> float:
    """Work of a frictionless straight press by Simpson's rule over the energy stored, less 1."""
    depth = np.array([s.tip_mm[2] for s in found.states])
    force = np.array([-s.force_n[2] for s in found.states])
    n = len(depth) - 1
    if n % 2:
        raise ValueError("an even number of steps is needed")
    weight = np.full(n + 1, 2.0)
    weight[1::2], weight[[0, -1]] = 4.0, 1.0
    work = float(weight @ force) * (depth[-1] - depth[0]) / n / 3
    return 100 * (work / energy_nmm(found.press, found.last) - 1)


# -- what a case computes: the figure that is held to a bound, and a note -------------------------


def finer(
    scene: GelCase, step_mm: float, tips: tuple[Point, ...], scratch: Path
) -> tuple[float, str]:
    """Force of the mesh over that of the finer one, less 1, in %."""
    found = trusted(solved(scene, step_mm, *tips))
    fine = solved(scene.finer(), step_mm, *tips)
    return 100 * (found.normal_n / fine.normal_n - 1), found.note()


def law(
    of: Callable[[FiniteSolution], float], scene: GelCase, step_mm: float,
    tips: tuple[Point, ...], scratch: Path,
) -> tuple[float, str]:  # fmt: skip
    """`cone_excess`, `imbalance` or `work_error_percent` of a path."""
    found = trusted(solved(scene, step_mm, *tips))
    return of(found), found.note()


def one_increment(scene: GelCase, depth_mm: float, scratch: Path) -> tuple[float, str]:
    """Force of a press in one step over that in ten, less 1."""
    one = solved(scene, depth_mm, down(depth_mm))
    many = solved(scene, depth_mm / 10, down(depth_mm))
    return one.normal_n / many.normal_n - 1, one.note()


def run(call: Callable[[], Any], scratch: Path) -> float:
    """For calls that must be refused: there is no figure."""
    call()
    return math.nan
