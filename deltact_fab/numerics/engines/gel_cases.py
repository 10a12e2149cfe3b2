"""Stiff and extreme presses of the finite-strain gel, each held against something independent.

A finer mesh; the work of the indenter along a frictionless path against the energy stored; what
the base carries; mirror images; the cone of friction. A state that the solver itself does not
trust (the indenter deep inside the gel) counts as refused.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np

from ...gel.choose import pick
from ...gel.finite import FinitePress, FiniteState, block_mesh
from ...gel.finite.field import whole_wrench
from ...gel.finite.linear import Name
from ...gel.level import Reach, open_contact
from ...gel.material import GelMaterial
from ...shapes import SkinDimensions
from ...shapes.indenter import parse
from ..engine import Case, Flagged

Point = tuple[float, float, float]
Box = tuple[float, float, float, float]
SPHERE = "sphere:15"
FOCUS: Box = (-7.5, 7.5, -7.5, 7.5)
DEPTHS = (0.05, 0.25, 0.5, 0.75, 0.9)  # of the thickness
NUS = (0.3, 0.4, 0.45, 0.49, 0.495, 0.499, 0.4999)
FINER = 1.5  # ratio of the mesh that a force is held against
SHARP = ("hexprism", "star", "edges", "4dots")


@dataclass(frozen=True)
class Scene:
    """One indenter on one gel with its mesh; hashable, so that what is solved is solved once."""

    indenter: str = SPHERE
    spacing_mm: float = 1.5
    friction: float = 0.0
    nu: float = 0.49
    modulus_mpa: float = 0.56
    side_mm: tuple[float, float] = (36.0, 34.0)
    thickness_mm: float = 12.0
    focus: Box | None = FOCUS
    mirrors: tuple[bool, bool] = (True, True)
    solver: Name = "auto"

    def skin(self) -> SkinDimensions:
        """Half of it stands proud."""
        proud = self.thickness_mm / 2
        return SkinDimensions(*self.side_mm, self.thickness_mm, min(2.0, proud / 2), proud)

    def press(self) -> FinitePress:
        """The scene's solver, without history."""
        mesh = block_mesh(self.skin(), self.spacing_mm, self.focus, self.mirrors)
        material = GelMaterial(self.modulus_mpa, self.nu, self.friction)
        return FinitePress(mesh, material, parse(self.indenter), solver=self.solver)

    def finer(self) -> Scene:
        """The same on a finer mesh."""
        return replace(self, spacing_mm=self.spacing_mm / FINER)


@dataclass(frozen=True, eq=False)
class Solved:
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

    @property
    def iterations(self) -> int:
        """Of the whole path."""
        return sum(s.diagnostics.iterations for s in self.states)

    def note(self) -> str:
        """Force, penetration and what it took."""
        d = [s.diagnostics for s in self.states]
        return (
            f"{self.normal_n:.4g} N, {d[-1].penetration_mm:.2g} mm inside, "
            f"stretch {d[-1].most_stretch:.3g}, least J {min(x.least_j for x in d):.2g}, "
            f"{self.iterations} iterations, {sum(x.cuts for x in d)} cuts"
        )


@cache
def solved(scene: Scene, step_mm: float, *tips: Point) -> Solved:
    """From above the first tip through all tips in steps. Raises what the solver raises."""
    press = scene.press()
    states = [press.rest((tips[0][0], tips[0][1], 0.0))]
    for tip in tips:
        states += press.path(states[-1], tip, step_mm)
    return Solved(press, tuple(states))


def trusted(found: Solved) -> Solved:
    """Raises Flagged where the last state is marked as not to be trusted."""
    if not found.last.trusted:
        inside = found.last.diagnostics.penetration_mm
        raise Flagged(f"not trusted: {inside:.2g} mm inside at depth {found.last.tip_mm[2]:g} mm")
    return found


# -- figures ---------------------------------------------------------------------------------------


