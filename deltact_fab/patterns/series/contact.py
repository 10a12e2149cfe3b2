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
    from ...imaging import ImageSensor, Printer

Pixels = NDArray[np.uint8]

VIEW_MM = 6.0
ZOOM = 2
"""Whole, so that no pixel is resampled; a page shows the sheet at half size."""
BAR_MM = 1.0
GAP_PX = 14
LEFT_PX, TOP_PX = 200, 118
TEXT_PX, LINE_PX = 24, 34
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

    shapes = {view.picture.shape for view in views}
    if len(shapes) != 1:
        raise ValueError(f"views of one size, not {sorted(shapes)}")
    view_px = views[0].picture.shape[0]
    side_px = view_px * ZOOM
    step_px = side_px + GAP_PX
    rows = sorted({view.d_mm for view in views})
    columns = sorted({view.r for view in views})
    foot_px = TOP_PX + len(rows) * step_px
    size = (LEFT_PX + len(columns) * step_px, foot_px + LINE_PX * (len(notes) + 2))
    sheet = Image.new("RGB", size, PAPER)
    draw = ImageDraw.Draw(sheet)

    def text(at: tuple[float, float], words: str, anchor: str = "ls", ink: str = INK) -> None:
        draw.text(at, words, ink, _font(), anchor=anchor)

    text((GAP_PX, LINE_PX), title)
    for j, r in enumerate(columns):
        text((LEFT_PX + j * step_px + side_px / 2, TOP_PX - 12), f"r = {r:g}", "ms")
    for i, d_mm in enumerate(rows):
        text((LEFT_PX - 16, TOP_PX + i * step_px + side_px / 2), f"d = {d_mm:g} mm", "rs")
        for j in range(len(columns)):
            x, y = LEFT_PX + j * step_px, TOP_PX + i * step_px
            draw.rectangle((x, y, x + side_px - 1, y + side_px - 1), EMPTY)
    for view in views:
        x = LEFT_PX + columns.index(view.r) * step_px
        y = TOP_PX + rows.index(view.d_mm) * step_px
        large = view.picture.repeat(ZOOM, axis=0).repeat(ZOOM, axis=1)
        sheet.paste(Image.fromarray(large), (x, y))
        if view.mark:
            x, y = x + side_px, y + side_px
            wide = draw.textlength(view.mark, font=_font()) + 16
            draw.rectangle((x - wide, y - LINE_PX, x - 1, y - 1), PAPER)
            text((x - 8, y - 8), view.mark, "rs")
    long_px = round(BAR_MM / mm_per_px * ZOOM)  # right to half a pixel
    draw.rectangle((LEFT_PX, foot_px + 10, LEFT_PX + long_px - 1, foot_px + 18), INK)
    side_mm = view_px * mm_per_px
    said = (
        f"{BAR_MM:g} mm;  each view {side_mm:.2f} x {side_mm:.2f} mm, "
        f"{view_px} x {view_px} camera pixels of {mm_per_px:g} mm"
    )
    text((LEFT_PX + long_px + 18, foot_px + 22), said)
    for k, note in enumerate(notes, start=1):
        text((LEFT_PX, foot_px + 22 + k * LINE_PX), note, ink=SOFT)
    file = io.BytesIO()
    sheet.save(file, "PNG", compress_level=6)
    return file.getvalue()


def _font() -> Any:
    """Pillow's own face, which is the same on every machine."""
    from PIL import ImageFont

    return ImageFont.load_default(TEXT_PX)
