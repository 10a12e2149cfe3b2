"""Linear elasticity of the finite block with free sides: face tractions to displacement.

The face's compliance is that of the spectral layer, on the fine grid of the contact, plus the
smooth effect of the free sides (`edge_compliance`), on a coarse finite element grid. One
interpolation links the grids, its transpose maps the loads, so the operator stays symmetric. The
grid ends at the block's edges.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from deltact_fab.common import Field, InputError

from ..shapes.sensor import SkinDimensions
from .edge_compliance import SLAB_PAD, FreeSides, even_odd, free_sides
from .layer import BondedLayer, WindowOperator, even_fast_length
from .material import GelMaterial


class FreeBlock:
    """Face of a block on a grid of ny x nx nodes at the centres of equal cells.

    spacing_mm: (x, y), the largest below the requested one that divides the face into a number of
    nodes fast for the transform. cell_mm: of the finite elements for the sides, None for a
    default. x_mm (nx,), y_mm (ny,): node coordinates in the sensor frame.
    Raises InputError for unusable sizes and a Poisson's ratio over 0.4999.
    """

    def __init__(
        self,
        skin: SkinDimensions,
        material: GelMaterial,
        spacing_mm: float = 0.25,
        cell_mm: float | None = None,
    ) -> None:
        sides = free_sides(skin, material.poisson, cell_mm)
        if not (math.isfinite(spacing_mm) and 0.02 <= spacing_mm <= skin.length_mm / 16):
            raise InputError(
                f"block: spacing_mm must be 0.02 to {skin.length_mm / 16:g} mm: {spacing_mm} fails"
            )
        nx, ny = (even_fast_length(s / spacing_mm) for s in (skin.width_mm, skin.length_mm))
        # Same period as the slab, so the effect of periodic images is subtracted with it.
        self.layer = BondedLayer(
            material,
            skin.thickness_mm,
            (SLAB_PAD * skin.width_mm, SLAB_PAD * skin.length_mm),
            (SLAB_PAD * ny, SLAB_PAD * nx),
        )
        self.material = material
        self.thickness_mm = self.layer.thickness_mm
        self.shape = (ny, nx)
        self.spacing_mm = self.layer.spacing_mm
        self.cell_mm2 = self.layer.cell_mm2
        self._row, self._column = (SLAB_PAD - 1) * ny // 2, (SLAB_PAD - 1) * nx // 2
        self.x_mm: Field = self.layer.x_mm[self._column : self._column + nx]
        self.y_mm: Field = self.layer.y_mm[self._row : self._row + ny]
        # Scaled for tractions instead of forces.
        self._sides = _Sides(
            even_odd(interpolate_block(sides.x_mm, self.x_mm).T),
            even_odd(interpolate_block(sides.y_mm, self.y_mm).T),
            sides.quarters * (self.cell_mm2 / material.modulus_mpa),
        )

    def apply(self, tractions_mpa: Field) -> Field:
        """Surface displacement (ny, nx, 3) in mm of tractions (ny, nx, 3) in MPa, all (x, y, z)."""
        return self.apply_patch(np.moveaxis(tractions_mpa, -1, 0), 0, 0)

    def apply_patch(self, tractions_mpa: Field, row: int, column: int) -> Field:
        """Displacement (ny, nx, 3) in mm of tractions (3, my, mx) that are zero outside a patch."""
        _, my, mx = tractions_mpa.shape
        ny, nx = self.shape
        u = self.layer.apply_patch(tractions_mpa, row + self._row, column + self._column)
        u = u[self._row : self._row + ny, self._column : self._column + nx]
        cut = self._sides.cut(row, column, my, mx)
        parts = [cut.amplitudes(i, tractions_mpa[i]) for i in range(3)]
        sides = [self._sides.displacement(i, parts, (0, 1, 2)) for i in range(3)]
        return u + np.stack(sides, axis=-1)

    def window(self, my: int, mx: int, row: int = 0, column: int = 0) -> BlockWindow:
        """Operator within the my x mx patch whose first node is (row, column)."""
        return BlockWindow(self.layer.window(my, mx), self._sides.cut(row, column, my, mx))


class _Sides(NamedTuple):
    """Effect of the sides on a patch: even and odd interpolations (2, h, m), `FreeSides.quarters`.

    quarters: displacement in mm due to a traction of 1 MPa on a node's cell.
    """

    in_x: Field
    in_y: Field
    quarters: Field

    def cut(self, row: int, column: int, my: int, mx: int) -> _Sides:
        """Restrict to a smaller patch."""
        return _Sides(
            np.ascontiguousarray(self.in_x[:, :, column : column + mx]),
            np.ascontiguousarray(self.in_y[:, :, row : row + my]),
            self.quarters,
        )

    def amplitudes(self, component: int, traction: Field) -> Field:
        """Amplitudes (4, q) of one traction component (my, mx) in the four symmetry classes."""
        (_, hx, mx), (_, hy, my) = self.in_x.shape, self.in_y.shape
        parts = self.in_y.reshape(-1, my) @ traction @ self.in_x.reshape(-1, mx).T
        parts = np.moveaxis(parts.reshape(2, hy, 2, hx), 2, 1)
        return swap_parity(component, parts).reshape(4, -1)

    def displacement(self, component: int, parts: Sequence[Field], axes: Sequence[int]) -> Field:
        """One component (my, mx) of the displacement from `amplitudes` of traction `axes`."""
        (_, hx, mx), (_, hy, my) = self.in_x.shape, self.in_y.shape
        amplitudes = np.zeros((4, hx * hy, 1))
        for part, j in zip(parts, axes, strict=True):
            amplitudes += self.quarters[component, j] @ part[..., None]
        values = np.moveaxis(swap_parity(component, amplitudes.reshape(2, 2, hy, hx)), 1, 2)
        values = self.in_y.reshape(-1, my).T @ values.reshape(2 * hy, 2 * hx)
        return values @ self.in_x.reshape(-1, mx)


def swap_parity(component: int, parts: Field) -> Field:
    """Swap parities (y, x, ...) between a class, defined by u_z, and a component's own."""
    if component == 0:
        return parts[:, ::-1]
    return parts[::-1] if component == 1 else parts


