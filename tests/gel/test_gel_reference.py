"""The references themselves: a published table, limits, and an equation solved another way."""

from __future__ import annotations

import math

import half_space
import numpy as np
import pytest
from sphere_on_layer import Profile, sphere_on_layer

from deltact_fab.elasticity.closed_forms import flat_punch_n_per_mm, hertz_force_n
from deltact_fab.elasticity.material import GelMaterial

POISSON = (0.3, 0.4, 0.45, 0.5)
# Flat punch on a bonded layer; Hayes et al. (J. Biomech. 5, 1972) agree to .3 % for a/h <= 1.
FACTORS = {
    0.2: (1.2066, 1.2323, 1.2523, 1.2806),
    0.6: (1.7848, 1.9178, 2.0328, 2.2129),
    1.0: (2.4835, 2.7938, 3.0914, 3.6187),
    2.0: (4.3532, 5.2985, 6.4206, 9.1495),
}


@pytest.mark.parametrize("ratio", FACTORS)
def test_flat_punch_table(ratio: float) -> None:
    """kappa in 4 G a kappa/(1 - nu)."""
    found = [
        flat_punch_n_per_mm(ratio, 1.0, GelMaterial(2 * (1 + nu), nu)) * (1 - nu) / (4 * ratio)
        for nu in POISSON
    ]
    assert [round(f, 4) for f in found] == list(FACTORS[ratio])


def test_thick_layer_gives_hertz_and_sneddon() -> None:
    material = GelMaterial(poisson=0.3)
    force, a = sphere_on_layer(5.0, 0.5, 1e6, material, "paraboloid")
    assert force == pytest.approx(hertz_force_n(5.0, 0.5, material), rel=1e-5)
    assert a == pytest.approx(math.sqrt(2.5), rel=1e-5)
    # Sneddon's sphere: depth = a/2 ln((R+a)/(R-a)), F = E*/2 ((a^2+R^2) ln(..) - 2aR).
    force, a = sphere_on_layer(5.0, 1.5, 1e6, material)
    logarithm = math.log((5 + a) / (5 - a))
    modulus = material.modulus_mpa / (1 - 0.09)
    assert a / 2 * logarithm == pytest.approx(1.5, rel=1e-5)
    assert force == pytest.approx(modulus / 2 * ((a * a + 25) * logarithm - 10 * a), rel=1e-5)


def test_sphere_and_paraboloid_agree_for_a_shallow_press_only() -> None:
    material = GelMaterial()
    forces = {
        depth: [sphere_on_layer(5.0, depth, 12.0, material, p)[0] for p in PROFILES]
        for depth in (0.01, 1.2)
    }
    assert forces[0.01][0] == pytest.approx(forces[0.01][1], rel=1e-3)
    assert forces[1.2][1] > 1.03 * forces[1.2][0]


PROFILES: tuple[Profile, ...] = ("sphere", "paraboloid")


def test_force_is_the_slope_of_the_work() -> None:
    """dF/d(depth) of a smooth contact is the flat punch's stiffness at the same radius."""
    material, h, eps = GelMaterial(poisson=0.45), 4.0, 1e-4
    up, down = (sphere_on_layer(5.0, 1 + s, h, material)[0] for s in (eps, -eps))
    _, a = sphere_on_layer(5.0, 1.0, h, material)
    stiffness = flat_punch_n_per_mm(a, h, material)
    assert (up - down) / (2 * eps) == pytest.approx(stiffness, rel=1e-6)


def test_cattaneo_closed_forms_hold_together() -> None:
    material = GelMaterial(poisson=0.5)
    a, normal, mu, shear = 2.0, 3.0, 0.5, 0.9
    c = half_space.cattaneo_stick_radius_mm(shear, normal, a, mu)
    r = np.linspace(0, a, 20001)
    q = half_space.cattaneo_traction_mpa(r, a, c, normal, mu)
    assert np.trapezoid(2 * math.pi * r * q, r) == pytest.approx(shear, rel=1e-5)
    small = half_space.cattaneo_shift_mm(1e-6, normal, a, material, mu) / 1e-6
    assert small == pytest.approx(1.5 / (8 * material.shear_modulus_mpa * a), rel=1e-6)
