"""The bonded layer: force on a sphere against the Fredholm equation; its ends and its refusals.

The spheres take the textbook contact, a node held against the indenter above where it rested. The
flat punch, whose edge is singular, is judged in the tests.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np

from ...aliases import Point
from ...elasticity.layer import BondedLayer
from ...elasticity.material import GelMaterial
from ...gel import reference
from ...gel.level import follow
from ...gel.linear.contact import LayerContact
from ...gel.linear.state import ContactState
from ...shapes import SkinDimensions
from ...shapes.indenter import parse
from ..engine import Case, CurveSetting, Engine, Work
from .gel_scene import run

SEED, PLACES = 5, 8
SPHERE_MM, DEPTH_MM = 10.0, 1.2
REFERENCE_ERROR = 1e-8  # %; 48 and 96 Gauss points agree to 1e-10


@cache
def _sphere_force_n(diameter_mm: float, depth_mm: float, thickness_mm: float, nu: float) -> float:
    material = GelMaterial(poisson=nu)
    return reference.sphere_on_layer(diameter_mm / 2, depth_mm, thickness_mm, material)[0]


def _skin(side_mm: tuple[float, float], thickness_mm: float) -> SkinDimensions:
    return SkinDimensions(*side_mm, thickness_mm, min(2.0, thickness_mm / 4), thickness_mm / 2)


def _textbook(layer: BondedLayer, diameter_mm: float = SPHERE_MM) -> LayerContact:
    return LayerContact(layer, parse(f"sphere:{diameter_mm:g}"), observe_shear=False)


def sphere_error_percent(
    layer: BondedLayer, depth_mm: float = DEPTH_MM, diameter_mm: float = SPHERE_MM
) -> float:
    """Root mean square error of the force in % over places between the nodes."""
    contact = _textbook(layer, diameter_mm)
    exact = _sphere_force_n(diameter_mm, depth_mm, layer.thickness_mm, layer.material.poisson)
    places = np.random.default_rng(SEED).uniform(-0.5, 0.5, (PLACES, 2)) * layer.spacing_mm[0]
    forces = [contact.solve(contact.rest(), (x, y, depth_mm)).force_n[2] for x, y in places]
    return float(np.sqrt(np.mean((-np.array(forces) / exact - 1) ** 2))) * 100


def _build_sphere(nu: float, spacing_mm: float, padding: float, scratch: Path) -> Work:
    layer = BondedLayer.for_skin(SkinDimensions(), GelMaterial(poisson=nu), spacing_mm, padding)
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
    spacing_mm: float,
    scratch: Path,
    *,
    nu: float = 0.49,
    thickness_mm: float = 12.0,
    side_mm: tuple[float, float] = (36.0, 34.0),
    depth_mm: float = DEPTH_MM,
    diameter_mm: float = SPHERE_MM,
    padding: float = 3.0,
) -> float:
    layer = BondedLayer.for_skin(
        _skin(side_mm, thickness_mm), GelMaterial(poisson=nu), spacing_mm, padding
    )
    return sphere_error_percent(layer, depth_mm, diameter_mm)


def _state(
    tip_mm: Point,
    *,
    modulus_mpa: float = 0.56,
    friction: float = 0.5,
    nu: float = 0.49,
    spacing_mm: float = 0.25,
    diameter_mm: float = SPHERE_MM,
    side_mm: tuple[float, float] = (36.0, 34.0),
    step_mm: float = 0.3,
    before_mm: Point | None = None,
) -> tuple[LayerContact, ContactState, ContactState]:
    """Press, then move to the tip in steps; contact, the state before the last step, the last."""
    layer = BondedLayer.for_skin(
        _skin(side_mm, 12.0), GelMaterial(modulus_mpa, nu, friction), spacing_mm
    )
    contact = LayerContact(layer, parse(f"sphere:{diameter_mm:g}"))
    states = [contact.rest((tip_mm[0], tip_mm[1], 0.0))]
    for target in (tip_mm,) if before_mm is None else (before_mm, tip_mm):
        states += follow(contact, states[-1], target, step_mm)
    return contact, states[-2] if len(states) > 1 else states[-1], states[-1]


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


def _laws(tip_mm: Point, scratch: Path, **options: Any) -> tuple[float, str]:
    contact, before, state = _state(tip_mm, **options)
    fx, _, fz = state.force_n
    return violation(contact, before, state), f"Fx {fx:+.3f} N, Fz {fz:+.3f} N"


def _scaled(factor: float, what: str, scratch: Path) -> float:
    """Press and shear with E and with E x factor: the change of force / E, or of iterations."""
    options: dict[str, Any] = {"before_mm": (0.0, 0.0, DEPTH_MM)}
    tip = (0.3, 0.0, DEPTH_MM)
    one, other = (_state(tip, modulus_mpa=e, **options)[2] for e in (0.56, 0.56 * factor))
    if what == "iterations":
        return float(other.iterations - one.iterations)
    f, g = np.array(one.force_n), np.array(other.force_n) / factor
    return float(np.abs(g - f).max() / np.abs(f).max())


def _translated(scratch: Path) -> float:
    """Near a corner of the skin, a whole number of nodes away: the layer has no sides."""
    layer = BondedLayer.for_skin(SkinDimensions(), GelMaterial(), 0.25)
    contact = LayerContact(layer, parse("sphere:10"))
    here = contact.solve(contact.rest(), (0.0, 0.0, DEPTH_MM)).force_n[2]
    there = contact.solve(contact.rest((14.0, 13.0, 0.0)), (14.0, 13.0, DEPTH_MM)).force_n[2]
    return abs(there / here - 1)


def _depth_zero(scratch: Path) -> float:
    layer = BondedLayer.for_skin(SkinDimensions(), GelMaterial(), 0.5)
    contact = LayerContact(layer, parse("sphere:10"))
    state = contact.solve(contact.rest(), (0.0, 0.0, 0.0))
    return float(np.abs(state.displacement_mm).max() + np.abs(state.force_n).max())


def _unloaded(scratch: Path) -> float:
    contact, _, state = _state((0.3, 0.0, 1.0), before_mm=(0.0, 0.0, 1.0))
    *_, free = follow(contact, state, (0.3, 0.0, 0.0), 0.1)
    return float(np.abs(free.displacement_mm).max() + np.abs(free.force_n).max())


def _one_increment(scratch: Path) -> float:
    """Shear of 1 mm in one increment against 24; relative change of the side force."""
    contact, _, pressed = _state((0.0, 0.0, DEPTH_MM), step_mm=0.1)
    forces = []
    for step_mm in (1.0, 1 / 24):
        *_, sheared = follow(contact, pressed, (1.0, 0.0, DEPTH_MM), step_mm)
        forces.append(sheared.force_n[0])
    return forces[0] / forces[1] - 1


def _mirrored(scratch: Path) -> float:
    forces = [
        _state((sign * 0.3, 0.0, DEPTH_MM), before_mm=(0.0, 0.0, DEPTH_MM))[2].force_n
        for sign in (1, -1)
    ]
    return abs(forces[0][0] + forces[1][0]) / abs(forces[0][0])


def _refused(name: str, says: str, tip_mm: Point, **options: Any) -> Case:
    return Case(
        name, "refused", partial(run, partial(_state, tip_mm, step_mm=9.0, **options)), says=says
    )


def cases(quick: bool) -> Sequence[Case]:
    """Ends of nu, E, friction, thickness and depth; the corners of the skin."""
    percent = "% of the force"
    grid_mm = 0.25 if quick else 0.18
    out = [
        *(Case(f"sphere, nu {nu:g}, padding 3", "right", partial(_sphere, grid_mm, nu=nu), 0.05,
               percent) for nu in ((0.5,) if quick else (0.0, 0.3, 0.4999, 0.5))),
        *(Case(f"E x {factor:g}: {what}", "right", partial(_scaled, factor, what), bound, unit)
          for factor in ((1e3,) if quick else (1e-3, 1e3))
          for what, bound, unit in (("force", 1e-9, "of the force over E"),
                                    ("iterations", 0, "more iterations"))),
        *(Case(f"friction {mu:g}, press and shear", "right or refused",
               partial(_laws, (0.3, 0.0, DEPTH_MM), friction=mu, before_mm=(0.0, 0.0, DEPTH_MM)),
               1e-5, "of the depth", "contact:")
          for mu in ((0.5,) if quick else (0.0, 0.5, 5.0, 100.0))),
        Case("depth 0", "right", _depth_zero, 0.0, "mm and N"),
        Case("pressed, sheared, lifted", "right", _unloaded, 0.0, "mm and N"),
        Case("shear to -x mirrors +x", "right", _mirrored, 1e-5, "of the force"),
        Case("14 mm and 13 mm off the centre", "right", _translated, 1e-6, "of the force"),
        _refused("depth over 25 % of the gel", "25 %", (0.0, 0.0, 3.01)),
        _refused("depth 1e-3 mm with the tip between nodes", "touches no grid node",
                 (0.0, 0.0, 1e-3)),
        _refused("tip beside the skin", "off the face", (18.5, 0.0, 1.0)),
        _refused("contact over a corner of the skin", "over the face", (17.5, 16.5, 1.0)),
        _refused("sphere:30 on a gel of 8 x 8 mm", "half the period", (0.0, 0.0, 2.5),
                 diameter_mm=30.0, side_mm=(8.0, 8.0)),
        _refused("sphere:3 to its equator", "sphere:3", (0.0, 0.0, 1.5), diameter_mm=3.0),
        _refused("depth NaN", "finite", (0.0, 0.0, math.nan)),
    ]  # fmt: skip
    if quick:
        return out
    return out + [
        Case("sphere, 25 % deep", "right", partial(_sphere, 0.18, depth_mm=3.0), 0.05, percent),
        Case("sphere, 1 % deep", "right", partial(_sphere, 0.125, depth_mm=0.12), 0.5, percent),
        # The images of a thick layer are nearer for its thickness: more padding, as one would set.
        Case("sphere, thickness 1 mm, 10 % deep", "right",
             partial(_sphere, 0.06, thickness_mm=1.0, side_mm=(12.0, 12.0), depth_mm=0.1), 0.2,
             percent),
        Case("sphere, thickness 30 mm, 10 % deep, padding 8", "right",
             partial(_sphere, 0.3, thickness_mm=30.0, depth_mm=3.0, padding=8.0), 0.2, percent),
        Case("sphere:30, wider than a gel of 20 x 20 mm", "right",
             partial(_sphere, 0.1, diameter_mm=30.0, side_mm=(20.0, 20.0), padding=5.0), 0.05,
             percent),
        Case("friction 0.5 at 25 % of the gel, press and shear", "right or refused",
             partial(_laws, (0.5, 0.0, 3.0), before_mm=(0.0, 0.0, 3.0), step_mm=0.25), 1e-5,
             "of the depth", "contact:"),
        Case("shear of 1 mm in 1 increment against 24, Fx", "right", _one_increment, 0.01,
             "of the force"),
    ]  # fmt: skip


ENGINE = Engine(
    "layer",
    "Gel layer",
    "Linear layer bonded to a rigid base, spectral operator, contact by conjugate gradients.",
    curves,
    cases,
)
