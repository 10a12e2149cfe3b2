"""The wiring drawing of a sensor: supply, resistor, LEDs in parallel, camera cable. No CAD kernel.

A schematic, not to scale, from the numbers by which check, bill of materials and guide go.
"""

from __future__ import annotations

from collections.abc import Sequence

from ...aliases import Point2
from ..dimensions import Design
from ..parts.camera import COMPUTER
from ..parts.light_holder import WIRE, WIRE_COLOURS
from .page import LARGE_MM, SMALL_MM, DrawingPage
from .sheet import LINE_MM, SHEETS, Title, draw_frame, wrapped

SHEET = "A4"
MAX_DRAWN = 6  # of more LEDs the first ones and the last stand for all
PLUS_Y, MINUS_Y, CABLE_Y = 48.0, 96.0, 126.0
SUPPLY_X, WALL_X, RING_X = (18.0, 52.0), 142.0, 168.0
RIGHT_X, TOP_Y, RING_END_Y, END_Y = 281.0, 24.0, 108.0, 144.0
DOT_MM = 0.6


def wiring(design: Design) -> DrawingPage:
    """The drawing on a sheet of A4. Same dimensions, same page."""
    light, shell = design.light, design.shell
    page = DrawingPage(SHEETS[SHEET], "wiring, not to scale")
    title = Title(
        "wiring", "DelTact sensor", "see bill of materials", "soldered", 1, "", SHEET, "",
        design.drawing, "wiring",
    )  # fmt: skip
    draw_frame(page, title)
    page.group = "supply"
    left, right = SUPPLY_X
    _box(page, left, PLUS_Y - 10, right, MINUS_Y + 10)
    middle = (left + right) / 2
    volts = f"{light.supply_v:g} V ± {100 * light.supply_tolerance:g} %"
    _stack(page, middle, 68, ("Supply", volts, f"at least {light.most_ma:.3g} mA"))
    for y, sign in ((PLUS_Y, "+"), (MINUS_Y, "−")):
        page.text((right - 4, y + 1.2), sign, LARGE_MM, "middle")

    page.group = "leads"
    plus, minus = WIRE_COLOURS
    resistor = (74.0, 94.0)
    drawn = min(light.led_count, MAX_DRAWN)
    xs = [RING_X + 14 + (RIGHT_X - RING_X - 30) * i / max(drawn - 1, 1) for i in range(drawn)]
    page.path([[(right, PLUS_Y), (resistor[0], PLUS_Y)]], "visible")
    page.path([[(resistor[1], PLUS_Y), (xs[-1], PLUS_Y)]], "visible")
    page.path([[(right, MINUS_Y), (xs[-1], MINUS_Y)]], "visible")
    _box(page, resistor[0], PLUS_Y - 3, resistor[1], PLUS_Y + 3)
    at = sum(resistor) / 2
    _stack(
        page, at, PLUS_Y - 14,
        (f"R {light.resistor_ohm:g} ohm, 1 %", f"{light.resistor_rating_w:g} W, outside, sleeved"),
    )  # fmt: skip
    for y, colour in ((PLUS_Y, plus), (MINUS_Y, minus)):
        said = f"{colour}, {WIRE}, {light.wire_mm:g} mm"
        page.text(((resistor[0] + WALL_X) / 2 - 8, y + 8), said, SMALL_MM, "middle")

    page.group = "leds"
    for i, x in enumerate(xs, 1):
        _led(page, x, f"LED {light.led_count if i == drawn else i}", light.strip_resistor_ohm)
    if light.led_count > drawn:
        # Dots stand for what is left out of a long chain.
        for shift in (-2.0, 0.0, 2.0):
            page.circle(((xs[-2] + xs[-1]) / 2 + shift, PLUS_Y + 10), 0.4, "visible")

    page.group = "walls"
    _box(page, WALL_X, TOP_Y, RIGHT_X, END_Y, "hidden")
    _box(page, RING_X, TOP_Y + 9, RIGHT_X - 4, RING_END_Y, "hidden")
    page.text((WALL_X + 3, TOP_Y + 5), "sensor: shell (3) and cover (7)")
    page.text((RING_X + 3, TOP_Y + 14), f"light holder (4): {light.led_count} LEDs in parallel")
    # Where the wires and the cable pass a wall.
    for y in (PLUS_Y, MINUS_Y, CABLE_Y):
        _gate(page, (WALL_X, y))
    for y in (PLUS_Y, MINUS_Y):
        _gate(page, (RING_X, y))
    notch = (
        f"cable notch {shell.cable_width_mm:g} × {shell.cable_height_mm:g} mm, at −y:",
        "both wires and the cable;",
        f"black foam, {shell.cable_foam_mm:g} mm" if shell.cable_foam_mm else "no foam",
    )
    for i, line in enumerate(notch):
        page.text((WALL_X - 4, 66 + LINE_MM * i), line, SMALL_MM, "end")
    page.line((WALL_X - 3, 66 - SMALL_MM / 2), (WALL_X, PLUS_Y + 3))
    page.text((WALL_X + 3, 113), f"slot {light.slot_mm:g} mm, at −y: both wires")
    page.line((RING_X - 3, 113 - SMALL_MM - 1), (RING_X, MINUS_Y + 3))

    page.group = "camera"
    _box(page, left, CABLE_Y - 8, right + 8, CABLE_Y + 8)
    for i, line in enumerate((COMPUTER, "camera port")):
        page.text(((left + right + 8) / 2, CABLE_Y + 4 * i), line, SMALL_MM, "middle")
    _box(page, RING_X + 20, CABLE_Y - 8, RING_X + 62, CABLE_Y + 8)
    _stack(page, RING_X + 41, CABLE_Y - 4, ("Camera (5)", "connector, locked"))
    for shift in (-1.2, 1.2):
        ends = (right + 8, CABLE_Y + shift), (RING_X + 20, CABLE_Y + shift)
        page.path([ends], "visible")
    over = wrapped(design.camera.cable, WALL_X - right - 12)
    for i, line in enumerate(reversed(over)):
        place = (right + 8 + WALL_X) / 2, CABLE_Y - 4 - LINE_MM * i
        page.text(place, line, SMALL_MM, "middle")
    for i, line in enumerate(("length as the arm needs;", "ends and contacts as the camera's")):
        page.text(((right + 8 + WALL_X) / 2, CABLE_Y + 7 + LINE_MM * i), line, SMALL_MM, "middle")

    page.group = "notes"
    y = END_Y + 6
    for said in _notes(design):
        for line in wrapped(said, 90):
            page.text((14, y + SMALL_MM), line)
            y += LINE_MM
    return page


