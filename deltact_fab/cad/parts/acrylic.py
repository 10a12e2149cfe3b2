"""Part 2, the acrylic plate behind the skin (paper, Tactile Subsystem: rectangle, 2 mm thick).

   +--------------------+          z = -thickness (ledge) to the joint, 2 mm
   |                    |   y
+--+                    +--+  ^    Its y edges lie between the frame's ledge and the shell's.
|                          |  |    The corners are notched around the frame's posts; where the
+--+                    +--+  +->  walls hold the posts it is the paper's rectangle.
   |                    |      x
   +--------------------+
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..checks import Expected
from ..dimensions import Design, Point2
from ..kernel import require

if TYPE_CHECKING:
    from cadquery import Shape

NAME = "acrylic"


def notched(half_mm: Point2, notch_mm: Point2) -> list[Point2]:
    """Corners of the rectangle +-half without a notch in each corner, counter-clockwise."""
    w, h = half_mm
    if min(notch_mm) <= 0:
        return [(-w, -h), (w, -h), (w, h), (-w, h)]
    x, y = w - notch_mm[0], h - notch_mm[1]
    upper = [(w, y), (x, y), (x, h), (-x, h), (-x, y), (-w, y)]
    return upper + [(-a, -b) for a, b in upper]


def expect(design: Design) -> Expected:
    """Closed forms of the plate = (rectangle - 4 notches) x thickness."""
    (w, h), (nx, ny) = design.acrylic_half_mm, design.acrylic_notch_mm
    thickness_mm = design.optics.acrylic_mm
    volume_mm3 = 4 * (w * h - nx * ny) * thickness_mm
    return Expected(
        (volume_mm3, volume_mm3),
        ((-w, -h, design.z_joint_mm), (w, h, design.z_ledge_mm)),
        {
            "acrylic_mm": thickness_mm,
            "half_x_mm": w,
            "half_y_mm": h,
            "notch_x_mm": nx,
            "notch_y_mm": ny,
        },
    )


def build(design: Design) -> Shape:
    """The plate as one solid in the sensor frame, z from the joint to the ledge."""
    cq = require()
    outline = notched(design.acrylic_half_mm, design.acrylic_notch_mm)
    plan = cq.Workplane().workplane(offset=design.z_joint_mm).polyline(outline).close()
    return plan.extrude(design.optics.acrylic_mm).val()
