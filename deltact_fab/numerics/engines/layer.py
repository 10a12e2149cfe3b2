"""The bonded layer: force on a sphere against the Fredholm equation; its ends and its refusals.

The spheres take the textbook contact, a node held against the indenter above where it rested. The
flat punch, whose edge is singular, is judged in the tests.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from ...aliases import Point
from ...elasticity.layer import BondedLayer
from ...elasticity.material import GelMaterial
from ...gel import reference
from ...gel.linear.contact import LayerContact
from ...gel.linear.state import ContactState
from ...shapes import SkinDimensions
from ...shapes.indenter import parse
from ..engine import Case, CurveSetting, Engine, Work
from .gel_scene import run

SEED, PLACES = 5, 8
SPHERE_MM, DEPTH_MM = 10.0, 1.2
REFERENCE_ERROR = 1e-8  # %; 48 and 96 Gauss points agree to 1e-10


def _layer(
    spacing_mm: float,
    padding: float = 3.0,
    *,
    nu: float = 0.49,
    friction: float = 0.5,
    thickness_mm: float = 12.0,
    side_mm: tuple[float, float] = (36.0, 34.0),
) -> BondedLayer:
    fillet_mm, proud_mm = min(2.0, thickness_mm / 4), thickness_mm / 2
    skin = SkinDimensions(*side_mm, thickness_mm, fillet_mm, proud_mm)
    return BondedLayer.for_skin(
        skin, GelMaterial(poisson=nu, friction=friction), spacing_mm, padding
    )


def _textbook(layer: BondedLayer, diameter_mm: float = SPHERE_MM) -> LayerContact:
    return LayerContact(layer, parse(f"sphere:{diameter_mm:g}"), observe_shear=False)


def sphere_error_percent(
    layer: BondedLayer, depth_mm: float = DEPTH_MM, diameter_mm: float = SPHERE_MM
) -> float:
    """Root mean square error of the force in % over places between the nodes."""
    contact = _textbook(layer, diameter_mm)
    exact, _ = reference.sphere_on_layer(
        diameter_mm / 2, depth_mm, layer.thickness_mm, layer.material
    )
    places = np.random.default_rng(SEED).uniform(-0.5, 0.5, (PLACES, 2)) * layer.spacing_mm[0]
    forces = [contact.solve(contact.rest(), (x, y, depth_mm)).force_n[2] for x, y in places]
    return float(np.sqrt(np.mean((-np.array(forces) / exact - 1) ** 2))) * 100


def _build_sphere(nu: float, spacing_mm: float, padding: float, scratch: Path) -> Work:
    layer = _layer(spacing_mm, padding, nu=nu)
    contact = _textbook(layer)
    return Work(
        lambda: contact.solve(contact.rest(), (0.0, 0.0, DEPTH_MM)),
        lambda state: sphere_error_percent(layer),
    )


def curves(quick: bool) -> Sequence[CurveSetting]:
    """Spheres by spacing and padding."""
    plan = {0.49: (3.0,)} if quick else {0.49: (3.0, 2.0, 4.0), 0.5: (3.0,)}
    return [
        CurveSetting(
            case=f"sphere:{SPHERE_MM:g} pressed {DEPTH_MM:g} mm, nu {nu:g}",
            series=f"padding {padding:g}",
            name=f"{spacing_mm:g} mm",
            unit="% of the force, rms over places",
            reference="Fredholm equation, sphere on a bonded layer",
            reference_error=REFERENCE_ERROR,
            build=partial(_build_sphere, nu, spacing_mm, padding),
        )
        for nu, paddings in plan.items()
        for padding in paddings
        for spacing_mm in ((0.5, 0.25) if quick else (0.5, 0.25, 0.18, 0.125))
    ]


def _sphere(
    scratch: Path, depth_mm: float = DEPTH_MM, diameter_mm: float = SPHERE_MM, **layer: Any
) -> float:
    return sphere_error_percent(_layer(**layer), depth_mm, diameter_mm)


def pressed(
    *tips_mm: Point,
    spacing_mm: float = 0.25,
    diameter_mm: float = SPHERE_MM,
    step_mm: float = 0.3,
    **layer: Any,
) -> tuple[LayerContact, ContactState, ContactState]:
    """Along the tips in steps; contact, the state before the last step, the last."""
    contact = LayerContact(_layer(spacing_mm, **layer), parse(f"sphere:{diameter_mm:g}"))
    states = [contact.rest((tips_mm[0][0], tips_mm[0][1], 0.0))]
    for tip in tips_mm:
        states += contact.path(states[-1], tip, step_mm)
    return contact, states[-2], states[-1]


def violation(contact: LayerContact, before: ContactState, state: ContactState) -> float:
    """Worst breach of the laws of contact over the depth, worked out anew on the whole grid.

    Penetration, a gap under pressure, a shear above friction x pressure (as a share of its bound),
    slip where it sticks: independent of the residual that the solver reports.
    """
    layer, depth = contact.layer, state.tip_mm[2]
    traction = np.concatenate([state.shear_mpa, -state.pressure_mpa[..., None]], axis=-1)
    u = layer.apply(traction)
    xx, yy = np.meshgrid(layer.x_mm, layer.y_mm)
    dragged = layer.apply(np.concatenate([state.drag_mpa, 0 * u[..., 2:]], axis=-1))[..., :2]
    height = contact.indenter.height_mm(
        xx + dragged[..., 0] - state.tip_mm[0], yy + dragged[..., 1] - state.tip_mm[1]
    )
    gap = height - depth - u[..., 2]
    touching = state.pressure_mpa > 0
    worst = max(float(-gap.min()), float(np.abs(gap[touching]).max())) / depth
    if contact.friction == 0:
        return worst
    was, now = before.tip_mm, state.tip_mm
    share = 1.0 if was[2] >= 0 else now[2] / (now[2] - was[2])
    travel = share * np.array([now[0] - was[0], now[1] - was[1]])
    bound = contact.friction * state.pressure_mpa
    moved = u[..., :2] - before.displacement_mm[..., :2]
    # The shear, and that of the same pressures without the travel.
    for shear, slip in (
        (state.shear_mpa, moved - travel),
        (state.shear_mpa - state.drag_mpa, moved - (dragged - before.drag_mm)),
    ):
        size = np.hypot(shear[..., 0], shear[..., 1])
        worst = max(worst, float((size - bound).max() / bound.max()))
        sticks = touching & (size < bound * (1 - 1e-2))
        if sticks.any():
            worst = max(worst, float(np.abs(slip[sticks]).max()) / depth)
    return worst


def _laws(friction: float, by_mm: float, depth_mm: float, scratch: Path) -> tuple[float, str]:
    tips = ((0.0, 0.0, depth_mm), (by_mm, 0.0, depth_mm))
    contact, before, state = pressed(*tips, friction=friction)
    fx, _, fz = state.force_n
    return violation(contact, before, state), f"Fx {fx:+.3f} N, Fz {fz:+.3f} N"


def _refused(name: str, says: str, tip_mm: Point, **options: Any) -> Case:
    call = partial(run, partial(pressed, tip_mm, step_mm=9.0, **options))
    return Case(name, "refused", call, says=says)


def cases(quick: bool) -> Sequence[Case]:
    """Ends of nu, friction, thickness and depth; the corners of the skin."""
    percent = "% of the force"
    out = [
        *(Case(f"sphere, nu {nu:g}, padding 3", "right",
               partial(_sphere, spacing_mm=0.25 if quick else 0.18, nu=nu), 0.05, percent)
          for nu in ((0.5,) if quick else (0.0, 0.3, 0.4999, 0.5))),
        *(Case(f"friction {mu:g}, press and shear", "right or refused",
               partial(_laws, mu, 0.3, DEPTH_MM), 1e-5, "of the depth", "contact:")
          for mu in ((0.5,) if quick else (0.0, 0.5, 5.0, 100.0))),
        _refused("depth 1e-3 mm with the tip between nodes", "touches no grid node",
                 (0.0, 0.0, 1e-3)),
        _refused("contact over a corner of the skin", "over the face", (17.5, 16.5, 1.0)),
        _refused("sphere:30 on a gel of 8 x 8 mm", "half the period", (0.0, 0.0, 2.5),
                 diameter_mm=30.0, side_mm=(8.0, 8.0)),
    ]  # fmt: skip
    if quick:
        return out
    # The images of a thick layer are nearer for its thickness: more padding, as one would set.
    ends: tuple[tuple[str, float, dict[str, Any]], ...] = (
        ("sphere, 25 % deep", 0.05, {"spacing_mm": 0.18, "depth_mm": 3.0}),
        ("sphere, 1 % deep", 0.5, {"spacing_mm": 0.125, "depth_mm": 0.12}),
        ("sphere, thickness 1 mm, 10 % deep", 0.2,
         {"spacing_mm": 0.06, "thickness_mm": 1.0, "side_mm": (12.0, 12.0), "depth_mm": 0.1}),
        ("sphere, thickness 30 mm, 10 % deep, padding 8", 0.2,
         {"spacing_mm": 0.3, "thickness_mm": 30.0, "depth_mm": 3.0, "padding": 8.0}),
        ("sphere:30, wider than a gel of 20 x 20 mm", 0.05,
         {"spacing_mm": 0.1, "diameter_mm": 30.0, "side_mm": (20.0, 20.0), "padding": 5.0}),
    )  # fmt: skip
    deep = Case("friction 0.5 at 25 % of the gel, press and shear", "right or refused",
                partial(_laws, 0.5, 0.5, 3.0), 1e-5, "of the depth", "contact:")  # fmt: skip
    return [*out, deep, *(Case(name, "right", partial(_sphere, **options), bound, percent)
                          for name, bound, options in ends)]  # fmt: skip


ENGINE = Engine(
    "Gel layer",
    "Linear layer bonded to a rigid base, spectral operator, contact by conjugate gradients.",
    cases,
    curves,
)
