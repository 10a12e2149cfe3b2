"""How far the acrylic plate yields to a press, and what it bears. Imports no CAD kernel.

A thin plate (Kirchhoff), its lines of support taken as simple: they do not turn it back. Its
strain energy (S. Timoshenko and S. Woinowsky-Krieger, Theory of Plates and Shells, 2nd ed. 1959,
section 82) is least for the deflection, which is sought among products of polynomials that vanish
on the supports (Ritz). So notched corners and free edges cost nothing extra, and each further term
can only bring the work of the load up towards the exact one.

Left out: the gel bonded to it and what frame and skin do against its turning on the ledges, which
make it stiffer (held on the ledges' whole breadth it would yield half as far; what a play of .03 mm
above its edges does away with), and shear, 2 % of the default plate's deflection.
"""

from __future__ import annotations

from dataclasses import astuple, dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
from numpy.polynomial import Legendre

from ..aliases import Point2

if TYPE_CHECKING:
    from ..aliases import Field
    from .dimensions import Design


TERMS = 14
"""Polynomials in each direction: the default plate yields within .3 % of what it does with 24."""


@dataclass(frozen=True)
class PlateShape:
    """A rectangle of +-half_mm less a notch in each corner, on lines at +-support_mm.

    support_mm: of the lines x = const (None: these edges are free) and y = const.
    """

    half_mm: Point2
    notch_mm: Point2
    support_mm: tuple[float | None, float]
    thickness_mm: float
    youngs_modulus_mpa: float
    poisson: float

    @property
    def rigidity_nmm(self) -> float:
        """D = E t^3 / (12 (1 - nu^2))."""
        return self.youngs_modulus_mpa * self.thickness_mm**3 / (12 * (1 - self.poisson**2))


@dataclass(frozen=True)
class Bending:
    """Of a force, uniform on a disc.

    deflection_mm: the largest. over_ring_mm: the largest over a ring about the middle. stress_mpa:
    the largest bending stress within the disc; where a notch's sharp corner bears more, that
    is left out.
    """

    deflection_mm: float
    over_ring_mm: float
    stress_mpa: float


def plate_of(design: Design) -> PlateShape:
    """The acrylic on the inner edges of the shell's ledges, two or four of them."""
    x, y = design.ledge_half_mm
    return PlateShape(
        design.acrylic_half_mm,
        design.acrylic_notch_mm,
        (x if design.shell.ledge_x_mm > 0 else None, y),
        design.optics.acrylic_mm,
        design.plate.youngs_modulus_mpa,
        design.plate.poisson,
    )


def press(design: Design, force_n: float, at_mm: Point2 = (0.0, 0.0)) -> Bending:
    """A press of force_n at a place of the face, spread by the gel on `plate.spread_mm`.

    The ring is the light holder.
    """
    x, y = map(abs, at_mm)
    ring = (design.light_bore_mm, design.light_radius_mm)
    unit = bend(plate_of(design), design.plate.spread_mm, (x, y), ring)
    return Bending(*(force_n * value for value in astuple(unit)))


@dataclass(frozen=True)
class _Basis:
    """Polynomials of one direction that vanish on its support."""

    scale_mm: float
    functions: tuple[Legendre, ...]

    @classmethod
    def make(cls, half_mm: float, support_mm: float | None, terms: int) -> _Basis:
        factor = Legendre([1.0])
        if support_mm is not None:
            # 1 - x^2 = 2/3 (P0 - P2), in units of the support.
            factor = Legendre([2 / 3, 0.0, -2 / 3])
        return cls(support_mm or half_mm, tuple(factor * Legendre.basis(k) for k in range(terms)))

    def at(self, points_mm: Field, order: int) -> Field:
        """Derivatives of an order, (function, point)."""
        t = points_mm / self.scale_mm
        rows = [f.deriv(order)(t) if order else f(t) for f in self.functions]
        return np.array(rows) / self.scale_mm**order

    def integrals(self, low_mm: float, high_mm: float) -> dict[tuple[int, int], Field]:
        """Of products of two functions' derivatives over an interval."""
        nodes, weights = np.polynomial.legendre.leggauss(len(self.functions) + 6)
        half = (high_mm - low_mm) / 2
        points = low_mm + half * (nodes + 1)
        rows = [self.at(points, order) for order in range(3)]
        return {
            (i, j): half * (rows[i] * weights) @ rows[j].T
            for i, j in ((0, 0), (1, 1), (2, 2), (0, 2), (2, 0))
        }


