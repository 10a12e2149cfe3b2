"""Stiff and extreme presses of the finite-strain gel, each right within its bound or refused.

A state that the solver itself does not trust (the indenter deep inside the gel) counts as refused.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Any

from ..engine import Case
from . import gel_checks as checks
from .gel_energy import work_but_jumps
from .gel_picks import one_increment_of_the_level, opened, thick
from .gel_scene import Point, Scene, down, solved

DEPTHS = (0.05, 0.25, 0.5, 0.75, 0.9)  # of the thickness
NUS = (0.3, 0.4, 0.45, 0.49, 0.495, 0.499, 0.4999)
SHARP = ("hexprism", "star", "edges", "4dots")


def quick_cases() -> Sequence[Case]:
    """A few seconds' worth: one of each kind."""
    coarse = Scene(spacing_mm=3.0)
    drag = replace(coarse, spacing_mm=2.0, friction=0.5, mirrors=(False, True))
    tiny = Scene("sphere:0.5", 3.0)
    return [
        Case("nu 0.4999 to 2 mm: work of the indenter", "right",
             partial(checks.work, replace(coarse, nu=0.4999), 2.0), 0.5, "% of the energy"),
        Case("friction 0.5, press and drag: cone", "right",
             partial(checks.cone, drag, 1.0, (down(3.0), (1.0, 0.0, 3.0))), 5e-3, "of the bound"),
        Case("friction 0.5, press and drag: base carries the force", "right",
             partial(checks.balance, drag, 1.0, (down(3.0), (1.0, 0.0, 3.0))), 1e-6,
             "of the force"),
        Case("10 mm to 0 in one step", "right", partial(checks.unloaded, coarse, 10.0), 1e-8, "mm"),
        Case("depth 0", "right", checks.depth_zero, 1e-12, "mm and N"),
        _refused("sphere:0.5 on cells of 3 mm", "hides between", tiny, down(0.2)),
        _refused("depth NaN", "finite", coarse, down(math.nan)),
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
    down5 = (down(5.0),)
    out = [
        Case(f"nu {nu:g} to 5 mm: finer mesh", "right",
             partial(checks.finer, Scene(nu=nu), 0.5, down5), 1.0, percent)
        for nu in NUS
    ]  # fmt: skip
    out += [
        Case(f"nu {nu:g} to 5 mm: work of the indenter", "right",
             partial(checks.work, Scene(nu=nu), 5.0), 0.5, "% of the energy")
        for nu in NUS
    ]  # fmt: skip
    for factor in (1e-3, 1e3):
        out += [
            Case(f"E x {factor:g}: {what}", "right", partial(checks.scaled, factor, what), bound,
                 unit)
            for what, bound, unit in (("force over E", 1e-6, force),
                                      ("iterations", 0, "more iterations"))
        ]  # fmt: skip
    for mu in (0.0, 0.1, 0.5, 1.0, 5.0, 100.0):
        scene = Scene(spacing_mm=2.0, friction=mu, mirrors=(False, True))
        tips = (down(3.0), (3.0, 0.0, 3.0))
        if mu > 0:
            out.append(
                Case(
                    f"friction {mu:g}, 3 mm deep, dragged 3 mm: cone",
                    "right or refused",
                    partial(checks.cone, scene, 1.0, tips),
                    5e-3,
                    "of the bound",
                    "press:",
                )
            )
        out.append(Case(f"friction {mu:g}, 3 mm deep, dragged 3 mm: base carries the force",
                        "right or refused", partial(checks.balance, scene, 1.0, tips), 1e-6, force,
                        "press:"))  # fmt: skip
    out += [
        Case(f"friction 0.5, 3 mm deep, dragged 3 mm: side force, {words}", "right",
             partial(checks.side_force, against), 3.0, "% of the side force")
        for against, words in (("mesh", "finer mesh"), ("steps", "half the steps"))
    ]  # fmt: skip
    out.append(Case("friction 100 against 1000", "right", checks.stick, 1e-3, force))
    for thickness in (1.0, 3.0, 12.0, 30.0):
        for share in DEPTHS:
            scene, step = thick(thickness, share)
            press = (scene, step, share * thickness)
            name = f"thickness {thickness:g} mm, {share:.0%} deep"
            # How far a gel can be pressed is a finding: refusing the deepest is allowed.
            expected: Any = "right" if share <= 0.5 else "right or refused"
            out += [
                Case(f"{name}: finer mesh", expected,
                     partial(checks.thickness, *press, "force"), 3.0, percent, "t"),
                Case(f"{name}: force grows, base carries it", expected,
                     partial(checks.thickness, *press, "laws"), 1e-6, force, "t"),
            ]  # fmt: skip
    out += _shape_cases()
    coarse = Scene(spacing_mm=2.0)
    out += [
        Case("10 mm in one increment, friction 0: against 10", "right",
             partial(checks.one_increment, coarse, 10.0), 1e-6, force),
        # Friction is of first order in the increment: the interface of all levels parts a long one.
        Case("10 mm in one increment, friction 0.5: against 10", "right",
             partial(one_increment_of_the_level, 10.0, 2.0), 0.1, force),
        *(
            Case(f"10 mm to 0 in one step, friction {mu:g}", "right",
                 partial(checks.unloaded, replace(coarse, friction=mu), 10.0), 1e-8, "mm")
            for mu in (0.0, 0.5)
        ),
    ]  # fmt: skip
    corner = Scene("sphere:10", 1.5)
    out += [
        Case("10 mm deep: finer mesh", "right", partial(checks.finer, coarse, 1.0, (down(10.0),)),
             3.0, percent),
        Case("10 mm deep: work of the indenter", "right", partial(checks.work, coarse, 10.0), 0.5,
             "% of the energy"),
        Case("four corners, sphere:10 at 14, 13 mm, 3 mm deep", "right",
             partial(checks.corners, corner, (14.0, 13.0), 3.0), 1e-6, force),
        Case("four corners, sphere:10 on the very corner, 2 mm deep", "right or refused",
             partial(checks.corners, corner, (18.0, 17.0), 2.0), 1e-6, force, "t"),
        Case("whole against quarter", "right",
             partial(checks.same, Scene(spacing_mm=2.0, mirrors=(False, False)), coarse), 1e-6,
             force),
        Case("SuperLU against the default solver", "right",
             partial(checks.same, replace(coarse, solver="superlu"), coarse), 1e-6, force),
        Case("conjugate gradients against the default solver", "right",
             partial(checks.same, replace(coarse, solver="cg"), coarse), 1e-6, force),
        Case("sphere:30 on a gel of 12 x 12 mm, 5 mm deep: finer mesh", "right",
             partial(checks.finer, Scene("sphere:30", 1.0, side_mm=(12.0, 12.0), focus=None), 1.0,
                     down5), 3.0, percent),
        Case("hexprism:20 on a gel of 12 x 12 mm, 5 mm deep: finer mesh", "right",
             partial(checks.finer, Scene("hexprism:20", 1.0, side_mm=(12.0, 12.0), focus=None), 1.0,
                     down5), 3.0, percent),
        Case("depth 0", "right", checks.depth_zero, 1e-12, "mm and N"),
        _refused("depth NaN", "finite", coarse, down(math.nan)),
        *(
            Case(f"depth {depth:g} of 12 mm, {how}", "refused",
                 partial(checks.run, partial(opened, depth, reach)),
                 says="below the gel's thickness")
            for depth in (12.0, 13.0)
            for how, reach in (("announced", depth), ("unannounced", 2.0))
        ),
        _refused("nu 0.5", "poisson", replace(coarse, nu=0.5), down(1.0)),
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
        tips = (down(4.0), (2.0, 0.0, 4.0))
        head = f"{name}, friction 0.5, 4 mm deep, dragged 2 mm"
        out += [
            Case(f"{head}: cone", "right or refused", partial(checks.cone, half, 0.5, tips), 5e-3,
                 "of the bound", "t"),
            Case(f"{head}: base carries the force", "right or refused",
                 partial(checks.balance, half, 0.5, tips), 1e-6, "of the force", "t"),
        ]  # fmt: skip
        if name != "star":
            even = replace(half, focus=(-6.0, 6.0, -6.0, 6.0))
            out.append(
                Case(
                    f"{name}, 4 mm deep: no side force",
                    "right or refused",
                    partial(checks.side_force_of_a_press, even, 4.0),
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
                f"{name}, no friction, 4 mm deep: work but for jumps",
                "right or refused",
                partial(work_but_jumps, quarter, 4.0),
                0.5,
                "% of the energy",
                "t",
            )
        )
    ball = Scene("sphere:10", 2.0, 0.5, mirrors=(False, True))
    out.append(Case("sphere:10, friction 0.5, 3 mm deep: drag to + mirrors -", "right",
                    partial(checks.drag, ball, 3.0, 2.0, 0), 1e-6, "of the force"))  # fmt: skip
    return out


def _refused(name: str, says: str, scene: Scene, *tips: Point, step_mm: float = 1.0) -> Case:
    return Case(
        name, "refused", partial(checks.run, partial(solved, scene, step_mm, *tips)), says=says
    )
