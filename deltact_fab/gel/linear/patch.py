"""The part of a face on which contact can be, and where its nodes are from the indenter's tip."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ...aliases import Field, Mask, Point
from ...elasticity.block import BlockWindow, FreeBlock
from ...errors import SolverError
from ...shapes import Indenter

MARGIN = 3  # nodes around those below the indenter


@dataclass
class Patch:
    """The part of the grid that a solve works on, and the height field above it."""

    rows: slice
    columns: slice
    x_mm: Field  # (my, mx), node positions relative to the tip
    y_mm: Field
    indenter: Indenter
    operator: BlockWindow

    def height_mm(self, shift_mm: Field) -> Field:
        """Height above the nodes where they are after an in-plane shift (2, my, mx)."""
        return self.indenter.height_mm(self.x_mm + shift_mm[0], self.y_mm + shift_mm[1])


def patch_below(
    face: FreeBlock, indenter: Indenter, tip: Point, grow_mm: float, shift_mm: Field
) -> Patch:
    """Nodes that can come into contact: those below the indenter's underside, and a margin.

    grow_mm: of the depth within which a node counts as below. shift_mm: as in `footprint`.
    Raises SolverError where a tip of the indenter meets no node.
    """
    x, y, depth = tip
    rows, columns, xx, yy = footprint(face, indenter, tip, shift_mm)
    height = indenter.height_mm(xx, yy)
    for t in indenter.tips:
        at_x, at_y = t.lowest_mm
        if not np.any((np.hypot(xx - at_x, yy - at_y) <= t.radius_mm) & (height < depth)):
            raise SolverError(
                f"contact: {indenter.name} at depth {depth:g} mm touches no grid node; "
                f"a spacing below {face.spacing_mm[0]:g} mm or more depth is needed"
            )
    near: Mask = height < depth + grow_mm
    rows = _widened(rows, np.logical_or.reduce(near, axis=1), face.shape[0])
    columns = _widened(columns, np.logical_or.reduce(near, axis=0), face.shape[1])
    xx, yy = np.meshgrid(face.x_mm[columns] - x, face.y_mm[rows] - y)
    operator = face.window(
        rows.stop - rows.start, columns.stop - columns.start, rows.start, columns.start
    )
    return Patch(rows, columns, xx, yy, indenter, operator)


def footprint(
    face: FreeBlock, indenter: Indenter, tip: Point, shift_mm: Field
) -> tuple[slice, slice, Field, Field]:
    """Rows and columns below the whole indenter, and their positions (my, mx) from the tip.

    shift_mm (ny, nx, 2): of the nodes in plane.
    """
    slack = float(np.abs(shift_mm).max())
    half_x, half_y = indenter.footprint_half_mm
    columns = span(np.abs(face.x_mm - tip[0]) <= half_x + slack)
    rows = span(np.abs(face.y_mm - tip[1]) <= half_y + slack)
    xx, yy = np.meshgrid(face.x_mm[columns] - tip[0], face.y_mm[rows] - tip[1])
    xx, yy = xx + shift_mm[rows, columns, 0], yy + shift_mm[rows, columns, 1]
    return rows, columns, xx, yy


def span(which: Mask) -> slice:
    """The slice from the first to the last True."""
    found = np.flatnonzero(which)
    return slice(int(found[0]), int(found[-1]) + 1) if found.size else slice(0, 0)


def _widened(within: slice, which: Mask, n: int) -> slice:
    """The span of `which` inside `within`, with a margin and a size rounded up to 8 nodes.

    Rounded sizes let a sliding contact reuse one window operator.
    """
    near = span(which)
    start, stop = within.start + near.start - MARGIN, within.start + near.stop + MARGIN
    size = min(n, 8 * math.ceil((stop - start) / 8))
    start = min(max(0, start - (size - (stop - start)) // 2), n - size)
    return slice(start, start + size)
