"""Linear elasticity of the finite block, its sides free: tractions on its face to displacement.

The face's compliance is that of the spectral layer, on as fine a grid as the contact needs, plus
what the free sides add (`edge_compliance`), on the coarse grid of finite elements that it is smooth
enough for. Between the grids stands one interpolation, and its transpose for the loads, so the
whole stays symmetric. The grid ends where the block ends: beside it is nothing to touch.
"""

from __future__ import annotations

import math
from collections import OrderedDict
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..aliases import Field
from ..errors import InputError
from ..shapes import SkinDimensions
from .edge_compliance import PADDING, free_sides, halves
from .layer import BondedLayer, WindowOperator, even_fast_length
from .material import GelMaterial


class FreeBlock:
    """The face of a block on a grid of ny x nx nodes in the middles of equal cells.

    spacing_mm: (x, y), the largest below the one asked for that divides the face evenly into a
    number of nodes the transform likes. cell_mm: of the finite elements for its sides, None for a
    default. x_mm (nx,), y_mm (ny,): node coordinates in the sensor frame.
    Raises InputError for sizes that cannot be used and a Poisson's ratio over .4999.
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
        # The layer's period is the slab's, so what its images do is taken off with the slab.
        self.layer = BondedLayer(
            material,
            skin.thickness_mm,
            (PADDING * skin.width_mm, PADDING * skin.length_mm),
            (PADDING * ny, PADDING * nx),
        )
        self.material = material
        self.thickness_mm = self.layer.thickness_mm
        self.shape = (ny, nx)
        self.spacing_mm = self.layer.spacing_mm
        self.cell_mm2 = self.layer.cell_mm2
        self._row, self._column = (PADDING - 1) * ny // 2, (PADDING - 1) * nx // 2
        self.x_mm: Field = self.layer.x_mm[self._column : self._column + nx]
        self.y_mm: Field = self.layer.y_mm[self._row : self._row + ny]
        # Tractions come in, not forces.
        self._sides = _Sides(
            halves(interpolation(sides.x_mm, self.x_mm).T),
            halves(interpolation(sides.y_mm, self.y_mm).T),
            sides.quarters * (self.cell_mm2 / material.modulus_mpa),
        )
        self._windows: OrderedDict[tuple[int, int, int, int], BlockWindow] = OrderedDict()

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
        parts = [cut.down(i, tractions_mpa[i]) for i in range(3)]
        return u + np.stack([self._sides.up(i, parts, (0, 1, 2)) for i in range(3)], axis=-1)

    def window(self, my: int, mx: int, row: int = 0, column: int = 0) -> BlockWindow:
        """The operator within the my x mx patch whose first node is (row, column), cached."""
        key = (my, mx, row, column)
        if key not in self._windows:
            if len(self._windows) >= 8:
                self._windows.popitem(last=False)
            self._windows[key] = BlockWindow(
                self.layer.window(my, mx), self._sides.cut(row, column, my, mx)
            )
        self._windows.move_to_end(key)
        return self._windows[key]


class _Sides(NamedTuple):
    """The sides' part on a patch: even and odd interpolations (2, h, m), and `FreeSides.quarters`.

    quarters: displacement in mm for a traction of 1 MPa on a node's cell.
    """

    in_x: Field
    in_y: Field
    quarters: Field

    def cut(self, row: int, column: int, my: int, mx: int) -> _Sides:
        """The same for a smaller patch."""
        return _Sides(
            np.ascontiguousarray(self.in_x[:, :, column : column + mx]),
            np.ascontiguousarray(self.in_y[:, :, row : row + my]),
            self.quarters,
        )

    def down(self, component: int, traction: Field) -> Field:
        """Amplitudes (4, q) in the four classes of one component (my, mx) of the traction."""
        (_, hx, mx), (_, hy, my) = self.in_x.shape, self.in_y.shape
        found = self.in_y.reshape(-1, my) @ traction @ self.in_x.reshape(-1, mx).T
        found = np.moveaxis(found.reshape(2, hy, 2, hx), 2, 1)
        return turned(component, found).reshape(4, -1)

    def up(self, component: int, parts: Sequence[Field], of: Sequence[int]) -> Field:
        """One component (my, mx) of the displacement by `down` of traction components `of`."""
        (_, hx, mx), (_, hy, my) = self.in_x.shape, self.in_y.shape
        found = np.zeros((4, hx * hy, 1))
        for part, j in zip(parts, of, strict=True):
            found += self.quarters[component, j] @ part[..., None]
        whole = np.moveaxis(turned(component, found.reshape(2, 2, hy, hx)), 1, 2)
        whole = self.in_y.reshape(-1, my).T @ whole.reshape(2 * hy, 2 * hx)
        return whole @ self.in_x.reshape(-1, mx)


def turned(component: int, parts: Field) -> Field:
    """Between a class, which is that of u_z, and a component's own parity (y, x, ...)."""
    if component == 0:
        return parts[:, ::-1]
    return parts[::-1] if component == 1 else parts


class BlockWindow:
    """The block's operator on one patch, with the methods of `layer.WindowOperator`."""

    def __init__(self, near: WindowOperator, sides: _Sides) -> None:
        self._near, self._sides = near, sides
        self.shape = near.shape

    def normal_of_pressure(self, pressure: Field) -> Field:
        part = self._sides.down(2, pressure)
        return self._near.normal_of_pressure(pressure) + self._sides.up(2, [part], [2])

    def shear_of_pressure(self, pressure: Field) -> Field:
        part = -self._sides.down(2, pressure)
        return self._near.shear_of_pressure(pressure) + self._in_plane([part], [2])

    def shear_of_shear(self, traction: Field) -> Field:
        parts = [self._sides.down(i, traction[i]) for i in (0, 1)]
        return self._near.shear_of_shear(traction) + self._in_plane(parts, [0, 1])

    def normal_of_shear(self, traction: Field) -> Field:
        parts = [self._sides.down(i, traction[i]) for i in (0, 1)]
        return self._near.normal_of_shear(traction) - self._sides.up(2, parts, [0, 1])

    def _in_plane(self, parts: Sequence[Field], of: Sequence[int]) -> Field:
        return np.stack([self._sides.up(i, parts, of) for i in (0, 1)])


def interpolation(knots_mm: Field, points_mm: Field) -> Field:
    """Matrix (points, knots) of the cubic spline through values at the knots."""
    from scipy.interpolate import CubicSpline

    return np.ascontiguousarray(CubicSpline(knots_mm, np.eye(len(knots_mm)))(points_mm))
