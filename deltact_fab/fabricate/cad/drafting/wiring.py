"""The wiring drawing of a sensor: supply, resistor, cuts of LEDs, camera cable. No CAD kernel.

A schematic, not to scale, from the same numbers as check, bill of materials and guide.
"""

from __future__ import annotations

from collections.abc import Sequence

from ..dimensions import Design
from ..parts.camera import HOST_COMPUTER
from ..parts.light_holder import WIRE_COLOURS, WIRE_SIZE
from .page import FORMATS_MM, TEXT_LINE_MM, TEXT_MM, TITLE_MM, DrawingPage, draw_frame, wrapped

WIRING_SHEET = "A4"
# By hand, mm on an A4 sheet: most cuts, and LEDs of a cut, drawn one by one; no overlaps.
MAX_DRAWN_CUTS, MAX_DRAWN_LEDS, LED_STEP_MM = 6, 3, 8.5
PLUS_Y, MINUS_Y, CABLE_Y = 48.0, 94.0, 120.0
LEFT_X, SUPPLY_X, RESISTOR_X, WALL_X, RING_X, RIGHT_X = 18.0, 52.0, 74.0, 142.0, 168.0, 281.0
TOP_Y, RING_END_Y, END_Y = 24.0, 104.0, 134.0
RESISTOR_MM, JUNCTION_MM = 20.0, 0.6


def wiring(design: Design) -> DrawingPage:
    """Draw the wiring on a sheet of A4. Same dimensions, same page."""
    light = design.light
    page = DrawingPage(FORMATS_MM[WIRING_SHEET], "wiring, not to scale")
    cells = {"Material": "see bill of materials", "Process": "soldered", "Quantity": "1",
             "Document": "wiring", "Belongs to": "DelTact sensor"}  # fmt: skip
    draw_frame(page, WIRING_SHEET, "wiring", design.drawing, cells)
    page.group = "supply"
    _box(page, LEFT_X, PLUS_Y - 10, SUPPLY_X, MINUS_Y + 10)
    volts = f"{light.supply_v:g} V ± {100 * light.supply_tolerance:g} %"
    middle = (LEFT_X + SUPPLY_X) / 2
    _stack(page, middle, 68, ("Supply", volts, f"at least {light.most_ma:.3g} mA"))
    count = min(light.cuts, MAX_DRAWN_CUTS)
    xs = [RING_X + 14 + (RIGHT_X - RING_X - 30) * i / max(count - 1, 1) for i in range(count)]
    x_after = RESISTOR_X + RESISTOR_MM
    page.path([[(SUPPLY_X, PLUS_Y), (RESISTOR_X, PLUS_Y)], [(x_after, PLUS_Y), (xs[-1], PLUS_Y)],
               [(SUPPLY_X, MINUS_Y), (xs[-1], MINUS_Y)]], "visible")  # fmt: skip
    _box(page, RESISTOR_X, PLUS_Y - 3, x_after, PLUS_Y + 3)
    rated = f"{light.resistor_rating_w:g} W, outside, sleeved"
    about = (f"R {light.resistor_ohm:g} ohm, 1 %", rated)
    _stack(page, (RESISTOR_X + x_after) / 2, PLUS_Y - 14, about)
    for y, sign, colour in zip((PLUS_Y, MINUS_Y), "+−", WIRE_COLOURS, strict=True):
        page.text((SUPPLY_X - 4, y + 1.2), sign, TITLE_MM, "middle")
        label = f"{colour}, {WIRE_SIZE}, {light.wire_mm:g} mm"
        page.text(((x_after + WALL_X) / 2 - 8, y + 8), label, TEXT_MM, "middle")
    page.group = "leds"
    for i, x in enumerate(xs, 1):
        _cut(page, x, f"cut {light.cuts if i == count else i}", light.leds_per_cut)
    if light.cuts > count:
        # Dots stand for the cuts not drawn.
        for shift in (-2.0, 0.0, 2.0):
            page.circle(((xs[-2] + xs[-1]) / 2 + shift, PLUS_Y + 10), 0.4, "visible")
    page.group = "walls"
    _box(page, WALL_X, TOP_Y, RIGHT_X, END_Y, "hidden")
    _box(page, RING_X, TOP_Y + 9, RIGHT_X - 4, RING_END_Y, "hidden")
    page.text((WALL_X + 3, TOP_Y + 5), "sensor: shell (3) and cover (7)")
    page.text((RING_X + 3, TOP_Y + 14), f"light holder (4): {light.cuts} cuts in parallel")
    page.group = "camera"
    _box(page, LEFT_X, CABLE_Y - 8, SUPPLY_X + 8, CABLE_Y + 8)
    _stack(page, middle + 4, CABLE_Y + 1, (HOST_COMPUTER, "camera port"), TEXT_MM)
    _box(page, RING_X + 20, CABLE_Y - 8, RING_X + 62, CABLE_Y + 8)
    _stack(page, RING_X + 41, CABLE_Y - 1, ("Camera (5)", "connector, locked"))
    page.line((SUPPLY_X + 8, CABLE_Y), (RING_X + 20, CABLE_Y), "visible")
    cable = wrapped(design.camera.cable, WALL_X - SUPPLY_X - 12)
    cable_x = (SUPPLY_X + 8 + WALL_X) / 2
    _stack(page, cable_x, CABLE_Y - 2 - TEXT_LINE_MM * len(cable), cable, TEXT_MM)
    ends = ("length to suit the arm;", "connectors to suit the camera")
    _stack(page, cable_x, CABLE_Y + 5, ends, TEXT_MM)
    page.group = "notes"
    y = END_Y + 2
    for note in _notes(design):
        for line in wrapped(note, 90):
            page.text((14, y + TEXT_MM), line)
            y += TEXT_LINE_MM
    return page


