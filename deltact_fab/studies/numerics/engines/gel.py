"""The gel at its levels: error of force and displacement against run time.

Truths are presses of other solvers, stored with the package. The linear level's error is its
model's, whatever its grid. Cases: stiff and extreme presses; a state that the solver marks as
untrusted counts as refused.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from deltact_fab.common import Point, RunFailed, read_json, validate
from deltact_fab.paths import asset
from deltact_fab.physics import FORCE_TOLERANCE, LinearContact, PressOutcome, follow_path, press_gel
from deltact_fab.sensor import FreeBlock, GelMaterial, SkinDimensions, parse_indenter

from ..engine import Case, CurveSetting, Engine, Work
from . import gel_press as checks
from .gel_press import GelCase, down, solve_press

CURVE_TOLERANCES = 0.1, FORCE_TOLERANCE, 0.01  # by hand: looser and tighter than the default


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


# -- curves --------------------------------------------------------------------------------------


@dataclass(frozen=True)
class TruePress:
    """A press in the middle of a block, with the force and field of an independent solver.

    side_mm: of the block, in x and y. shear_mm: drag along x after the press. error_rel: of
    the truth's force. radial_mm: displacement at radii RADII_STEP_MM apart; empty: not known.
    solver: of the truth.
    """

    indenter: str
    poisson: float
    friction: float
    side_mm: tuple[float, float]
    thickness_mm: float
    depth_mm: float
    force_n: tuple[float, float, float]
    error_rel: float
    solver: str
    shear_mm: float = 0.0
    radial_mm: tuple[float, ...] = ()

    @property
    def name(self) -> str:
        drag = f", dragged {self.shear_mm:g} mm" if self.shear_mm else ""
        return (
            f"{self.indenter} pressed {self.depth_mm:g} mm into {self.thickness_mm:g} mm, nu "
            f"{self.poisson:g}, friction {self.friction:g}{drag}"
        )

    def solve(self, **options: Any) -> PressOutcome:
        """Press like `gel press`; options: of `press_gel`. Raises RunFailed where it refuses."""
        h = self.thickness_mm
        skin = SkinDimensions(*self.side_mm, h, min(2.0, h / 2), h)
        gel = GelMaterial(TRUTH_MPA, self.poisson, friction=self.friction)
        shear = self.shear_mm, 0.0
        press = press_gel(
            skin, gel, parse_indenter(self.indenter), (0.0, 0.0), self.depth_mm, shear, **options
        )
        if press.result["force_n"] is None:
            raise RunFailed(f"{self.name}: {press.result['reason']}")
        return press

    def force_percent(self, press: PressOutcome) -> float:
        """Error of the force, % of its size."""
        truth = np.array(self.force_n)
        error_n = np.array(press.result["force_n"]) - truth
        return 100 * float(np.linalg.norm(error_n) / np.linalg.norm(truth))

    def in_plane_mm(self, press: PressOutcome) -> float:
        """Error of the in-plane displacement, rms over the face.

        Within a thickness of the sides, where a block is no cylinder, nothing counts as error.
        """
        x, y = np.meshgrid(press.x_mm, press.y_mm)
        r, radii_mm = np.hypot(x, y), RADII_STEP_MM * np.arange(len(self.radial_mm))
        radial = np.interp(r, radii_mm, self.radial_mm) / np.maximum(r, 1e-12)
        error_mm = press.displacement_mm[..., :2] - radial[..., None] * np.stack([x, y], axis=-1)
        inner = r <= min(self.side_mm) / 2 - self.thickness_mm
        return checks.rms_mm(error_mm * inner[..., None])


RADII_STEP_MM = 0.25  # definition: of the stored truths
TRUTH_MPA = 0.56  # definition: modulus of the stored truths


def load_truths() -> list[TruePress]:
    """Stored answers of solvers that share no line with the gel; see the file for their scripts."""
    path = asset("gel_truths.json")
    return [validate(TruePress, row, str(path)) for row in read_json(path)["presses"]]


def curves(quick: bool) -> Sequence[CurveSetting]:
    """`gel press` by tolerance, and its linear level by grid, on presses of other solvers."""
    settings = []
    for truth in load_truths()[: 1 if quick else None]:
        options: list[dict[str, Any]] = [
            {"tolerance": t} for t in CURVE_TOLERANCES[: 2 if quick else 3]
        ]
        if not (quick or truth.shear_mm) and truth.indenter.startswith("sphere"):
            options += [{"model": "linear", "spacing_mm": h} for h in (0.5, 0.25)]
        for option in options:
            settings.append(_setting(truth, option, "% of the force", TruePress.force_percent))
            if truth.radial_mm and not quick:
                settings.append(
                    _setting(truth, option, "mm rms over the face", TruePress.in_plane_mm)
                )
    return settings


def _setting(
    truth: TruePress, options: dict[str, Any], unit: str,
    error: Callable[[TruePress, PressOutcome], float],
) -> CurveSetting:  # fmt: skip
    linear = "model" in options
    force = unit.startswith("%")
    return CurveSetting(
        f"{truth.name}: {'force' if force else 'in plane'}",
        "linear" if linear else "by tolerance, error estimate included",
        f"{options['spacing_mm']:g} mm" if linear else f"tolerance {options['tolerance']:g}",
        unit, truth.solver, 100 * truth.error_rel if force else 0.0,
        partial(_build, truth, options, error), "independent solver",
        options.get("tolerance") == FORCE_TOLERANCE,
    )  # fmt: skip


def _build(
    truth: TruePress, options: dict[str, Any], error: Callable[[TruePress, PressOutcome], float],
    scratch: Path,
) -> Work:  # fmt: skip
    return Work(partial(truth.solve, **options), partial(error, truth))


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
    "Gel", "The command gel press against presses of independent solvers.", cases, curves
)
