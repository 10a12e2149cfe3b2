"""Energy, nodal forces and tangent of the bulk, all cells at once, and its sparsity pattern."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from deltact_fab.common import Field, InputError
from deltact_fab.sensor import brick_gradients

from .material import Memory, NeoHooke
from .mesh import HexMesh

CELL_DOFS = 24  # definition: 8 nodes x 3
CELL_UPPER = np.triu_indices(CELL_DOFS)
FACE_UPPER = np.triu_indices(12)
_FACE_OF_CELL = np.flatnonzero((CELL_UPPER[0] >= 12) & (CELL_UPPER[1] >= 12))


class MatrixPattern:
    """Sparsity pattern (CSR, upper triangle) of the matrix over a mesh's free displacements.

    free (n, 3): True where a displacement is not fixed. size: number of free displacements.
    number (3 n,): index of a displacement among the free ones; `size` where it is fixed.
    slots (m, 300): index in `data` of each entry of a cell matrix's upper triangle, `entries` where
    it is fixed. face_slots (f, 78): the same for the four upper nodes of the touched cells.
    """

    def __init__(self, mesh: HexMesh, free: NDArray[np.bool_]) -> None:
        self.free = free
        flat = free.ravel()
        self.size = int(flat.sum())
        self.number = np.full(flat.size, self.size, dtype=np.int64)
        self.number[flat] = np.arange(self.size)
        dofs = (3 * mesh.cells[:, :, None] + np.arange(3)).reshape(-1, CELL_DOFS)
        place = self.number[dofs]
        first, second = place[:, CELL_UPPER[0]], place[:, CELL_UPPER[1]]
        low, high = np.minimum(first, second), np.maximum(first, second)
        fixed = (high == self.size).ravel()
        keys = (low * (self.size + 1) + high).ravel()
        # The sort is slow, but done once per mesh and cheaper than one factorisation.
        unique, inverse = np.unique(keys[~fixed], return_inverse=True)
        self.entries = len(unique)
        slots = np.full(keys.size, self.entries, dtype=np.int64)
        slots[~fixed] = inverse
        self.slots: NDArray[np.int64] = slots.reshape(low.shape)
        self.face_slots: NDArray[np.int64] = self.slots[mesh.touched][:, _FACE_OF_CELL]
        rows = unique // (self.size + 1)
        self.indices = (unique % (self.size + 1)).astype(np.int32)
        self.indptr = np.zeros(self.size + 1, dtype=np.int32)
        np.cumsum(np.bincount(rows, minlength=self.size), out=self.indptr[1:])

    def expand(self, free_values: Field) -> Field:
        """Expand values of the free displacements (size,) to (n, 3), 0 where fixed."""
        out = np.zeros(self.free.shape)
        out[self.free] = free_values
        return out

    def matrix(self, data: Field) -> sp.csr_matrix:
        """Return the upper triangle with the given entries, not copied."""
        return sp.csr_matrix(
            (data, self.indices, self.indptr), shape=(self.size, self.size), copy=False
        )

    def add(self, slots: NDArray[np.int64], values: Field) -> Field:
        """Sum of entries (any, k) at their slots (any, k), as CSR data."""
        total = np.bincount(slots.ravel(), weights=values.ravel(), minlength=self.entries + 1)
        return np.asarray(total[: self.entries], dtype=np.float64)


CELL_POINTS = 8  # definition: 2 x 2 x 2 Gauss points
# Empty arrays stand for None in machine code.
_NO_PRESSURE = np.empty(0)
_NO_MEMORY = np.empty((0, CELL_POINTS, 6))


class Bulk(NamedTuple):
    """Result of one evaluation.

    energy_nmm; inf where a cell is inverted (least_j <= 0), and then the other fields are invalid.
    force_n (n, 3): derivative of the energy, the force that holds the nodes. data: CSR entries of
    the tangent (N/mm), empty if not requested. least_j: smallest local volume ratio. jbar (m,):
    mean dilatation of the cells. volume_rate_mm2 (m, 24): derivative of volume x jbar.
    """

    energy_nmm: float
    force_n: Field
    data: Field
    least_j: float
    jbar: Field
    volume_rate_mm2: Field


class BulkAssembly:
    """Integrals over a mesh with 2 x 2 x 2 points per cell; reference gradients are stored.

    gradients_per_mm (m, 8 nodes, 8 points x 3). weights_mm3 (m, 8).
    """

    def __init__(self, mesh: HexMesh, law: NeoHooke, pattern: MatrixPattern) -> None:
        self.mesh, self.law, self.pattern = mesh, law, pattern
        local = brick_gradients()
        x = mesh.nodes_mm[mesh.cells]
        jacobian = np.einsum("mai,qaj->mqij", x, local)
        det = np.linalg.det(jacobian)
        if not det.min() > 0:
            raise InputError("mesh: a cell is inverted at rest")
        gradients = np.einsum("qaj,mqji->maqi", local, np.linalg.inv(jacobian), optimize=True)
        self.gradients_per_mm: Field = np.ascontiguousarray(gradients).reshape(len(x), 8, -1)
        self.weights_mm3: Field = np.ascontiguousarray(det)
        self.volumes_mm3: Field = det.sum(axis=1)

    def evaluate(
        self,
        displacement_mm: Field,
        tangent: bool = True,
        pressure_mpa: Field | None = None,
        memory: Memory | None = None,
    ) -> Bulk:
        """Return energy, forces and, if `tangent`, the tangent's entries at displacements (n, 3).

        pressure_mpa (m,): tension-positive cell pressure with which the tangent's geometric part is
        formed; None: U'(jbar). memory: the local energy is scale mu[...] + h:(C - I)/2, see
        `Viscosity`.
        """
        from . import compiled  # loads numba, which is slow

        scale, memory_mpa = (1.0, _NO_MEMORY) if memory is None else memory[:2]
        m = len(self.mesh.cells)
        force = np.zeros_like(displacement_mm)
        data = np.zeros(self.pattern.entries + 1 if tangent else 0)
        jbar, volume_rate = np.empty(m), np.empty((m, 24))
        energy, least_j = compiled.loop(
            np.ascontiguousarray(displacement_mm), self.mesh.cells, self.gradients_per_mm,
            self.weights_mm3, self.pattern.slots, self.law.mu_mpa,
            self.law.lambda_mpa, self.law.local_mpa,
            tangent, force, data, jbar, volume_rate,
            _NO_PRESSURE if pressure_mpa is None else pressure_mpa, scale,
            memory_mpa,
        )  # fmt: skip
        return Bulk(energy, force, data[:-1], least_j, jbar, volume_rate)

    def deformation_gradient(self, displacement_mm: Field) -> Field:
        u = displacement_mm[self.mesh.cells]
        grad = np.matmul(np.swapaxes(u, 1, 2), self.gradients_per_mm)
        f = np.swapaxes(grad.reshape(len(u), 3, CELL_POINTS, 3), 1, 2)
        return f + np.eye(3)

    def scatter(self, nodal: Field) -> Field:
        """Sum of cell forces (m, 8, 3) at the nodes, (n, 3)."""
        return self.mesh.at_nodes(self.mesh.cells, nodal)
