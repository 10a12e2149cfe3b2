"""Where things are placed on a page, in millimetres on the real print.

A page, as it is read:

         header: how to print, which transfer
         |....|....| ruler in x, 100 mm
         [K][C][M][Y][R]...   inks, pairs, greys
     _   .           ..           .            corners of the film, where it is cut
     |    F'-----'     F'-----'                F: mark of the corner (-x, -y), beside the pattern
     |     |     |      |     |                sticker, with ticks along its edges
     |     '-----'      '-----'
     |   '           ''           '
     _    [QR] law, d, r ...                   never mirrored
         footer

Everything is placed at whole printer dots, x to the right and y down from the page's top left
corner, so that every edge is sharp on the printer and rounding errors do not accumulate. With a
scale correction, lengths here are those on the paper; those in the file are longer by the scale.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from deltact_fab.common import MM_PER_INCH, InputError

from ...pdf import POINTS_PER_MM, figure, glyphs, width_em
from ..cell_grid import CellGrid

PAPERS_MM = {
    "A5": (148.0, 210.0),
    "A4": (210.0, 297.0),
    "A3": (297.0, 420.0),
    "A2": (420.0, 594.0),
    "SRA3": (320.0, 450.0),
    "Letter": (215.9, 279.4),
    "Legal": (215.9, 355.6),
    "Tabloid": (279.4, 431.8),
}
"""Width and height in mm (ISO 216, ISO 217, ANSI/ASME Y14.1)."""

TEXT_PT = 6.0
HEAD_PT = 7.0
LINE_SPACING = 1.2
FOOTER_MM = 6.0
LEFT_BAND_MM = 10.0
PAGE_MARGIN_MM = 8.0
"""Left blank around a page."""
STICKER_PAD_MM = 4.5
"""Least margin around a sticker, for its ticks and its F."""
LABEL_GAP_MM = 1.6
QUIET_MM = 1.6
"""Clear space around a QR code: four modules of 0.4 mm (ISO/IEC 18004, 9.1)."""
MODULE_MM = 0.33
LABEL_MM = 28.5
"""Width of a label's text beside its QR code."""
INSET_MM = 1e-4
"""By which the box of a rectangle or picture is smaller on each side than its place.

Renderers fill every dot that a picture's box touches. A box that ends exactly at a dot's edge
touches the next dot through rounding, and the picture would grow by one dot and be resampled.
"""


def width_mm(text: str, size_pt: float) -> float:
    """Width of a line in mm."""
    return width_em(text) * size_pt / POINTS_PER_MM


def wrapped(words: list[str], room_mm: float, size_pt: float, between: str = "  ") -> list[str]:
    """Words joined into lines that fit; a word that is too long stands alone on its line."""
    lines: list[str] = []
    for word in words:
        longer = f"{lines[-1]}{between}{word}" if lines else word
        if lines and width_mm(longer, size_pt) <= room_mm:
            lines[-1] = longer
        else:
            lines.append(word)
    return lines


@dataclass(frozen=True)
class Sheet:
    """The paper, the printer's resolution and the scale correction: millimetres to marks of a PDF.

    A mark is an operator of the page's content, with every edge at a printer dot. paper_mm: (width,
    height); scale: (x, y) by which the file is stretched.
    """

    paper_mm: tuple[float, float]
    dpi: float
    scale: tuple[float, float]

    @property
    def pitch_mm(self) -> tuple[float, float]:
        """A printer dot's size (x, y) on the real print."""
        return (MM_PER_INCH / self.dpi / self.scale[0], MM_PER_INCH / self.dpi / self.scale[1])

    @property
    def page_px(self) -> tuple[int, int]:
        """The page in whole dots, within half a dot of the paper's size, so that every corner lies
        on the grid of dots, whichever one a printer counts from."""
        width_mm, height_mm = self.paper_mm
        return (round(width_mm * self.dpi / MM_PER_INCH), round(height_mm * self.dpi / MM_PER_INCH))

    @property
    def size_mm(self) -> tuple[float, float]:
        """The page in millimetres of the real print."""
        return (self.page_px[0] * self.pitch_mm[0], self.page_px[1] * self.pitch_mm[1])

    @property
    def size_pt(self) -> tuple[float, ...]:
        """The page in points; rounded down, for a renderer counts a dot's fraction as one more."""
        return tuple(int(side * 72 / self.dpi * 1e5) / 1e5 for side in self.page_px)

    def x_px(self, x_mm: float) -> int:
        """The nearest dot to a place along x."""
        return round(x_mm / self.pitch_mm[0])

    def y_px(self, y_mm: float) -> int:
        """The nearest dot to a place along y."""
        return round(y_mm / self.pitch_mm[1])

    def box(
        self,
        x_mm: float,
        y_mm: float,
        w_mm: float,
        h_mm: float,
        ink: int | tuple[int, int, int] = 0,
    ) -> str:
        """A box with every edge at its nearest dot, at least a dot wide; ink: as of `rectangle`."""
        x_px, y_px = self.x_px(x_mm), self.y_px(y_mm)
        width_px, height_px = self.x_px(x_mm + w_mm) - x_px, self.y_px(y_mm + h_mm) - y_px
        return self.rectangle(x_px, y_px, max(1, width_px), max(1, height_px), ink)

    def rectangle(
        self,
        x_px: int,
        y_px: int,
        width_px: int,
        height_px: int,
        ink: int | tuple[int, int, int] = 0,
    ) -> str:
        """A filled one. ink: one byte of grey (black ink alone), or three of RGB."""
        values = (ink,) if isinstance(ink, int) else ink
        fill = f"{' '.join(figure(v / 255) for v in values)} {'g' if len(values) == 1 else 'rg'}"
        return f"{fill} {' '.join(self._place(x_px, y_px, width_px, height_px))} re f"

    def picture(self, x_px: int, y_px: int, picture: CellGrid, number: int) -> str:
        """A picture, one pixel a printer dot; number: of its object in the file."""
        x, y, width, height = self._place(x_px, y_px, picture.width_px, picture.height_px)
        return f"q {width} 0 0 {height} {x} {y} cm /I{number} Do Q"

    def words(self, x_mm: float, y_mm: float, text: str, size_pt: float = TEXT_PT) -> str:
        """A line of text in black, ASCII only, with its baseline's left end at a place."""
        x, y = (figure(v) for v in self._to_points(self.x_px(x_mm), self.y_px(y_mm)))
        return f"BT 0 g /F {figure(size_pt)} Tf {x} {y} Td <{glyphs(text)}> Tj ET"

    def _place(self, x_px: int, y_px: int, width_px: int, height_px: int) -> list[str]:
        """Left, lower edge, width and height in points, less the inset on each side."""
        inset = INSET_MM * POINTS_PER_MM
        x, y = self._to_points(x_px, y_px + height_px)
        sides = (px * 72 / self.dpi - 2 * inset for px in (width_px, height_px))
        return [figure(v) for v in (x + inset, y + inset, *sides)]

    def _to_points(self, x_px: int, y_px: int) -> tuple[float, float]:
        """A place in points from the lower left corner."""
        return x_px * 72 / self.dpi, self.size_pt[1] - y_px * 72 / self.dpi