class BlockWindow:
    """Operator of the block on one patch, with the methods of `layer.WindowOperator`."""

    def __init__(self, near: WindowOperator, sides: _Sides) -> None:
        self._near, self._sides = near, sides
        self.shape = near.shape

    def normal_of_pressure(self, pressure: Field) -> Field:
        part = self._sides.amplitudes(2, pressure)
        return self._near.normal_of_pressure(pressure) + self._sides.displacement(2, [part], [2])

    def shear_of_pressure(self, pressure: Field) -> Field:
        part = -self._sides.amplitudes(2, pressure)
        return self._near.shear_of_pressure(pressure) + self._in_plane([part], [2])

    def shear_of_shear(self, traction: Field) -> Field:
        parts = [self._sides.amplitudes(i, traction[i]) for i in (0, 1)]
        return self._near.shear_of_shear(traction) + self._in_plane(parts, [0, 1])

    def normal_of_shear(self, traction: Field) -> Field:
        parts = [self._sides.amplitudes(i, traction[i]) for i in (0, 1)]
        return self._near.normal_of_shear(traction) - self._sides.displacement(2, parts, [0, 1])

    def _in_plane(self, parts: Sequence[Field], axes: Sequence[int]) -> Field:
        return np.stack([self._sides.displacement(i, parts, axes) for i in (0, 1)])


def interpolate_block(knots_mm: Field, points_mm: Field) -> Field:
    """Matrix (points, knots) of cubic spline interpolation."""
    from scipy.interpolate import CubicSpline

    return np.ascontiguousarray(CubicSpline(knots_mm, np.eye(len(knots_mm)))(points_mm))


CELL_NODES = 4  # by hand: doubling it changes a cell's own compliance by 1 %


