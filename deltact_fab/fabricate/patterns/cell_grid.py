"""A sticker or QR code in printer dots: coloured cells on a grid, markers on top."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from . import dots
from .recipe import DotGrid

BAND_ROWS = 128
"""Rows of an image in memory at a time; by hand: more costs memory, fewer costs time."""


@dataclass(frozen=True, eq=False)
class CellGrid:
    """Coloured cells on a grid.

    cells: (rows, columns, 3) RGB or (rows, columns) grey, uint8, unmirrored. mirrored: printed
    with left and right exchanged, dots included. size_mm: true size (x, y). pitch_mm: size (x, y)
    of a printer dot on the real print. grid: marker dots on top.
    """

    key: str
    """Equal for equal pixels, which a file holds once."""
    cells: NDArray[np.uint8]
    size_mm: tuple[float, float]
    pitch_mm: tuple[float, float]
    mirrored: bool = False
    grid: DotGrid | None = None

    @cached_property
    def columns_px(self) -> NDArray[np.int64]:
        """Edges of the columns from 0, before mirroring, (columns + 1,)."""
        return snap_edges(self.cells.shape[1], self.size_mm[0], self.pitch_mm[0])

    @cached_property
    def rows_px(self) -> NDArray[np.int64]:
        """Edges of the rows from 0, (rows + 1,)."""
        return snap_edges(self.cells.shape[0], self.size_mm[1], self.pitch_mm[1])

    @property
    def width_px(self) -> int:
        """Printer dots across."""
        return int(self.columns_px[-1])

    @property
    def height_px(self) -> int:
        """Printer dots down."""
        return int(self.rows_px[-1])

    @property
    def snap_error_mm(self) -> float:
        """Largest distance of a snapped edge from its true position about the centre, mm."""
        worst_mm = 0.0
        for axis, edges_px in enumerate((self.columns_px, self.rows_px)):
            true_mm = edges_mm(len(edges_px) - 1, self.size_mm[axis])
            found_mm = (edges_px - edges_px[-1] / 2) * self.pitch_mm[axis]
            worst_mm = max(worst_mm, float(np.abs(found_mm - true_mm).max()))
        return worst_mm

    def rows(self, first: int, stop: int) -> NDArray[np.uint8]:
        """Render rows first to stop as printed, (stop - first, width[, 3])."""
        cell_row = np.searchsorted(self.rows_px, np.arange(first, stop), "right") - 1
        cells = self.cells[cell_row[0] : cell_row[-1] + 1]
        band = cells.repeat(np.diff(self.columns_px), axis=1)[cell_row - cell_row[0]]
        if self.grid is not None:
            self._stamp(band, first, stop)
        return band[:, ::-1] if self.mirrored else band

    def bands(self) -> Iterator[NDArray[np.uint8]]:
        """Yield all rows as printed, in bands."""
        for first in range(0, self.height_px, BAND_ROWS):
            yield self.rows(first, min(first + BAND_ROWS, self.height_px))

    def _stamp(self, band: NDArray[np.uint8], first: int, stop: int) -> None:
        """Colour every printer dot whose centre lies in a marker, without blending."""
        assert self.grid is not None
        radius_mm = self.grid.diameter_mm / 2
        pitch_x_mm, pitch_y_mm = self.pitch_mm
        at_px = self.grid.centres_mm() / np.array(self.pitch_mm)
        at_px += (np.array([self.width_px, self.height_px]) - 1) / 2
        for x, y in at_px:
            rows, dy_mm = dots.covered_px(stop - first, y - first, radius_mm, pitch_y_mm)
            columns, dx_mm = dots.covered_px(self.width_px, x, radius_mm, pitch_x_mm)
            inked = dx_mm[None, :] ** 2 + dy_mm[:, None] ** 2 <= radius_mm**2
            band[rows, columns][inked] = self.grid.rgb


def snap_edges(count: int, size_mm: float, pitch_mm: float) -> NDArray[np.int64]:
    """Snap the edges of equal cells to printer dots, from 0, (count + 1,)."""
    side_px = max(1, round(size_mm / pitch_mm))
    edges_px = np.floor(edges_mm(count, size_mm) / pitch_mm + side_px / 2 + 0.5)
    return np.asarray(edges_px, np.int64)


def edges_mm(count: int, size_mm: float) -> NDArray[np.float64]:
    """Edges of equal cells from -size / 2 to size / 2, (count + 1,)."""
    return np.asarray((np.arange(count + 1) / count - 0.5) * size_mm, np.float64)
