"""What stands on a page: how to print it, marks to check the print with, and stickers.

Rulers and colour patches; a recipe's picture, label and QR code, with ticks, corner mark and the
film's corners. All marks are operators of a PDF, from `layout.Sheet`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from itertools import product

import numpy as np

from deltact_fab.common import InputError
from deltact_fab.version import PACKAGE_VERSION

from ..cell_grid import CellGrid
from ..raster import finest_mm
from ..recipe import PatternRecipe
from .layout import (
    HEAD_PT,
    LABEL_GAP_MM,
    LABEL_MM,
    LEFT_BAND_MM,
    MARGIN_MM,
    MODULE_MM,
    QUIET_MM,
    TEXT_PT,
    Sheet,
    StickerCell,
    line_mm,
    width_mm,
    wrapped,
)

RULER_MM = 100.0
LINE_MM = 0.1
TICK_MM = 3.0
TICK_GAP_MM = 1.0
FILM_CORNER_MM = 4.0
MAX_STICKER_PX = 120_000_000
"""Largest raster of a sticker: some seconds; bands keep its memory small at any size."""


def _instructions(sheet: Sheet, paper: str, transfer: str) -> list[str]:
    """The header's lines."""
    how = {
        "face-down": "Transfer face-down: ink towards the gel. Printed as the camera sees it, not "
        "mirrored.",
        "slide": "Transfer slide: film towards the gel, ink away from it. Stickers are printed "
        "mirrored.",
    }[transfer]
    scale_x, scale_y = sheet.scale
    if sheet.scale == (1.0, 1.0):
        ruler = "if one measures L mm, print again with that axis' scale at 100 / L."
    else:
        ruler = (
            f"scale x {scale_x:g}, y {scale_y:g} is applied to all of the sheet, rulers too. If "
            "one still measures L mm, multiply its scale by 100 / L."
        )
    return [
        f"Pattern stickers, {paper}, {sheet.dpi:g} dpi. Print at 100 % (actual size, no fitting), "
        f"at {sheet.dpi:g} dpi, with no smoothing, sharpening or toner saving.",
        how,
        "Test: looked at from the side that will lie on the gel, every F reads right and stands at "
        "the corner (-x, -y). Cut the film at its corner marks; the ticks point along the edges of "
        "the pattern and are trimmed off with F and margin when it is dry.",
        f"Rulers, left or upper edge of the lines: 100 mm in x and in y; {ruler}",
    ]


def header(sheet: Sheet, paper: str, transfer: str) -> tuple[list[str], float]:
    """Header, rulers, colour patches; and where the stickers begin (y, mm)."""
    left = MARGIN_MM + LEFT_BAND_MM
    room_mm = sheet.size_mm[0] - MARGIN_MM - left
    marks: list[str] = []
    y_mm = MARGIN_MM
    for line in _instructions(sheet, paper, transfer):
        for part in wrapped(line.split(" "), room_mm, HEAD_PT, " "):
            y_mm += line_mm(HEAD_PT)
            marks.append(sheet.words(left, y_mm, part, HEAD_PT))
    y_mm += 3.0
    marks += _ruler(sheet, left, y_mm, 0)
    y_mm += 8.5
    marks += _colours(sheet, left, y_mm)
    y_mm += 9.0
    marks += _ruler(sheet, MARGIN_MM, y_mm + 2.0, 1)
    return marks, y_mm


def footer(sheet: Sheet, page: int, pages: int) -> list[str]:
    """A line along the lower margin."""
    y_mm = sheet.size_mm[1] - MARGIN_MM - 1.0
    text = (
        f"deltact-fab {PACKAGE_VERSION}, page {page + 1} of {pages}. The text of a QR code "
        "regenerates its pattern: deltact-fab pattern make CODE -o FILE"
    )
    return [sheet.words(MARGIN_MM + LEFT_BAND_MM, y_mm, text)]


def corner_mark(sheet: Sheet, x_px: int, y_px: int, mirrored: bool) -> list[str]:
    """An F in the corner's own quadrant, beside the pattern: the corner (-x, -y) of the sensor.

    x_px, y_px: that corner of the sticker as printed. Mirrored with the sticker, so it reads right
    from the side that comes to lie on the gel, and only then.
    """
    strokes_mm = ((0.0, 0.0, 0.5, 3.0), (0.5, 0.0, 1.5, 0.5), (0.5, 1.25, 1.0, 0.5))
    pitch_x_mm, pitch_y_mm = sheet.pitch_mm
    out: list[str] = []
    for x_mm, y_mm, w_mm, h_mm in strokes_mm:
        # From the corner outwards: 3.6 to 1.6 mm to the left and 4.2 to 1.2 mm up
        near, far = round((3.6 - x_mm - w_mm) / pitch_x_mm), round((3.6 - x_mm) / pitch_x_mm)
        top, end = round((4.2 - y_mm) / pitch_y_mm), round((4.2 - y_mm - h_mm) / pitch_y_mm)
        left = x_px + near if mirrored else x_px - far
        out.append(sheet.rectangle(left, y_px - top, max(1, far - near), max(1, top - end)))
    return out


