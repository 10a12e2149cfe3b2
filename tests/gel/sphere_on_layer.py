"""A quadrature solution that the contact solver is measured against.

Axisymmetric frictionless contact on a bonded layer is a Fredholm equation of the second kind
(after Lebedev and Ufliand, J. Appl. Math. Mech. 22, 1958): with the layer's compliance written as
(1 - nu)/(G k) M(k h), and the pressure's transform p(k) = G/(1 - nu) int_0^a phi(t) cos(k t) dt,

    phi(t) - 2/pi int_0^a phi(s) int_0^inf (1 - M(k h)) cos(k s) cos(k t) dk ds = g(t),
    g(t) = 2/pi d/dt int_0^t r f(r)/sqrt(t^2 - r^2) dr,   F = 2 pi G/(1 - nu) int_0^a phi dt,

where f(r) is the depth of the indenter's underside and phi(a) = 0 where the contact ends smoothly.
Half-space limit: Sneddon. Everything here is axisymmetric; lengths in mm, G in MPa, forces in N.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Literal

import numpy as np

from deltact_fab.aliases import Field
from deltact_fab.elasticity.layer import surface_compliance
from deltact_fab.elasticity.material import GelMaterial

Profile = Literal["sphere", "paraboloid"]


class LayerPunch:
    """The discretised integral equation for one contact radius over thickness ratio.

    radius_mm: contact radius. nodes: Gauss points on the radius; the kernel is smooth, so 48 give
    ten digits up to a/h = 2.
    """

    def __init__(
        self, radius_mm: float, thickness_mm: float, material: GelMaterial, nodes: int = 48
    ) -> None:
        self.radius_mm = radius_mm
        self.material = material
        t, w = np.polynomial.legendre.leggauss(nodes)
        self._t, self._w = radius_mm * (t + 1) / 2, radius_mm * w / 2
        # 1 - M falls off as (k h)^2 exp(-2 k h): at k h = 24 nothing is left.
        ratio = radius_mm / thickness_mm
        k, wk = np.polynomial.legendre.leggauss(max(96, int(24 * ratio * 2) + 64))
        k, wk = 12 * (k + 1) / thickness_mm, 12 * wk / thickness_mm
        normal = surface_compliance(k, thickness_mm, material).normal
        self._k = k
        lost = 1 - normal * material.shear_modulus_mpa * k / (1 - material.poisson)
        self._wk = 2 / math.pi * wk * lost
        self._matrix = np.eye(nodes) - self._kernel(self._t) * self._w

    def _kernel(self, t: Field) -> Field:
        return (np.cos(np.outer(t, self._k)) * self._wk) @ np.cos(np.outer(self._k, self._t))

    def density(self, g: Callable[[Field], Field]) -> tuple[Field, float]:
        """phi at the Gauss points and at the contact's edge, for a right-hand side g(t)."""
        phi = np.asarray(np.linalg.solve(self._matrix, g(self._t)), dtype=np.float64)
        edge = np.array([self.radius_mm])
        return phi, float((g(edge) + self._kernel(edge) @ (self._w * phi))[0])

    def force_n(self, phi: Field) -> float:
        """F = 2 pi G/(1 - nu) int_0^a phi dt."""
        stiffness = self.material.shear_modulus_mpa / (1 - self.material.poisson)
        return float(2 * math.pi * stiffness * (self._w @ phi))


def sphere_on_layer(
    radius_mm: float,
    depth_mm: float,
    thickness_mm: float,
    material: GelMaterial,
    profile: Profile = "sphere",
) -> tuple[float, float]:
    """Force (N) and contact radius (mm) of a frictionless rigid sphere on a bonded layer.

    profile: the true sphere, or the paraboloid r^2/2R of Hertz.
    """
    from scipy.optimize import brentq

    def shape(t: Field) -> Field:
        if profile == "paraboloid":
            return 2 / math.pi * t**2 / radius_mm
        return 2 / math.pi * t * np.arctanh(t / radius_mm)

    def solve(a: float) -> tuple[float, float]:
        """Depth that ends smoothly at a, and its force: the equation is linear in both."""
        punch = LayerPunch(a, thickness_mm, material)
        flat, flat_edge = punch.density(lambda t: np.full_like(t, 2 / math.pi))
        curved, curved_edge = punch.density(shape)
        depth = curved_edge / flat_edge
        return depth, punch.force_n(depth * flat - curved)

    low = 1e-6 * radius_mm
    high = radius_mm * (1 - 1e-6) if profile == "sphere" else 4 * math.sqrt(radius_mm * depth_mm)
    a = float(brentq(lambda r: solve(r)[0] - depth_mm, low, high, xtol=1e-13, rtol=1e-13))
    return solve(a)[1], a
