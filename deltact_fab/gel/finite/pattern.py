"""Where the entries of cell matrices go in one symmetric sparse matrix, found once per mesh."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ...aliases import Field, Index
from .mesh import HexMesh

CELL_DOFS = 24
UPPER = np.triu_indices(CELL_DOFS)
FACE_UPPER = np.triu_indices(12)
_FACE_OF_CELL = np.flatnonzero((UPPER[0] >= 12) & (UPPER[1] >= 12))


class Pattern:
    """The upper triangle in CSR of the matrix over the free displacements of a mesh.

    free (n, 3): True where a displacement is not held. size: their number.
    number (3 n,): place of a displacement among the free ones; `size` where it is held.
    slots (m, 300): place in `data` of each entry of a cell matrix's upper triangle, `entries` for
    what is held. face_slots (f, 78): the same for the four upper nodes of the touched cells.
    """

    def __init__(self, mesh: HexMesh, free: NDArray[np.bool_]) -> None:
        self.free = free
        flat = free.ravel()
        self.size = int(flat.sum())
        self.number = np.full(flat.size, self.size, dtype=np.int64)
        self.number[flat] = np.arange(self.size)
        dofs = (3 * mesh.cells[:, :, None] + np.arange(3)).reshape(-1, CELL_DOFS)
        place = self.number[dofs]
        one, two = place[:, UPPER[0]], place[:, UPPER[1]]
        low, high = np.minimum(one, two), np.maximum(one, two)
        held = (high == self.size).ravel()
        keys = (low * (self.size + 1) + high).ravel()
        # Sorting is dear, so each neighbouring pair of nodes could be sorted once instead; it is
        # paid once per mesh and is less than one factorisation.
        unique, inverse = np.unique(keys[~held], return_inverse=True)
        self.entries = len(unique)
        slots = np.full(keys.size, self.entries, dtype=np.int64)
        slots[~held] = inverse
        self.slots: Index = slots.reshape(low.shape)
        self.face_slots: Index = self.slots[mesh.touched][:, _FACE_OF_CELL]
        rows = unique // (self.size + 1)
        self.indices = (unique % (self.size + 1)).astype(np.int32)
        self.indptr = np.zeros(self.size + 1, dtype=np.int32)
        np.cumsum(np.bincount(rows, minlength=self.size), out=self.indptr[1:])

    def whole(self, free_values: Field) -> Field:
        """Values (n, 3) from those of the free displacements (size,), 0 where held."""
        out = np.zeros(self.free.shape)
        out[self.free] = free_values
        return out

    def matrix(self, data: Field) -> sp.csr_matrix:
        """The upper triangle with the given entries, not copied."""
        return sp.csr_matrix(
            (data, self.indices, self.indptr), shape=(self.size, self.size), copy=False
        )

    def add(self, slots: Index, values: Field) -> Field:
        """Sum of entries (any, k) at their slots (any, k), as CSR data."""
        total = np.bincount(slots.ravel(), weights=values.ravel(), minlength=self.entries + 1)
        return np.asarray(total[: self.entries], dtype=np.float64)
