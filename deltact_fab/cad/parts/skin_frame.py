"""Part 1, the tactile skin base: the black frame that the skin is cast into.

Seen along -z (from the touched side):            Section at x = 0:

    +--------------------------------+               z = -protrusion
    |  o  +--------------------+  o  |  y        +---+     +---+
    |     |                    |     |  ^        |   |     |   |  frame height
    +-----+                    +-----+  |        |  _|     |_  |  z = -thickness: the ledge
      |           window           |    +-> x    +-+         +-+
    +-----+  width x length    +-----+             <-> seat_y
    |     |  less the posts    |     |
    |  o  +--------------------+  o  |        o: blind pilot from below, pilot depth deep, on the
    +--------------------------------+           axis of the square corner post (side post)

The paper gives no drawing. A 3 mm wall cannot hold an M1.6 screw, so a square post stands in each
corner and takes a corner of the window; the skin is notched there below the protrusion. Behind the
skin the window is wider in y, so that the acrylic plate rests on a ledge. Frame and skin share
faces and no volume.
"""

from __future__ import annotations

import math
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from ..checks import Expected
from ..dimensions import Design, Point2
from ..kernel import require

if TYPE_CHECKING:
    from cadquery import Shape

NAME = "skin-frame"


def window_area_mm2(design: Design) -> float:
    """Area of the window in front of the ledge = width x length - 4 post corners."""
    x_mm, y_mm = design.post_in_window_mm
    return design.skin.width_mm * design.skin.length_mm - 4 * x_mm * y_mm


def pocket_area_mm2(design: Design) -> float:
    """Area of the acrylic's pocket behind the ledge = its rectangle - what the posts take."""
    x, y = design.seat_half_mm
    px, py = design.post_edge_mm
    corner = max(x - px, 0.0) * max(y - py, 0.0)
    return 4 * (x * y - corner)


def expect(design: Design) -> Expected:
    """Closed forms of the frame."""
    skin, screw = design.skin, design.screw
    outer_x, outer_y = design.frame_outer_mm
    hole_mm3 = math.pi / 4 * screw.row.pilot_mm**2 * screw.pilot_depth_mm
    behind_mm = skin.thickness_mm - skin.protrusion_mm
    acrylic_mm = design.optics.acrylic_mm
    volume_mm3 = outer_x * outer_y * design.frame_height_mm - 4 * hole_mm3
    volume_mm3 -= window_area_mm2(design) * behind_mm + pocket_area_mm2(design) * acrylic_mm
    half = (outer_x / 2, outer_y / 2)
    return Expected(
        (volume_mm3, volume_mm3),
        ((-half[0], -half[1], design.z_joint_mm), (half[0], half[1], design.z_front_mm)),
        {
            "width_mm": skin.width_mm,
            "length_mm": skin.length_mm,
            **asdict(design.frame),
            "post_mm": design.post_mm,
            "frame_height_mm": design.frame_height_mm,
            "pilot_depth_mm": screw.pilot_depth_mm,
        },
    )


def build(design: Design) -> Shape:
    """The frame as one solid in the sensor frame, z from the joint to -protrusion."""
    cq = require()
    screw = design.screw
    bottom_mm = design.z_joint_mm
    outer = cq.Workplane().workplane(offset=bottom_mm).rect(*design.frame_outer_mm)
    body = outer.extrude(design.frame_height_mm)
    # Cutters stand out at the ends: faces that coincide are where booleans go wrong.
    window = (design.skin.width_mm / 2, design.skin.length_mm / 2)
    if design.skin.thickness_mm > design.skin.protrusion_mm:
        body = body.cut(_prism(cq, design, window, bottom_mm - 1, design.z_front_mm + 1))
    body = body.cut(_prism(cq, design, design.seat_half_mm, bottom_mm - 1, design.z_ledge_mm))
    pilots = (
        cq.Workplane()
        .workplane(offset=bottom_mm - 1)
        .pushPoints(design.screw_centres_mm)
        .circle(screw.row.pilot_mm / 2)
        .extrude(screw.pilot_depth_mm + 1)
    )
    return body.cut(pilots).val()


def _prism(cq: Any, design: Design, half: Point2, low_mm: float, high_mm: float) -> Any:
    """A prism of the rectangle +-half without the corners in which the posts stand."""
    w, h = half
    px, py = design.post_edge_mm
    if px >= w or py >= h:
        outline = [(-w, -h), (w, -h), (w, h), (-w, h)]
    else:
        upper = [(w, py), (px, py), (px, h), (-px, h), (-px, py), (-w, py)]
        outline = upper + [(-x, -y) for x, y in upper]
    plan = cq.Workplane().workplane(offset=low_mm).polyline(outline).close()
    return plan.extrude(high_mm - low_mm)