def imbalance(found: Solved) -> float:
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


def cone_excess(found: Solved) -> float:
    """Shear beyond friction x pressure at a contact point, over the largest bound, end of path."""
    bound = found.press.friction * found.last.pressure_mpa
    size = np.linalg.norm(found.last.shear_mpa, axis=2)
    return float((size - bound).max() / bound.max())


def energy_nmm(press: FinitePress, state: FiniteState) -> float:
    """Stored in the gel and in the contact's penalty."""
    u, tip = state.displacement_mm, np.array(state.tip_mm)
    bulk = press.bulk.evaluate(u, False).energy_nmm
    return bulk + press.surface.evaluate(u, tip, tangent=False).energy_nmm


def work_error(found: Solved) -> float:
    """Work of a frictionless straight press by Simpson's rule over the energy stored, less 1."""
    depth = np.array([s.tip_mm[2] for s in found.states])
    force = np.array([-s.force_n[2] for s in found.states])
    n = len(depth) - 1
    if n % 2:
        raise ValueError("an even number of steps is needed")
    weight = np.full(n + 1, 2.0)
    weight[1::2], weight[[0, -1]] = 4.0, 1.0
    work = float(weight @ force) * (depth[-1] - depth[0]) / n / 3
    return work / energy_nmm(found.press, found.last) - 1


def mesh_change(scene: Scene, step_mm: float, *tips: Point) -> tuple[float, str]:
    """Force of the mesh over that of the finer one, less 1, in %."""
    found = trusted(solved(scene, step_mm, *tips))
    fine = solved(scene.finer(), step_mm, *tips)
    return 100 * (found.normal_n / fine.normal_n - 1), found.note()


def _side_force(against: str, scratch: Path) -> tuple[float, str]:
    """Side force of a drag over that on a finer mesh, or in half the steps, less 1, in %."""
    scene = Scene(spacing_mm=1.5, friction=0.5, focus=(-6.0, 9.0, -6.0, 6.0), mirrors=(False, True))
    tips = (_down(3.0), (3.0, 0.0, 3.0))
    found = trusted(solved(scene, 0.5, *tips))
    other = solved(scene.finer(), 0.5, *tips) if against == "mesh" else solved(scene, 0.25, *tips)
    return 100 * (found.last.force_n[0] / other.last.force_n[0] - 1), found.note()


def _down(depth_mm: float) -> Point:
    return (0.0, 0.0, depth_mm)


def _finer(scene: Scene, step_mm: float, tips: tuple[Point, ...], scratch: Path) -> Any:
    return mesh_change(scene, step_mm, *tips)


def _work(scene: Scene, depth_mm: float, scratch: Path) -> tuple[float, str]:
    found = solved(scene, depth_mm / 10, _down(depth_mm))
    return 100 * work_error(found), found.note()


def _scaled(factor: float, what: str, scratch: Path) -> tuple[float, str]:
    scene = Scene(spacing_mm=2.0, friction=0.5, mirrors=(False, True))
    tips = (_down(3.0), (1.0, 0.0, 3.0))
    one, other = (solved(replace(scene, modulus_mpa=e), 1.0, *tips) for e in (0.56, 0.56 * factor))
    note = f"{one.iterations} and {other.iterations} iterations"
    if what == "iterations":
        return other.iterations - one.iterations, note
    f, g = np.array(one.last.force_n), np.array(other.last.force_n) / factor
    return float(np.abs(g - f).max() / np.abs(f).max()), note


def _cone(scene: Scene, step_mm: float, tips: tuple[Point, ...], scratch: Path) -> Any:
    found = trusted(solved(scene, step_mm, *tips))
    return cone_excess(found), found.note()


def _balance(scene: Scene, step_mm: float, tips: tuple[Point, ...], scratch: Path) -> Any:
    found = trusted(solved(scene, step_mm, *tips))
    return imbalance(found), found.note()


