"""The LED strip, flat as it is cut and soldered, before it goes into the light holder's channel.

    +----+----+----+        led_count pieces of pitch_mm along x, cut from a strip that may be cut
    | [] | [] | [] |        at every LED; a LED in the middle of each, pads on either side of
    +----+----+----+        a cut. The wires leave at the -x end.

Frame: z = 0 is the adhesive's side, z up to the LEDs, x and y from the middle of the strip. Its DXF
also holds the ring along the lens's axis, on layer RING. LEDs are taken to be square (5050: 5 x 5).
Pads are drawn where such strips have them; their sizes are no dimension of the sensor.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

from ...aliases import Point2
from ..dimensions import Design
from ..kernel import Shape, require
from ..part import AMBER, BOUGHT, Flat, Part
from ..rule import Quantity, Rule
from ..solid_gate import Box, around

CUT, LED, MARK, RING = "CUT", "LED", "MARK", "RING"
PAD_MM = 1.5  # length of a pad; its width and place are shares of the strip's width
PAD_WIDTH, PAD_AT = 0.2, 0.3
BEYOND_MM = 1.0  # a cut mark stands out so far
APART_MM = 10.0  # between strip and ring


def box(design: Design) -> Box:
    """Strip and LEDs."""
    light = design.light
    high = light.strip_thickness_mm + light.led_height_mm
    return around(light.strip_mm / 2, light.strip_width_mm / 2, 0.0, high)


def led_at_mm(design: Design) -> list[float]:
    """x of each LED's middle."""
    light = design.light
    return [(k + 0.5) * light.pitch_mm - light.strip_mm / 2 for k in range(light.led_count)]


def build(design: Design) -> Shape:
    """Strip and LEDs as one solid in its own frame."""
    cq = require()
    light = design.light
    strip = cq.Workplane().rect(light.strip_mm, light.strip_width_mm)
    body = strip.extrude(light.strip_thickness_mm)
    leds = cq.Workplane().pushPoints([(x, 0.0) for x in led_at_mm(design)])
    # From the strip's underside, so that the two share a volume and not only a face.
    leds = leds.rect(light.led_width_mm, light.led_width_mm)
    return body.union(leds.extrude(light.strip_thickness_mm + light.led_height_mm)).val()


def rules(d: Design) -> Iterator[Rule]:
    """LEDs beside one another, on their strip."""
    light = d.light
    width = Quantity("led_width_mm", light.led_width_mm)
    yield width.below("pitch = 1000 / leds_per_m", light.pitch_mm)
    yield width.at_most("strip_width_mm", light.strip_width_mm)


def flat(d: Design) -> tuple[Flat, ...]:
    """Outline, LEDs, cut marks and pads of the strip; above it, the ring they make."""
    light = d.light
    half, high = light.strip_mm / 2, light.strip_width_mm / 2
    lines = [_box(CUT, 0.0, 0.0, half, high)]
    lines += [_box(LED, x, 0.0, *2 * [light.led_width_mm / 2]) for x in led_at_mm(d)]
    long = min(PAD_MM, (light.pitch_mm - light.led_width_mm) / 4)
    wide, at = PAD_WIDTH * light.strip_width_mm, PAD_AT * light.strip_width_mm
    for k in range(light.led_count + 1):
        x = k * light.pitch_mm - half
        if 0 < k < light.led_count:
            lines.append(_line((x, -high - BEYOND_MM), (x, high + BEYOND_MM)))
        # The pads of the piece that ends at this cut, and of the one that starts there.
        sides = [side for side, piece in ((-1, k - 1), (1, k)) if 0 <= piece < light.led_count]
        for side in sides:
            for y in (-at, at):
                lines.append(_box(MARK, x + side * long / 2, y, long / 2, wide / 2))
    # Wire side, beyond the -x end: + at the upper pad, - at the lower one.
    x = -half - 2 * BEYOND_MM
    lines += [_line((x - BEYOND_MM, y), (x + BEYOND_MM, y)) for y in (-at, at)]
    lines.append(_line((x, at - BEYOND_MM), (x, at + BEYOND_MM)))
    return (*lines, *_ring(d, high + APART_MM + d.light_radius_mm))


def led_turns(d: Design) -> list[float]:
    """Angle of each LED about the lens's axis, from +x towards +y, in radians.

    The strip lies on the channel's outer wall, its gap in the middle of the wire slot at -y.
    """
    return [math.pi / 2 + x / d.strip_radius_mm for x in led_at_mm(d)]


def _ring(d: Design, up_mm: float) -> Iterator[Flat]:
    """The holder's circles, its slot, and each LED on its chord; the axis at (0, up_mm)."""
    light = d.light
    for radius in (d.light_radius_mm, d.strip_radius_mm, d.channel_inner_mm, d.light_bore_mm):
        yield Flat(RING, ((radius, up_mm, 1.0), (-radius, up_mm, 1.0)))
    out, wall, half = d.light_radius_mm, d.strip_radius_mm, light.slot_mm / 2
    reach = [math.sqrt(r**2 - half**2) for r in (out, wall)]
    corners = [(-half, -reach[0]), (half, -reach[0]), (half, -reach[1]), (-half, -reach[1])]
    yield Flat(RING, tuple((x, y + up_mm, 0.0) for x, y in corners))
    half = light.led_width_mm / 2
    back = math.sqrt(wall**2 - half**2) - light.strip_thickness_mm
    for turn in led_turns(d):
        ux, uy = math.cos(turn), math.sin(turn)
        front = back - light.led_height_mm
        box = ((back, -half), (back, half), (front, half), (front, -half))
        yield Flat(RING, tuple((r * ux - t * uy, up_mm + r * uy + t * ux, 0.0) for r, t in box))


def _box(layer: str, x: float, y: float, half_x: float, half_y: float) -> Flat:
    corners = ((-1, -1), (1, -1), (1, 1), (-1, 1))
    return Flat(layer, tuple((x + a * half_x, y + b * half_y, 0.0) for a, b in corners))


def _line(a: Point2, b: Point2) -> Flat:
    return Flat(MARK, ((*a, 0.0), (*b, 0.0)), closed=False)


PARTS = (
    Part(
        "led-strip",
        "LED strip, 5050, white",
        BOUGHT,
        build,
        box,
        group="electronics",
        colour=AMBER,
        sections=("light",),
        derived=("strip_radius_mm", "channel_inner_mm"),
        rules=rules,
        note="{d.light.led_count} single-LED cuts of {d.light.pitch_mm:.1f} x "
        "{d.light.strip_width_mm:g} mm, {d.light.strip_mm:.1f} mm in all; a {d.light.supply_v:g} V "
        "strip that is cut at every LED",
        how="cut at every mark and soldered, by its DXF and the wiring drawing",
        look_for="plus to plus; no solder above the LEDs",
        flat=flat,
    ),
)
