"""Test coupons, made and measured before the parts.

The coupon mold: a row of open wells of the molds' own resin, to test whether the silicone cures on
it. Platinum-cure silicone stays tacky on a resin that inhibits it: each well gets another post-cure
or barrier coat, and the same mix.

Section along x:

    z = base + depth   +-+    +-+    +-+    +-+    +-+
                       | |    | |    | |    | |    | |   wells of diameter_mm, wall_mm between
    z = base           | +----+ +----+ +----+ +----+ |   and around them
    z = 0              +-----------------------------+

The resin printer's fit coupon: holes and slots in steps, a block and a peg to try them with.

Seen from above:                                      From the front:

    +------------------------------------+                            +-+   peg
    |  o    o    o    o    o    o  +---+ |                          +-+-+-+
    |                              | O | |  block with its peg      |block|
    |  _    _    _    _    _    _  +---+ |   +----------------------+-----+--+
    +-| |--| |--| |--| |--| |--| |-------+   +--------------------------------+  base

Hole and slot i measure first + i step, the smallest at -x. Two coupons make a gauge: the peg of one
is tried in the holes of the other.

The laser's kerf coupon: a strip that is cut many times and measured as a stack.

    +--------------------+   width_mm, along y      n strips side by side are n kerfs shorter than
    |                    |                          n widths if the cut runs on the outline:
    +--------------------+   length_mm, along x     kerf = (n width - measured) / n

Frame of each: z = 0 is the underside, z up; x along the row or strip, from its middle. Measurements
go into a table of readings for `cad fit`.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

from deltact_fab.common import Check, Point2

from ..dimensions import Design
from ..drafting.dimensioning import Callouts, x_of
from ..kernel import Extent, Shape, around, cuboid, cylinders
from ..part import AMBER_RGBA, CLEAR_RGBA, LASER_CUT, RESIN_MATERIAL, Part
from ..rule import at_most, below
from .mold import MOLD_POSE

KERF_PIECES = 10  # by hand: more average the kerf better and take more sheet


def well_volume_mm3(design: Design) -> float:
    """Volume of one well, filled to the brim."""
    return math.pi / 4 * design.coupon.diameter_mm**2 * design.coupon.depth_mm


def centres_mm(design: Design) -> list[Point2]:
    """Axes of the wells, from -x; pitch = diameter + wall."""
    coupon = design.coupon
    pitch_mm = coupon.diameter_mm + coupon.wall_mm
    return [(pitch_mm * (i - (coupon.wells - 1) / 2), 0.0) for i in range(coupon.wells)]


def well_box(design: Design) -> Extent:
    """Bounding box of the row of wells."""
    coupon, wall_mm = design.coupon, design.coupon.wall_mm
    x = coupon.wells * coupon.diameter_mm + (coupon.wells + 1) * wall_mm
    return around(x / 2, coupon.diameter_mm / 2 + wall_mm, 0.0, coupon.base_mm + coupon.depth_mm)


def well_build(design: Design) -> Shape:
    """The coupon mold as one solid in its own frame, z from 0 to its top."""
    coupon = design.coupon
    wells = cylinders(centres_mm(design), coupon.diameter_mm, coupon.base_mm, coupon.depth_mm + 1)
    return cuboid(well_box(design)).cut(wells).val()


def well_callouts(d: Design) -> Callouts:
    """Drawing content: wells, section through the first."""
    notes = ("Same resin, same wash, cure and coat as the mold, to test them.",)
    return Callouts(notes=notes, cut_x_mm=centres_mm(d)[0][0])


def fit_box(design: Design) -> Extent:
    """Bounding box of base, block and peg."""
    coupon, (x, y) = design.fit_coupon, design.fit_coupon.outer_mm
    top = coupon.base_mm + coupon.block_height_mm + coupon.peg_height_mm
    return around(x / 2, y / 2, 0.0, top)


def fit_build(design: Design) -> Shape:
    """The coupon as one solid in its own frame, z from 0 to the peg's end."""
    coupon, (x, y) = design.fit_coupon, design.fit_coupon.outer_mm
    base, block_x = coupon.base_mm, coupon.block_x_mm
    row_y = coupon.slot_mm / 2  # midway between the slots' ends and the edge
    body = cuboid(around(x / 2, y / 2, 0.0, base))
    for i, size in enumerate(coupon.sizes_mm):
        centre_x = coupon.pitch_mm * (i + 0.5) - x / 2
        body = body.cut(cylinders([(centre_x, row_y)], size, -1, base + 2))
        # 1 mm longer outside, so that no face of the cutter coincides with one of the body.
        end = coupon.slot_mm - y / 2
        slot = ((centre_x - size / 2, -y / 2 - 1, -1.0), (centre_x + size / 2, end, base + 1))
        body = body.cut(cuboid(slot))
    top, half = base + coupon.block_height_mm, coupon.block_mm / 2
    block = cuboid(((block_x - half, row_y - half, base), (block_x + half, row_y + half, top)))
    peg = cylinders([(block_x, row_y)], coupon.peg_mm, top, coupon.peg_height_mm)
    return body.union(block).union(peg).val()