def _stick(scratch: Path) -> tuple[float, str]:
    """Friction so high that nothing slips: ten times as high must change nothing."""
    scene = Scene(spacing_mm=2.0, mirrors=(False, True))
    tips = (_down(3.0), (1.0, 0.0, 3.0))
    a, b = (solved(replace(scene, friction=mu), 1.0, *tips) for mu in (100.0, 1000.0))
    f, g = np.array(a.last.force_n), np.array(b.last.force_n)
    return float(np.abs(f - g).max() / np.abs(f).max()), a.note()


def thick(thickness_mm: float, share: float) -> tuple[Scene, float]:
    """A sphere pressed to a share of a gel's thickness; mesh and step as `gel press` picks them.

    On a thin gel all is smaller: its sides are many thicknesses away even so.
    """
    scene = Scene(thickness_mm=thickness_mm)
    if thickness_mm < 6:
        scene = replace(scene, indenter="sphere:6", side_mm=(14.0, 13.0))
    reach = Reach(deepest_mm=share * thickness_mm)
    choice = pick(scene.skin(), GelMaterial(), parse(scene.indenter), reach, level="hyperelastic",
                  friction=0.0)  # fmt: skip
    picked = replace(scene, spacing_mm=choice.spacing_mm, focus=choice.focus)
    return picked, choice.step_mm


def _thickness(thickness_mm: float, share: float, what: str, scratch: Path) -> tuple[float, str]:
    scene, step = thick(thickness_mm, share)
    tip = _down(share * thickness_mm)
    if what == "force":
        return mesh_change(scene, step, tip)
    found = trusted(solved(scene, step, tip))
    force = np.array([-s.force_n[2] for s in found.states])
    fall = max(0.0, -float(np.diff(force).min())) / force[-1]
    return max(fall, imbalance(found)), found.note()


def _corners(scene: Scene, at_mm: tuple[float, float], depth_mm: float, scratch: Path) -> Any:
    """Largest difference of the four corners' forces, mirrored, over the force."""
    forces, last = [], None
    for sx in (1, -1):
        for sy in (1, -1):
            x, y = sx * at_mm[0], sy * at_mm[1]
            box = (x - 4, x + 4, y - 4, y + 4)
            here = replace(scene, mirrors=(False, False), focus=box)
            last = trusted(solved(here, 1.0, (x, y, depth_mm)))
            forces.append(np.array(last.last.force_n) * [sx, sy, 1])
    assert last is not None
    spread = np.ptp(np.array(forces), axis=0).max()
    return float(spread / np.abs(forces[0]).max()), last.note()


def _one_increment(scene: Scene, depth_mm: float, scratch: Path) -> tuple[float, str]:
    one = solved(scene, depth_mm, _down(depth_mm))
    many = solved(scene, depth_mm / 10, _down(depth_mm))
    return one.normal_n / many.normal_n - 1, one.note()


def _unloaded(scene: Scene, depth_mm: float, scratch: Path) -> tuple[float, str]:
    found = solved(scene, 1.0, _down(depth_mm))
    free = found.press.solve(found.last, _down(0.0))
    return float(np.abs(free.displacement_mm).max()), found.note()


def _same(one: Scene, two: Scene, scratch: Path) -> float:
    a, b = (solved(s, 1.0, _down(3.0)) for s in (one, two))
    return a.normal_n / b.normal_n - 1


def _depth_zero(scratch: Path) -> float:
    press = Scene(spacing_mm=3.0).press()
    state = press.solve(press.rest(), _down(0.0))
    return float(np.abs(state.displacement_mm).max() + np.abs(state.force_n).max())


def _side_force_of_a_press(scene: Scene, depth_mm: float, scratch: Path) -> tuple[float, str]:
    """Side force of a straight press that symmetry forbids, over the force."""
    found = trusted(solved(scene, 0.5, _down(depth_mm)))
    force, _ = whole_wrench(found.press.mesh, found.last)
    return float(np.abs(force[:2]).max() / abs(force[2])), found.note()


