"""The contact sheet: patterns side by side as the camera would see them, at one magnification.

d \\ r     0.1      0.3      0.4  ...
0.05             .--------.
                 |        |             one view a pattern, cut from the middle of the image;
0.075            '--------'             a camera pixel is a square of `ZOOM` pixels
 ...
          |----| 1 mm
"""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..quality.measure import MM_PER_PX
from ..quality.photo import photograph, sent
from ..recipe import PatternRecipe

if TYPE_CHECKING:
    from PIL.ImageDraw import ImageDraw

    from ...imaging import ImageSensor, Printer

Pixels = NDArray[np.uint8]

VIEW_MM = 6.0
ZOOM = 2
"""Whole, so that no pixel is resampled; a page shows the sheet at half size."""
BAR_MM = 1.0
GAP_PX = 14
LEFT_PX = 150
TOP_PX = 118
FOOT_PX = 64
TITLE_PX, HEAD_PX, TEXT_PX = 32, 28, 24
INK, SOFT, EMPTY, PAPER = "#1d2330", "#5b6475", "#f0f2f6", "#ffffff"


@dataclass(frozen=True, eq=False)
class Tile:
    """One pattern's picture, (h, h, 3) uint8 RGB, and where it stands; mark: a word below r."""

    d_mm: float
    r: float
    picture: Pixels
    mark: str = ""


def view(recipe: PatternRecipe, printer: Printer, sensor: ImageSensor, seed: int) -> Pixels:
    """The middle of the camera's image of a sticker at rest, (h, h, 3) uint8 RGB; simulated.

    h: VIEW_MM, or what the sticker has of it, in whole pairs of pixels. seed: of halftone,
    misregistration and noise.
    """
    side_px = 2 * round(min(VIEW_MM, recipe.printed_mm) / MM_PER_PX / 2)
    side_mm = side_px * MM_PER_PX
    rng = np.random.default_rng([seed, 1])
    values = sent(recipe, printer.dpi, (side_mm, side_mm)).astype(np.float32) / np.float32(255)
    printed = printer.print_(values, rng)
    return photograph(printed, printer.mm_per_dot, sensor, MM_PER_PX, (side_px, side_px), rng)


def png(views: Sequence[Tile], mm_per_px: float, title: str, notes: Sequence[str]) -> bytes:
    """The views in a grid, d down and r to the right, as PNG; equal views give equal bytes.

    mm_per_px: of a view. title, notes: what the sheet says above and below. All views are of one
    size (ValueError else).
    """
    from PIL import Image, ImageDraw
    from PIL.PngImagePlugin import PngInfo

    shapes = {view.picture.shape for view in views}
    if len(shapes) != 1:
        raise ValueError(f"views of one size, not {sorted(shapes)}")
    side_px = views[0].picture.shape[0] * ZOOM
    rows = sorted({view.d_mm for view in views})
    columns = sorted({view.r for view in views})
    step_px = side_px + GAP_PX
    foot_px = FOOT_PX + line_px(TEXT_PX) * len(notes)
    size = (LEFT_PX + len(columns) * step_px, TOP_PX + len(rows) * step_px + foot_px)
    sheet = Image.new("RGB", size, PAPER)
    draw = ImageDraw.Draw(sheet)
    draw.text((GAP_PX, 12), title, INK, _font(TITLE_PX))
    for j, r in enumerate(columns):
        _text(draw, (LEFT_PX + j * step_px + side_px / 2, TOP_PX - 12), f"r = {r:g}", HEAD_PX, "ms")
    for i, d_mm in enumerate(rows):
        middle = TOP_PX + i * step_px + side_px / 2
        _text(draw, (LEFT_PX - 16, middle - 4), f"d = {d_mm:g}", HEAD_PX, "rs")
        _text(draw, (LEFT_PX - 16, middle + 4), "mm", HEAD_PX, "ra", SOFT)
    held = {(view.d_mm, view.r): view for view in views}
    for i, d_mm in enumerate(rows):
        for j, r in enumerate(columns):
            x, y = LEFT_PX + j * step_px, TOP_PX + i * step_px
            view = held.get((d_mm, r))
            if view is None:
                draw.rectangle((x, y, x + side_px - 1, y + side_px - 1), EMPTY)
                centre = (x + side_px / 2, y + side_px / 2)
                _text(draw, centre, "not in the series", TEXT_PX, "mm", SOFT)
                continue
            large = view.picture.repeat(ZOOM, axis=0).repeat(ZOOM, axis=1)
            sheet.paste(Image.fromarray(large), (x, y))
            if view.mark:
                _tag(draw, (x + side_px, y + side_px), view.mark)
    _foot(draw, (LEFT_PX, size[1] - foot_px), mm_per_px, views[0].picture.shape[0], notes)
    said = PngInfo()
    said.add_text("Title", title)
    file = io.BytesIO()
    sheet.save(file, "PNG", compress_level=6, pnginfo=said)
    return file.getvalue()


def line_px(size_px: int) -> int:
    """Height of a line of text."""
    return round(1.35 * size_px)


def bar_px(mm_per_px: float) -> int:
    """Length of the scale bar on the sheet, in whole pixels: right to half a pixel."""
    return round(BAR_MM / mm_per_px * ZOOM)


def _foot(
    draw: ImageDraw, at: tuple[int, int], mm_per_px: float, view_px: int, notes: Sequence[str]
) -> None:
    """The scale bar, what it and a view measure, and the notes."""
    x, y = at[0], at[1] + 14
    long_px = bar_px(mm_per_px)
    draw.rectangle((x, y, x + long_px - 1, y + 7), INK)
    for end in (x, x + long_px - 3):
        draw.rectangle((end, y - 6, end + 2, y + 13), INK)
    side_mm = view_px * mm_per_px
    said = (
        f"{BAR_MM:g} mm;  each view {side_mm:.2f} x {side_mm:.2f} mm, "
        f"{view_px} x {view_px} camera pixels of {mm_per_px:g} mm"
    )
    _text(draw, (x + long_px + 18, y + 4), said, TEXT_PX, "lm")
    for k, note in enumerate(notes):
        top = y + 30 + k * line_px(TEXT_PX)
        _text(draw, (x, top), note, TEXT_PX, "la", SOFT)


def _tag(draw: ImageDraw, corner: tuple[int, int], words: str) -> None:
    """Words on a plain ground in a view's lower right corner."""
    x, y = corner
    wide = draw.textlength(words, font=_font(TEXT_PX)) + 16
    draw.rectangle((x - wide, y - line_px(TEXT_PX) - 2, x - 1, y - 1), PAPER)
    _text(draw, (x - 8, y - 8), words, TEXT_PX, "rs")


def _text(
    draw: ImageDraw,
    at: tuple[float, float],
    words: str,
    size_px: int,
    anchor: str,
    ink: str = INK,
) -> None:
    draw.text(at, words, ink, _font(size_px), anchor=anchor)


def _font(size_px: int) -> Any:
    """Pillow's own face, which is the same on every machine."""
    from PIL import ImageFont

    return ImageFont.load_default(size_px)
