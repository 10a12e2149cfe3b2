"""What stands on a sheet, in printer dots: boxes, words, and pictures of cells.

Page coordinates are whole printer dots, x to the right and y down from the page's top left corner,
so that every edge is sharp on the printer and no rounding adds up.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

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


def printable(text: str) -> str:
    """The text with every character that the font table lacks shown as `?`."""
    return "".join(c if 32 <= ord(c) <= 126 else "?" for c in text)


def grey_bytes(band: NDArray[Any]) -> NDArray[np.uint8]:
    """(rows, width) grey to (rows, width, 3); RGB stays."""
    return np.asarray(band if band.ndim == 3 else band[..., None].repeat(3, axis=2), np.uint8)
