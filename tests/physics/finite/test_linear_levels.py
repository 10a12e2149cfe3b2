"""The linear level against independent solutions of a cylinder with the face's area."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pytest

from benchmarks.gel_axisymmetric import Ball, Cylinder, graded
from deltact_fab.physics.gel.level import Reach, follow_path
from deltact_fab.physics.gel.level_selection import select_level
from deltact_fab.physics.gel.path.open import open_contact
from deltact_fab.sensor.elasticity.material import GelMaterial
from deltact_fab.sensor.shapes.indenter import parse_indenter
from deltact_fab.sensor.shapes.sensor import SkinDimensions

FACE_MM = float(np.sqrt(36 * 34 / np.pi))


class Held(NamedTuple):
    """True errors, of the force and in plane (rms over the face), and what the level says."""

    force_rel: float
    in_plane_mm: float
    told_force_rel: float
    told_in_plane_mm: float


def body(face_mm: float, thickness_mm: float, poisson: float, contact_mm: float) -> Cylinder:
    """Ten cells over the contact's radius, larger ones away from it."""
    size = contact_mm / 10
    r = graded(face_mm, size, 1.6 * contact_mm, most=2 / size)
    z = -graded(thickness_mm, size, 0.8 * contact_mm, most=1.2 / size)[::-1]
    return Cylinder(r, z, GelMaterial().modulus_mpa, poisson)


def force_n(skin: SkinDimensions, nu: float, name: str, depth: float) -> float:
    """What a user gets of a press without friction."""
    reach = Reach(deepest_mm=depth)
    material = GelMaterial(poisson=nu)
    scene = skin, material, parse_indenter(name)
    gel = open_contact(*scene, select_level(*scene, reach, level="linear", friction=0.0))
    *_, state = follow_path(gel, gel.rest(), (0.0, 0.0, depth), gel.choice.step_mm)
    return -state.force_n[2]


@pytest.mark.parametrize(("nu", "thickness"), [(0.35, 12.0), (0.499, 8.0)])
def test_block_agrees_with_equal_area_disc(nu: float, thickness: float) -> None:
    """Its sides, too: they take 2 to 3 % off the layer here, the corners' part of it is small."""
    skin = SkinDimensions(thickness_mm=thickness)
    disc = body(FACE_MM, thickness, nu, 3.9).linear_force_n(7.5, 2.0)
    assert force_n(skin, nu, "sphere:15", 2.0) == pytest.approx(disc, rel=4e-3)


# -- against finite strain ----------------------------------------------------------------------


def held(nu: float, thickness: float, radius: float, depth: float) -> Held:
    """A press in the middle against the cylinder at finite strain."""
    skin = SkinDimensions(thickness_mm=thickness)
    contact = np.sqrt(radius * depth)
    # Nearly incompressible, the twin's Newton takes short steps only.
    step = contact / 30 if nu > 0.49 else None
    true = body(FACE_MM, thickness, nu, contact).press(Ball(radius), [depth], step)[0]
    reach, indenter = Reach(deepest_mm=depth), parse_indenter(f"sphere:{2 * radius:g}")
    scene = skin, GelMaterial(poisson=nu), indenter
    choice = select_level(*scene, reach, level="linear", friction=0.0, spacing_mm=0.25)
    gel = open_contact(*scene, choice)
    *_, state = follow_path(gel, gel.rest(), (0.0, 0.0, depth), choice.step_mm)
    x, y = np.meshgrid(gel.x_mm, gel.y_mm)
    r = np.hypot(x, y)
    on = r <= FACE_MM
    out = np.stack([x[on], y[on]], axis=1) / np.maximum(r[on], 1e-12)[:, None]
    off = state.displacement_mm[on][:, :2] - true.radial_mm(r[on])[:, None] * out
    return Held(
        abs(-state.force_n[2] / true.force_n - 1),
        float(np.sqrt((off**2).sum(axis=1).mean())),
        gel.choice.model_force_rel,
        gel.choice.model_in_plane_mm,
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    ("nu", "thickness", "radius", "depth"), [(0.35, 9.0, 8.0, 0.45), (0.499, 8.0, 6.0, 0.4)]
)
def test_linear_level_error_within_estimate(
    nu: float, thickness: float, radius: float, depth: float
) -> None:
    found = held(nu, thickness, radius, depth)
    assert found.force_rel <= found.told_force_rel < 0.05
    assert found.in_plane_mm <= found.told_in_plane_mm < 0.08
