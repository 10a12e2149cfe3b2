"""The gel at its two levels: error of force and tracked displacement against run time.

One press: a 15 mm sphere to 2 and 5 mm in the middle of the standard skin. Reference: the
finite-strain level on two fine meshes, Richardson-extrapolated at second order; its error is the
change from the finer mesh. The linear level's error is its model's, whatever its grid. Cases:
stiff and extreme presses; a state that the solver marks as untrusted counts as refused.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from deltact_fab.common import Point, RunFailed
from deltact_fab.physics import (
    GelLevel,
    LinearContact,
    Reach,
    follow_path,
    open_contact,
    press_gel,
    select_level,
)
from deltact_fab.sensor import FreeBlock, GelMaterial, SkinDimensions, parse_indenter

from ..engine import Case, CurveSetting, Engine, Work
from . import gel_press as checks
from .gel_press import (
    FACE_LATTICE_MM,
    QUICK_CELLS_MM,
    REFERENCE_CELLS_MM,
    REFERENCE_ERROR,
    SPHERE_INDENTER,
    GelAnswer,
    GelCase,
    PressSetup,
    down,
    errors,
    reference,
    solve_finite,
    solve_press,
)


def solve(run: PressSetup) -> GelAnswer:
    """Solve the press from scratch: mesh, factors and path. Raises the gel's errors."""
    if run.level == "hyperelastic":
        return solve_finite(run)
    return solve_auto(run) if run.level == "auto" else solve_linear(run)


def solve_auto(run: PressSetup) -> GelAnswer:
    """Solve like `gel press`, with its error estimate."""
    material, indenter = GelMaterial(friction=run.friction), parse_indenter(SPHERE_INDENTER)
    press = press_gel(SkinDimensions(), material, indenter, (0.0, 0.0), run.depth_mm,
                  tolerance=run.tolerance)  # fmt: skip
    if press.result["force_n"] is None:
        raise RunFailed(f"auto: {press.result['reason']}")
    step = round(FACE_LATTICE_MM / float(press.x_mm[1] - press.x_mm[0]))
    u = press.displacement_mm[::step, ::step, :2]
    note_keys = ("model", "error_estimate", "picked", "within_tolerance")
    return GelAnswer(-press.result["force_n"][2], u, {k: press.result[k] for k in note_keys})


def solve_linear(run: PressSetup) -> GelAnswer:
    """Solve at the linear level, on a grid of the run's spacing."""
    skin, material, indenter = (
        SkinDimensions(),
        GelMaterial(friction=run.friction),
        parse_indenter(SPHERE_INDENTER),
    )
    choice = select_level(skin, material, indenter, Reach(deepest_mm=run.depth_mm), level=run.level,
                  spacing_mm=run.spacing_mm)  # fmt: skip
    contact = open_contact(skin, material, indenter, choice, FACE_LATTICE_MM)
    *_, last = follow_path(
        contact, contact.rest(), (0.0, 0.0, run.depth_mm), contact.choice.step_mm
    )
    return GelAnswer(-last.force_n[2], last.displacement_mm[..., :2], {"dofs": contact.dofs})


def linear_breach(scene: GelCase, depth_mm: float, scratch: Path) -> tuple[float, str]:
    """Worst contact violation of a press and 0.3 mm drag at the linear level.

    Penetration or gap under pressure (over the depth), or shear above friction x pressure (over its
    largest bound), recomputed on the whole face.
    """
    face = FreeBlock(scene.skin(), scene.material(), scene.spacing_mm)
    contact = LinearContact(face, parse_indenter(scene.indenter))
    *_, pressed = follow_path(contact, contact.rest(), (0.0, 0.0, depth_mm), 0.3)
    state = contact.solve(pressed, (0.3, 0.0, depth_mm))
    traction = np.concatenate([state.shear_mpa, -state.pressure_mpa[..., None]], axis=-1)
    x, y = np.meshgrid(face.x_mm, face.y_mm)
    height = contact.indenter.height_mm(x + state.drag_mm[..., 0] - 0.3, y + state.drag_mm[..., 1])
    gap = height - depth_mm - face.apply(traction)[..., 2]
    bound = contact.friction * state.pressure_mpa
    excess = (np.hypot(*np.moveaxis(state.shear_mpa, -1, 0)) - bound).max() / bound.max()
    worst = max(-gap.min(), np.abs(gap[state.pressure_mpa > 0]).max()) / depth_mm
    fx, _, fz = state.force_n
    return float(max(worst, excess)), f"Fx {fx:+.3f} N, Fz {fz:+.3f} N"


FORCE_UNIT, IN_PLANE_UNIT = "% of the force", "mm rms over the face"


def curves(quick: bool) -> Sequence[CurveSetting]:
    """Settings fast enough to repeat six times; `make evidence` has the others."""
    if quick:
        runs = [PressSetup("hyperelastic", 2.0, 0.0, h) for h in (3.0, 2.0)]
        return [_setting(r, FORCE_UNIT, True) for r in runs]
    levels: dict[GelLevel, tuple[float, ...]] = {
        "hyperelastic": (3.0, 2.0, 1.5, 1.0), "linear": (0.5, 0.35, 0.25, 0.125),
    }  # fmt: skip
    runs = [PressSetup(level, 2.0, 0.0, h) for level, spacings in levels.items() for h in spacings]
    runs += [PressSetup("auto", 2.0, 0.0, tolerance=t) for t in (0.1, 0.03, 0.01)]
    deep = [PressSetup("hyperelastic", 5.0, 0.0, h) for h in (3.0, 2.0, 1.5, 1.0)]
    return [_setting(r, FORCE_UNIT, False) for r in (*runs, *deep)] + [
        _setting(r, IN_PLANE_UNIT, False) for r in deep
    ]


