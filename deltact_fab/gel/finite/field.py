"""Fields of a finite-strain state on a regular lattice over the resting face.

Displacements: a cubic through the four nodes next to a point, along x and then along y (piecewise
Hermite, slopes of the parabola through three nodes). It is C1, exact for parabolas at any grading,
and a kink at the contact's edge is felt one cell away at most; a spline would ring.
Tractions: every contact point stands for a part of its face as large as its weight, so that their
sum over the resting face is the force.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from .mesh import HexMesh

if TYPE_CHECKING:
    from .press import FinitePress
    from .state import FiniteState

Field = NDArray[np.float64]


class FaceLattice:
    """Lattice nodes x_mm (nx,), y_mm (ny,) on the touched face of a block.

    Mirrors of the mesh are unfolded. Raises ValueError for a mesh that is no block.
    """

    def __init__(self, mesh: HexMesh, x_mm: Field, y_mm: Field) -> None:
        if mesh.axes_mm is None:
            raise ValueError("lattice: a block mesh is needed")
        self.mesh, self.x_mm, self.y_mm = mesh, x_mm, y_mm
        knots = [mesh.axes_mm[0], mesh.axes_mm[1]]
        self._shape = (len(knots[1]), len(knots[0]))
        self._along = [
            hermite(unfolded(k) if mirror else k, at)
            for k, at, mirror in zip(knots, (x_mm, y_mm), mesh.mirrors, strict=True)
        ]
        self._cells = [
            _cells(k, np.abs(at) if mirror else at)
            for k, at, mirror in zip(knots, (x_mm, y_mm), mesh.mirrors, strict=True)
        ]

    def displacement_mm(self, nodes_mm: Field) -> Field:
        """(ny, nx, 3) of the displacements (n, 3) of all nodes."""
        ny, nx = self._shape
        u = np.moveaxis(nodes_mm[-ny * nx :].reshape(ny, nx, 3), -1, 0)
        if self.mesh.mirrors[0]:
            sign = np.array([-1.0, 1.0, 1.0])[:, None, None]
            u = np.concatenate([sign * u[:, :, :0:-1], u], axis=2)
        if self.mesh.mirrors[1]:
            sign = np.array([1.0, -1.0, 1.0])[:, None, None]
            u = np.concatenate([sign * u[:, :0:-1], u], axis=1)
        wx, wy = self._along
        return np.ascontiguousarray(np.moveaxis(wy @ u @ wx.T, 0, -1))

    def of_points(self, values: Field) -> Field:
        """Scalars (ny, nx) or vectors (ny, nx, 3) of those at the contact points, (f, q, ...)."""
        n = math.isqrt(values.shape[1])
        ends = np.cumsum(np.polynomial.legendre.leggauss(n)[1][:-1]) / 2
        (i, s), (j, t) = self._cells
        point = np.searchsorted(ends, t, side="right")[:, None] * n
        point = point + np.searchsorted(ends, s, side="right")
        face = j[:, None] * (self._shape[1] - 1) + i
        found = values[face, point]
        if found.ndim == 3:
            found[..., 0] *= self._sign(0)[None, :]
            found[..., 1] *= self._sign(1)[:, None]
        return found

    def _sign(self, axis: int) -> Field:
        at = (self.x_mm, self.y_mm)[axis]
        return np.where((at < 0) & self.mesh.mirrors[axis], -1.0, 1.0)


def whole_wrench(mesh: HexMesh, state: FiniteState) -> tuple[Field, Field]:
    """Force (3,) in N and torque (3,) in N mm on the whole body of a mirrored mesh."""
    force = np.array(state.force_n) * mesh.copies
    torque = np.array(state.torque_nmm) * mesh.copies
    for axis, mirror in enumerate(mesh.mirrors):
        if mirror:
            force[axis] = 0.0
            torque[np.arange(3) != axis] = 0.0
    return force, torque


def tractions_mpa(press: FinitePress, state: FiniteState) -> Field:
    """On the gel, per resting area, at the contact points (f, q, 3)."""
    seen = press.surface.evaluate(state.displacement_mm, np.array(state.tip_mm), tangent=False)
    normal = seen.gap.normal.reshape(state.shear_mpa.shape)
    return state.pressure_mpa[..., None] * normal + state.shear_mpa


def unfolded(half: Field) -> Field:
    """Coordinates from 0 on, continued to the other side of the mirror."""
    return np.concatenate([-half[:0:-1], half])


def hermite(knots: Field, at: Field) -> Field:
    """Matrix (points, knots) of the local cubic; outside of the knots the last parabola goes on."""
    n = len(knots)
    slope = _slopes(knots)
    i = np.clip(np.searchsorted(knots, at, side="right") - 1, 0, n - 2)
    h = knots[i + 1] - knots[i]
    t = (at - knots[i]) / h
    rows = np.arange(len(at))
    found = np.zeros((len(at), n))
    found[rows, i] += 1 - t**2 * (3 - 2 * t)
    found[rows, i + 1] += t**2 * (3 - 2 * t)
    found += (h * t * (1 - t) ** 2)[:, None] * slope[i]
    found -= (h * t**2 * (1 - t))[:, None] * slope[i + 1]
    return found


def _slopes(knots: Field) -> Field:
    """Matrix (knots, knots) from values to slopes, of parabolas through three neighbours."""
    n = len(knots)
    if n < 3:
        return np.tile(np.array([-1.0, 1.0]) / (knots[1] - knots[0]), (2, 1))
    found = np.zeros((n, n))
    for k in range(n):
        m = min(max(k, 1), n - 2)
        a, b, c = knots[m - 1 : m + 2]
        x = knots[k]
        found[k, m - 1] = (2 * x - b - c) / ((a - b) * (a - c))
        found[k, m] = (2 * x - a - c) / ((b - a) * (b - c))
        found[k, m + 1] = (2 * x - a - b) / ((c - a) * (c - b))
    return found


def _cells(knots: Field, at: Field) -> tuple[NDArray[np.int64], Field]:
    """Cell of every point, and where in it, 0 to 1."""
    i = np.clip(np.searchsorted(knots, at, side="right") - 1, 0, len(knots) - 2)
    return i, (at - knots[i]) / (knots[i + 1] - knots[i])
