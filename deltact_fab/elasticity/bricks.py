"""The stiffness of a box of equal bricks at small strain.

Eight nodes a brick, 2 x 2 x 2 points, and one mean dilatation (Nagtegaal, Parks and Rice 1974), so
that near incompressibility does not lock them.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ..aliases import Field

# Corners of a brick as (x, y, z) steps: round the lower face, then round the upper one.
_CORNERS = np.array(
    [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]]
)


class BrickBox(NamedTuple):
    """Bricks along x, y and z, and the sides (x, y, z) of one, mm.

    Nodes go row by row along x, then y, then z from the base up; displacements are (x, y, z).
    """

    bricks: tuple[int, int, int]
    side_mm: tuple[float, float, float]

    @property
    def nodes_a_layer(self) -> int:
        return (self.bricks[0] + 1) * (self.bricks[1] + 1)

    @property
    def nodes(self) -> int:
        return self.nodes_a_layer * (self.bricks[2] + 1)


def stiffness(box: BrickBox, poisson: float, free: NDArray[np.bool_]) -> sp.csr_matrix:
    """Upper triangle over the free displacements, for a modulus of 1 MPa; free: (nodes, 3)."""
    nx, ny, nz = box.bricks
    z, y, x = np.meshgrid(np.arange(nz), np.arange(ny), np.arange(nx), indexing="ij")
    corners = [
        ((z + dz) * (ny + 1) + y + dy) * (nx + 1) + x + dx for dx, dy, dz in _CORNERS.tolist()
    ]
    nodes = np.stack(corners, axis=-1).reshape(-1, 8)
    number = np.full(free.size, -1)
    number[free.ravel()] = np.arange(np.count_nonzero(free))
    place = number[(3 * nodes[:, :, None] + np.arange(3)).reshape(-1, 24)]
    rows, columns = np.repeat(place, 24, axis=1), np.tile(place, (1, 24))
    values = np.tile(_brick(box.side_mm, poisson).ravel(), (len(nodes), 1))
    kept = (rows >= 0) & (columns >= rows)
    size = int(np.count_nonzero(free))
    entries = (values[kept], (rows[kept], columns[kept]))
    return sp.coo_matrix(entries, shape=(size, size)).tocsr()


def _brick(side_mm: tuple[float, float, float], poisson: float) -> Field:
    """(24, 24) N/mm of one brick, for a modulus of 1 MPa."""
    mu = 1 / (2 * (1 + poisson))
    lame = poisson / ((1 + poisson) * (1 - 2 * poisson))
    side = np.asarray(side_mm)
    signs = 2.0 * _CORNERS - 1
    points = signs / np.sqrt(3)
    factor = 1 + points[:, None, :] * signs[None]  # (points, nodes, 3)
    gradient = np.empty((8, 8, 3))
    for j in range(3):
        others = [k for k in range(3) if k != j]
        gradient[:, :, j] = signs[:, j] * factor[..., others].prod(axis=-1) / (4 * side[j])
    weight = float(side.prod()) / 8
    laplace = np.einsum("qai,qbi->ab", gradient, gradient)
    crossed = np.einsum("qaj,qbi->aibj", gradient, gradient)
    shear = np.einsum("ab,ij->aibj", laplace, np.eye(3)) + crossed
    volume_rate = weight * gradient.sum(axis=0).ravel()
    bulk = lame / float(side.prod()) * np.outer(volume_rate, volume_rate)
    return mu * weight * shear.reshape(24, 24) + bulk
