"""Deflection and stress of the acrylic plate under a press. Imports no CAD kernel.

A thin plate (Kirchhoff) on the bead of silicone that fills the gap before the shell's ledges. The
deflection is the sum of products of Legendre polynomials with the least energy (Ritz method): the
plate's strain energy (S. Timoshenko and S. Woinowsky-Krieger, Theory of Plates and Shells, 2nd ed.
1959, section 82) and the bead's, as springs distributed over the plate's overlap with a ledge.
Notched corners and free edges need no extra terms.

The bead pushes but does not pull, as its adhesion is unknown. Where the plate's edge lifts off, the
springs vanish, so that a thin bead acts like the bare inner edge of the ledge.

Not modelled: the gel bonded to the plate and the resistance of frame and bead to rotation at the
ledges, which stiffen it, and shear, 2 % of the default plate's deflection.
"""

from __future__ import annotations

from dataclasses import astuple, dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
from numpy.polynomial import legendre

from deltact_fab.common import InputError, Point2, SolverError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from deltact_fab.common import Field

    from .dimensions import Design

RITZ_TERMS = 14
"""Polynomials per direction; by hand: the default deflection is within 0.2 % of that with 24."""
BULK_MPA = 1000.0  # by hand, silicone's order of magnitude: bounds the stiffness of a thin bead
DRY_MM = 0.02  # by hand, bead thickness that stands for a bare ledge: thicker yields too much
LET_GO_N_MM = 1e-4  # by hand, stiffness where the plate lifts off: 0 would make the system singular
SECOND_ORDERS = (2, 0), (0, 2), (1, 1)  # exact: second derivatives in x and y
# By hand, for a load of 1 N: iterations, and residual of springs in the wrong state.
REST_ROUNDS, SETTLED_N = 200, 1e-4


@dataclass(frozen=True)
class PlateShape:
    """A rectangle of +-half_mm with notched corners, on ledges that begin at +-support_mm.

    support_mm: equal to half_mm without a ledge. bead_mm: height of the bead, 0 for none.
    """

    half_mm: Point2
    notch_mm: Point2
    support_mm: Point2
    thickness_mm: float
    youngs_modulus_mpa: float
    poisson: float
    bead_mm: float
    bead_modulus_mpa: float

    @property
    def rigidity_nmm(self) -> float:
        """D = E t^3 / (12 (1 - nu^2))."""
        return self.youngs_modulus_mpa * self.thickness_mm**3 / (12 * (1 - self.poisson**2))

    def bead_n_mm3(self, width_mm: float, inside: Field) -> Field:
        """Spring stiffness per area of a long bead bonded on both sides = 1 / (t / Ec + t / K).

        inside = 1 - (2 x / width)^2: 1 in its middle. Ec = 4/3 E (1 + 3/2 S^2 inside), on average
        4/3 E (1 + S^2), S = width / (2 t): confined rubber is stiffer (A. N. Gent and
        P. B. Lindley, Proc. Inst. Mech. Eng. 173, 1959, pp. 111-122).
        """
        t = max(self.bead_mm, DRY_MM)
        confined_mpa = (
            4 / 3 * self.bead_modulus_mpa * (1 + 1.5 * (width_mm / (2 * t)) ** 2 * inside)
        )
        return 1 / (t / confined_mpa + t / BULK_MPA)

    def covers(self, x: Field, y: Field) -> NDArray[np.bool_]:
        """True for points on the plate."""
        (w, h), (nx, ny), x, y = self.half_mm, self.notch_mm, np.abs(x), np.abs(y)
        return (x <= w) & (y <= h) & ((x <= w - nx) | (y <= h - ny))

    def products(self, x: Field, y: Field, terms: int, i: int = 0, j: int = 0) -> Field:
        """Return derivatives (order i in x, j in y) of the basis functions, (terms^2, points)."""
        of_x, of_y = (
            legendre.legval(t / half_mm, legendre.legder(np.eye(terms), order)) / half_mm**order
            for t, half_mm, order in zip((x, y), self.half_mm, (i, j), strict=True)
        )
        products: Field = (of_x[:, None] * of_y).reshape(-1, len(x))
        return products


@dataclass(frozen=True)
class Bending:
    """Response to a force, uniform on a disc.

    deflection_mm: maximum. over_ring_mm: maximum over a ring about the middle. stress_mpa: maximum
    bending stress within the disc; stress concentrations at notches are not included.
    """

    deflection_mm: float
    over_ring_mm: float
    stress_mpa: float


def plate_of(design: Design) -> PlateShape:
    """Return the acrylic on the shell's two or four ledges. Raises InputError without ledges."""
    x, y = design.ledge_half_mm
    if y >= design.acrylic_half_mm[1]:
        raise InputError("acrylic: no ledge in y; raise shell.ledge_mm")
    return PlateShape(
        design.acrylic_half_mm,
        design.acrylic_notch_mm,
        (x if design.shell.ledge_x_mm > 0 else design.acrylic_half_mm[0], y),
        design.optics.acrylic_mm,
        design.plate.youngs_modulus_mpa,
        design.plate.poisson,
        design.shell.ledge_drop_mm,
        design.plate.bead_modulus_mpa,
    )