@lru_cache(maxsize=256)
def bend(
    plate: PlateShape,
    spread_mm: float,
    at_mm: Point2 = (0.0, 0.0),
    ring_mm: Point2 = (0.0, 0.0),
    terms: int = TERMS,
) -> Bending:
    """Bending by 1 N on a disc of diameter spread_mm about at_mm.

    ring_mm: inner and outer radius of the ring behind the plate. The part of the disc beyond a
    support is borne by the ledge itself.
    """
    (w, h), (sx, sy) = plate.half_mm, plate.support_mm
    x_basis, y_basis, compliance = _system(plate, terms)
    x, y, share = _disc(spread_mm, at_mm)
    inside = (np.abs(x) < (w if sx is None else sx)) & (np.abs(y) < sy)
    if not inside.any():
        return Bending(0.0, 0.0, 0.0)
    x, y, share = x[inside], y[inside], share[inside]
    load = ((x_basis.at(x, 0) * share) @ y_basis.at(y, 0).T).ravel()
    weights = (compliance @ load).reshape(terms, terms)

    def field(x: Field, y: Field, i: int = 0, j: int = 0) -> Field:
        by_point: Field = (x_basis.at(x, i) * (weights @ y_basis.at(y, j))).sum(axis=0)
        return by_point

    xx, yy, xy = field(x, y, 2, 0), field(x, y, 0, 2), field(x, y, 1, 1)
    nu, d = plate.poisson, plate.rigidity_nmm
    mx, my, mxy = d * (xx + nu * yy), d * (yy + nu * xx), d * (1 - nu) * xy
    moment = np.abs(mx + my) / 2 + np.hypot((mx - my) / 2, mxy)
    gx, gy = (g.ravel() for g in np.meshgrid(np.linspace(-w, w, 41), np.linspace(-sy, sy, 41)))
    nx, ny = plate.notch_mm
    kept = (np.abs(gx) <= w - nx) | (np.abs(gy) <= h - ny)
    radius, angle = np.meshgrid(np.linspace(*ring_mm, 8), np.linspace(0, 2 * np.pi, 49))
    ring = field((radius * np.cos(angle)).ravel(), (radius * np.sin(angle)).ravel())
    largest = max(float(field(gx[kept], gy[kept]).max()), float(field(x, y).max()))
    stress_mpa = 6 * float(moment.max()) / plate.thickness_mm**2
    return Bending(largest, float(ring.max()), stress_mpa)


@lru_cache(maxsize=8)
def _system(plate: PlateShape, terms: int) -> tuple[_Basis, _Basis, Field]:
    """What all loads on a plate have in common."""
    (w, h), (sx, sy) = plate.half_mm, plate.support_mm
    x_basis = _Basis.make(w, sx, terms)
    y_basis = _Basis.make(h, sy, terms)
    compliance: Field = np.linalg.inv(_stiffness(plate, x_basis, y_basis)).astype(np.float64)
    return x_basis, y_basis, compliance


def _stiffness(plate: PlateShape, x_basis: _Basis, y_basis: _Basis) -> Field:
    """Second derivatives of the strain energy in the weights, over the notched rectangle."""
    (w, h), (nx, ny), nu = plate.half_mm, plate.notch_mm, plate.poisson
    n = len(x_basis.functions)
    pieces = [((-w, w), (-(h - ny), h - ny))]
    if min(nx, ny) > 0:
        pieces += [((nx - w, w - nx), side) for side in ((-h, ny - h), (h - ny, h))]
    else:
        pieces = [((-w, w), (-h, h))]
    total = np.zeros((n * n, n * n))
    for (x0, x1), (y0, y1) in pieces:
        a, b = x_basis.integrals(x0, x1), y_basis.integrals(y0, y1)
        total += np.kron(a[2, 2], b[0, 0]) + np.kron(a[0, 0], b[2, 2])
        total += nu * (np.kron(a[2, 0], b[0, 2]) + np.kron(a[0, 2], b[2, 0]))
        total += 2 * (1 - nu) * np.kron(a[1, 1], b[1, 1])
    return plate.rigidity_nmm * total


def _disc(diameter_mm: float, at_mm: Point2) -> tuple[Field, Field, Field]:
    """Points of a disc and their shares of its area."""
    nodes, weights = np.polynomial.legendre.leggauss(12)
    angle = (np.arange(32) + 0.5) * 2 * np.pi / 32
    r = (nodes + 1) / 2
    share = np.repeat(weights * r, len(angle)) / len(angle)
    r, angle = np.repeat(r, len(angle)), np.tile(angle, len(r))
    r = r * diameter_mm / 2
    return at_mm[0] + r * np.cos(angle), at_mm[1] + r * np.sin(angle), share
