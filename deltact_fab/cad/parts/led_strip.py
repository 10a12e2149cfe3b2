"""The LED strip, flat as it is cut and soldered, before it goes into the light holder's channel.

    +----+----+----+        led_count pieces of pitch_mm along x, cut from a strip that may be cut
    | [] | [] | [] |        at every LED; a LED in the middle of each, pads on either side of
    +----+----+----+        a cut. The wires leave at the -x end.

Frame: z = 0 is the adhesive's side, z up to the LEDs, x and y from the middle of the strip. LEDs
are taken to be square (5050: 5 x 5).
"""

from __future__ import annotations

import math
from collections.abc import Iterator

from ..dimensions import Design
from ..kernel import Shape, require
from ..part import AMBER, BOUGHT, Part
from ..rule import Quantity, Rule
from ..solid_gate import Box, around


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


def led_turns(d: Design) -> list[float]:
    """Angle of each LED about the lens's axis, from +x towards +y, in radians.

    The strip lies on the channel's outer wall, its gap in the middle of the wire slot at -y.
    """
    return [math.pi / 2 + x / d.strip_radius_mm for x in led_at_mm(d)]


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
        rules=rules,
        note="{d.light.led_count} single-LED cuts of {d.light.pitch_mm:.1f} x "
        "{d.light.strip_width_mm:g} mm, {d.light.strip_mm:.1f} mm in all; a {d.light.supply_v:g} V "
        "strip that is cut at every LED",
        how="cut between the LEDs and soldered, by the wiring drawing",
        look_for="plus to plus; no solder above the LEDs",
    ),
)