@dataclass(frozen=True)
class FaceCells:
    """Equal cells that fill a block's face, symmetric about its axes.

    For inverse problems, which need the matrix: mean displacement of cells due to a uniform
    traction on others. The layer is translation-invariant, so one cell's response is enough; the
    smooth effect of the free sides is added by `FreeSides`.
    x_mm (nx,), y_mm (ny,): centres in the sensor frame. For a modulus of 1 MPa, so tractions are in
    units of the gel's.
    """

    skin: SkinDimensions
    poisson: float
    x_mm: Field
    y_mm: Field

    @classmethod
    def from_skin(cls, skin: SkinDimensions, poisson: float, cell_mm: float) -> FaceCells:
        """Cells with sides nearest to cell_mm."""
        a, b = skin.opening_half_mm
        return cls(skin, poisson, _centres(a, cell_mm), _centres(b, cell_mm))

    @property
    def cell_mm2(self) -> float:
        return float((self.x_mm[1] - self.x_mm[0]) * (self.y_mm[1] - self.y_mm[0]))

    def compliance(self, targets: tuple[slice, slice], loaded: tuple[slice, slice]) -> Field:
        """Displacement of cells due to tractions on others (n targets, 3, n loaded, 3), mm / MPa.

        targets, loaded: (rows, columns) of two windows, cells row by row. Raises InputError for a
        Poisson's ratio or a skin that `free_sides` rejects.
        """
        kernel = self._layer()
        windows = [np.mgrid[rows, columns] for rows, columns in (targets, loaded)]
        row, column, to_row, to_column = (index.ravel() for pair in windows for index in pair)
        matrix = kernel[:, :, row[:, None] - to_row, column[:, None] - to_column]
        matrix = np.ascontiguousarray(matrix.transpose(2, 0, 3, 1))
        sides = free_sides(self.skin, self.poisson)
        up, down = (self._classes(sides, window) for window in (targets, loaded))
        for i in range(3):
            for j in range(3):
                parts = zip(up[i], sides.quarters[i, j] * self.cell_mm2, down[j], strict=True)
                matrix[:, i, :, j] += sum(a.T @ (quarter @ b) for a, quarter, b in parts)
        return matrix

    def _layer(self) -> Field:
        """Mean displacement (3, 3, 2 ny, 2 nx) of the cell at an offset due to a traction."""
        my, mx = SLAB_PAD * len(self.y_mm), SLAB_PAD * len(self.x_mm)
        layer = BondedLayer(
            GelMaterial(1.0, self.poisson, prony=()),
            self.skin.thickness_mm,
            (
                SLAB_PAD * 2 * self.skin.opening_half_mm[0],
                SLAB_PAD * 2 * self.skin.opening_half_mm[1],
            ),
            (my * CELL_NODES, mx * CELL_NODES),
        )
        kernel = []
        for j in range(3):
            load = np.zeros((3, CELL_NODES, CELL_NODES))
            load[j] = 1
            u = layer.apply_patch(load, 0, 0).reshape(my, CELL_NODES, mx, CELL_NODES, 3)
            kernel.append(np.moveaxis(u.mean(axis=(1, 3)), -1, 0))
        return np.stack(kernel, axis=1)

    def _classes(self, sides: FreeSides, window: tuple[slice, slice]) -> list[Field]:
        """Interpolation (4, q, n) from four symmetry classes to a window's cells, per component."""
        in_y, in_x = (
            even_odd(_means(knots, centres, cut).T)
            for knots, centres, cut in (
                (sides.y_mm, self.y_mm, window[0]),
                (sides.x_mm, self.x_mm, window[1]),
            )
        )
        weights = np.einsum("ahy,bkx->abhkyx", in_y, in_x)
        flat = (4, in_y.shape[1] * in_x.shape[1], -1)
        return [swap_parity(component, weights).reshape(flat) for component in range(3)]


def _centres(half_mm: float, cell_mm: float) -> Field:
    """Centres of an even number of cells from -half_mm to half_mm."""
    n = 2 * round(half_mm / cell_mm)
    return np.asarray((np.arange(n) - (n - 1) / 2) * (2 * half_mm / n), np.float64)


def _means(knots_mm: Field, centres_mm: Field, cut: slice) -> Field:
    """Matrix (cells, knots) from values at knots to means over the cells of a slice."""
    step = centres_mm[1] - centres_mm[0]
    nodes = centres_mm[cut, None] + step * ((np.arange(CELL_NODES) + 0.5) / CELL_NODES - 0.5)
    return np.asarray(
        interpolate_block(knots_mm, nodes.ravel()).reshape(len(nodes), CELL_NODES, -1).mean(1)
    )
