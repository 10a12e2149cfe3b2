"""Meshes of eight-node bricks: the block of a skin, and a disc to compare with axisymmetry.

Sensor frame: the touched face at z = 0, the bonded base at z = -thickness.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from deltact_fab.common import Field, InputError
from deltact_fab.sensor import SkinDimensions

FocusBox = tuple[float, float, float, float]

CELL_GROWTH = 1.25  # ratio of neighbouring cells; by hand: more costs accuracy at the transition
MAX_CELL_RATIO = 5.0  # largest cell over smallest; by hand: more saves few unknowns


@dataclass(frozen=True, eq=False)
class HexMesh:
    """Hexahedra whose nodes 0-3 run round the lower quadrilateral and 4-7 above them.

    nodes_mm (n, 3). cells (m, 8): node numbers. touched (f,): cells whose upper quadrilateral lies
    in the touched face. base (b,): nodes fixed to the rigid base.
    mirrors: True where x = 0, y = 0 is a mirror plane; the mesh lies on its positive side.
    axes_mm: of a block, the coordinates along x, y and z, whose product are the nodes.
    """

    nodes_mm: Field
    cells: NDArray[np.int64]
    touched: NDArray[np.int64]
    base: NDArray[np.int64]
    mirrors: tuple[bool, bool] = (False, False)
    axes_mm: tuple[Field, Field, Field] | None = None

    @property
    def fixed(self) -> NDArray[np.bool_]:
        """Mask (n, 3) of zero displacements: of the base, and across mirrors."""
        mask = np.zeros(self.nodes_mm.shape, dtype=bool)
        mask[self.base] = True
        for axis, mirror in enumerate(self.mirrors):
            if mirror:
                mask[:, axis] |= self.nodes_mm[:, axis] == 0.0
        return mask

    @property
    def copies(self) -> int:
        return 2 ** sum(self.mirrors)

    @property
    def faces(self) -> NDArray[np.int64]:
        """Node numbers (f, 4) of the touched face, round it, seen from outside counterclockwise."""
        return self.cells[self.touched, 4:]

    def at_nodes(self, cells: NDArray[np.int64], forces: Field) -> Field:
        """Sum forces (m, k, 3) at the nodes (m, k) of cells or faces to (n, 3)."""
        flat, n = cells.ravel(), len(self.nodes_mm)
        columns = [np.bincount(flat, weights=forces[..., i].ravel(), minlength=n) for i in range(3)]
        return np.stack(columns, axis=1)

    @property
    def free_dofs(self) -> int:
        return int((~self.fixed).sum())


def block_mesh(
    skin: SkinDimensions,
    spacing_mm: float,
    focus: FocusBox | None = None,
    mirrors: tuple[bool, bool] = (False, False),
    growth: float = CELL_GROWTH,
) -> HexMesh:
    """Mesh a block width x length x thickness; the edges' fillet and the frame are neglected.

    spacing_mm: cell size, everywhere or, with a focus, inside it and at the face.
    focus: (x_low, x_high, y_low, y_high) in mm; cells grow from it by `growth` up to
        MAX_CELL_RATIO, and from the face towards the base.
    mirrors: keep only x >= 0, y >= 0; a focus must be symmetric there.
    Raises InputError for an unusable spacing.
    """
    if not (math.isfinite(spacing_mm) and 0 < spacing_mm <= skin.thickness_mm):
        raise InputError(
            f"block mesh: spacing_mm must be > 0, <= {skin.thickness_mm:g} mm (got {spacing_mm})"
        )
    x, y, z = _axes(skin, spacing_mm, focus, mirrors, growth)
    yy, xx = np.meshgrid(y, x, indexing="ij")
    plane = np.stack([xx.ravel(), yy.ravel()], axis=1)
    row, column = np.meshgrid(np.arange(len(y) - 1), np.arange(len(x) - 1), indexing="ij")
    corner = (row * len(x) + column).ravel()
    quads = np.stack([corner, corner + 1, corner + 1 + len(x), corner + len(x)], axis=1)
    return replace(extruded(plane, quads, z), mirrors=mirrors, axes_mm=(x, y, z))


def unknowns(
    skin: SkinDimensions,
    spacing_mm: float,
    focus: FocusBox,
    mirrors: tuple[bool, bool],
    growth: float = CELL_GROWTH,
) -> int:
    """Estimate the free displacements of `block_mesh`; those across mirrors are counted too."""
    x, y, z = _axes(skin, spacing_mm, focus, mirrors, growth)
    return 3 * len(x) * len(y) * (len(z) - 1)


def _axes(
    skin: SkinDimensions,
    spacing_mm: float,
    focus: FocusBox | None,
    mirrors: tuple[bool, bool],
    growth: float = CELL_GROWTH,
) -> tuple[Field, Field, Field]:
    halves = skin.opening_half_mm
    axes = []
    for axis, half in enumerate(halves):
        low = 0.0 if mirrors[axis] else -half
        if focus is None:
            axes.append(_uniform(low, half, spacing_mm))
        else:
            start, end = focus[2 * axis], focus[2 * axis + 1]
            if mirrors[axis] and abs(start + end) > 1e-9 * half:
                raise InputError(f"block mesh: a focus from {start:g} to {end:g} mm has no mirror")
            axes.append(_graded(low, half, max(start, low), end, spacing_mm, growth))
    if focus is None:
        z = _uniform(-skin.thickness_mm, 0.0, spacing_mm)
    else:
        # Two equal layers below the face, then growing: strain decays with depth.
        z = _graded(-skin.thickness_mm, 0.0, -2 * spacing_mm, 0.0, spacing_mm, growth)
    return axes[0], axes[1], z


def extruded(plane_mm: Field, quads: NDArray[np.int64], z_mm: Field) -> HexMesh:
    """Extrude quadrilaterals (q, 4) over points (p, 2), counterclockwise, through heights z_mm."""
    p, layers = len(plane_mm), len(z_mm) - 1
    nodes = np.concatenate(
        [np.repeat(plane_mm[None], layers + 1, axis=0), np.empty((layers + 1, p, 1))], axis=2
    )
    nodes[..., 2] = z_mm[:, None]
    low = np.arange(layers)[:, None, None] * p + quads[None]
    cells = np.concatenate([low, low + p], axis=2).reshape(-1, 8)
    return HexMesh(
        nodes_mm=nodes.reshape(-1, 3),
        cells=cells.astype(np.int64),
        touched=np.arange((layers - 1) * len(quads), layers * len(quads)),
        base=np.arange(p),
    )


def _uniform(low: float, high: float, spacing: float) -> Field:
    return np.linspace(low, high, max(1, round((high - low) / spacing)) + 1)


def _graded(
    low: float, high: float, inner_low: float, inner_high: float, spacing: float, growth: float
) -> Field:
    """Points from low to high: equal cells between the inner bounds, growing outside them."""
    a, b = max(low, min(inner_low, high - spacing)), min(high, max(inner_high, low + spacing))
    count = max(1, math.ceil((b - a) / spacing - 1e-9))
    # Widen to a whole number of cells where there is room, so that they have the given size.
    excess = count * spacing - (b - a)
    if a > low and b < high:
        a, b = max(low, a - excess / 2), min(high, b + excess / 2)
    elif b < high:
        b = min(high, b + excess)
    elif a > low:
        a = max(low, a - excess)
    middle = np.linspace(a, b, count + 1)
    lower = a - _growing(a - low, spacing, growth)[::-1]
    upper = b + _growing(high - b, spacing, growth)
    return np.concatenate([lower, middle, upper])


def _growing(length: float, spacing: float, growth: float) -> Field:
    """Distances of points from 0 (excluded) to `length`, their steps growing from `spacing`."""
    if length < 1e-9 * spacing:
        return np.empty(0)
    steps: list[float] = []
    step = spacing
    while sum(steps) < length:
        step = min(step * growth, spacing * MAX_CELL_RATIO)
        steps.append(step)
    # One step fewer where that is nearer; then all are scaled to fit.
    if len(steps) > 1 and length - sum(steps[:-1]) < sum(steps) - length:
        steps.pop()
    points = np.cumsum(steps)
    return points * (length / points[-1])
