"""Part 6, the camera holder: the plate behind the camera's board (paper, Imaging Subsystem).

Seen along -z:                                   y
                 +---------------+               ^     tongue: carries the two pilots, into which
                 |  o         o  |               |     the camera's screws cut their thread
    +------------+   _________   +------------+  +-> x
    | O             |         |             O |
    |               | window  |               |        window: room for the connector, open
    |               |         |               |        towards -y for the cable
    | O             |         |             O |
    +---------------+         +---------------+        O: holes for the cover's pegs

The board lies on its front; the cover's floor bears on its back.
"""

from __future__ import annotations

import math
from dataclasses import asdict
from typing import TYPE_CHECKING

from ..checks import Expected
from ..dimensions import Design
from ..kernel import require

if TYPE_CHECKING:
    from cadquery import Shape

NAME = "camera-holder"


def expect(design: Design) -> Expected:
    """Closed forms of the plate."""
    holder, half_x, arm = design.holder, design.holder_half_x_mm, design.holder_arm_mm
    tongue, top = design.holder_tongue_mm
    window_mm2 = 2 * design.holder_window_half_mm * (arm + design.holder_window_top_mm)
    area_mm2 = 4 * half_x * arm + 2 * tongue * max(top - arm, 0.0) - window_mm2
    area_mm2 -= math.pi * design.cover.hole_mm**2
    area_mm2 -= math.pi / 2 * holder.row.pilot_mm**2
    volume_mm3 = area_mm2 * holder.clearance_mm
    numbers = {key: value for key, value in asdict(holder).items() if key.endswith("_mm")}
    return Expected(
        (volume_mm3, volume_mm3),
        ((-half_x, -arm, design.z_floor_mm), (half_x, max(arm, top), design.z_board_back_mm)),
        {
            **numbers,
            "holder_half_x_mm": half_x,
            "holder_arm_mm": arm,
            "holder_window_half_mm": design.holder_window_half_mm,
            "holder_window_top_mm": design.holder_window_top_mm,
            "peg_hole_mm": design.cover.hole_mm,
        },
    )


def build(design: Design) -> Shape:
    """The plate as one solid in the sensor frame, z from the cover's floor to the board's back."""
    cq = require()
    half_x, arm = design.holder_half_x_mm, design.holder_arm_mm
    tongue, top = design.holder_tongue_mm
    window, window_top = design.holder_window_half_mm, design.holder_window_top_mm
    outline = [(-window, window_top), (-window, -arm), (-half_x, -arm), (-half_x, arm)]
    if top > arm:
        outline += [(-tongue, arm), (-tongue, top)]
    outline += [(-x, y) for x, y in reversed(outline)]
    plan = cq.Workplane().workplane(offset=design.z_floor_mm).polyline(outline).close()
    body = plan.extrude(design.holder.clearance_mm)
    for centres, diameter_mm in (
        (design.peg_centres_mm, design.cover.hole_mm),
        (design.camera_screw_centres_mm, design.holder.row.pilot_mm),
    ):
        holes = (
            cq.Workplane()
            .workplane(offset=design.z_floor_mm - 1)
            .pushPoints(centres)
            .circle(diameter_mm / 2)
            .extrude(design.holder.clearance_mm + 2)
        )
        body = body.cut(holes)
    return body.val()
