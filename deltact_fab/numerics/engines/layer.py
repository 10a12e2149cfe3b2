"""The bonded layer: force on a sphere against the Fredholm equation; its ends and its refusals.

The spheres take the textbook contact, a node held against the indenter above where it rested. The
flat punch, whose edge is singular, is judged in the tests.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from ...aliases import Point
from ...elasticity.layer import BondedLayer
from ...gel import reference
from ...gel.level import follow
from ...gel.linear.contact import LayerContact
from ...gel.linear.state import ContactState
from ...shapes import SphereTip
from ...shapes.indenter import parse
from ..engine import Case, CurveSetting, Engine, Work
from .gel_scene import GelCase, down, run

SEED, PLACES = 5, 8
SCENE, DEPTH_MM = GelCase("sphere:10", 0.25, friction=0.5), 1.2
REFERENCE_ERROR = 1e-8  # %; 48 and 96 Gauss points agree to 1e-10


def _contact(scene: GelCase, padding: float = 3.0, shear: bool = True) -> LayerContact:
    layer = BondedLayer.for_skin(scene.skin(), scene.material(), scene.spacing_mm, padding)
    return LayerContact(layer, parse(scene.indenter), observe_shear=shear)


def _error_percent(scene: GelCase, depth_mm: float, padding: float, scratch: Path) -> float:
    """Root mean square error of the force of a sphere in % over places between the nodes."""
    contact = _contact(scene, padding, shear=False)
    layer, (tip,) = contact.layer, contact.indenter.tips
    assert isinstance(tip, SphereTip)
    exact, _ = reference.sphere_on_layer(
        tip.radius_mm, depth_mm, layer.thickness_mm, layer.material
    )
    places = np.random.default_rng(SEED).uniform(-0.5, 0.5, (PLACES, 2)) * layer.spacing_mm[0]
    forces = [contact.solve(contact.rest(), (x, y, depth_mm)).force_n[2] for x, y in places]
    return float(np.sqrt(np.mean((-np.array(forces) / exact - 1) ** 2))) * 100


def _work(scene: GelCase, padding: float, scratch: Path) -> Work:
    contact = _contact(scene, padding, shear=False)
    return Work(
        lambda: contact.solve(contact.rest(), down(DEPTH_MM)),
        lambda state: _error_percent(scene, DEPTH_MM, padding, scratch),
    )


def curves(quick: bool) -> Sequence[CurveSetting]:
    """Spheres by spacing and padding."""
    plan = {0.49: (3.0,)} if quick else {0.49: (3.0, 2.0, 4.0), 0.5: (3.0,)}
    return [
        CurveSetting(
            f"{SCENE.indenter} pressed {DEPTH_MM:g} mm, nu {nu:g}", f"padding {padding:g}",
            f"{spacing_mm:g} mm", "% of the force, rms over places",
            "Fredholm equation, sphere on a bonded layer", REFERENCE_ERROR,
            partial(_work, replace(SCENE, nu=nu, spacing_mm=spacing_mm), padding),
        )
        for nu, paddings in plan.items() for padding in paddings
        for spacing_mm in ((0.5, 0.25) if quick else (0.5, 0.25, 0.18, 0.125))
    ]  # fmt: skip


def pressed(
    scene: GelCase, step_mm: float, *tips_mm: Point
) -> tuple[LayerContact, ContactState, ContactState]:
    """Along the tips in steps; contact, the state before the last step, the last."""
    contact = _contact(scene)
    states = [contact.rest((tips_mm[0][0], tips_mm[0][1], 0.0))]
    for tip in tips_mm:
        states += follow(contact, states[-1], tip, step_mm)
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


def _laws(scene: GelCase, depth_mm: float, by_mm: float, scratch: Path) -> tuple[float, str]:
    contact, before, state = pressed(scene, 0.3, down(depth_mm), (by_mm, 0.0, depth_mm))
    fx, _, fz = state.force_n
    return violation(contact, before, state), f"Fx {fx:+.3f} N, Fz {fz:+.3f} N"


def cases(quick: bool) -> Sequence[Case]:
    """Ends of nu, friction, thickness and depth; the corners of the skin."""
    nus, frictions = ((0.5,), (0.5,)) if quick else ((0.0, 0.3, 0.4999, 0.5), (0.0, 0.5, 5.0, 100))
    fine = replace(SCENE, spacing_mm=0.25 if quick else 0.18)
    spheres: list[tuple[str, float, GelCase, float, float]] = [
        (f"sphere, nu {nu:g}, padding 3", 0.05, replace(fine, nu=nu), DEPTH_MM, 3.0) for nu in nus
    ]
    drags = [(f"friction {mu:g}", replace(SCENE, friction=mu), DEPTH_MM, 0.3) for mu in frictions]
    if not quick:
        # The images of a thick layer are nearer for its thickness: more padding, as one would set.
        thin = GelCase("sphere:10", 0.06, side_mm=(12.0, 12.0), thickness_mm=1.0)
        thick = GelCase("sphere:10", 0.3, thickness_mm=30.0)
        wide = GelCase("sphere:30", 0.1, side_mm=(20.0, 20.0))
        spheres += [
            ("sphere, 25 % deep", 0.05, fine, 3.0, 3.0),
            ("sphere, 1 % deep", 0.5, replace(SCENE, spacing_mm=0.125), 0.12, 3.0),
            ("sphere, thickness 1 mm, 10 % deep", 0.2, thin, 0.1, 3.0),
            ("sphere, thickness 30 mm, 10 % deep, padding 8", 0.2, thick, 3.0, 8.0),
            ("sphere:30, wider than a gel of 20 x 20 mm", 0.05, wide, DEPTH_MM, 5.0),
        ]
        drags.append(("friction 0.5 at 25 % of the gel", SCENE, 3.0, 0.5))
    refused = (
        ("depth 1e-3 mm with the tip between nodes", "touches no grid node", SCENE, down(1e-3)),
        ("contact over a corner of the skin", "over the face", SCENE, (17.5, 16.5, 1.0)),
        ("sphere:30 on a gel of 8 x 8 mm", "half the period",
         replace(SCENE, indenter="sphere:30", side_mm=(8.0, 8.0)), down(2.5)),
    )  # fmt: skip
    return [
        *(Case(name, "right", partial(_error_percent, scene, depth_mm, padding), bound,
               "% of the force") for name, bound, scene, depth_mm, padding in spheres),
        *(Case(f"{name}, press and shear", "right or refused",
               partial(_laws, scene, depth_mm, by_mm), 1e-5, "of the depth", "contact:")
          for name, scene, depth_mm, by_mm in drags),
        *(Case(name, "refused", partial(run, partial(pressed, scene, 9.0, tip)), says=says)
          for name, says, scene, tip in refused),
    ]  # fmt: skip


ENGINE = Engine(
    "Gel layer",
    "Linear layer bonded to a rigid base, spectral operator, contact by conjugate gradients.",
    cases,
    curves,
)