def _notes(design: Design) -> Sequence[str]:
    light = design.light
    keys = [key for key in design.unverified() if key.startswith("light.")]
    own = f"{light.strip_resistor_ohm:g} ohm" if light.strip_resistor_ohm else "left out"
    return (
        f"All LEDs: {light.total_ma:.2f} mA ({light.least_ma:.2f} to {light.most_ma:.2f}).",
        f"A chip: at most {light.chip_most_ma:.2f} of {light.led_limit_ma:g} mA.",
        f"LED {light.led_v:g} ± {light.led_spread_v:g} V, {light.led_chips} chips in parallel; "
        f"the strip's own resistor at each LED: {own}.",
        f"Resistor: {1000 * light.resistor_most_w:.1f} mW at most; the least of E24 for these "
        f"LEDs: {light.least_resistor_ohm:g} ohm.",
        "A LED's bar is its minus side.",
        *([f"Rests on unverified values: {', '.join(keys)}."] if keys else []),
    )


def _led(page: DrawingPage, x: float, name: str, own_ohm: float) -> None:
    """A diode from plus to minus, its bar at minus; the strip's own resistor above, if any."""
    middle, half = (PLUS_Y + MINUS_Y) / 2 + 4, 3.0
    top = middle - half
    if own_ohm:
        y = PLUS_Y + 6
        page.path([[(x, PLUS_Y), (x, y)], [(x, y + 8), (x, top)]], "visible")
        _box(page, x - 1.5, y, x + 1.5, y + 8)
    else:
        page.path([[(x, PLUS_Y), (x, top)]], "visible")
    page.path([[(x - half, top), (x + half, top), (x, middle + half)]], "visible", closed=True)
    bar = middle + half
    page.path([[(x - half, bar), (x + half, bar)], [(x, bar), (x, MINUS_Y)]], "visible")
    for shift in (0.0, 2.5):
        # Light leaves it.
        tip = (x + half + 3.2, middle - 2.2 + shift)
        page.line((tip[0] - 2.6, tip[1] + 1.6), tip)
        page.arrow(tip, (2.6, -1.6))
    for y in (PLUS_Y, MINUS_Y):
        page.circle((x, y), DOT_MM, "visible")
    page.text((x - 2, bar + 8), name, SMALL_MM, "end")


def _box(
    page: DrawingPage, x0: float, y0: float, x1: float, y1: float, style: str = "visible"
) -> None:
    page.path([[(x0, y0), (x1, y0), (x1, y1), (x0, y1)]], style, closed=True)


def _gate(page: DrawingPage, at: Point2) -> None:
    """A hole in a wall that a lead passes."""
    x, y = at
    page.path([[(x - 1.5, y - 2.5), (x + 1.5, y - 2.5)]], "visible")
    page.path([[(x - 1.5, y + 2.5), (x + 1.5, y + 2.5)]], "visible")


def _stack(page: DrawingPage, x: float, y: float, lines: Sequence[str]) -> None:
    """Lines of text below one another, the first one large."""
    for i, line in enumerate(lines):
        size = SMALL_MM if i else LARGE_MM
        page.text((x, y + LARGE_MM + i * 5.0), line, size, "middle")
