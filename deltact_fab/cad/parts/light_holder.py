"""Part 4, the light holder: a translucent ring round the lens, with a channel for the LED strip.

Half section at y = 0, the lens's axis on the left:

    z_light        +---+     +---+     a little below the acrylic: it bears no press
                   |   |     |   |
                   | d |  c  | w |     d: diffuser, c: channel, open towards +z, w: outer wall
                   |   |     |   |
                   |   +-----+   |
                   |    floor    |
    z_board_front  +-------------+     stands on the camera's board
               light_bore    light_radius

A slot of slot_mm through the outer wall at -y, above the floor, lets the wires out on the side
where the camera's cable leaves. The heads of the camera's two screws stand in reliefs of the floor.
The paper gives the material and the LEDs (Imaging Subsystem), no dimensions.
"""

from __future__ import annotations

import math
from dataclasses import asdict
from typing import TYPE_CHECKING

from ..checks import Expected
from ..dimensions import Design
from ..kernel import require
from .planes import band_mm2, common_circles_mm2

if TYPE_CHECKING:
    from cadquery import Shape

NAME = "light-holder"


def expect(design: Design) -> Expected:
    """Closed forms of the ring, also where a relief meets its edge or misses it."""
    light = design.light
    radius, strip, inner, bore = (
        design.light_radius_mm,
        design.strip_radius_mm,
        design.channel_inner_mm,
        design.light_bore_mm,
    )
    height_mm = design.z_light_mm - design.z_board_front_mm
    depth_mm = height_mm - light.floor_mm
    volume_mm3 = math.pi * (radius**2 - bore**2) * height_mm
    volume_mm3 -= math.pi * (strip**2 - inner**2) * depth_mm
    half_slot_mm = light.slot_mm / 2
    slot_mm2 = (band_mm2(half_slot_mm, radius) - band_mm2(half_slot_mm, strip)) / 2
    volume_mm3 -= slot_mm2 * depth_mm
    for x, y in design.camera_screw_centres_mm:
        away, relief = math.hypot(x, y), design.head_relief_mm
        met_mm2 = common_circles_mm2(relief, radius, away) - common_circles_mm2(relief, bore, away)
        volume_mm3 -= met_mm2 * light.floor_mm
    return Expected(
        (volume_mm3, volume_mm3),
        (
            (-radius, -radius, design.z_board_front_mm),
            (radius, radius, design.z_light_mm),
        ),
        {
            **{key: asdict(light)[key] for key in SHOWN},
            "light_radius_mm": radius,
            "light_bore_mm": bore,
            "head_relief_mm": design.head_relief_mm,
        },
    )


def build(design: Design) -> Shape:
    """The ring as one solid in the sensor frame, z from the board's front to z_light."""
    cq = require()
    light = design.light
    low_mm, high_mm = design.z_board_front_mm, design.z_light_mm
    floor_mm = low_mm + light.floor_mm
    ring = (
        cq.Workplane()
        .workplane(offset=low_mm)
        .circle(design.light_radius_mm)
        .circle(design.light_bore_mm)
        .extrude(high_mm - low_mm)
    )
    above = cq.Workplane().workplane(offset=floor_mm)
    up_mm = high_mm - floor_mm + 1
    channel = above.circle(design.strip_radius_mm).circle(design.channel_inner_mm).extrude(up_mm)
    # Ends inside the channel along a circle: a straight end could reach into the diffuser.
    outside = design.light_radius_mm + 1
    slot = above.center(0, -outside / 2).rect(light.slot_mm, outside).extrude(up_mm)
    middle_mm = (design.strip_radius_mm + design.channel_inner_mm) / 2
    slot = slot.cut(above.circle(middle_mm).extrude(up_mm))
    reliefs = (
        cq.Workplane()
        .workplane(offset=low_mm - 1)
        .pushPoints(design.camera_screw_centres_mm)
        .circle(design.head_relief_mm)
        .extrude(light.floor_mm + 1)
    )
    return ring.cut(channel).cut(slot).cut(reliefs).val()


SHOWN = ("strip_width_mm", "channel_mm", "diffuser_mm", "wall_mm", "floor_mm", "fit_mm", "slot_mm")
