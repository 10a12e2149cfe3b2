"""Stiff and extreme presses of the finite-strain gel, each right within its bound or refused.

A state that the solver itself does not trust (the indenter deep inside the gel) counts as refused.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import partial

from ...aliases import Point
from ..engine import Case
from . import gel_checks as checks
from .gel_picks import opened
from .gel_scene import GelCase, down, solved

NUS = (0.3, 0.49, 0.499, 0.4999)
FRICTIONS = (0.0, 0.5, 100.0)


def quick_cases() -> Sequence[Case]:
    """A few seconds' worth: one of each kind."""
    coarse = GelCase(spacing_mm=3.0)
    drag = replace(coarse, spacing_mm=2.0, friction=0.5, mirrors=(False, True))
    tiny = GelCase("sphere:0.5", 3.0)
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


def cases() -> Sequence[Case]:
    """Lines of the table that take seconds; those of minutes and hours are `make evidence`'s."""
    force = "of the force"
    out = of_nu(NUS)
    for factor in (1e-3, 1e3):
        out += [
            Case(f"E x {factor:g}: {what}", "right", partial(checks.scaled, factor, what), bound,
                 unit)
            for what, bound, unit in (("force over E", 1e-6, force),
                                      ("iterations", 0, "more iterations"))
        ]  # fmt: skip
    out += of_friction(FRICTIONS)
    out += [
        Case(f"friction 0.5, 3 mm deep, dragged 3 mm: side force, {words}", "right",
             partial(checks.side_force, against), 3.0, "% of the side force")
        for against, words in (("mesh", "finer mesh"), ("steps", "half the steps"))
    ]  # fmt: skip
    out.append(Case("friction 100 against 1000", "right", checks.stick, 1e-3, force))
    ball = GelCase("sphere:10", 2.0, 0.5, mirrors=(False, True))
    out.append(Case("sphere:10, friction 0.5, 3 mm deep: drag to + mirrors -", "right",
                    partial(checks.drag, ball, 3.0, 2.0, 0), 1e-6, force))  # fmt: skip
    coarse = GelCase(spacing_mm=2.0)
    out += [
        Case("10 mm in one increment, friction 0: against 10", "right",
             partial(checks.one_increment, coarse, 10.0), 1e-6, force),
        *(
            Case(f"10 mm to 0 in one step, friction {mu:g}", "right",
                 partial(checks.unloaded, replace(coarse, friction=mu), 10.0), 1e-8, "mm")
            for mu in (0.0, 0.5)
        ),
        Case("whole against quarter", "right",
             partial(checks.same, GelCase(spacing_mm=2.0, mirrors=(False, False)), coarse), 1e-6,
             force),
        Case("SuperLU against the default solver", "right",
             partial(checks.same, replace(coarse, solver="superlu"), coarse), 1e-6, force),
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
                 GelCase(name, h, mirrors=(False, False), focus=None), (x, y, depth))
        for name, h, x, y, depth in (
            ("sphere:0.5", 2.0, 1.0, 1.0, 0.2), ("sphere:0.5", 2.0, 0.0, 0.0, 0.2),
            ("sphere:0.5", 3.0, 0.7, 0.2, 0.5), ("sphere:1", 4.0, 2.0, 2.0, 0.5),
        )
    ]  # fmt: skip
    return out


def of_nu(nus: Sequence[float]) -> list[Case]:
    """Presses to 5 mm at these Poisson's ratios, against a finer mesh and the energy stored."""
    finer = [
        Case(f"nu {nu:g} to 5 mm: finer mesh", "right",
             partial(checks.finer, GelCase(nu=nu), 0.5, (down(5.0),)), 1.0, "% of the force")
        for nu in nus
    ]  # fmt: skip
    return finer + [
        Case(f"nu {nu:g} to 5 mm: work of the indenter", "right",
             partial(checks.work, GelCase(nu=nu), 5.0), 0.5, "% of the energy")
        for nu in nus
    ]  # fmt: skip


def of_friction(frictions: Sequence[float]) -> list[Case]:
    """Drags at these coefficients: the cone, and what the base carries."""
    out = []
    tips = (down(3.0), (3.0, 0.0, 3.0))
    for mu in frictions:
        scene = GelCase(spacing_mm=2.0, friction=mu, mirrors=(False, True))
        head = f"friction {mu:g}, 3 mm deep, dragged 3 mm"
        if mu > 0:
            out.append(Case(f"{head}: cone", "right or refused",
                            partial(checks.cone, scene, 1.0, tips), 5e-3, "of the bound",
                            "press:"))  # fmt: skip
        out.append(Case(f"{head}: base carries the force", "right or refused",
                        partial(checks.balance, scene, 1.0, tips), 1e-6, "of the force",
                        "press:"))  # fmt: skip
    return out


def _refused(name: str, says: str, scene: GelCase, *tips: Point, step_mm: float = 1.0) -> Case:
    return Case(
        name, "refused", partial(checks.run, partial(solved, scene, step_mm, *tips)), says=says
    )