def drag_mirrored(scene: Scene, depth_mm: float, by_mm: float, axis: int, step_mm: float) -> Any:
    """Drags to + and to - along an axis across which the indenter is symmetric: worst difference
    of the forces, mirrored, over the largest."""
    forces, notes = [], []
    for sign in (1.0, -1.0):
        tip = [0.0, 0.0, depth_mm]
        tip[axis] = sign * by_mm
        found = trusted(solved(scene, step_mm, _down(depth_mm), (tip[0], tip[1], tip[2])))
        mirror = np.ones(3)
        mirror[axis] = sign
        forces.append([np.array(s.force_n) * mirror for s in found.states])
        notes.append(found.note())
    a, b = (np.array(f) for f in forces)
    return float(np.abs(a - b).max() / np.abs(a).max()), "; ".join(notes)


def _drag(scene: Scene, depth_mm: float, by_mm: float, axis: int, scratch: Path) -> Any:
    return drag_mirrored(scene, depth_mm, by_mm, axis, 0.5)


def _run(call: Callable[[], Any], scratch: Path) -> float:
    call()
    return math.nan


def _refused(name: str, says: str, scene: Scene, *tips: Point, step_mm: float = 1.0) -> Case:
    return Case(name, "refused", partial(_run, partial(solved, scene, step_mm, *tips)), says=says)


def _opened(depth_mm: float, reach_mm: float) -> None:
    """Through the interface of all levels, which knows the thickness."""
    contact = open_contact(
        SkinDimensions(), GelMaterial(), parse(SPHERE), level="hyperelastic",
        reach=Reach(deepest_mm=reach_mm),
    )  # fmt: skip
    list(contact.path(contact.rest(), _down(depth_mm)))


# -- the table -------------------------------------------------------------------------------------


def quick_cases() -> Sequence[Case]:
    """A few seconds' worth: one of each kind."""
    coarse = Scene(spacing_mm=3.0)
    drag = replace(coarse, spacing_mm=2.0, friction=0.5, mirrors=(False, True))
    tiny = Scene("sphere:0.5", 3.0)
    return [
        Case("nu 0.4999 to 2 mm: work of the indenter", "right",
             partial(_work, replace(coarse, nu=0.4999), 2.0), 0.5, "% of the energy"),
        Case("friction 0.5, press and drag: cone", "right",
             partial(_cone, drag, 1.0, (_down(3.0), (1.0, 0.0, 3.0))), 5e-3, "of the bound"),
        Case("friction 0.5, press and drag: base carries the force", "right",
             partial(_balance, drag, 1.0, (_down(3.0), (1.0, 0.0, 3.0))), 1e-6, "of the force"),
        Case("10 mm to 0 in one step", "right", partial(_unloaded, coarse, 10.0), 1e-8, "mm"),
        Case("depth 0", "right", _depth_zero, 1e-12, "mm and N"),
        _refused("sphere:0.5 on cells of 3 mm", "hides between", tiny, _down(0.2)),
        _refused("depth NaN", "finite", coarse, _down(math.nan)),
    ]  # fmt: skip


# The rest of the table takes an hour or more and is `evidence`'s.
LONG = (
    "thickness", "nu 0.4 ", "nu 0.45", "nu 0.495", "friction 0.1", "friction 1,", "friction 5,",
    "10 mm deep", "10 mm in one increment, friction 0.5", "sphere:30", "hexprism:20",
    "four corners", "conjugate", *SHARP,
)  # fmt: skip


def cases() -> Sequence[Case]:
    """Lines of the table that take seconds."""
    return [case for case in every_case() if not case.name.startswith(LONG)]