def _notes(design: Design) -> Sequence[str]:
    light, shell = design.light, design.shell
    keys = [key for key in design.unverified() if key.startswith("light.")]
    foam = f"closed by black foam, {shell.cable_foam_mm:g} mm" if shell.cable_foam_mm else "no foam"
    return (
        f"At −y, wires through the light holder's slot of {light.slot_mm:g} mm; wires and cable at "
        f"{shell.cable_side.replace('-', '−')} through the cable notch of "
        f"{shell.cable_width_mm:g} × {shell.cable_height_mm:g} mm; "
        f"{foam}.",
        f"In all: {light.total_ma:.2f} mA ({light.least_ma:.2f} to {light.most_ma:.2f}); "
        f"a cut: at most {light.cut_most_ma:.2f} of {light.cut_rated_ma:.3g} mA.",
        f"A cut: {light.leds_per_cut} LEDs of {light.led_v:g} ± {light.led_spread_v:g} V in "
        f"series and the strip's own resistor, about {light.strip_resistor_ohm:.3g} ohm by its "
        f"{light.strip_w_per_m:g} W/m.",
        f"Resistor: {1000 * light.resistor_most_w:.1f} mW at most; lowest E24 value for these "
        f"LEDs: {light.least_resistor_ohm:g} ohm. An LED's bar is its minus side.",
        *([f"Depends on unverified values: {', '.join(keys)}."] if keys else []),
    )


def _cut(page: DrawingPage, x: float, name: str, leds: int) -> None:
    """Draw a cut from plus to minus: the strip's own resistor, then its LEDs in series."""
    shown_leds, half = min(leds, MAX_DRAWN_LEDS), 2.2
    _box(page, x - 1.2, PLUS_Y + 4, x + 1.2, PLUS_Y + 11)
    y = PLUS_Y + 11
    page.line((x, PLUS_Y), (x, PLUS_Y + 4), "visible")
    for _ in range(shown_leds):
        top, bar = y + LED_STEP_MM - 2 * half, y + LED_STEP_MM
        page.line((x, y), (x, top), "visible")
        page.path([[(x - half, top), (x + half, top), (x, bar)]], "visible", closed=True)
        page.line((x - half, bar), (x + half, bar), "visible")
        # Emitted light.
        tip = (x + half + 3.2, top)
        page.line((tip[0] - 2.6, tip[1] + 1.6), tip)
        page.arrow(tip, (2.6, -1.6))
        y = bar
    page.line((x, y), (x, MINUS_Y), "visible")
    for end in (PLUS_Y, MINUS_Y):
        page.circle((x, end), JUNCTION_MM, "visible")
    page.text((x - 2, y + 6), name, TEXT_MM, "end")
    if leds > shown_leds:
        page.text((x - 2, PLUS_Y + 16), f"{leds} LEDs", TEXT_MM, "end")


def _box(
    page: DrawingPage, x0: float, y0: float, x1: float, y1: float, style: str = "visible"
) -> None:
    page.path([[(x0, y0), (x1, y0), (x1, y1), (x0, y1)]], style, closed=True)


def _stack(
    page: DrawingPage, x: float, y: float, lines: Sequence[str], first_mm: float = TITLE_MM
) -> None:
    """Draw lines of text below one another."""
    for i, line in enumerate(lines):
        page.text((x, y + i * (TEXT_LINE_MM + 0.4)), line, TEXT_MM if i else first_mm, "middle")
