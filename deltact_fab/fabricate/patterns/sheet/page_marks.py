"""Marks of a page: print instructions, marks to check the print, and stickers.

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
    MODULE_MM,
    PAGE_MARGIN_MM,
    QUIET_MM,
    TEXT_PT,
    Sheet,
    StickerCell,
    line_mm,
    width_mm,
    wrapped,
)

# By hand: 100 mm is read to 0.1 % with a steel ruler; marks are thin, clear of the pattern.
RULER_MM, MARK_LINE_MM, TICK_MM, TICK_GAP_MM, FILM_CORNER_MM = 100.0, 0.1, 3.0, 1.0, 4.0
MAX_STICKER_PX = 120_000_000
"""Largest raster of a sticker, by hand: some seconds; bands keep its memory small."""


def _instructions(sheet: Sheet, paper: str, transfer: str) -> list[str]:
    """Lines of the header."""
    transfer_text = {
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
        transfer_text,
        "Test: seen from the side that will lie on the gel, every F reads correctly and marks "
        "the corner (-x, -y). Cut the film at its corner marks; the ticks point along the edges of "
        "the pattern and are trimmed off with F and margin when it is dry.",
        f"Rulers, left or upper edge of the lines: 100 mm in x and in y; {ruler}",
    ]


def header(
    sheet: Sheet, paper: str, transfer: str, first_line: str = ""
) -> tuple[list[str], float]:
    """Return header, rulers and colour patches, and the top of the stickers (y, mm).

    first_line: above the instructions; empty: none.
    """
    left_mm = PAGE_MARGIN_MM + LEFT_BAND_MM
    room_mm = sheet.size_mm[0] - PAGE_MARGIN_MM - left_mm
    marks: list[str] = []
    y_mm = PAGE_MARGIN_MM
    for line in [*filter(None, [first_line]), *_instructions(sheet, paper, transfer)]:
        for part in wrapped(line.split(" "), room_mm, HEAD_PT, " "):
            y_mm += line_mm(HEAD_PT)
            marks.append(sheet.text_line(left_mm, y_mm, part, HEAD_PT))
    y_mm += 3.0
    marks += _ruler(sheet, left_mm, y_mm, 0)
    y_mm += 8.5
    marks += _colours(sheet, left_mm, y_mm)
    y_mm += 9.0
    marks += _ruler(sheet, PAGE_MARGIN_MM, y_mm + 2.0, 1)
    return marks, y_mm


def footer(sheet: Sheet, page: int, pages: int) -> list[str]:
    """Line of text along the lower margin."""
    y_mm = sheet.size_mm[1] - PAGE_MARGIN_MM - 1.0
    text = (
        f"deltact-fab {PACKAGE_VERSION}, page {page + 1} of {pages}. The text of a QR code "
        "regenerates its pattern: deltact-fab pattern make CODE -o FILE"
    )
    return [sheet.text_line(PAGE_MARGIN_MM + LEFT_BAND_MM, y_mm, text)]


def corner_mark(sheet: Sheet, x_px: int, y_px: int, mirrored: bool) -> list[str]:
    """F beside the pattern at the corner (-x, -y) of the sensor.

    x_px, y_px: that corner of the printed sticker. Mirrored with the sticker, it reads correctly
    only from the side that will lie on the gel.
    """
    strokes_mm = ((0.0, 0.0, 0.5, 3.0), (0.5, 0.0, 1.5, 0.5), (0.5, 1.25, 1.0, 0.5))
    pitch_x_mm, pitch_y_mm = sheet.pitch_mm
    out: list[str] = []
    for x_mm, y_mm, w_mm, h_mm in strokes_mm:
        # From the corner outwards: 3.6 to 1.6 mm to the left and 4.2 to 1.2 mm up
        inner, outer = round((3.6 - x_mm - w_mm) / pitch_x_mm), round((3.6 - x_mm) / pitch_x_mm)
        top, end = round((4.2 - y_mm) / pitch_y_mm), round((4.2 - y_mm - h_mm) / pitch_y_mm)
        start_px = x_px + inner if mirrored else x_px - outer
        out.append(sheet.rectangle(start_px, y_px - top, max(1, outer - inner), max(1, top - end)))
    return out


def film_corners(sheet: Sheet, x_mm: float, y_mm: float, film_mm: tuple[float, float]) -> list[str]:
    """Angles inside the film's corners; the film is cut along their outer edges."""
    out: list[str] = []
    far_mm = FILM_CORNER_MM - MARK_LINE_MM  # an angle's start to its upright on the far side
    right_mm, low_mm = x_mm + film_mm[0] - FILM_CORNER_MM, y_mm + film_mm[1] - FILM_CORNER_MM
    for left_mm, top_mm in product((x_mm, right_mm), (y_mm, low_mm)):
        row_mm = top_mm + (far_mm if top_mm == low_mm else 0)
        column_mm = left_mm + (far_mm if left_mm == right_mm else 0)
        out.append(sheet.box(left_mm, row_mm, FILM_CORNER_MM, MARK_LINE_MM))
        out.append(sheet.box(column_mm, top_mm, MARK_LINE_MM, FILM_CORNER_MM))
    return out


