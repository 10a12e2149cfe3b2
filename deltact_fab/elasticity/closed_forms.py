"""Forces of rigid indenters without friction that have a closed form, or nearly one."""

from __future__ import annotations

import math

import numpy as np

from .layer import surface_compliance
from .material import GelMaterial

NODES = 48  # Gauss points on the radius; the kernel is smooth: ten digits up to radius/h = 2


def flat_punch_n_per_mm(radius_mm: float, thickness_mm: float, material: GelMaterial) -> float:
    """Force over depth of a flat cylinder on the bonded layer.

    A Fredholm equation of the second kind (after Lebedev and Ufliand, J. Appl. Math. Mech. 22,
    1958): with the layer's compliance written as (1 - nu)/(G k) M(k h) and the pressure's transform
    as G/(1 - nu) int_0^a phi(t) cos(k t) dt,
        phi(t) - 2/pi int_0^a phi(s) int_0^inf (1 - M(k h)) cos(k s) cos(k t) dk ds = 2/pi,
    and F = 2 pi G/(1 - nu) int_0^a phi dt.
    """
    stiffness = material.shear_modulus_mpa / (1 - material.poisson)
    t, weight = np.polynomial.legendre.leggauss(NODES)
    t, weight = radius_mm * (t + 1) / 2, radius_mm * weight / 2
    # 1 - M falls off as (k h)^2 exp(-2 k h): at k h = 24 nothing is left.
    ratio = radius_mm / thickness_mm
    k, weight_k = np.polynomial.legendre.leggauss(max(96, int(48 * ratio) + 64))
    k, weight_k = 12 * (k + 1) / thickness_mm, 12 * weight_k / thickness_mm
    lost = 1 - surface_compliance(k, thickness_mm, material).normal * stiffness * k
    waves = np.cos(np.outer(t, k))
    kernel = (waves * (2 / math.pi * weight_k * lost)) @ waves.T
    phi = np.linalg.solve(np.eye(NODES) - kernel * weight, np.full(NODES, 2 / math.pi))
    return float(2 * math.pi * stiffness * (weight @ phi))


def hertz_force_n(radius_mm: float, depth_mm: float, material: GelMaterial) -> float:
    """Rigid paraboloid on a half-space: F = 4/3 E/(1 - nu^2) sqrt(R d^3), a = sqrt(R d)."""
    modulus = material.modulus_mpa / (1 - material.poisson**2)
    return 4 / 3 * modulus * math.sqrt(radius_mm * depth_mm**3)