def every_case() -> Sequence[Case]:
    """Every line of the table but the long drags, which stand in `evidence`."""
    percent, force = "% of the force", "of the force"
    down5 = (_down(5.0),)
    out = [
        Case(f"nu {nu:g} to 5 mm: finer mesh", "right",
             partial(_finer, Scene(nu=nu), 0.5, down5), 1.0, percent)
        for nu in NUS
    ]  # fmt: skip
    out += [
        Case(f"nu {nu:g} to 5 mm: work of the indenter", "right",
             partial(_work, Scene(nu=nu), 5.0), 0.5, "% of the energy")
        for nu in NUS
    ]  # fmt: skip
    for factor in (1e-3, 1e3):
        out += [
            Case(f"E x {factor:g}: {what}", "right", partial(_scaled, factor, what), bound, unit)
            for what, bound, unit in (("force over E", 1e-6, force),
                                      ("iterations", 0, "more iterations"))
        ]  # fmt: skip
    for mu in (0.0, 0.1, 0.5, 1.0, 5.0, 100.0):
        scene = Scene(spacing_mm=2.0, friction=mu, mirrors=(False, True))
        tips = (_down(3.0), (3.0, 0.0, 3.0))
        if mu > 0:
            out.append(
                Case(
                    f"friction {mu:g}, 3 mm deep, dragged 3 mm: cone",
                    "right or refused",
                    partial(_cone, scene, 1.0, tips),
                    5e-3,
                    "of the bound",
                    "press:",
                )
            )
        out.append(Case(f"friction {mu:g}, 3 mm deep, dragged 3 mm: base carries the force",
                        "right or refused", partial(_balance, scene, 1.0, tips), 1e-6, force,
                        "press:"))  # fmt: skip
    out += [
        Case(f"friction 0.5, 3 mm deep, dragged 3 mm: side force, {words}", "right",
             partial(_side_force, against), 3.0, "% of the side force")
        for against, words in (("mesh", "finer mesh"), ("steps", "half the steps"))
    ]  # fmt: skip
    out.append(Case("friction 100 against 1000", "right", _stick, 1e-3, force))
    for thickness in (1.0, 3.0, 12.0, 30.0):
        for share in DEPTHS:
            name = f"thickness {thickness:g} mm, {share:.0%} deep"
            # How far a gel can be pressed is a finding: refusing the deepest is allowed.
            expected: Any = "right" if share <= 0.5 else "right or refused"
            out += [
                Case(f"{name}: finer mesh", expected,
                     partial(_thickness, thickness, share, "force"), 3.0, percent, "t"),
                Case(f"{name}: force grows, base carries it", expected,
                     partial(_thickness, thickness, share, "laws"), 1e-6, force, "t"),
            ]  # fmt: skip
    out += _shape_cases()
    coarse = Scene(spacing_mm=2.0)
    for mu in (0.0, 0.5):
        held = replace(coarse, friction=mu)
        out += [
            Case(f"10 mm in one increment, friction {mu:g}: against 10", "right",
                 partial(_one_increment, held, 10.0), 1e-6 if mu == 0 else 0.1, force),
            Case(f"10 mm to 0 in one step, friction {mu:g}", "right",
                 partial(_unloaded, held, 10.0), 1e-8, "mm"),
        ]  # fmt: skip
    corner = Scene("sphere:10", 1.5)
    out += [
        Case("10 mm deep: finer mesh", "right", partial(_finer, coarse, 1.0, (_down(10.0),)), 3.0,
             percent),
        Case("10 mm deep: work of the indenter", "right", partial(_work, coarse, 10.0), 0.5,
             "% of the energy"),
        Case("four corners, sphere:10 at 14, 13 mm, 3 mm deep", "right",
             partial(_corners, corner, (14.0, 13.0), 3.0), 1e-6, force),
        Case("four corners, sphere:10 on the very corner, 2 mm deep", "right or refused",
             partial(_corners, corner, (18.0, 17.0), 2.0), 1e-6, force, "t"),
        Case("whole against quarter", "right",
             partial(_same, Scene(spacing_mm=2.0, mirrors=(False, False)), coarse), 1e-6, force),
        Case("SuperLU against the default solver", "right",
             partial(_same, replace(coarse, solver="superlu"), coarse), 1e-6, force),
        Case("conjugate gradients against the default solver", "right",
             partial(_same, replace(coarse, solver="cg"), coarse), 1e-6, force),
        Case("sphere:30 on a gel of 12 x 12 mm, 5 mm deep: finer mesh", "right",
             partial(_finer, Scene("sphere:30", 1.0, side_mm=(12.0, 12.0), focus=None), 1.0, down5),
             3.0, percent),
        Case("hexprism:20 on a gel of 12 x 12 mm, 5 mm deep: finer mesh", "right",
             partial(_finer, Scene("hexprism:20", 1.0, side_mm=(12.0, 12.0), focus=None), 1.0,
                     down5), 3.0, percent),
        Case("depth 0", "right", _depth_zero, 1e-12, "mm and N"),
        _refused("depth NaN", "finite", coarse, _down(math.nan)),
        *(
            Case(f"depth {depth:g} of 12 mm, {how}", "refused",
                 partial(_run, partial(_opened, depth, reach)), says="below the gel's thickness")
            for depth in (12.0, 13.0)
            for how, reach in (("announced", depth), ("unannounced", 2.0))
        ),
        _refused("nu 0.5", "poisson", replace(coarse, nu=0.5), _down(1.0)),
    ]  # fmt: skip
    out += [
        _refused(f"{name} on cells of {h:g} mm at {x:g}, {y:g}", "hides between",
                 Scene(name, h, mirrors=(False, False), focus=None), (x, y, depth))
        for name, h, x, y, depth in (
            ("sphere:0.5", 2.0, 1.0, 1.0, 0.2), ("sphere:0.5", 2.0, 0.0, 0.0, 0.2),
            ("sphere:0.5", 3.0, 0.7, 0.2, 0.5), ("sphere:1", 4.0, 2.0, 2.0, 0.5),
        )
    ]  # fmt: skip
    return out


