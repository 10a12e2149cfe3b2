"""What every page has besides stickers: how to print it, and marks to check the print with.

Rulers, colour patches, the film's corners, and a sticker's ticks and corner mark.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import product

from ...version import VERSION
from .layout import (
    HEAD_PT,
    LEFT_BAND_MM,
    MARGIN_MM,
    TEXT_PT,
    FilledRectangle,
    Mark,
    Sheet,
    line_mm,
    width_mm,
    wrapped,
)

RULER_MM = 100.0
LINE_MM = 0.1
TICK_MM = 3.0
TICK_GAP_MM = 1.0
FILM_CORNER_MM = 4.0


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


def header(sheet: Sheet, paper: str, transfer: str) -> tuple[list[Mark], float]:
    """Header, rulers, colour patches; and where the stickers begin (y, mm)."""
    left = MARGIN_MM + LEFT_BAND_MM
    room_mm = sheet.size_mm[0] - MARGIN_MM - left
    marks: list[Mark] = []
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


def footer(sheet: Sheet, page: int, pages: int) -> list[Mark]:
    """A line along the lower margin."""
    y_mm = sheet.size_mm[1] - MARGIN_MM - 1.0
    text = (
        f"deltact-fab {VERSION}, page {page + 1} of {pages}. The text of a QR code regenerates "
        "its pattern: deltact-fab pattern make CODE -o FILE"
    )
    return [sheet.words(MARGIN_MM + LEFT_BAND_MM, y_mm, text)]


def corner_mark(sheet: Sheet, x_px: int, y_px: int, mirrored: bool) -> list[Mark]:
    """An F in the corner's own quadrant, beside the pattern: the corner (-x, -y) of the sensor.

    x_px, y_px: that corner of the sticker as printed. Mirrored with the sticker, so it reads right
    from the side that comes to lie on the gel, and only then.
    """
    strokes_mm = ((0.0, 0.0, 0.5, 3.0), (0.5, 0.0, 1.5, 0.5), (0.5, 1.25, 1.0, 0.5))
    pitch_x_mm, pitch_y_mm = sheet.pitch_mm
    out: list[Mark] = []
    for x_mm, y_mm, w_mm, h_mm in strokes_mm:
        # From the corner outwards: 3.6 to 1.6 mm to the left and 4.2 to 1.2 mm up
        near, far = round((3.6 - x_mm - w_mm) / pitch_x_mm), round((3.6 - x_mm) / pitch_x_mm)
        top, end = round((4.2 - y_mm) / pitch_y_mm), round((4.2 - y_mm - h_mm) / pitch_y_mm)
        left = x_px + near if mirrored else x_px - far
        out.append(FilledRectangle(left, y_px - top, max(1, far - near), max(1, top - end)))
    return out


def film_corners(
    sheet: Sheet, x_mm: float, y_mm: float, film_mm: tuple[float, float]
) -> list[Mark]:
    """An angle in each corner of the film, inside it: the film is cut along their outer edges."""
    out: list[Mark] = []
    far_mm = FILM_CORNER_MM - LINE_MM  # from where an angle begins to its upright on the far side
    right_mm, low_mm = x_mm + film_mm[0] - FILM_CORNER_MM, y_mm + film_mm[1] - FILM_CORNER_MM
    for left_mm, top_mm in product((x_mm, right_mm), (y_mm, low_mm)):
        row_mm = top_mm + (far_mm if top_mm == low_mm else 0)
        column_mm = left_mm + (far_mm if left_mm == right_mm else 0)
        out.append(sheet.box(left_mm, row_mm, FILM_CORNER_MM, LINE_MM))
        out.append(sheet.box(column_mm, top_mm, LINE_MM, FILM_CORNER_MM))
    return out


def edge_ticks(sheet: Sheet, x_px: int, y_px: int, width_px: int, height_px: int) -> list[Mark]:
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
            FilledRectangle(x - thick_x // 2, y, thick_x, long_y)
            for x, y in product((x_px, x_px + width_px), ends_y)
        ),
        *(
            FilledRectangle(x, y - thick_y // 2, long_x, thick_y)
            for y, x in product((y_px, y_px + height_px), ends_x)
        ),
    ]


def _ruler(sheet: Sheet, x_mm: float, y_mm: float, axis: int) -> list[Mark]:
    """100 mm along x (0) or y (1), from the left or upper edge of the first tick to the last's."""
    along = ((RULER_MM, LINE_MM), (LINE_MM, RULER_MM))[axis]
    marks: list[Mark] = [sheet.box(x_mm, y_mm, *along)]
    thick = max(1, (sheet.x_px, sheet.y_px)[axis](LINE_MM))
    for k in range(101):
        long_mm = 4.0 if k % 10 == 0 else 2.8 if k % 5 == 0 else 1.8
        if axis == 0:
            tick = replace(sheet.box(x_mm + k, y_mm, LINE_MM, long_mm), width_px=thick)
            number = sheet.words(x_mm + k + 0.4, y_mm + 5.2, f"{k}" if k < 100 else "100 mm x")
        else:
            tick = replace(sheet.box(x_mm, y_mm + k, long_mm, LINE_MM), height_px=thick)
            number = sheet.words(x_mm + 2.4, y_mm + k + 2.3, f"{k}")
        marks += [tick, number] if k % 10 == 0 else [tick]
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


def _colours(sheet: Sheet, x_mm: float, y_mm: float) -> list[Mark]:
    marks: list[Mark] = []
    for k, (name, ink) in enumerate(COLOURS):
        marks.append(sheet.box(x_mm + 6 * k, y_mm, 5.0, 4.0, ink))
        middle_mm = (5.0 - width_mm(name, TEXT_PT)) / 2
        marks.append(sheet.words(x_mm + 6 * k + middle_mm, y_mm + 6.4, name))
    return marks
