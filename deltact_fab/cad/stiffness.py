"""How far the acrylic plate yields to a press, and what it bears. Imports no CAD kernel.

A thin plate (Kirchhoff) on the bead of silicone that fills the gap before the shell's ledges. The
deflection is, of all sums of products of Legendre's polynomials (Ritz), the one of least energy:
the plate's strain energy (S. Timoshenko and S. Woinowsky-Krieger, Theory of Plates and Shells, 2nd
ed. 1959, section 82) and the bead's, springs spread over the width that the plate lies on a ledge.
So notched corners and free edges cost nothing extra.

The bead pushes and does not pull: how well it sticks nobody knows. Where the plate's edge lifts off
it is let go, so that a thin bead becomes the bare inner edge of the ledge.

Left out: the gel bonded to the plate and what frame and bead do against its turning on the ledges,
which make it stiffer, and shear, 2 % of the default plate's deflection.
"""

from __future__ import annotations

from dataclasses import astuple, dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
from numpy.polynomial import legendre

from ..aliases import Point2
from ..errors import SolverError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ..aliases import Field
    from .dimensions import Design

TERMS = 14
"""Polynomials in each direction: the default plate yields within .2 % of what it does with 24."""
BULK_MPA = 1000.0  # of silicone, about: what bounds a very thin bead
DRY_MM = 0.01  # a ledge without a bead counts as one of this thickness
LET_GO_N_MM = 1e-4  # at a point where the plate lifts off; keeps a press beyond all ledges finite
ROUNDS = 60


@dataclass(frozen=True)
class PlateShape:
    """A rectangle of +-half_mm less a notch in each corner, on ledges that begin at +-support_mm.

    support_mm: in x (None: these edges are free) and in y. bead_mm: height of the bead, 0 for none.
    """

    half_mm: Point2
    notch_mm: Point2
    support_mm: tuple[float | None, float]
    thickness_mm: float
    youngs_modulus_mpa: float
    poisson: float
    bead_mm: float
    bead_modulus_mpa: float

    @property
    def rigidity_nmm(self) -> float:
        """D = E t^3 / (12 (1 - nu^2))."""
        return self.youngs_modulus_mpa * self.thickness_mm**3 / (12 * (1 - self.poisson**2))

    def bead_n_mm3(self, width_mm: float) -> float:
        """Spring of a long bonded bead, per area = 1 / (t / Ec + t / K); Ec = 4/3 E (1 + S^2).

        S = width / (2 t): rubber that cannot widen is stiffer (A. N. Gent and P. B. Lindley, Proc.
        Inst. Mech. Eng. 173, 1959, pp. 111-122).
        """
        t = max(self.bead_mm, DRY_MM)
        confined_mpa = 4 / 3 * self.bead_modulus_mpa * (1 + (width_mm / (2 * t)) ** 2)
        return 1 / (t / confined_mpa + t / BULK_MPA)

    def covers(self, x: Field, y: Field) -> NDArray[np.bool_]:
        """Which points lie on it."""
        (w, h), (nx, ny), x, y = self.half_mm, self.notch_mm, np.abs(x), np.abs(y)
        return (x <= w) & (y <= h) & ((x <= w - nx) | (y <= h - ny))

    def polynomials(self, axis: int, points_mm: Field, order: int, terms: int) -> Field:
        """Derivatives of an order of one direction's polynomials, (terms, points)."""
        half_mm = self.half_mm[axis]
        coefficients = legendre.legder(np.eye(terms), order)
        return np.asarray(legendre.legval(points_mm / half_mm, coefficients)) / half_mm**order

    def products(self, x: Field, y: Field, terms: int, i: int = 0, j: int = 0) -> Field:
        """Derivatives of orders i in x and j in y of both directions', (terms^2, points)."""
        of_x, of_y = self.polynomials(0, x, i, terms), self.polynomials(1, y, j, terms)
        return (of_x[:, None] * of_y).reshape(-1, len(x))


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
    """The acrylic on the shell's ledges, two or four of them."""
    x, y = design.ledge_half_mm
    return PlateShape(
        design.acrylic_half_mm,
        design.acrylic_notch_mm,
        (x if design.shell.ledge_x_mm > 0 else None, y),
        design.optics.acrylic_mm,
        design.plate.youngs_modulus_mpa,
        design.plate.poisson,
        design.shell.ledge_drop_mm,
        design.plate.bead_modulus_mpa,
    )


def press(design: Design, force_n: float, at_mm: Point2 = (0.0, 0.0)) -> Bending:
    """A press of force_n at a place of the face, spread by the gel on `plate.spread_mm`.

    The ring is the light holder.
    """
    x, y = map(abs, at_mm)
    ring = (design.light_bore_mm, design.light_radius_mm)
    unit = bend(plate_of(design), design.plate.spread_mm, (x, y), ring)
    return Bending(*(force_n * value for value in astuple(unit)))


