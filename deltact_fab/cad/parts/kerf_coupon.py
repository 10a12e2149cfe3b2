"""The laser's kerf coupon: a strip that is cut many times and measured as a stack.

    +--------------------+   width_mm, along y      n strips side by side are n kerfs shorter than
    |                    |                          n widths where the cut runs on the outline:
    +--------------------+   length_mm, along x     kerf = (n width - measured) / n

Frame: z = 0 is the underside, z up, x and y from the middle of the strip.
"""

from __future__ import annotations

from collections.abc import Iterator

from ..dimensions import Design
from ..drafting.dimensioning import Callouts
from ..kernel import Shape, cuboid
from ..part import CLEAR, LASER_CUT, Part
from ..rule import Quantity, Rule
from ..solid_gate import Box, around

PIECES = 10


def box(design: Design) -> Box:
    """The strip."""
    coupon = design.kerf_coupon
    return around(coupon.length_mm / 2, coupon.width_mm / 2, 0.0, design.optics.acrylic_mm)


def build(design: Design) -> Shape:
    """The strip as one solid in its own frame, z from 0 to the sheet's thickness."""
    return cuboid(box(design)).val()


def rules(d: Design) -> Iterator[Rule]:
    """A strip that can be told from its side."""
    coupon = d.kerf_coupon
    yield Quantity("width_mm", coupon.width_mm).below("length_mm", coupon.length_mm)


def callouts(d: Design) -> Callouts:
    """The strip."""
    notes = (
        f"{PIECES} pieces from the plate's own sheet, with the plate's own settings.",
        f"Measure {PIECES} side by side along the short side, each alone, and its thickness.",
    )
    return Callouts(notes=notes)


PARTS = (
    Part(
        "kerf-coupon",
        "cast PMMA, clear",
        LASER_CUT,
        build,
        box,
        quantity=PIECES,
        group="tools",
        colour=CLEAR,
        sections=("kerf_coupon", "optics", "laser"),
        rules=rules,
        callouts=callouts,
        note="to measure the laser: cad fit",
        how="cut by the DXF, all from one corner of the sheet",
        look_for="no burr that a caliper would count",
    ),
)