def press_plate(design: Design, force_n: float, at_mm: Point2 = (0.0, 0.0)) -> Bending:
    """Return the response to force_n at a point of the face, spread on `plate.spread_mm`.

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
    terms: int = RITZ_TERMS,
) -> Bending:
    """Return the response to 1 N on a disc of diameter spread_mm about at_mm.

    ring_mm: inner and outer radius of the ring behind the plate. The frame carries the part of the
    disc beyond the plate. Raises SolverError if the contact with the bead does not converge.
    """
    r, angle, area = _rectangle((0.0, spread_mm / 2), (0.0, 2 * np.pi), 12, 32)
    x, y = at_mm[0] + r * np.cos(angle), at_mm[1] + r * np.sin(angle)
    on = plate.covers(x, y)
    if not on.any():
        return Bending(0.0, 0.0, 0.0)
    x, y, share = x[on], y[on], (r * area)[on] / (np.pi * spread_mm**2 / 4)
    weights = _find_rest(plate, terms, plate.products(x, y, terms) @ share)
    xx, yy, xy = (weights @ plate.products(x, y, terms, *orders) for orders in SECOND_ORDERS)
    nu, d = plate.poisson, plate.rigidity_nmm
    mx, my, mxy = d * (xx + nu * yy), d * (yy + nu * xx), d * (1 - nu) * xy
    moment = np.abs(mx + my) / 2 + np.hypot((mx - my) / 2, mxy)
    grid = np.meshgrid(*(np.linspace(-half_mm, half_mm, 41) for half_mm in plate.half_mm))
    gx, gy = (np.append(g[plate.covers(*grid)], p) for g, p in zip(grid, (x, y), strict=True))
    r, angle = (g.ravel() for g in np.meshgrid(np.linspace(*ring_mm, 8), np.linspace(0, 6.28, 49)))
    ring = weights @ plate.products(r * np.cos(angle), r * np.sin(angle), terms)
    largest = float((weights @ plate.products(gx, gy, terms)).max())
    return Bending(largest, float(ring.max()), 6 * float(moment.max()) / plate.thickness_mm**2)


def _find_rest(plate: PlateShape, terms: int, load: Field) -> Field:
    """Return the weights of least energy under a load, with springs only under compression.

    Newton's method; steps are halved while they raise the energy.
    """
    bare, places, springs = _plate_system(plate, terms)

    def active_springs(weights: Field) -> Field:
        return np.where(weights @ places > 0, springs, LET_GO_N_MM)

    def energy(weights: Field) -> float:
        bead = active_springs(weights) @ (weights @ places) ** 2
        return float((weights @ bare @ weights + bead) / 2 - load @ weights)

    weights, pushing = np.zeros(len(load)), springs
    for _ in range(REST_ROUNDS):
        full = np.linalg.solve(bare + (places * pushing) @ places.T, load).astype(np.float64)
        wrong_n = np.abs(np.subtract(pushing, active_springs(full)) * (full @ places)).sum()
        if wrong_n <= SETTLED_N:
            return full
        step = full - weights
        while energy(weights + step) > energy(weights):
            step = step / 2
        weights = weights + step
        pushing = active_springs(weights)
    raise SolverError(f"plate on its bead: no convergence in {REST_ROUNDS} iterations")


@lru_cache(maxsize=8)
def _plate_system(plate: PlateShape, terms: int) -> tuple[Field, Field, Field]:
    """Return the terms of a plate common to all loads.

    Hessian of the strain energy in the weights, over the notched rectangle; basis functions at
    points of the bead, (terms^2, points); spring stiffness there, in N/mm.
    """
    (w, h), (nx, ny), (sx, sy) = plate.half_mm, plate.notch_mm, plate.support_mm
    bare, nu, within = np.zeros((terms**2, terms**2)), plate.poisson, (nx - w, w - nx)
    for piece in (((-w, w), (ny - h, h - ny)), (within, (-h, ny - h)), (within, (h - ny, h))):
        x, y, mm2 = _rectangle(*piece, terms, terms)
        xx, yy, xy = (plate.products(x, y, terms, *orders) for orders in SECOND_ORDERS)
        bare += (xx * mm2) @ (xx + nu * yy).T + (yy * mm2) @ (yy + nu * xx).T
        bare += 2 * (1 - nu) * (xy * mm2) @ xy.T
    places, springs = [], []
    for axis, inner, outer, end in ((0, sx, w, min(h - ny, sy)), (1, sy, h, w - nx)):
        if inner >= outer:
            continue
        across, along, mm2 = _rectangle((inner, outer), (-end, end), 4, 24)
        inside = 1 - ((2 * across - inner - outer) / (outer - inner)) ** 2
        for side in (-1, 1):
            x, y = (side * across, along) if axis == 0 else (along, side * across)
            places.append(plate.products(x, y, terms))
            springs.append(plate.bead_n_mm3(outer - inner, inside) * mm2)
    return plate.rigidity_nmm * bare, np.hstack(places), np.hstack(springs)


def _rectangle(
    x_mm: Point2, y_mm: Point2, points_x: int, points_y: int
) -> tuple[Field, Field, Field]:
    """Return Gauss points in a rectangle, and the weight (area) of each."""
    (x, weights_x), (y, weights_y) = legendre.leggauss(points_x), legendre.leggauss(points_y)
    x, y = (np.interp(t, (-1, 1), ends) for t, ends in ((x, x_mm), (y, y_mm)))
    area = (x_mm[1] - x_mm[0]) * (y_mm[1] - y_mm[0]) / 4
    return np.repeat(x, len(y)), np.tile(y, len(x)), area * np.outer(weights_x, weights_y).ravel()
