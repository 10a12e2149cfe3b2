"""Marks as pages of a PDF: rectangles, text and pictures at exact printer dots, lossless.

A picture has one pixel per printer dot, so a printer at the sheet's resolution does not resample
it.
"""

from __future__ import annotations

import zlib
from collections.abc import Iterable, Sequence

from ...pdf import Document, figure, glyphs
from ...units import POINTS_PER_MM
from ..cell_grid import CellGrid
from .layout import FilledRectangle, Mark, TextLine

INSET_MM = 1e-4
"""By which a picture's box is smaller on each side than its place.

Renderers fill every dot that a picture's box touches. A box that ends exactly at a dot's edge
touches the next dot through rounding, and the picture would grow by one dot and be resampled.
"""


class Pdf:
    """Pages of marks, collected and then written by `finish`.

    page_px: size in printer dots; dpi: dots an inch.
    """

    def __init__(self, page_px: tuple[int, int], dpi: float):
        self._dpi = dpi
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
        space = "/DeviceRGB" if picture.cells.ndim == 3 else "/DeviceGray"
        opening = (
            f"<< /Type /XObject /Subtype /Image /Width {picture.width_px} "
            f"/Height {picture.height_px} /ColorSpace {space} /BitsPerComponent 8 "
            "/Interpolate false /Filter /FlateDecode"
        )
        deflate = zlib.compressobj()
        packed = [deflate.compress(band.tobytes()) for band in picture.bands()]
        number = self._file.stream(opening, b"".join([*packed, deflate.flush()]))
        self._images[picture.key] = number
        return number

    def _placed(self, picture: CellGrid, number: int) -> str:
        left, low, wide, high = self._place(picture)
        return f"q {wide} 0 0 {high} {left} {low} cm /I{number} Do Q"

    def _box(self, box: FilledRectangle) -> str:
        ink = (
            f"{figure(box.ink / 255)} g"
            if isinstance(box.ink, int)
            else " ".join(figure(v / 255) for v in box.ink) + " rg"
        )
        return f"{ink} {' '.join(self._place(box))} re f"

    def _place(self, mark: CellGrid | FilledRectangle) -> list[str]:
        """Left, lower edge, width and height in points, less the inset on each side."""
        inset = INSET_MM * POINTS_PER_MM
        left, low = self._at(mark.x_px, mark.y_px + mark.height_px)
        sides = (px * 72 / self._dpi - 2 * inset for px in (mark.width_px, mark.height_px))
        return [figure(v) for v in (left + inset, low + inset, *sides)]

    def _words(self, words: TextLine) -> str:
        x, y = (figure(v) for v in self._at(words.x_px, words.y_px))
        return f"BT 0 g /F {figure(words.size_pt)} Tf {x} {y} Td <{glyphs(words.text)}> Tj ET"

    def _at(self, x_px: float, y_px: float) -> tuple[float, float]:
        """A place in points from the lower left corner."""
        return x_px * 72 / self._dpi, self._size_pt[1] - y_px * 72 / self._dpi
