"""What every page has besides stickers: how to print it, and what tells whether it was.

Rulers, colour patches, the film's corners, and a sticker's ticks and corner.
"""

from __future__ import annotations

from collections.abc import Sequence

from ...version import VERSION
from .layout import HEAD_PT, LEFT_BAND_MM, MARGIN_MM, Sheet, line_mm
from .marks import FilledRectangle, Mark, width_mm, wrapped

RULER_MM = 100.0
LINE_MM = 0.1
TICK_MM = 3.0
TICK_GAP_MM = 1.0
FILM_CORNER_MM = 4.0
SMALL_PT = 6.0


def instructions(sheet: Sheet, paper: str, transfer: str) -> list[str]:
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


def signature(page: int, pages: int) -> str:
    """The footer."""
    return (
        f"deltact-fab {VERSION}, page {page + 1} of {pages}. The text of a QR code regenerates "
        "its pattern: deltact-fab pattern make CODE -o FILE"
    )


def header(sheet: Sheet, lines: Sequence[str]) -> tuple[list[Mark], float]:
    """Header, rulers, colour patches; and where the stickers begin (y, mm)."""
    left = MARGIN_MM + LEFT_BAND_MM
    room_mm = sheet.size_mm[0] - MARGIN_MM - left
    marks: list[Mark] = []
    y_mm = MARGIN_MM
    for line in lines:
        for part in wrapped(line.split(" "), room_mm, HEAD_PT, " "):
            y_mm += line_mm(HEAD_PT)
            marks.append(sheet.words(left, y_mm, part, HEAD_PT))
    y_mm += 3.0
    marks += _ruler_x(sheet, left, y_mm)
    y_mm += 8.5
    marks += _colours(sheet, left, y_mm)
    y_mm += 9.0
    marks += _ruler_y(sheet, MARGIN_MM, y_mm + 2.0)
    return marks, y_mm


def footer(sheet: Sheet, text: str) -> list[Mark]:
    """A line along the lower margin."""
    y_mm = sheet.size_mm[1] - MARGIN_MM - 1.0
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
    far_x_mm, far_y_mm = x_mm + film_mm[0], y_mm + film_mm[1]
    for left_mm, column_mm in (
        (x_mm, x_mm),
        (far_x_mm - FILM_CORNER_MM, far_x_mm - LINE_MM),
    ):
        for top_mm, row_mm in (
            (y_mm, y_mm),
            (far_y_mm - FILM_CORNER_MM, far_y_mm - LINE_MM),
        ):
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
    out: list[Mark] = []
    for x in (x_px, x_px + width_px):
        for y in (y_px - gap_y - long_y, y_px + height_px + gap_y):
            out.append(FilledRectangle(x - thick_x // 2, y, thick_x, long_y))
    for y in (y_px, y_px + height_px):
        for x in (x_px - gap_x - long_x, x_px + width_px + gap_x):
            out.append(FilledRectangle(x, y - thick_y // 2, long_x, thick_y))
    return out


def _ruler_x(sheet: Sheet, x_mm: float, y_mm: float) -> list[Mark]:
    """100 mm from the left edge of the first line to the left edge of the last."""
    thick = max(1, sheet.x_px(LINE_MM))
    marks: list[Mark] = [sheet.box(x_mm, y_mm, RULER_MM, LINE_MM)]
    for k in range(101):
        long_mm = 4.0 if k % 10 == 0 else 2.8 if k % 5 == 0 else 1.8
        tick = sheet.box(x_mm + k, y_mm, LINE_MM, long_mm)
        marks.append(FilledRectangle(tick.x_px, tick.y_px, thick, tick.height_px))
        if k % 10 == 0:
            text = f"{k}" if k < 100 else "100 mm x"
            marks.append(sheet.words(x_mm + k + 0.4, y_mm + 5.2, text, SMALL_PT))
    return marks


def _ruler_y(sheet: Sheet, x_mm: float, y_mm: float) -> list[Mark]:
    """100 mm from the upper edge of the first line to the upper edge of the last."""
    thick = max(1, sheet.y_px(LINE_MM))
    marks: list[Mark] = [sheet.box(x_mm, y_mm, LINE_MM, RULER_MM)]
    for k in range(101):
        long_mm = 4.0 if k % 10 == 0 else 2.8 if k % 5 == 0 else 1.8
        tick = sheet.box(x_mm, y_mm + k, long_mm, LINE_MM)
        marks.append(FilledRectangle(tick.x_px, tick.y_px, tick.width_px, thick))
        if k % 10 == 0:
            marks.append(sheet.words(x_mm + 2.4, y_mm + k + 2.3, f"{k}", SMALL_PT))
    marks.append(sheet.words(x_mm + 2.4, y_mm + RULER_MM + 4.6, "mm y", SMALL_PT))
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
        middle_mm = (5.0 - width_mm(name, SMALL_PT)) / 2
        marks.append(sheet.words(x_mm + 6 * k + middle_mm, y_mm + 6.4, name, SMALL_PT))
    return marks