def fit_rules(d: Design) -> Iterator[Check]:
    """Rule of the peg on its block."""
    coupon = d.fit_coupon
    yield at_most("peg-on-block", "peg_mm + 2", coupon.peg_mm + 2.0, "block_mm", coupon.block_mm)


def fit_callouts(d: Design) -> Callouts:
    """Drawing content: coupon, section through the block."""
    notes = (
        "Each slot is as wide as the hole above it. No edge is broken or rubbed.",
        "Measure each hole, slot and outside length; enter nominal and measured in a table.",
    )
    coupon = d.fit_coupon
    centre_x, half = coupon.block_x_mm, coupon.block_mm / 2
    block = x_of(centre_x - half, centre_x + half, fitted=False)
    return Callouts((block,), notes=notes, cut_x_mm=centre_x)


def kerf_box(design: Design) -> Extent:
    """Bounding box of the strip."""
    coupon = design.kerf_coupon
    return around(coupon.length_mm / 2, coupon.width_mm / 2, 0.0, design.optics.acrylic_mm)


def kerf_build(design: Design) -> Shape:
    """The strip as one solid in its own frame, z from 0 to the sheet's thickness."""
    return cuboid(kerf_box(design)).val()


def kerf_rules(d: Design) -> Iterator[Check]:
    """Rule that tells the strip's sides apart."""
    coupon = d.kerf_coupon
    yield below("strip-sides", "width_mm", coupon.width_mm, "length_mm", coupon.length_mm)


def kerf_callouts(d: Design) -> Callouts:
    """Drawing content of the strip."""
    notes = (
        f"{KERF_PIECES} pieces from the plate's own sheet, with the plate's own settings.",
        f"Measure {KERF_PIECES} side by side along the short side, each alone, and its thickness.",
    )
    return Callouts(notes=notes)


PARTS = (
    Part(
        "coupon-mold",
        well_build,
        well_box,
        material=RESIN_MATERIAL,
        group="tools",
        colour=AMBER_RGBA,
        sections=("coupon",),
        wall_keys=("shell.wall_mm",),
        callouts=well_callouts,
        pose=MOLD_POSE,
        note="to test whether the resin inhibits the cure",
        how="same job and same wash as the mold",
        look_for="as the mold",
    ),
    Part(
        "fit-coupon",
        fit_build,
        fit_box,
        material=RESIN_MATERIAL,
        group="tools",
        colour=AMBER_RGBA,
        sections=("fit_coupon", "resin_printer"),
        rules=fit_rules,
        wall_keys=("shell.wall_mm",),
        callouts=fit_callouts,
        note="to measure the printer: cad fit",
        how="twice, far from each other",
        look_for="measure holes with pin gauges or drill shanks, the rest with a caliper",
    ),
    Part(
        "kerf-coupon",
        kerf_build,
        kerf_box,
        material="cast PMMA, clear",
        process=LASER_CUT,
        quantity=KERF_PIECES,
        group="tools",
        colour=CLEAR_RGBA,
        sections=("kerf_coupon", "optics", "laser"),
        rules=kerf_rules,
        callouts=kerf_callouts,
        note="to measure the laser: cad fit",
        how="cut to the DXF, all from one corner of the sheet",
        look_for="no burr that affects a caliper reading",
    ),
)
