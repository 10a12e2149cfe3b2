"""The references themselves: a published table, and closed forms that hold together."""

from __future__ import annotations

import math

import half_space
import numpy as np
import pytest

from deltact_fab.elasticity.closed_forms import flat_punch_n_per_mm
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


def test_cattaneo_closed_forms_hold_together() -> None:
    material = GelMaterial(poisson=0.5)
    a, normal, mu, shear = 2.0, 3.0, 0.5, 0.9
    c = half_space.cattaneo_stick_radius_mm(shear, normal, a, mu)
    r = np.linspace(0, a, 20001)
    q = half_space.cattaneo_traction_mpa(r, a, c, normal, mu)
    assert np.trapezoid(2 * math.pi * r * q, r) == pytest.approx(shear, rel=1e-5)
    small = half_space.cattaneo_shift_mm(1e-6, normal, a, material, mu) / 1e-6
    assert small == pytest.approx(1.5 / (8 * material.shear_modulus_mpa * a), rel=1e-6)