def edge_ticks(sheet: Sheet, x_px: int, y_px: int, width_px: int, height_px: int) -> list[str]:
    """Eight ticks along the sticker's edges, ending short of them."""
    pitch_x_mm, pitch_y_mm = sheet.pitch_mm
    gap_x, gap_y = round(TICK_GAP_MM / pitch_x_mm), round(TICK_GAP_MM / pitch_y_mm)
    long_x, long_y = round(TICK_MM / pitch_x_mm), round(TICK_MM / pitch_y_mm)
    thick_x = max(1, round(MARK_LINE_MM / pitch_x_mm))
    thick_y = max(1, round(MARK_LINE_MM / pitch_y_mm))
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
    """Ruler of 100 mm along x (0) or y (1), between left or upper edges of its end ticks."""
    along = ((RULER_MM, MARK_LINE_MM), (MARK_LINE_MM, RULER_MM))[axis]
    marks: list[str] = [sheet.box(x_mm, y_mm, *along)]
    thick = max(1, (sheet.x_px, sheet.y_px)[axis](MARK_LINE_MM))
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
        marks += [tick, sheet.text_line(*number)] if k % 10 == 0 else [tick]
    if axis == 1:
        marks.append(sheet.text_line(x_mm + 2.4, y_mm + RULER_MM + 4.6, "mm y"))
    return marks


INK_PATCHES: tuple[tuple[str, int | tuple[int, int, int]], ...] = (
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
"""Single inks, pairs, all three and grey steps, in the stickers' RGB; K is grey 0."""


def _colours(sheet: Sheet, x_mm: float, y_mm: float) -> list[str]:
    marks: list[str] = []
    for k, (name, ink) in enumerate(INK_PATCHES):
        marks.append(sheet.box(x_mm + 6 * k, y_mm, 5.0, 4.0, ink))
        middle_mm = (5.0 - width_mm(name, TEXT_PT)) / 2
        marks.append(sheet.text_line(x_mm + 6 * k + middle_mm, y_mm + 6.4, name))
    return marks


def check_dots(recipe: PatternRecipe, sheet: Sheet) -> None:
    """Raise InputError if the printer's dots are too coarse for the recipe."""
    pitch_mm = max(sheet.pitch_mm)
    for limit_mm, feature in finest_mm(recipe):
        if pitch_mm > limit_mm * (1 + 1e-9):
            least_dpi = math.ceil(sheet.dpi * pitch_mm / limit_mm - 1e-9)
            raise InputError(
                f"{sticker_name(recipe)}: a printer dot at {sheet.dpi:g} dpi is {pitch_mm:.4g} mm, "
                f"larger than {feature} ({limit_mm:g} mm); use {least_dpi} dpi or more"
            )


def make_cell(
    recipe: PatternRecipe, code: str, sheet: Sheet, mirrored: bool, film_mm: tuple[float, float]
) -> StickerCell:
    """Make the sticker's cell, not yet placed. Raises InputError if the printer is too coarse."""
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
        max_dpi = math.floor(sheet.dpi * math.sqrt(MAX_STICKER_PX / area_px))
        raise InputError(
            f"{sticker_name(recipe)}: {side_mm:g} mm at {sheet.dpi:g} dpi is {sticker.width_px} x "
            f"{sticker.height_px} printer dots, more than {MAX_STICKER_PX // 10**6} million; use "
            f"at most {max_dpi} dpi"
        )
    label = wrapped(_facts(recipe, code), LABEL_MM, TEXT_PT)
    return StickerCell(film_mm, sticker, _qr(code, sheet), tuple(label))


def _facts(recipe: PatternRecipe, code: str) -> list[str]:
    """Text of the label in unbreakable pieces."""
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
    """QR symbol of the code, level M, modules of whole printer dots."""
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


def draw_cell(
    sheet: Sheet, cell: StickerCell, x_mm: float, y_mm: float, images: Mapping[str, int]
) -> tuple[list[str], tuple[int, int]]:
    """Return a cell's marks and the origin of its sticker, px; images: numbers by key."""
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
        marks.append(sheet.text_line(code_x_mm + cell.code_mm + QUIET_MM, baseline_mm, line))
    return marks, (x_px, y_px)


def sticker_name(recipe: PatternRecipe) -> str:
    """Short name of a recipe's sticker for messages."""
    patch = "" if recipe.patch_mm is None else f", d {recipe.patch_mm:g} mm"
    return f"sticker ({recipe.law}{patch}, {recipe.printed_mm:g} mm)"
