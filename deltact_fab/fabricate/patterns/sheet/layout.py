"""Layout of a page, in millimetres on the real print.

A page:

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

# By hand: smaller is hard to read, larger leaves less room for stickers. 8 mm of margin clear the
# unprintable edge of most printers; STICKER_PAD_MM is around a sticker, for its ticks and its F.
TEXT_PT, HEAD_PT, LINE_SPACING = 6.0, 7.0, 1.2
FOOTER_MM, LEFT_BAND_MM, PAGE_MARGIN_MM = 6.0, 10.0, 8.0
STICKER_PAD_MM, LABEL_GAP_MM, LABEL_MM = 4.5, 1.6, 28.5  # the last: width of a label's text
QUIET_MM = 1.6
"""Clear space around a QR code: four modules of 0.4 mm (ISO/IEC 18004, 9.1)."""
MODULE_MM = 0.33  # of a QR code, by hand: four dots at 300 dpi; smaller is hard to scan
INSET_MM = 1e-4
"""Inset of the box of a rectangle or picture on each side (decision 0008).

Renderers fill every dot that a picture's box touches. A box that ends exactly at a dot's edge
touches the next dot through rounding, and the picture would grow by one dot and be resampled.
"""


def width_mm(text: str, size_pt: float) -> float:
    """Width of a line of text, mm."""
    return width_em(text) * size_pt / POINTS_PER_MM


def wrapped(words: list[str], room_mm: float, size_pt: float, between: str = "  ") -> list[str]:
    """Join words into lines that fit; a word that is too long gets a line of its own."""
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
    """Paper, printer resolution and scale correction: convert millimetres to marks of a PDF.

    A mark is an operator of the page's content, with every edge at a printer dot. paper_mm: (width,
    height). scale: stretch of the file in (x, y).
    """

    paper_mm: tuple[float, float]
    dpi: float
    scale: tuple[float, float]

    @property
    def pitch_mm(self) -> tuple[float, float]:
        """Size (x, y) of a printer dot on the real print."""
        return (MM_PER_INCH / self.dpi / self.scale[0], MM_PER_INCH / self.dpi / self.scale[1])

    @property
    def page_px(self) -> tuple[int, int]:
        """Page size in whole dots, within half a dot of the paper, so that the grid of dots fits
        from every corner."""
        width_mm, height_mm = self.paper_mm
        return (round(width_mm * self.dpi / MM_PER_INCH), round(height_mm * self.dpi / MM_PER_INCH))

    @property
    def size_mm(self) -> tuple[float, float]:
        """Page size, mm of the real print."""
        return (self.page_px[0] * self.pitch_mm[0], self.page_px[1] * self.pitch_mm[1])

    @property
    def size_pt(self) -> tuple[float, ...]:
        """Page size in points, rounded down: renderers count a fraction of a dot as one more."""
        return tuple(int(side * 72 / self.dpi * 1e5) / 1e5 for side in self.page_px)

    def x_px(self, x_mm: float) -> int:
        """Nearest dot along x."""
        return round(x_mm / self.pitch_mm[0])

    def y_px(self, y_mm: float) -> int:
        """Nearest dot along y."""
        return round(y_mm / self.pitch_mm[1])

    def box(
        self,
        x_mm: float,
        y_mm: float,
        w_mm: float,
        h_mm: float,
        ink: int | tuple[int, int, int] = 0,
    ) -> str:
        """Box with every edge at its nearest dot, at least a dot wide; ink as in `rectangle`."""
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
        """Filled rectangle. ink: one byte of grey (black ink only), or three of RGB."""
        values = (ink,) if isinstance(ink, int) else ink
        fill = f"{' '.join(figure(v / 255) for v in values)} {'g' if len(values) == 1 else 'rg'}"
        return f"{fill} {' '.join(self._place(x_px, y_px, width_px, height_px))} re f"

    def picture(self, x_px: int, y_px: int, picture: CellGrid, number: int) -> str:
        """Picture, one pixel per printer dot; number: its object in the file."""
        x, y, width, height = self._place(x_px, y_px, picture.width_px, picture.height_px)
        return f"q {width} 0 0 {height} {x} {y} cm /I{number} Do Q"

    def text_line(self, x_mm: float, y_mm: float, text: str, size_pt: float = TEXT_PT) -> str:
        """Line of black ASCII text; x_mm, y_mm: left end of its baseline."""
        x, y = (figure(v) for v in self._to_points(self.x_px(x_mm), self.y_px(y_mm)))
        return f"BT 0 g /F {figure(size_pt)} Tf {x} {y} Td <{glyphs(text)}> Tj ET"

    def _place(self, x_px: int, y_px: int, width_px: int, height_px: int) -> list[str]:
        """Left, lower edge, width and height in points, less the inset on each side."""
        inset = INSET_MM * POINTS_PER_MM
        x, y = self._to_points(x_px, y_px + height_px)
        sides = (px * 72 / self.dpi - 2 * inset for px in (width_px, height_px))
        return [figure(v) for v in (x + inset, y + inset, *sides)]

    def _to_points(self, x_px: int, y_px: int) -> tuple[float, float]:
        """Convert dots to points from the lower left corner."""
        return x_px * 72 / self.dpi, self.size_pt[1] - y_px * 72 / self.dpi


@dataclass(frozen=True, eq=False)
class StickerCell:
    """A sticker with its label and code, not yet placed on a page.

    film_mm: sides of the sensor's piece of film. label: lines of text.
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
        """Sides of the cut film: the sensor's, or more if the sticker needs it."""
        x_mm, y_mm = self.film_mm
        least_mm = self.side_mm + 2 * STICKER_PAD_MM
        return (max(x_mm, least_mm), max(y_mm, least_mm))

    @property
    def code_mm(self) -> float:
        """Side of the QR code without quiet zone."""
        return self.code.size_mm[0]

    @property
    def size_mm(self) -> tuple[float, float]:
        """Width and height of the cell with marks and label."""
        label_mm = max(self.code_mm, len(self.label) * line_mm(TEXT_PT))
        code_room_mm = self.code_mm + QUIET_MM
        widest_mm = max(width_mm(line, TEXT_PT) for line in self.label)
        return (
            max(self.cut_mm[0], code_room_mm + widest_mm + 2 * QUIET_MM),
            self.cut_mm[1] + LABEL_GAP_MM + label_mm + QUIET_MM,
        )


@dataclass(frozen=True)
class CellPlace:
    """Position of a cell: page from 0, top left corner, mm."""

    cell: int
    page: int
    x_mm: float
    y_mm: float


def line_mm(size_pt: float) -> float:
    """Distance of baselines, mm."""
    return size_pt * LINE_SPACING * MM_PER_INCH / 72


def place_cells(
    sheet: Sheet, cells: Sequence[StickerCell], names: Sequence[str], top_mm: float
) -> list[CellPlace]:
    """Place cells row by row on as many pages as needed; InputError for a cell too large."""
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
                f"{names[i]}: {cell.side_mm:g} mm do not fit on the paper with marks and label, "
                f"at most {max(0, math.floor(side_mm))} mm: use a larger --paper"
            )
        if x_mm + wide_mm > x1 + 1e-9:
            x_mm, y_mm, row_mm = x0, y_mm + row_mm, 0.0
        if y_mm + high_mm > y1 + 1e-9:
            page, x_mm, y_mm, row_mm = page + 1, x0, top_mm, 0.0
        places.append(CellPlace(i, page, x_mm, y_mm))
        x_mm, row_mm = x_mm + wide_mm, max(row_mm, high_mm)
    return places
