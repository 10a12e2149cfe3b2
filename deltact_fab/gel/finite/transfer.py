"""Displacements of a coarser mesh on a finer one: a start for Newton's method.

Both meshes are blocks, so interpolation is the product of three along the axes. The answer does not
depend on it, but the finer mesh finds it in about half the factors.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...aliases import Field, Point
from .mesh import HexMesh
from .state import FiniteState

SAME_MM = 1e-6  # tips no further apart are one


class Guide:
    """Increments of a way that a coarser mesh has gone, asked for in its order.

    states: of that mesh, in the order solved.
    """

    def __init__(self, coarse: HexMesh, states: Sequence[FiniteState], fine: HexMesh) -> None:
        assert coarse.axes_mm is not None
        assert fine.axes_mm is not None
        self._states, self._next = states, 0
        self._nodes = [_linear(a, b) for a, b in zip(coarse.axes_mm, fine.axes_mm, strict=True)]
        middles = [[(a[1:] + a[:-1]) / 2 for a in mesh.axes_mm or ()] for mesh in (coarse, fine)]
        self._cells = [_linear(a, b) for a, b in zip(*middles, strict=True)]

    def change(self, start_mm: Point, end_mm: Point) -> tuple[Field, Field] | None:
        """Of displacements (n, 3) and cell pressures (m,) between two tips; None if not there."""
        first = self._index(start_mm, self._next)
        last = None if first is None else self._index(end_mm, first + 1)
        if first is None or last is None:
            return None
        self._next = first
        a, b = self._states[first], self._states[last]
        moved = _laid(b.displacement_mm - a.displacement_mm, self._nodes)
        return moved, _laid((b.cell_pressure_mpa - a.cell_pressure_mpa)[:, None], self._cells)[:, 0]

    def _index(self, tip_mm: Point, start: int) -> int | None:
        for k in range(start, len(self._states)):
            if np.allclose(self._states[k].tip_mm, tip_mm, rtol=0, atol=SAME_MM):
                return k
        return None


def _linear(at_mm: Field, to_mm: Field) -> Field:
    """Weights (len(to), len(at)) of linear interpolation, constant beyond the ends."""
    return np.stack([np.interp(to_mm, at_mm, unit) for unit in np.eye(len(at_mm))], axis=1)


def _laid(values: Field, weights: Sequence[Field]) -> Field:
    """Values (points, k) of a block, x fastest and z slowest, at the points of another."""
    x, y, z = weights
    grid = values.reshape(z.shape[1], y.shape[1], x.shape[1], -1)
    found = np.einsum("ai,bj,ck,ijkd->abcd", z, y, x, grid, optimize=True)
    return np.asarray(found.reshape(-1, grid.shape[-1]))
