"""The linear levels against independent solutions of a cylinder with the face's area."""

from __future__ import annotations

import numpy as np
import pytest
from axisymmetric import Cylinder, graded

from deltact_fab.gel import reference
from deltact_fab.gel.level import Reach, open_contact
from deltact_fab.gel.material import GelMaterial
from deltact_fab.shapes import SkinDimensions
from deltact_fab.shapes.indenter import parse

FACE_MM = float(np.sqrt(36 * 34 / np.pi))


def body(face_mm: float, thickness_mm: float, poisson: float, contact_mm: float) -> Cylinder:
    """Ten cells over the contact's radius, larger ones away from it."""
    size = contact_mm / 10
    r = graded(face_mm, size, 1.6 * contact_mm, most=2 / size)
    z = -graded(thickness_mm, size, 0.8 * contact_mm, most=1.2 / size)[::-1]
    return Cylinder(r, z, GelMaterial().modulus_mpa, poisson)


def force_n(level: str, skin: SkinDimensions, nu: float, name: str, depth: float) -> float:
    """What a user gets of a press without friction."""
    reach = Reach(deepest_mm=depth)
    material = GelMaterial(poisson=nu)
    gel = open_contact(skin, material, parse(name), level=level, reach=reach, friction=0.0)  # type: ignore[arg-type]
    *_, state = gel.path(gel.rest(), (0.0, 0.0, depth))
    return -state.force_n[2]


@pytest.mark.parametrize("nu", [0.35, 0.42, 0.49, 0.499])
def test_the_layer_is_the_integral_equation_and_the_disc(nu: float) -> None:
    """Two solutions that share nothing, and what the interface of the levels gives."""
    wide = SkinDimensions(width_mm=80, length_mm=80)
    exact, _ = reference.sphere_on_layer(5.0, 1.5, 12.0, GelMaterial(poisson=nu))
    assert body(60.0, 12.0, nu, 2.7).linear_force_n(5.0, 1.5) == pytest.approx(exact, rel=2e-3)
    assert force_n("layer", wide, nu, "sphere:10", 1.5) == pytest.approx(exact, rel=2e-3)


@pytest.mark.parametrize(("nu", "thickness"), [(0.35, 12.0), (0.49, 12.0), (0.499, 8.0)])
def test_the_block_is_the_disc_of_equal_area(nu: float, thickness: float) -> None:
    """Its sides, too: they take 2 to 3 % off the layer here, the corners' part of it is small."""
    skin = SkinDimensions(thickness_mm=thickness)
    disc = body(FACE_MM, thickness, nu, 3.9).linear_force_n(7.5, 2.0)
    assert force_n("block", skin, nu, "sphere:15", 2.0) == pytest.approx(disc, rel=4e-3)
