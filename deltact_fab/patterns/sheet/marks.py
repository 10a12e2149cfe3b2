"""The elements of a sheet, in printer dots: rectangles, lines of text, and pictures of cells.

Page coordinates are whole printer dots, x to the right and y down from the page's top left corner,
so that every edge is sharp on the printer and rounding errors do not accumulate.
"""

from __future__ import annotations

from dataclasses import dataclass

from ...pdf import width_em
from ...units import POINTS_PER_MM
from ..cell_grid import CellGrid


@dataclass(frozen=True)
class FilledRectangle:
    """A filled rectangle. ink: one byte of grey (black ink alone), or three of RGB."""

    x_px: int
    y_px: int
    width_px: int
    height_px: int
    ink: int | tuple[int, int, int] = 0


@dataclass(frozen=True)
class TextLine:
    """A line in black; (x, y) is the left end of its baseline. ASCII only."""

    x_px: int
    y_px: int
    size_pt: float
    text: str


Mark = FilledRectangle | TextLine | CellGrid


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
