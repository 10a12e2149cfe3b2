"""Part 8, the four cap screws through cover and shell into the frame, and the camera's two.

    cap screw (ISO 4762)              cheese head screw (ISO 1207)

        +--+  z_head + length             +--+  +--+
        |  |                              |  +--+  |  slot, along y
     +--+  +--+  z_head                   +--+  +--+  z_board_front
     |  +--+  |  hexagon socket              |  |
     +--+  +--+  z_head - head height        +--+     z_board_front - screw_length

Smooth bodies on the axis x = y = 0: a shank has the thread's nominal diameter, and so overlaps its
pilot.
"""

from __future__ import annotations

from collections.abc import Iterator

from deltact_fab.common import Check

from ..dimensions import Design
from ..kernel import Extent, Shape, around, cuboid, cylinders, require
from ..part import BOUGHT_PROCESS, STEEL_RGBA, Part, Shift
from ..rule import at_most


def box(design: Design) -> Extent:
    """Bounding box of head and shank."""
    row, under, head = design.screw.row, design.z_head_mm, design.screw.row.head_mm / 2
    return around(head, head, under - row.head_height_mm, under + design.screw.length_mm)


def build(design: Design) -> Shape:
    """Build a cap screw as one solid: head backwards, its underside at z_head."""
    row, under = design.screw.row, design.z_head_mm
    back = under - row.head_height_mm
    plan = require().Workplane().workplane(offset=back - 1)
    socket = plan.polygon(6, row.socket_mm, circumscribed=True).extrude(row.head_height_mm / 2 + 1)
    head = cylinders([(0, 0)], row.head_mm, back, row.head_height_mm)
    shank = cylinders([(0, 0)], row.thread_mm, under, design.screw.length_mm)
    return head.union(shank).cut(socket).val()


def camera_box(design: Design) -> Extent:
    """Bounding box of a camera screw."""
    row, under, head = design.holder.row, design.z_board_front_mm, design.holder.row.head_mm / 2
    return around(head, head, under - design.holder.screw_length_mm, under + row.head_height_mm)


def build_camera_screw(design: Design) -> Shape:
    """Build a camera screw as one solid: head on the board's front, shank towards -z."""
    row, under = design.holder.row, design.z_board_front_mm
    top = under + row.head_height_mm
    slot = around(row.slot_mm / 2, row.head_mm / 2 + 1, top - row.slot_depth_mm, top + 1)
    head = cylinders([(0, 0)], row.head_mm, under, row.head_height_mm)
    shank = cylinders([(0, 0)], row.thread_mm, under, -design.holder.screw_length_mm)
    return head.union(shank).cut(cuboid(slot)).val()


def places(d: Design) -> list[Shift]:
    """Positions on the axes of the four corner posts."""
    return [(x, y, 0.0) for x, y in d.screw_centres_mm]


def camera_places(d: Design) -> list[Shift]:
    """Positions on the board's upper holes; none if the board is bonded."""
    return [(x, y, 0.0) for x, y in d.camera_screw_centres_mm]


def rules(d: Design) -> Iterator[Check]:
    """Rule that the heads do not protrude from the back."""
    heads, z_mm = "back of the screw heads (screw.length_mm)", box(d)[0][2]
    yield at_most("heads-inside", "back of the sensor", d.z_back_mm, heads, z_mm)


def stock_note(d: Design) -> str:
    """Return a note on a screw length that is not stocked; empty if it is."""
    screw, row = d.screw, d.screw.row
    if screw.length_mm in row.stock_mm:
        return ""
    name = f"{screw.thread} x {screw.length_mm:g} is not stocked"
    longer = next((length for length in row.stock_mm if length > screw.length_mm), None)
    if longer is not None:
        return f"{name}: cut one of {longer:g} mm down and dress the thread"
    longest = row.stock_mm[-1]
    return (
        f"{name}; the longest sold is {longest:g} mm: make it from {screw.thread} threaded rod "
        f"with a nut as head (glued on, corners filed to pass the {row.bore_mm:g} mm bore, a slot "
        f"sawn across), or use screw.length_mm={longest:g}"
    )


def note(d: Design) -> str:
    """Return size, key, and a note if the length is not stocked."""
    size = f"{d.screw.thread} x {d.screw.length_mm:g}, key {d.screw.row.socket_mm:g} mm"
    stock = stock_note(d)
    return f"{size}; {stock}" if stock else size


PARTS = (
    Part(
        "screw",
        build,
        box,
        material="cap screw, ISO 4762, stainless steel A2",
        process=BOUGHT_PROCESS,
        quantity=4,
        spares=2,
        number=8,
        explode_mm=-104,
        colour=STEEL_RGBA,
        places=places,
        sections=("screw",),
        derived=("z_head_mm",),
        rules=rules,
        note=note,
        look_for="measure the length below the head",
    ),
    Part(
        "camera-screw",
        build_camera_screw,
        camera_box,
        material="cheese head screw, ISO 1207, stainless steel A2",
        process=BOUGHT_PROCESS,
        quantity=2,
        spares=2,
        explode_mm=-41,
        colour=STEEL_RGBA,
        places=camera_places,
        sections=("holder",),
        derived=("z_board_front_mm",),
        note="{d.holder.screw} x {d.holder.screw_length_mm:g}, slotted",
        look_for="the head is no higher than the light holder's floor",
    ),
)
