"""Marks as the pages of a PDF: boxes, words and pictures at exact printer dots, lossless.

A picture is embedded in one of two ways. With one pixel a cell, the printer draws the cells at
exact millimetres; viewers smooth cells of less than about five dots. With one pixel a printer dot,
the edges are already on the grid, and at the sheet's resolution nothing is left to resample.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from ...pdf import Document, figure, glyphs
from ...units import POINTS_PER_MM
from ..cell_grid import CellGrid
from .marks import FilledRectangle, Mark, TextLine
from .pixels import NONE, SUB, packed

INSET_MM = 1e-4
"""By which a picture's box is smaller on each side than its place.

Renderers take every dot that a picture's box touches, and a box that ends exactly on a dot's edge
touches the next one by rounding: the picture would grow by a dot and be resampled.
"""

MIN_DOTS = 5.0
"""Printer dots a cell from which one pixel a cell is right in every renderer tried."""


class Pdf:
    """Pages of marks, collected and then written by `finish`.

    page_px: size in printer dots; dpi: dots an inch. least_dots: printer dots a cell from which a
    picture is embedded with one pixel a cell.
    """

    def __init__(self, page_px: tuple[int, int], dpi: float, least_dots: float = MIN_DOTS):
        self._dpi = dpi
        self._least_dots = least_dots
        # Rounded down: a renderer counts a dot's fraction at the page's edge as one more
        self._size_pt = tuple(int(side * 72 / dpi * 1e5) / 1e5 for side in page_px)
        self._file = Document()
        self._images: dict[str, int] = {}

    def page(self, marks: Iterable[Mark]) -> None:
        """Add a page."""
        content: list[str] = []
        used: dict[str, int] = {}
        for mark in marks:
            if isinstance(mark, FilledRectangle):
                content.append(self._box(mark))
            elif isinstance(mark, TextLine):
                content.append(self._words(mark))
            else:
                number = self._image(mark)
                used[f"I{number}"] = number
                content.append(self._placed(mark, number))
        self._file.page(self._size_pt, "\n".join(content), used)

    def finish(self, title: str, producer: str, keywords: Sequence[str]) -> bytes:
        """The file."""
        return self._file.finish(title, producer, keywords)

    def _image(self, picture: CellGrid) -> int:
        if picture.key in self._images:
            return self._images[picture.key]
        if picture.by_cells(self._least_dots):
            small = picture.small()
            height, width = small.shape[:2]
            data = b"".join(packed([small], NONE))
        else:
            height, width = picture.height_px, picture.width_px
            data = b"".join(packed(picture.bands(), SUB))
        colours = 3 if picture.cells.ndim == 3 else 1
        space = "/DeviceRGB" if colours == 3 else "/DeviceGray"
        opening = (
            f"<< /Type /XObject /Subtype /Image /Width {width} /Height {height} "
            f"/ColorSpace {space} /BitsPerComponent 8 /Interpolate false /Filter /FlateDecode "
            f"/DecodeParms << /Predictor 15 /Colors {colours} /BitsPerComponent 8 "
            f"/Columns {width} >>"
        )
        number = self._images[picture.key] = self._file.stream(opening, data)
        return number

    def _placed(self, picture: CellGrid, number: int) -> str:
        inset = INSET_MM * POINTS_PER_MM
        if picture.by_cells(self._least_dots):
            # The file is longer than the real print by the scale, as the pitch is shorter
            width, height = (
                size_mm / pitch_mm
                for size_mm, pitch_mm in zip(picture.size_mm, picture.pitch_mm, strict=True)
            )
        else:
            width, height = picture.width_px, picture.height_px
        left, low = self._at(picture.x_px, picture.y_px + height)
        sides = (side * 72 / self._dpi - 2 * inset for side in (width, height))
        wide, high = (figure(side) for side in sides)
        return (
            f"q {wide} 0 0 {high} {figure(left + inset)} {figure(low + inset)} cm /I{number} Do Q"
        )

    def _box(self, box: FilledRectangle) -> str:
        # A box's edges are kept off the dots' edges by the same inset
        left, low = self._at(box.x_px, box.y_px + box.height_px)
        inset = INSET_MM * POINTS_PER_MM
        wide, high = (s * 72 / self._dpi - 2 * inset for s in (box.width_px, box.height_px))
        ink = (
            f"{figure(box.ink / 255)} g"
            if isinstance(box.ink, int)
            else " ".join(figure(v / 255) for v in box.ink) + " rg"
        )
        place = " ".join(figure(v) for v in (left + inset, low + inset, wide, high))
        return f"{ink} {place} re f"

    def _words(self, words: TextLine) -> str:
        x, y = (figure(v) for v in self._at(words.x_px, words.y_px))
        return f"BT 0 g /F {figure(words.size_pt)} Tf {x} {y} Td <{glyphs(words.text)}> Tj ET"

    def _at(self, x_px: float, y_px: float) -> tuple[float, float]:
        """A place in points from the lower left corner."""
        return x_px * 72 / self._dpi, self._size_pt[1] - y_px * 72 / self._dpi
