"""Energy, nodal forces and tangent of the bulk, all cells at once."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...errors import InputError

from .material import NeoHooke
from .mesh import HexMesh
from .pattern import CELL_DOFS, UPPER, Pattern

try:
    from . import compiled
except ImportError:  # numba is an extra
    compiled = None  # type: ignore[assignment]

Field = NDArray[np.float64]

_G = 1 / np.sqrt(3)
_CORNER = np.array(
    [[-1, -1, -1], [1, -1, -1], [1, 1, -1], [-1, 1, -1],
     [-1, -1, 1], [1, -1, 1], [1, 1, 1], [-1, 1, 1]], dtype=np.float64,
)  # fmt: skip
POINTS = 8


class Bulk(NamedTuple):
    """What one evaluation gives.

    energy_nmm; inf where a cell is turned inside out, and then the rest is None.
    force_n (n, 3): derivative of the energy, what holds the nodes there. data: CSR entries of the
    tangent (N/mm), None if not asked for. least_j: smallest local volume ratio.
    """

    energy_nmm: float
    force_n: Field | None
    data: Field | None
    least_j: float


class BulkAssembly:
    """The integrals over a mesh with 2 x 2 x 2 points a cell; reference gradients are kept.

    use_compiled: None takes the compiled loop where numba is there (about five times as fast).
    gradients_per_mm (m, 8 nodes, 8 points x 3). weights_mm3 (m, 8).
    """

    def __init__(
        self, mesh: HexMesh, law: NeoHooke, pattern: Pattern, use_compiled: bool | None = None
    ) -> None:
        self.mesh, self.law, self.pattern = mesh, law, pattern
        self._compiled = compiled is not None if use_compiled is None else use_compiled
        local = _local_gradients()
        x = mesh.nodes_mm[mesh.cells]
        jacobian = np.einsum("mai,qaj->mqij", x, local)
        det = np.linalg.det(jacobian)
        if not det.min() > 0:
            raise InputError("mesh: a cell is turned inside out at rest")
        gradients = np.einsum("qaj,mqji->maqi", local, np.linalg.inv(jacobian), optimize=True)
        self.gradients_per_mm: Field = np.ascontiguousarray(gradients).reshape(len(x), 8, -1)
        self.weights_mm3: Field = np.ascontiguousarray(det)
        self.volumes_mm3: Field = det.sum(axis=1)
        self._constant: Field | None = None

    def evaluate(self, displacement_mm: Field, tangent: bool = True) -> Bulk:
        """Energy, forces and, if asked for, the tangent's entries at displacements (n, 3)."""
        if self._compiled:
            return Bulk(*compiled.evaluate(self, displacement_mm, tangent))
        return self._evaluate(displacement_mm, tangent)

    def deformation_gradient(self, displacement_mm: Field) -> Field:
        """F (m, 8 points, 3, 3)."""
        u = displacement_mm[self.mesh.cells]
        grad = np.matmul(np.swapaxes(u, 1, 2), self.gradients_per_mm)
        f = np.swapaxes(grad.reshape(len(u), 3, POINTS, 3), 1, 2)
        return f + np.eye(3)

    def _evaluate(self, displacement_mm: Field, tangent: bool) -> Bulk:
        law, w, volume = self.law, self.weights_mm3, self.volumes_mm3
        f = self.deformation_gradient(displacement_mm)
        j, inverse = _determinant_and_inverse(f)
        least = float(j.min())
        if not least > 0:
            return Bulk(np.inf, None, None, least)
        jbar = (w * j).sum(axis=1) / volume
        u0, u1, u2 = law.volumetric(jbar)
        local = (np.einsum("mqij,mqij->mq", f, f) - 3) / 2 - np.log(j)
        energy = law.mu_mpa * float((w * local).sum()) + float(volume @ u0)
        # First Piola stress with the cell's own pressure at every point.
        pj = u1[:, None] * j
        stress = law.mu_mpa * f + ((pj - law.mu_mpa)[..., None, None]) * np.swapaxes(inverse, 2, 3)
        stress *= w[..., None, None]
        m = len(w)
        flat = np.swapaxes(stress, 1, 2).reshape(m, 3, -1)
        nodal = np.matmul(self.gradients_per_mm, np.swapaxes(flat, 1, 2))
        force = self.scatter(nodal)
        data = None
        if tangent:
            ke = self._cell_matrices(inverse, w * pj, w * (law.mu_mpa - pj), w * j, u2 / volume)
            data = self.pattern.add(self.pattern.slots, ke[:, UPPER[0], UPPER[1]])
        return Bulk(energy, force, data, least)

    def scatter(self, nodal: Field) -> Field:
        """Sum of cell forces (m, 8, 3) at the nodes, (n, 3)."""
        n = len(self.mesh.nodes_mm)
        flat = self.mesh.cells.ravel()
        columns = [np.bincount(flat, weights=nodal[..., i].ravel(), minlength=n) for i in range(3)]
        return np.stack(columns, axis=1)

    def _cell_matrices(
        self, inverse: Field, outer: Field, crossed: Field, volume_change: Field, bulk: Field
    ) -> Field:
        """K (m, 24, 24) of the tangent in `NeoHooke.tangent`, U'' spread over the cell."""
        m = len(outer)
        grad = np.swapaxes(self.gradients_per_mm.reshape(m, 8, POINTS, 3), 1, 2)
        g = np.matmul(grad, inverse).reshape(m, POINTS, CELL_DOFS)
        turned = np.swapaxes(g, 1, 2)
        ke = np.matmul(turned * outer[:, None, :], g)
        other = np.matmul(turned * crossed[:, None, :], g).reshape(m, 8, 3, 8, 3)
        ke += np.swapaxes(other, 2, 4).reshape(m, CELL_DOFS, CELL_DOFS)
        whole = np.matmul(volume_change[:, None, :], g)[:, 0, :]
        ke += (bulk[:, None] * whole)[:, :, None] * whole[:, None, :]
        return ke + self._laplacian()

    def _laplacian(self) -> Field:
        """The part mu grad N_a . grad N_b, which does not change; (m, 24, 24)."""
        if self._constant is None:
            m = len(self.weights_mm3)
            grad = self.gradients_per_mm
            weighted = grad * np.repeat(self.weights_mm3, 3, axis=1)[:, None, :]
            scalar = self.law.mu_mpa * np.matmul(weighted, np.swapaxes(grad, 1, 2))
            constant = np.zeros((m, 8, 3, 8, 3))
            for i in range(3):
                constant[:, :, i, :, i] = scalar
            self._constant = constant.reshape(m, CELL_DOFS, CELL_DOFS)
        return self._constant


def _local_gradients() -> Field:
    """dN_a / dxi_j (points, nodes, 3) at the Gauss points of the cube from -1 to 1."""
    points = _G * _CORNER
    factor = 1 + points[:, None, :] * _CORNER[None]
    out = np.empty((POINTS, 8, 3))
    for j in range(3):
        others = [k for k in range(3) if k != j]
        out[:, :, j] = _CORNER[:, j] * factor[..., others[0]] * factor[..., others[1]] / 8
    return out


def _determinant_and_inverse(f: Field) -> tuple[Field, Field]:
    """Of matrices (m, q, 3, 3) by cofactors: far quicker than LAPACK called for each."""
    c = np.empty_like(f)
    for i in range(3):
        a, b = f[..., (i + 1) % 3, :], f[..., (i + 2) % 3, :]
        for j in range(3):
            p, q = (j + 1) % 3, (j + 2) % 3
            c[..., j, i] = a[..., p] * b[..., q] - a[..., q] * b[..., p]
    det = sum(f[..., 0, j] * c[..., j, 0] for j in range(3))
    with np.errstate(divide="ignore", invalid="ignore"):
        c /= det[..., None, None]
    return det, c
