"""Closed forms of a rigid sphere on an elastic half-space (Johnson, Contact Mechanics, 4 and 7)."""

from __future__ import annotations

import math

import numpy as np

from deltact_fab.aliases import Field
from deltact_fab.elasticity.material import GelMaterial


def cattaneo_shift_mm(
    shear_n: float,
    normal_n: float,
    contact_radius_mm: float,
    material: GelMaterial,
    friction: float,
) -> float:
    """Tangential shift of a rigid sphere on a half-space under Q <= mu N (Cattaneo, Mindlin).

    3 mu N (2 - nu)/(16 G a) (1 - (1 - Q/(mu N))^(2/3)) (Johnson, Contact Mechanics, 7.2). It
    neglects the slip across the load and, unless nu = .5, the coupling of normal and tangential.
    """
    limit = friction * normal_n
    full = (
        3 * limit * (2 - material.poisson) / (16 * material.shear_modulus_mpa * contact_radius_mm)
    )
    return full * (1 - (1 - shear_n / limit) ** (2 / 3))


def cattaneo_stick_radius_mm(
    shear_n: float, normal_n: float, contact_radius_mm: float, friction: float
) -> float:
    """Radius of the stick zone, a (1 - Q/(mu N))^(1/3)."""
    return contact_radius_mm * (1 - shear_n / (friction * normal_n)) ** (1 / 3)


def cattaneo_traction_mpa(
    r_mm: Field, contact_radius_mm: float, stick_radius_mm: float, normal_n: float, friction: float
) -> Field:
    """Shear traction along the load: mu p(a) less its copy on the stick zone; shape of r_mm."""
    a, c = contact_radius_mm, stick_radius_mm
    peak = friction * 3 * normal_n / (2 * math.pi * a**2)
    outer = np.sqrt(np.maximum(0.0, 1 - r_mm**2 / a**2))
    inner = c / a * np.sqrt(np.maximum(0.0, 1 - r_mm**2 / c**2)) if c > 0 else 0.0
    return peak * (outer - inner)
