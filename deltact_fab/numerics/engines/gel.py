"""The gel at its three levels: error of force and tracked displacement against run time.

One press, a sphere of 15 mm to 2 and 5 mm in the middle of the standard skin. The reference is the
finite-strain level on two fine meshes, extrapolated at second order; what that moves the finer one
is stated as its own error. A linear level's error is its model's, whatever its grid. The cases are
stiff and extreme presses; a state that the solver itself does not trust counts as refused.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

from ...aliases import Point
from ...elasticity.material import GelMaterial
from ...gel.level import Reach, follow
from ...gel.level_selection import pick
from ...gel.open import contact_of
from ...shapes import SkinDimensions
from ...shapes.indenter import parse
from ..engine import Case, CurveSetting, Engine, Work
from . import gel_scene as checks
from .gel_press import FINE, OWN_ERROR, QUICK_FINE, PressSetup, errors, reference
from .gel_run import solve
from .gel_scene import SPHERE, GelCase, down, solved

FORCE, IN_PLANE = "% of the force", "mm rms over the face"
NUS = (0.3, 0.49, 0.499, 0.4999)
FRICTIONS = (0.0, 0.5, 100.0)


def curves(quick: bool) -> Sequence[CurveSetting]:
    """What can be repeated six times; the rest is left to `make evidence`."""
    if quick:
        runs = [PressSetup("hyperelastic", 2.0, 0.0, h) for h in (3.0, 2.0)]
        return [_setting(r, FORCE, True) for r in runs]
    runs = [PressSetup("hyperelastic", 2.0, 0.0, h) for h in (3.0, 2.0, 1.5, 1.0)]
    runs += [PressSetup("auto", 2.0, 0.0, tolerance=t) for t in (0.1, 0.03, 0.01)]
    runs += [PressSetup("layer", 2.0, 0.0, h) for h in (0.5, 0.25, 0.125)]
    runs += [PressSetup("block", 2.0, 0.0, h) for h in (0.5, 0.35, 0.25)]
    runs += [PressSetup("hyperelastic", 2.0, 0.0, 2.0, "whole", s) for s in ("auto", "superlu")]
    deep = [PressSetup("hyperelastic", 5.0, 0.0, h) for h in (3.0, 2.0, 1.5, 1.0)]
    return [_setting(r, FORCE, False) for r in (*runs, *deep)] + [
        _setting(r, IN_PLANE, False) for r in deep
    ]


def _setting(run: PressSetup, unit: str, quick: bool) -> CurveSetting:
    coarse, fine, *_ = QUICK_FINE if quick else FINE[run.friction == 0]
    own = OWN_ERROR[run.depth_mm, run.friction, quick]
    return CurveSetting(
        case=f"{run.case}: {'force' if unit == FORCE else 'in plane'}",
        series=run.series,
        name=run.name,
        unit=unit,
        reference=f"hyperelastic, quarter, {coarse:g} and {fine:g} mm extrapolated",
        reference_error=own[0] if unit == FORCE else own[1],
        build=partial(_build, run, unit, quick),
        kind="self-test",
    )


def _build(run: PressSetup, unit: str, quick: bool, scratch: Path) -> Work:
    truth = reference(run.depth_mm, run.friction, quick)
    place = 0 if unit == FORCE else 1
    return Work(partial(solve, run), lambda answer: abs(errors(answer, truth)[place]))


def opened(depth_mm: float, reach_mm: float) -> None:
    """Through the interface of all levels, which knows the thickness."""
    scene = SkinDimensions(), GelMaterial(), parse(SPHERE)
    choice = pick(*scene, Reach(deepest_mm=reach_mm), level="hyperelastic")
    contact = contact_of(*scene, choice)
    list(follow(contact, contact.rest(), down(depth_mm), contact.choice.step_mm))


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


def full_cases() -> Sequence[Case]:
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


def cases(quick: bool) -> Sequence[Case]:
    """Some seconds' worth, or minutes'; those of hours are `make evidence`'s."""
    return quick_cases() if quick else full_cases()


ENGINE = Engine(
    "gel",
    "Gel, three levels",
    "Linear layer, linear block and finite strain against the finest finite-strain press.",
    curves,
    cases,
)
