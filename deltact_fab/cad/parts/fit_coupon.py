"""The resin printer's fit coupon: holes and slots in steps, a block and a peg to try them with.

Seen from above:                                      From the front:

    +------------------------------------+                            +-+   peg
    |  o    o    o    o    o    o  +---+ |                          +-+-+-+
    |                              | O | |  block with its peg      |block|
    |  _    _    _    _    _    _  +---+ |   +----------------------+-----+--+
    +-| |--| |--| |--| |--| |--| |-------+   +--------------------------------+  base

Frame: z = 0 is the underside, z up; x along the row, from its middle. Hole and slot i measure
first + i step, the smallest at -x. Two coupons make a gauge: the peg of one is tried in the holes
of the other. What is measured goes into a table of readings, and `cad fit` reads that.
"""

from __future__ import annotations

from collections.abc import Iterator

from ..dimensions import Design
from ..drafting.dimensioning import Callouts, Cut, x_of
from ..kernel import Shape, cuboid, cylinders
from ..part import AMBER, PRINT, RESIN, Part
from ..rule import Quantity, Rule
from ..solid_gate import Box, around


def box(design: Design) -> Box:
    """Base, block and peg."""
    coupon, (x, y) = design.fit_coupon, design.fit_coupon.outer_mm
    top = coupon.base_mm + coupon.block_height_mm + coupon.peg_height_mm
    return around(x / 2, y / 2, 0.0, top)


def build(design: Design) -> Shape:
    """The coupon as one solid in its own frame, z from 0 to the peg's end."""
    coupon, (x, y) = design.fit_coupon, design.fit_coupon.outer_mm
    base, block_x = coupon.base_mm, coupon.block_x_mm
    row_y = coupon.slot_mm / 2  # midway between the slots' ends and the edge
    body = cuboid(around(x / 2, y / 2, 0.0, base))
    for i, size in enumerate(coupon.sizes_mm):
        at = coupon.pitch_mm * (i + 0.5) - x / 2
        body = body.cut(cylinders([(at, row_y)], size, -1, base + 2))
        # One more millimetre outside: a cutter does not end in the face that it opens.
        end = coupon.slot_mm - y / 2
        slot = ((at - size / 2, -y / 2 - 1, -1.0), (at + size / 2, end, base + 1))
        body = body.cut(cuboid(slot))
    top, half = base + coupon.block_height_mm, coupon.block_mm / 2
    block = cuboid(((block_x - half, row_y - half, base), (block_x + half, row_y + half, top)))
    peg = cylinders([(block_x, row_y)], coupon.peg_mm, top, coupon.peg_height_mm)
    return body.union(block).union(peg).val()


def rules(d: Design) -> Iterator[Rule]:
    """A peg that is on its block."""
    coupon = d.fit_coupon
    yield Quantity("peg_mm + 2", coupon.peg_mm + 2.0).at_most("block_mm", coupon.block_mm)


def callouts(d: Design) -> Callouts:
    """The coupon; section through the block."""
    notes = (
        "Each slot is as wide as the hole above it. No edge is broken or rubbed.",
        "Measure each hole, slot and outside length; enter nominal and measured in a table.",
    )
    coupon = d.fit_coupon
    at, half = coupon.block_x_mm, coupon.block_mm / 2
    block = x_of(at - half, at + half, fitted=False)
    return Callouts((block,), notes=notes, cut=Cut(at))


PARTS = (
    Part(
        "fit-coupon",
        RESIN,
        PRINT,
        build,
        box,
        group="tools",
        colour=AMBER,
        sections=("fit_coupon", "resin_printer"),
        rules=rules,
        wall_keys=("shell.wall_mm",),
        callouts=callouts,
        note="to measure the printer: cad fit",
        how="twice, far from each other",
        look_for="measure holes with pin gauges or drill shanks, the rest with a caliper",
    ),
)