def _setting(run: PressSetup, unit: str, quick: bool) -> CurveSetting:
    quantity = "force" if unit == FORCE_UNIT else "in plane"
    coarse, fine = QUICK_CELLS_MM if quick else REFERENCE_CELLS_MM
    return CurveSetting(
        f"{run.case}: {quantity}", run.series, run.name, unit,
        f"hyperelastic, quarter, {coarse:g} and {fine:g} mm extrapolated",
        REFERENCE_ERROR[run.depth_mm, quick][unit == IN_PLANE_UNIT],
        partial(_build, run, unit, quick), "self-test",
    )  # fmt: skip


def _build(run: PressSetup, unit: str, quick: bool, scratch: Path) -> Work:
    truth = reference(run.depth_mm, quick)
    place = int(unit == IN_PLANE_UNIT)
    return Work(partial(solve, run), lambda answer: abs(errors(answer, truth)[place]))


def cases(quick: bool) -> Sequence[Case]:
    """Cases of seconds; `make evidence` has those of minutes and hours."""
    coarse = GelCase(spacing_mm=2.0)
    out = [
        *(cases_by_poisson((0.4999,))[1:] if quick else cases_by_poisson((0.3, 0.4999))),
        *cases_by_friction((0.5,) if quick else (0.5, 100.0)),
        *_linear(quick),
        _refused("depth NaN", "finite", coarse, down(math.nan)),
        _refused("nu 0.5", "poisson", replace(coarse, nu=0.5), down(1.0)),
        *(
            _refused(f"sphere:0.5 on cells of {h:g} mm at {x:g}, {y:g}", "not resolved",
                     GelCase("sphere:0.5", h, mirrors=(False, False), focus=None), (x, y, depth))
            for h, x, y, depth in ((2.0, 0.0, 0.0, 0.2), (3.0, 0.7, 0.2, 0.5))
        ),
    ]  # fmt: skip
    if not quick:
        out.append(Case("10 mm in one increment, friction 0: against 10", "right",
                        partial(checks.one_increment, coarse, 10.0), 1e-6,
                        "of the force"))  # fmt: skip
    return out


def cases_by_poisson(nus: Sequence[float]) -> list[Case]:
    """Presses to 5 mm at these Poisson's ratios, against a finer mesh and the stored energy."""
    work = partial(checks.evaluate_law, checks.work_error_percent)
    judges = (("finer mesh", checks.mesh_error_percent, 1.0, "% of the force"),
              ("work of the indenter", work, 0.5, "% of the energy"))  # fmt: skip
    return [
        Case(f"nu {nu:g} to 5 mm: {name}", "right",
             partial(judge, GelCase(nu=nu), 0.5, (down(5.0),)), bound, unit)
        for name, judge, bound, unit in judges for nu in nus
    ]  # fmt: skip


def cases_by_friction(frictions: Sequence[float]) -> list[Case]:
    """Drags at these friction coefficients: friction cone, and force balance at the base."""
    laws = (("cone", checks.cone_excess, 5e-3, "of the bound"),
            ("base carries the force", checks.imbalance, 1e-6, "of the force"))  # fmt: skip
    return [
        Case(f"friction {mu:g}, 3 mm deep, dragged 3 mm: {name}", "right or refused",
             partial(checks.evaluate_law, measure,
                     GelCase(spacing_mm=2.0, friction=mu, mirrors=(False, True)), 1.0,
                     (down(3.0), (3.0, 0.0, 3.0))), bound, unit, "press:")
        for mu in frictions
        for name, measure, bound, unit in laws
        if mu > 0 or measure is not checks.cone_excess
    ]  # fmt: skip


def _linear(quick: bool) -> list[Case]:
    """Drags at the linear level to its limits of material, friction and depth; refusals."""
    fine = GelCase("sphere:10", 0.5, friction=0.5)
    drags = [(fine, 1.2)]
    if not quick:
        drags += [(replace(fine, nu=nu), 1.2) for nu in (0.0, 0.4999)]
        drags += [(replace(fine, friction=mu), 1.2) for mu in (5.0, 100.0)]
        drags.append((fine, 3.0))
    refused = (("1e-3 mm deep, the tip between nodes", "touches no grid node", fine, 1e-3),
               ("over a quarter of the gel", "use level hyperelastic", fine, 3.1),
               ("nu 0.5", "poisson <=", replace(fine, nu=0.5), 1.2))  # fmt: skip
    return [
        *(Case(f"linear: nu {scene.nu:g}, friction {scene.friction:g}, {depth:g} mm deep, dragged",
               "right or refused", partial(linear_breach, scene, depth), 1e-5, "of the depth",
               "contact:") for scene, depth in drags),
        *(Case(f"linear: {name}", "refused", partial(linear_breach, scene, depth), says=says)
          for name, says, scene, depth in refused),
    ]  # fmt: skip


def _refused(name: str, says: str, scene: GelCase, tip: Point) -> Case:
    call = partial(checks.expect_refusal, partial(solve_press, scene, 1.0, tip))
    return Case(name, "refused", call, says=says)


ENGINE = Engine(
    "Gel, two levels",
    "The linear level and finite strain against the finest finite-strain press.",
    cases,
    curves,
)