def film_corners(sheet: Sheet, x_mm: float, y_mm: float, film_mm: tuple[float, float]) -> list[str]:
    """An angle in each corner of the film, inside it: the film is cut along their outer edges."""
    out: list[str] = []
    far_mm = FILM_CORNER_MM - LINE_MM  # from where an angle begins to its upright on the far side
    right_mm, low_mm = x_mm + film_mm[0] - FILM_CORNER_MM, y_mm + film_mm[1] - FILM_CORNER_MM
    for left_mm, top_mm in product((x_mm, right_mm), (y_mm, low_mm)):
        row_mm = top_mm + (far_mm if top_mm == low_mm else 0)
        column_mm = left_mm + (far_mm if left_mm == right_mm else 0)
        out.append(sheet.box(left_mm, row_mm, FILM_CORNER_MM, LINE_MM))
        out.append(sheet.box(column_mm, top_mm, LINE_MM, FILM_CORNER_MM))
    return out


def edge_ticks(sheet: Sheet, x_px: int, y_px: int, width_px: int, height_px: int) -> list[str]:
    """Eight ticks that point along the sticker's edges and stop short of them."""
    pitch_x_mm, pitch_y_mm = sheet.pitch_mm
    gap_x, gap_y = round(TICK_GAP_MM / pitch_x_mm), round(TICK_GAP_MM / pitch_y_mm)
    long_x, long_y = round(TICK_MM / pitch_x_mm), round(TICK_MM / pitch_y_mm)
    thick_x = max(1, round(LINE_MM / pitch_x_mm))
    thick_y = max(1, round(LINE_MM / pitch_y_mm))
    ends_x = (x_px - gap_x - long_x, x_px + width_px + gap_x)
    ends_y = (y_px - gap_y - long_y, y_px + height_px + gap_y)
    return [
        *(
            sheet.rectangle(x - thick_x // 2, y, thick_x, long_y)
            for x, y in product((x_px, x_px + width_px), ends_y)
        ),
        *(
            sheet.rectangle(x, y - thick_y // 2, long_x, thick_y)
            for y, x in product((y_px, y_px + height_px), ends_x)
        ),
    ]


def _ruler(sheet: Sheet, x_mm: float, y_mm: float, axis: int) -> list[str]:
    """100 mm along x (0) or y (1), from the left or upper edge of the first tick to the last's."""
    along = ((RULER_MM, LINE_MM), (LINE_MM, RULER_MM))[axis]
    marks: list[str] = [sheet.box(x_mm, y_mm, *along)]
    thick = max(1, (sheet.x_px, sheet.y_px)[axis](LINE_MM))
    for k in range(101):
        long_mm = 4.0 if k % 10 == 0 else 2.8 if k % 5 == 0 else 1.8
        if axis == 0:
            x_px, y_px = sheet.x_px(x_mm + k), sheet.y_px(y_mm)
            tick = sheet.rectangle(x_px, y_px, thick, sheet.y_px(y_mm + long_mm) - y_px)
            number = x_mm + k + 0.4, y_mm + 5.2, f"{k}" if k < 100 else "100 mm x"
        else:
            x_px, y_px = sheet.x_px(x_mm), sheet.y_px(y_mm + k)
            tick = sheet.rectangle(x_px, y_px, sheet.x_px(x_mm + long_mm) - x_px, thick)
            number = x_mm + 2.4, y_mm + k + 2.3, f"{k}"
        marks += [tick, sheet.words(*number)] if k % 10 == 0 else [tick]
    if axis == 1:
        marks.append(sheet.words(x_mm + 2.4, y_mm + RULER_MM + 4.6, "mm y"))
    return marks


COLOURS: tuple[tuple[str, int | tuple[int, int, int]], ...] = (
    ("K", 0),
    ("C", (0, 255, 255)),
    ("M", (255, 0, 255)),
    ("Y", (255, 255, 0)),
    ("MY", (255, 0, 0)),
    ("CY", (0, 255, 0)),
    ("CM", (0, 0, 255)),
    ("CMY", (0, 0, 0)),
    *((f"{v}", (v, v, v)) for v in (32, 64, 96, 128, 160, 192, 224)),
)
"""Each ink, pairs, all three, and grey steps, as the RGB that stickers are sent in; K is grey 0."""


def _colours(sheet: Sheet, x_mm: float, y_mm: float) -> list[str]:
    marks: list[str] = []
    for k, (name, ink) in enumerate(COLOURS):
        marks.append(sheet.box(x_mm + 6 * k, y_mm, 5.0, 4.0, ink))
        middle_mm = (5.0 - width_mm(name, TEXT_PT)) / 2
        marks.append(sheet.words(x_mm + 6 * k + middle_mm, y_mm + 6.4, name))
    return marks


def check_dots(recipe: PatternRecipe, sheet: Sheet) -> None:
    """Raise InputError where the printer's dots are too coarse for the recipe, or too many."""
    pitch_mm = max(sheet.pitch_mm)
    for limit_mm, what in finest_mm(recipe):
        if pitch_mm > limit_mm * (1 + 1e-9):
            least = math.ceil(sheet.dpi * pitch_mm / limit_mm - 1e-9)
            raise InputError(
                f"{name(recipe)}: a printer dot at {sheet.dpi:g} dpi is {pitch_mm:.4g} mm, larger "
                f"than {what} ({limit_mm:g} mm), and cannot show it; use {least} dpi or more"
            )


def cell(
    recipe: PatternRecipe, code: str, sheet: Sheet, mirrored: bool, film_mm: tuple[float, float]
) -> StickerCell:
    """The sticker without a place. Raises InputError when the printer cannot show it."""
    check_dots(recipe, sheet)
    side_mm = recipe.printed_mm
    sticker = CellGrid(
        key=code,
        cells=recipe.patches(),
        size_mm=(side_mm, side_mm),
        pitch_mm=sheet.pitch_mm,
        mirrored=mirrored,
        grid=recipe.dots,
    )
    area_px = sticker.width_px * sticker.height_px
    if area_px > MAX_STICKER_PX:
        most = math.floor(sheet.dpi * math.sqrt(MAX_STICKER_PX / area_px))
        raise InputError(
            f"{name(recipe)}: {side_mm:g} mm at {sheet.dpi:g} dpi is {sticker.width_px} x "
            f"{sticker.height_px} printer dots, more than {MAX_STICKER_PX // 10**6} million; use "
            f"at most {most} dpi"
        )
    label = wrapped(_facts(recipe, code), LABEL_MM, TEXT_PT)
    return StickerCell(film_mm, sticker, _qr(code, sheet), tuple(label))


def _facts(recipe: PatternRecipe, code: str) -> list[str]:
    """What the label says, in pieces that stay together."""
    facts = [recipe.law]
    if recipe.patch_mm is not None:
        facts += [f"d {recipe.patch_mm:.6g} mm", f"n {recipe.n} x {recipe.n}"]
    if recipe.r is not None:
        facts.append(f"r {recipe.r!r}".removesuffix(".0"))
    facts += ["grey"] * (recipe.channels == 1)
    for key, values in (("scales", recipe.scales_mm), ("weights", recipe.weights)):
        facts += [f"{key} {', '.join(f'{v:.4g}' for v in values)}"] if values else []
    facts += [f"seed {recipe.seed}", f"{recipe.printed_mm:.6g} mm"]
    if (grid := recipe.dots) is not None:
        facts += [f"{grid.columns} x {grid.rows} dots", f"{grid.diameter_mm:g} mm {grid.colour}"]
    return [*facts, f"patches {code.rsplit('/', 1)[1].split('-')[0].lower()}"]


def _qr(code: str, sheet: Sheet) -> CellGrid:
    """The code as a QR symbol, level M, modules of whole printer dots."""
    import segno

    symbol = segno.make(code, error="m", micro=False, boost_error=False)
    dark = np.array([list(row) for row in symbol.matrix], bool)
    modules = len(dark)
    size_mm = tuple(
        modules * max(1, math.ceil(MODULE_MM / pitch_mm - 1e-9)) * pitch_mm
        for pitch_mm in sheet.pitch_mm
    )
    return CellGrid(
        key=f"qr {code}",
        cells=np.where(dark, 0, 255).astype(np.uint8),
        size_mm=(size_mm[0], size_mm[1]),
        pitch_mm=sheet.pitch_mm,
    )


def put(
    sheet: Sheet, cell: StickerCell, x_mm: float, y_mm: float, images: Mapping[str, int]
) -> tuple[list[str], tuple[int, int]]:
    """A cell's marks at its place, and where its sticker begins, px; images: numbers, by key."""
    (cut_x_mm, cut_y_mm), sticker = cell.cut_mm, cell.sticker
    x_px = sheet.x_px(x_mm + (cut_x_mm - cell.side_mm) / 2)
    y_px = sheet.y_px(y_mm + (cut_y_mm - cell.side_mm) / 2)
    corner_px = x_px + (sticker.width_px if sticker.mirrored else 0)
    label_y_mm, code_x_mm = y_mm + cut_y_mm + LABEL_GAP_MM, x_mm + QUIET_MM
    code_px = sheet.x_px(code_x_mm), sheet.y_px(label_y_mm)
    marks = [
        sheet.picture(x_px, y_px, sticker, images[sticker.key]),
        *edge_ticks(sheet, x_px, y_px, sticker.width_px, sticker.height_px),
        *film_corners(sheet, x_mm, y_mm, cell.cut_mm),
        *corner_mark(sheet, corner_px, y_px, sticker.mirrored),
        sheet.picture(*code_px, cell.code, images[cell.code.key]),
    ]
    for k, line in enumerate(cell.label):
        baseline_mm = label_y_mm + 1.8 + k * line_mm(TEXT_PT)
        marks.append(sheet.words(code_x_mm + cell.code_mm + QUIET_MM, baseline_mm, line))
    return marks, (x_px, y_px)


def name(recipe: PatternRecipe) -> str:
    """A recipe in a few words, for messages."""
    patch = "" if recipe.patch_mm is None else f", d {recipe.patch_mm:g} mm"
    return f"sticker ({recipe.law}{patch}, {recipe.printed_mm:g} mm)"