@dataclass(frozen=True, eq=False)
class StickerCell:
    """A sticker with its label and code, not yet placed on a page.

    film_mm: sides of the piece of film that the sensor takes. label: lines of text.
    """

    film_mm: tuple[float, float]
    sticker: CellGrid
    code: CellGrid
    label: tuple[str, ...]

    @property
    def side_mm(self) -> float:
        """Side of the printed square."""
        return self.sticker.size_mm[0]

    @property
    def cut_mm(self) -> tuple[float, float]:
        """Sides of the film as it is cut: the sensor's, or more where the sticker needs more."""
        x_mm, y_mm = self.film_mm
        least_mm = self.side_mm + 2 * STICKER_PAD_MM
        return (max(x_mm, least_mm), max(y_mm, least_mm))

    @property
    def code_mm(self) -> float:
        """Side of the QR code with no clear space."""
        return self.code.size_mm[0]

    @property
    def size_mm(self) -> tuple[float, float]:
        """Width and height of the cell, marks and label included."""
        label_mm = max(self.code_mm, len(self.label) * line_mm(TEXT_PT))
        beside_mm = self.code_mm + QUIET_MM
        widest_mm = max(width_mm(line, TEXT_PT) for line in self.label)
        return (
            max(self.cut_mm[0], beside_mm + widest_mm + 2 * QUIET_MM),
            self.cut_mm[1] + LABEL_GAP_MM + label_mm + QUIET_MM,
        )


@dataclass(frozen=True)
class CellPlace:
    """Where a cell stands: page from 0, and the cell's top left corner in mm."""

    cell: int
    page: int
    x_mm: float
    y_mm: float


def line_mm(size_pt: float) -> float:
    """From one baseline to the next."""
    return size_pt * LINE_SPACING * MM_PER_INCH / 72


def place_cells(
    sheet: Sheet, cells: Sequence[StickerCell], names: Sequence[str], top_mm: float
) -> list[CellPlace]:
    """Cells row by row on as many pages as they take, in the order given.

    Raises InputError for a cell that no page can hold.
    """
    width, height = sheet.size_mm
    x0 = PAGE_MARGIN_MM + LEFT_BAND_MM
    x1, y1 = width - PAGE_MARGIN_MM, height - PAGE_MARGIN_MM - FOOTER_MM
    places: list[CellPlace] = []
    page, x_mm, y_mm, row_mm = 0, x0, top_mm, 0.0
    for i, cell in enumerate(cells):
        wide_mm, high_mm = cell.size_mm
        if wide_mm > x1 - x0 or high_mm > y1 - top_mm:
            side_mm = min(
                x1 - x0 - (wide_mm - cell.side_mm), y1 - top_mm - (high_mm - cell.side_mm)
            )
            raise InputError(
                f"{names[i]}: {cell.side_mm:g} mm do not fit on the paper with marks and label; "
                f"it has room for {max(0, math.floor(side_mm))} mm: use a larger --paper"
            )
        if x_mm + wide_mm > x1 + 1e-9:
            x_mm, y_mm, row_mm = x0, y_mm + row_mm, 0.0
        if y_mm + high_mm > y1 + 1e-9:
            page, x_mm, y_mm, row_mm = page + 1, x0, top_mm, 0.0
        places.append(CellPlace(i, page, x_mm, y_mm))
        x_mm, row_mm = x_mm + wide_mm, max(row_mm, high_mm)
    return places
