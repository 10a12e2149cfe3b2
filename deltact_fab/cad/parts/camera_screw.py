"""The two screws that lock the camera's board to its holder, smooth bodies.

    cheese head screw (ISO 1207)

        +--+  +--+
        |  +--+  |  slot, along y
        +--+  +--+  z_board_front
           |  |
           +--+     z_board_front - screw_length

Built on the axis x = y = 0. The shank has the thread's nominal diameter, and so overlaps its pilot.
"""

from __future__ import annotations

from ..dimensions import Design
from ..kernel import Shape, require
from ..part import BOUGHT, STEEL, Part, Shift
from ..solid_gate import Box, around
from .solids import cylinders


def box(design: Design) -> Box:
    """Head and shank."""
    row, under, head = design.holder.row, design.z_board_front_mm, design.holder.row.head_mm / 2
    return around(head, head, under - design.holder.screw_length_mm, under + row.head_height_mm)


def build(design: Design) -> Shape:
    """A camera screw as one solid: its head on the board's front, the shank towards -z."""
    cq = require()
    row = design.holder.row
    under_mm, top_mm = design.z_board_front_mm, design.z_board_front_mm + row.head_height_mm
    head = cylinders([(0, 0)], row.head_mm, under_mm, row.head_height_mm)
    shank = cylinders([(0, 0)], row.thread_mm, under_mm, -design.holder.screw_length_mm)
    slot = (
        cq.Workplane()
        .workplane(offset=top_mm - row.slot_depth_mm)
        .rect(row.slot_mm, row.head_mm + 2)
        .extrude(row.slot_depth_mm + 1)
    )
    return head.union(shank).cut(slot).val()


def places(d: Design) -> list[Shift]:
    """On the board's upper holes; none where the board is bonded."""
    return [(x, y, 0.0) for x, y in d.camera_screw_centres_mm]


PARTS = (
    Part(
        "camera-screw",
        "steel, ISO 1207",
        BOUGHT,
        build,
        box,
        quantity=2,
        explode_mm=-41,
        colour=STEEL,
        places=places,
        sections=("holder",),
        derived=("camera_screw_centres_mm", "z_board_front_mm"),
        bound_by=("camera-holder",),
        note="{d.holder.screw} x {d.holder.screw_length_mm:g}, slotted",
        how="bought",
        look_for="the head is no higher than the light holder's floor",
    ),
)
