"""Energy, nodal forces and tangent of the bulk, all cells at once."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...aliases import Field
from ...errors import InputError
from .material import NeoHooke
from .mesh import HexMesh
from .pattern import CELL_DOFS, UPPER, Pattern
from .viscous import Memory

try:
    from . import compiled
except ImportError:  # numba is an extra
    compiled = None  # type: ignore[assignment]


_G = 1 / np.sqrt(3)
_CORNER = np.array(
    [[-1, -1, -1], [1, -1, -1], [1, 1, -1], [-1, 1, -1],
     [-1, -1, 1], [1, -1, 1], [1, 1, 1], [-1, 1, 1]], dtype=np.float64,
)  # fmt: skip
POINTS = 8
# Empty arrays stand for None in machine code.
_NO_PRESSURE = np.empty(0)
_NO_MEMORY = np.empty((0, POINTS, 6))


class Bulk(NamedTuple):
    """What one evaluation gives.

    energy_nmm; inf where a cell is turned inside out, and then the rest is None.
    force_n (n, 3): derivative of the energy, what holds the nodes there. data: CSR entries of the
    tangent (N/mm), None if not asked for. least_j: smallest local volume ratio. jbar (m,): mean
    dilatation of the cells. volume_rate_mm2 (m, 24): derivative of volume x jbar.
    """

    energy_nmm: float
    force_n: Field | None
    data: Field | None
    least_j: float
    jbar: Field | None = None
    volume_rate_mm2: Field | None = None


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

    def evaluate(
        self,
        displacement_mm: Field,
        tangent: bool = True,
        pressure_mpa: Field | None = None,
        memory: Memory | None = None,
    ) -> Bulk:
        """Energy, forces and, if asked for, the tangent's entries at displacements (n, 3).

        pressure_mpa (m,): tension-positive cell pressure with which the tangent's geometric part is
        formed; None: U'(jbar). memory: the local energy is scale mu[...] + h:(C - I)/2, see
        `viscous`.
        """
        scale, memory_mpa = (1.0, None) if memory is None else (memory.scale, memory.stress_mpa)
        way = self._in_machine_code if self._compiled else self._in_numpy
        return way(displacement_mm, tangent, pressure_mpa, scale, memory_mpa)

    def _in_machine_code(
        self, displacement_mm: Field, tangent: bool, pressure_mpa: Field | None,
        scale: float, memory_mpa: Field | None,
    ) -> Bulk:  # fmt: skip
        m = len(self.mesh.cells)
        force = np.zeros_like(displacement_mm)
        data = np.zeros(self.pattern.entries + 1 if tangent else 0)
        jbar, whole = np.empty(m), np.empty((m, 24))
        energy, least = compiled.loop(
            np.ascontiguousarray(displacement_mm), self.mesh.cells, self.gradients_per_mm,
            self.weights_mm3, self.pattern.slots, self.law.mu_mpa,
            self.law.lambda_mpa, self.law.local_mpa,
            tangent, force, data, jbar, whole,
            _NO_PRESSURE if pressure_mpa is None else pressure_mpa, scale,
            _NO_MEMORY if memory_mpa is None else memory_mpa,
        )  # fmt: skip
        if not least > 0:
            return Bulk(np.inf, None, None, least)
        return Bulk(energy, force, data[:-1] if tangent else None, least, jbar, whole)

    def deformation_gradient(self, displacement_mm: Field) -> Field:
        """F (m, 8 points, 3, 3)."""
        u = displacement_mm[self.mesh.cells]
        grad = np.matmul(np.swapaxes(u, 1, 2), self.gradients_per_mm)
        f = np.swapaxes(grad.reshape(len(u), 3, POINTS, 3), 1, 2)
        return f + np.eye(3)

    def _in_numpy(
        self, displacement_mm: Field, tangent: bool, pressure_mpa: Field | None, scale: float,
        memory_mpa: Field | None,
    ) -> Bulk:  # fmt: skip
        law, w, volume = self.law, self.weights_mm3, self.volumes_mm3
        mu = scale * law.mu_mpa
        f = self.deformation_gradient(displacement_mm)
        j, inverse = _determinant_and_inverse(f)
        least = float(j.min())
        if not least > 0:
            return Bulk(np.inf, None, None, least)
        jbar = (w * j).sum(axis=1) / volume
        u0, u1, u2 = law.volumetric(jbar)
        log = np.log(j)
        own = law.local_mpa * log**3
        local = mu * ((np.einsum("mqij,mqij->mq", f, f) - 3) / 2 - log) + own * log / 4
        energy = float((w * local).sum()) + float(volume @ u0)
        cofactor = np.swapaxes(inverse, 2, 3)
        stress = mu * (f - cofactor) + own[..., None, None] * cofactor
        memory = None if memory_mpa is None else _tensors(memory_mpa)
        if memory is not None:
            stress += f @ memory
            cauchy = np.swapaxes(f, 2, 3) @ f - np.eye(3)
            energy += float((w * np.einsum("mqij,mqij->mq", memory, cauchy)).sum()) / 2
        force = self._nodal(w[..., None, None] * stress)
        rate = self._nodal((w * j)[..., None, None] * cofactor)
        rate_of_volume = rate.reshape(len(w), CELL_DOFS)
        data = None
        if tangent:
            held = u1 if pressure_mpa is None else pressure_mpa
            pj = held[:, None] * j
            steep = pj + 3 * law.local_mpa * log**2
            ke = self._cell_matrices(inverse, w * steep, w * (mu - pj - own))
            ke += (u2 / volume)[:, None, None] * (
                rate_of_volume[:, :, None] * rate_of_volume[:, None, :]
            )
            ke += scale * self._laplacian()
            if memory is not None:
                ke += self._spread(w[..., None, None] * memory)
            data = self.pattern.add(self.pattern.slots, ke[:, UPPER[0], UPPER[1]])
        total = self.scatter(force + u1[:, None, None] * rate)
        return Bulk(energy, total, data, least, jbar, rate_of_volume)

    def _nodal(self, stress: Field) -> Field:
        """Cell forces (m, 8, 3) of weighted Piola stresses (m, 8 points, 3, 3)."""
        flat = np.swapaxes(stress, 1, 2).reshape(len(stress), 3, -1)
        return np.matmul(self.gradients_per_mm, np.swapaxes(flat, 1, 2))

    def scatter(self, nodal: Field) -> Field:
        """Sum of cell forces (m, 8, 3) at the nodes, (n, 3)."""
        n = len(self.mesh.nodes_mm)
        flat = self.mesh.cells.ravel()
        columns = [np.bincount(flat, weights=nodal[..., i].ravel(), minlength=n) for i in range(3)]
        return np.stack(columns, axis=1)

    def _cell_matrices(self, inverse: Field, outer: Field, crossed: Field) -> Field:
        """The part of the tangent (m, 24, 24) that J and the inverse make."""
        m = len(outer)
        grad = np.swapaxes(self.gradients_per_mm.reshape(m, 8, POINTS, 3), 1, 2)
        g = np.matmul(grad, inverse).reshape(m, POINTS, CELL_DOFS)
        turned = np.swapaxes(g, 1, 2)
        ke = np.matmul(turned * outer[:, None, :], g)
        other = np.matmul(turned * crossed[:, None, :], g).reshape(m, 8, 3, 8, 3)
        return ke + np.swapaxes(other, 2, 4).reshape(m, CELL_DOFS, CELL_DOFS)

    def _laplacian(self) -> Field:
        """The part mu grad N_a . grad N_b, which does not change; (m, 24, 24)."""
        if self._constant is None:
            unit = self.law.mu_mpa * self.weights_mm3[..., None, None] * np.eye(3)
            self._constant = self._spread(unit)
        return self._constant

    def _spread(self, tensor: Field) -> Field:
        """grad N_a . h grad N_b on the diagonal of directions, of h (m, 8 points, 3, 3)."""
        m = len(tensor)
        grad = self.gradients_per_mm
        rows = np.swapaxes(grad.reshape(m, 8, POINTS, 3), 1, 2)
        turned = np.swapaxes(np.matmul(rows, tensor), 1, 2).reshape(m, 8, 3 * POINTS)
        scalar = np.matmul(turned, np.swapaxes(grad, 1, 2))
        out = np.zeros((m, 8, 3, 8, 3))
        for i in range(3):
            out[:, :, i, :, i] = scalar
        return out.reshape(m, CELL_DOFS, CELL_DOFS)


def _local_gradients() -> Field:
    """dN_a / dxi_j (points, nodes, 3) at the Gauss points of the cube from -1 to 1."""
    points = _G * _CORNER
    factor = 1 + points[:, None, :] * _CORNER[None]
    out = np.empty((POINTS, 8, 3))
    for j in range(3):
        others = [k for k in range(3) if k != j]
        out[:, :, j] = _CORNER[:, j] * factor[..., others[0]] * factor[..., others[1]] / 8
    return out


def _tensors(six: Field) -> Field:
    """Symmetric tensors (..., 3, 3) from xx yy zz xy xz yz."""
    return six[..., np.array([[0, 3, 4], [3, 1, 5], [4, 5, 2]])]


def _determinant_and_inverse(f: Field) -> tuple[Field, Field]:
    """Of matrices (m, q, 3, 3) by cofactors: far quicker than LAPACK called for each."""
    c = np.empty_like(f)
    for i in range(3):
        a, b = f[..., (i + 1) % 3, :], f[..., (i + 2) % 3, :]
        for j in range(3):
            p, q = (j + 1) % 3, (j + 2) % 3
            c[..., j, i] = a[..., p] * b[..., q] - a[..., q] * b[..., p]
    det = np.einsum("...j,...j->...", f[..., 0, :], c[..., :, 0])
    with np.errstate(divide="ignore", invalid="ignore"):
        c /= det[..., None, None]
    return det, c