def _shape_cases() -> list[Case]:
    """Sharp indenters, half of the block; the long drags are in `evidence`."""
    out = []
    for name in SHARP:
        half = Scene(name, 0.6, 0.5, focus=(-6.0, 8.0, -6.0, 6.0), mirrors=(False, True))
        tips = (_down(4.0), (2.0, 0.0, 4.0))
        head = f"{name}, friction 0.5, 4 mm deep, dragged 2 mm"
        out += [
            Case(f"{head}: cone", "right or refused", partial(_cone, half, 0.5, tips), 5e-3,
                 "of the bound", "t"),
            Case(f"{head}: base carries the force", "right or refused",
                 partial(_balance, half, 0.5, tips), 1e-6, "of the force", "t"),
        ]  # fmt: skip
        if name != "star":
            even = replace(half, focus=(-6.0, 6.0, -6.0, 6.0))
            out.append(
                Case(
                    f"{name}, 4 mm deep: no side force",
                    "right or refused",
                    partial(_side_force_of_a_press, even, 4.0),
                    1e-6,
                    "of the force",
                    "t",
                )
            )
        quarter = replace(
            half, friction=0.0, mirrors=(name != "star", True), focus=(-6.0, 6.0, -6.0, 6.0)
        )
        out.append(
            Case(
                f"{name}, no friction, 4 mm deep: work of the indenter",
                "right or refused",
                partial(_work, quarter, 4.0),
                0.5,
                "% of the energy",
                "t",
            )
        )
    ball = Scene("sphere:10", 2.0, 0.5, mirrors=(False, True))
    out.append(Case("sphere:10, friction 0.5, 3 mm deep: drag to + mirrors -", "right",
                    partial(_drag, ball, 3.0, 2.0, 0), 1e-6, "of the force"))  # fmt: skip
    return out