@lru_cache(maxsize=256)
def bend(
    plate: PlateShape,
    spread_mm: float,
    at_mm: Point2 = (0.0, 0.0),
    ring_mm: Point2 = (0.0, 0.0),
    terms: int = TERMS,
) -> Bending:
    """Bending by 1 N on a disc of diameter spread_mm about at_mm.

    ring_mm: inner and outer radius of the ring behind the plate. The part of the disc beyond the
    plate is borne by the frame. Raises SolverError where the plate finds no rest on the bead.
    """
    x, y, share = _disc(spread_mm, at_mm)
    on = plate.covers(x, y)
    if not on.any():
        return Bending(0.0, 0.0, 0.0)
    x, y = x[on], y[on]
    weights = _at_rest(plate, terms, plate.products(x, y, terms) @ share[on])
    xx, yy, xy = (weights @ plate.products(x, y, terms, *o) for o in ((2, 0), (0, 2), (1, 1)))
    nu, d = plate.poisson, plate.rigidity_nmm
    mx, my, mxy = d * (xx + nu * yy), d * (yy + nu * xx), d * (1 - nu) * xy
    moment = np.abs(mx + my) / 2 + np.hypot((mx - my) / 2, mxy)
    grid = np.meshgrid(*(np.linspace(-half_mm, half_mm, 41) for half_mm in plate.half_mm))
    gx, gy = (np.append(g[plate.covers(*grid)], p) for g, p in zip(grid, (x, y), strict=True))
    r, angle = (g.ravel() for g in np.meshgrid(np.linspace(*ring_mm, 8), np.linspace(0, 6.28, 49)))
    ring = weights @ plate.products(r * np.cos(angle), r * np.sin(angle), terms)
    largest = float((weights @ plate.products(gx, gy, terms)).max())
    return Bending(largest, float(ring.max()), 6 * float(moment.max()) / plate.thickness_mm**2)


def _at_rest(plate: PlateShape, terms: int, load: Field) -> Field:
    """Weights of least energy under a load, with springs only where the plate is pushed down."""
    bare, places, springs = _system(plate, terms)
    pushed = np.ones(len(springs), dtype=bool)
    for _ in range(ROUNDS):
        held = places * np.where(pushed, springs, LET_GO_N_MM)
        weights: Field = np.linalg.solve(bare + held @ places.T, load)
        before, pushed = pushed, weights @ places > 0
        if (before == pushed).all():
            return weights
    raise SolverError(f"the plate finds no rest on its bead within {ROUNDS} rounds")


@lru_cache(maxsize=8)
def _system(plate: PlateShape, terms: int) -> tuple[Field, Field, Field]:
    """What all loads on a plate have in common.

    Second derivatives of its strain energy in the weights, over the notched rectangle; the
    products at points of the bead, (terms^2, points); the springs there, in N/mm.
    """
    (w, h), (nx, ny), (sx, sy) = plate.half_mm, plate.notch_mm, plate.support_mm
    bare, nu = np.zeros((terms**2, terms**2)), plate.poisson
    for left, low, high in ((-w, ny - h, h - ny), (nx - w, -h, ny - h), (nx - w, h - ny, h)):
        a, b = _integrals(plate, 0, left, -left, terms), _integrals(plate, 1, low, high, terms)
        bare += np.kron(a[2, 2], b[0, 0]) + np.kron(a[0, 0], b[2, 2])
        bare += nu * (np.kron(a[2, 0], b[0, 2]) + np.kron(a[0, 2], b[2, 0]))
        bare += 2 * (1 - nu) * np.kron(a[1, 1], b[1, 1])
    places, springs = [], []
    for axis, (inner, end) in enumerate(((sx, min(h - ny, sy)), (sy, w - nx))):
        if inner is None:
            continue
        (u, wide_mm), (v, long_mm) = _gauss(inner, plate.half_mm[axis], 4), _gauss(-end, end, 24)
        per_mm2 = plate.bead_n_mm3(plate.half_mm[axis] - inner)
        for side in (-1, 1):
            at = np.repeat(side * u, len(v)), np.tile(v, len(u))
            places.append(plate.products(*(at if axis == 0 else at[::-1]), terms))
            springs.append(per_mm2 * np.outer(wide_mm, long_mm).ravel())
    return plate.rigidity_nmm * bare, np.hstack(places), np.hstack(springs)


def _integrals(plate: PlateShape, axis: int, low_mm: float, high_mm: float, terms: int) -> Field:
    """Of products of two polynomials' derivatives over an interval, (3, 3, terms, terms)."""
    points, weights = _gauss(low_mm, high_mm, terms)
    rows = np.array([plate.polynomials(axis, points, order, terms) for order in range(3)])
    return np.asarray(np.einsum("iap,jbp,p->ijab", rows, rows, weights))


def _gauss(low: float, high: float, points: int) -> tuple[Field, Field]:
    """Places and weights of Gauss's rule on an interval."""
    nodes, weights = legendre.leggauss(points)
    return (low + high) / 2 + (high - low) / 2 * nodes, (high - low) / 2 * weights


def _disc(diameter_mm: float, at_mm: Point2) -> tuple[Field, Field, Field]:
    """Points of a disc and their shares of its area."""
    r, weights = _gauss(0.0, diameter_mm / 2, 12)
    angle = (np.arange(32) + 0.5) * 2 * np.pi / 32
    share = np.repeat(weights * r / (weights @ r), 32) / 32
    r, angle = np.repeat(r, 32), np.tile(angle, 12)
    return at_mm[0] + r * np.cos(angle), at_mm[1] + r * np.sin(angle), share
