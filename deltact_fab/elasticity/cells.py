"""The block's face as cells: mean displacement of some for an even traction on others.

What an inverse wants is not an operator to apply but its matrix. The layer moves with the load, so
one cell's response is enough; what the free sides add is smooth, and comes through `FreeSides`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..aliases import Field
from ..shapes import SkinDimensions
from .block import interpolation, turned
from .edge_compliance import PADDING, FreeSides, free_sides, halves
from .layer import BondedLayer
from .material import GelMaterial

PARTS = 4  # nodes along a cell: twice as many change its own compliance by 1 %


@dataclass(frozen=True)
class FaceCells:
    """Equal cells that fill a block's face, a mirror image of each other on either side.

    x_mm (nx,), y_mm (ny,): their centres in the sensor frame. A modulus of 1 MPa is meant, so that
    tractions are shares of the gel's.
    """

    skin: SkinDimensions
    poisson: float
    x_mm: Field
    y_mm: Field

    @classmethod
    def of(cls, skin: SkinDimensions, poisson: float, cell_mm: float) -> FaceCells:
        """The cells nearest to cell_mm along each side."""
        a, b = skin.opening_half_mm
        return cls(skin, poisson, _centres(a, cell_mm), _centres(b, cell_mm))

    @property
    def cell_mm2(self) -> float:
        return float((self.x_mm[1] - self.x_mm[0]) * (self.y_mm[1] - self.y_mm[0]))

    def compliance(self, seen: tuple[slice, slice], loaded: tuple[slice, slice]) -> Field:
        """Displacement of cells for tractions on others, (n seen, 3, n loaded, 3), mm / MPa.

        seen, loaded: (rows, columns) of two windows, whose cells go row by row. Raises InputError
        for a Poisson's ratio or a skin that `free_sides` cannot take.
        """
        kernel = self._layer()
        row, column, to_row, to_column = (
            index.ravel() for window in (seen, loaded) for index in np.mgrid[window[0], window[1]]
        )
        found = kernel[:, :, row[:, None] - to_row, column[:, None] - to_column]
        found = np.ascontiguousarray(found.transpose(2, 0, 3, 1))
        sides = free_sides(self.skin, self.poisson)
        up, down = (self._classes(sides, window) for window in (seen, loaded))
        for i in range(3):
            for j in range(3):
                parts = zip(up[i], sides.quarters[i, j] * self.cell_mm2, down[j], strict=True)
                found[:, i, :, j] += sum(a.T @ (quarter @ b) for a, quarter, b in parts)
        return found

    def _layer(self) -> Field:
        """Mean displacement of the cell at an offset for a traction, (3, 3, 2 ny, 2 nx)."""
        ny, nx = len(self.y_mm), len(self.x_mm)
        layer = BondedLayer(
            GelMaterial(1.0, self.poisson, prony=()),
            self.skin.thickness_mm,
            (
                PADDING * 2 * self.skin.opening_half_mm[0],
                PADDING * 2 * self.skin.opening_half_mm[1],
            ),
            (PADDING * ny * PARTS, PADDING * nx * PARTS),
        )
        kernel = []
        for j in range(3):
            load = np.zeros((3, PARTS, PARTS))
            load[j] = 1
            u = layer.apply_patch(load, 0, 0).reshape(PADDING * ny, PARTS, PADDING * nx, PARTS, 3)
            kernel.append(np.moveaxis(u.mean(axis=(1, 3)), -1, 0))
        return np.stack(kernel, axis=1)

    def _classes(self, sides: FreeSides, window: tuple[slice, slice]) -> list[Field]:
        """For each component, a window's cells in the sides' four classes, (4, q, n)."""
        in_y, in_x = (
            halves(_means(knots, at, cut).T)
            for knots, at, cut in (
                (sides.y_mm, self.y_mm, window[0]),
                (sides.x_mm, self.x_mm, window[1]),
            )
        )
        whole = np.einsum("ahy,bkx->abhkyx", in_y, in_x)
        flat = (4, in_y.shape[1] * in_x.shape[1], -1)
        return [turned(component, whole).reshape(flat) for component in range(3)]


def _centres(half_mm: float, cell_mm: float) -> Field:
    """Of an even number of cells from -half_mm to half_mm."""
    n = 2 * round(half_mm / cell_mm)
    return np.asarray((np.arange(n) - (n - 1) / 2) * (2 * half_mm / n), np.float64)


def _means(knots_mm: Field, centres_mm: Field, cut: slice) -> Field:
    """Matrix (cells, knots) from values at knots to means over some of the cells."""
    step = centres_mm[1] - centres_mm[0]
    nodes = centres_mm[cut, None] + step * ((np.arange(PARTS) + 0.5) / PARTS - 0.5)
    return np.asarray(interpolation(knots_mm, nodes.ravel()).reshape(len(nodes), PARTS, -1).mean(1))
