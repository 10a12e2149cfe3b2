"""Fields of a finite-strain state on a regular lattice over the resting face.

Displacements: a cubic through the four nodes next to a point, along x and then along y (piecewise
Hermite, slopes of the parabola through three nodes). It is C1, exact for parabolas at any grading,
and a kink at the contact's edge is felt one cell away at most; a spline would ring.
Tractions: every contact point stands for a part of its face as large as its weight, and the parts
go to the nodes by areas (`zones.means`), so that their sum over the resting face is the force.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from ...aliases import Field
from ..zones import hermite, means
from .mesh import HexMesh

if TYPE_CHECKING:
    from .press import FinitePress
    from .state import FiniteState


class FaceLattice:
    """Lattice nodes x_mm (nx,), y_mm (ny,) on the touched face of a block.

    Mirrors of the mesh are unfolded.
    """

    def __init__(self, mesh: HexMesh, x_mm: Field, y_mm: Field) -> None:
        assert mesh.axes_mm is not None, "of a block"
        self.mesh, self.x_mm, self.y_mm = mesh, x_mm, y_mm
        knots = [mesh.axes_mm[0], mesh.axes_mm[1]]
        self._shape = (len(knots[1]), len(knots[0]))
        self._along = [
            hermite(unfolded(k) if mirror else k, at)
            for k, at, mirror in zip(knots, (x_mm, y_mm), mesh.mirrors, strict=True)
        ]
        self._knots = knots
        self._means: dict[int, list[Field]] = {}

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
        """Vectors (ny, nx, 3) of those at the contact points, (f, q, 3)."""
        n = math.isqrt(values.shape[1])
        ny, nx = (size - 1 for size in self._shape)
        parts = values.reshape(ny, nx, n, n, -1).swapaxes(1, 2).reshape(ny * n, nx * n, -1)
        for axis, mirror in enumerate(self.mesh.mirrors):
            if mirror:
                image = np.flip(parts, axis=1 - axis).copy()
                image[..., axis] *= -1
                parts = np.concatenate([image, parts], axis=1 - axis)
        wx, wy = self._to_means(n)
        return np.ascontiguousarray(np.moveaxis(wy @ np.moveaxis(parts, -1, 0) @ wx.T, 0, -1))

    def _to_means(self, n: int) -> list[Field]:
        if n not in self._means:
            ends = np.cumsum(np.polynomial.legendre.leggauss(n)[1]) / 2
            self._means[n] = []
            for k, at, mirror in zip(
                self._knots, (self.x_mm, self.y_mm), self.mesh.mirrors, strict=True
            ):
                edges = np.append(k[0], k[:-1, None] + np.diff(k)[:, None] * ends)
                self._means[n].append(means(unfolded(edges) if mirror else edges, at))
        return self._means[n]


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
