"""A row of open wells of the molds' own resin, to see whether it lets the silicone cure.

Section along x:

    z = base + depth   +-+    +-+    +-+    +-+    +-+
                       | |    | |    | |    | |    | |   wells of diameter_mm, wall_mm between
    z = base           | +----+ +----+ +----+ +----+ |   and around them
    z = 0              +-----------------------------+

Frame: z = 0 is the underside, z up; x along the row, from its middle. Platinum-cure silicone stays
tacky on a resin that inhibits it: each well takes another post-cure or barrier coat, and one mix.
"""

from __future__ import annotations

import math

from ...aliases import Point2
from ..dimensions import Design
from ..drafting.dimensioning import Callouts, Cut
from ..kernel import Shape, cuboid, cylinders
from ..part import AMBER, PRINT, RESIN, Part
from ..solid_gate import Box, around


def well_volume_mm3(design: Design) -> float:
    """Volume of one well, filled to the brim."""
    return math.pi / 4 * design.coupon.diameter_mm**2 * design.coupon.depth_mm


def centres_mm(design: Design) -> list[Point2]:
    """Axes of the wells, from -x; pitch = diameter + wall."""
    coupon = design.coupon
    pitch_mm = coupon.diameter_mm + coupon.wall_mm
    return [(pitch_mm * (i - (coupon.wells - 1) / 2), 0.0) for i in range(coupon.wells)]


def box(design: Design) -> Box:
    """The row of wells."""
    x, y, z = design.coupon_outer_mm
    return around(x / 2, y / 2, 0.0, z)


def build(design: Design) -> Shape:
    """The coupon mold as one solid in its own frame, z from 0 to its top."""
    coupon = design.coupon
    wells = cylinders(centres_mm(design), coupon.diameter_mm, coupon.base_mm, coupon.depth_mm + 1)
    return cuboid(box(design)).cut(wells).val()


def callouts(d: Design) -> Callouts:
    """The wells; section through the first."""
    notes = ("Same resin, same wash, cure and coat as the mold: it is there to test them.",)
    return Callouts(notes=notes, cut=Cut(centres_mm(d)[0][0]))


PARTS = (
    Part(
        "coupon-mold",
        RESIN,
        PRINT,
        build,
        box,
        group="tools",
        colour=AMBER,
        sections=("coupon",),
        derived=("coupon_outer_mm",),
        wall_keys=("shell.wall_mm",),
        callouts=callouts,
        note="to test whether the resin inhibits the cure",
        how="same job and same wash as the mold",
        look_for="as the mold",
    ),
)
