"""The bought screws as smooth bodies: M1.6 cap screws and the camera's two cheese head screws.

    cap screw (ISO 4762), part 8            cheese head screw (ISO 1207)

        +--+  z_head + length                   +--+  +--+
        |  |                                    |  +--+  |  slot, along y
     +--+  +--+  z_head                         +--+  +--+  z_board_front
     |  +--+  |  hexagon socket                    |  |
     +--+  +--+  z_head - head height              +--+  z_board_front - screw_length

Both are built on the axis x = y = 0; assembly.places says where they go. Threads are left out:
the shank has the thread's nominal diameter, and so overlaps its pilot (assembly.thread_overlap).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from ..checks import Expected
from ..dimensions import Design
from ..kernel import require
from .planes import band_mm2

if TYPE_CHECKING:
    from cadquery import Shape

NAME = "screw"


def expect(design: Design) -> Expected:
    """Closed forms of the cap screw."""
    row, length_mm = design.screw.row, design.screw.length_mm
    volume_mm3 = math.pi / 4 * row.head_mm**2 * row.head_height_mm
    volume_mm3 -= math.sqrt(3) / 2 * row.socket_mm**2 * row.head_height_mm / 2
    volume_mm3 += math.pi / 4 * row.thread_mm**2 * length_mm
    head = row.head_mm / 2
    return Expected(
        (volume_mm3, volume_mm3),
        (
            (-head, -head, design.z_head_mm - row.head_height_mm),
            (head, head, design.z_head_mm + length_mm),
        ),
        {"length_mm": length_mm, "thread_mm": row.thread_mm, "head_mm": row.head_mm},
    )


def build(design: Design) -> Shape:
    """A cap screw as one solid: head backwards, its underside at z_head on the axis x = y = 0."""
    cq = require()
    row = design.screw.row
    under_mm, back_mm = design.z_head_mm, design.z_head_mm - row.head_height_mm
    head = cq.Workplane().workplane(offset=back_mm).circle(row.head_mm / 2)
    shank = cq.Workplane().workplane(offset=under_mm).circle(row.thread_mm / 2)
    socket = (
        cq.Workplane()
        .workplane(offset=back_mm - 1)
        .polygon(6, row.socket_mm, circumscribed=True)
        .extrude(row.head_height_mm / 2 + 1)
    )
    body = head.extrude(row.head_height_mm).union(shank.extrude(design.screw.length_mm))
    return body.cut(socket).val()


def expect_camera_screw(design: Design) -> Expected:
    """Closed forms of the camera's screw."""
    row, length_mm = design.holder.row, design.holder.screw_length_mm
    head = row.head_mm / 2
    volume_mm3 = math.pi * head**2 * row.head_height_mm
    volume_mm3 -= band_mm2(row.slot_mm / 2, head) * row.slot_depth_mm
    volume_mm3 += math.pi / 4 * row.thread_mm**2 * length_mm
    under_mm = design.z_board_front_mm
    return Expected(
        (volume_mm3, volume_mm3),
        ((-head, -head, under_mm - length_mm), (head, head, under_mm + row.head_height_mm)),
        {"screw_length_mm": length_mm, "thread_mm": row.thread_mm, "head_mm": row.head_mm},
    )


def build_camera_screw(design: Design) -> Shape:
    """A camera screw as one solid: its head on the board's front, the shank towards -z."""
    cq = require()
    row = design.holder.row
    under_mm, top_mm = design.z_board_front_mm, design.z_board_front_mm + row.head_height_mm
    on_board = cq.Workplane().workplane(offset=under_mm)
    head = on_board.circle(row.head_mm / 2).extrude(row.head_height_mm)
    shank = on_board.circle(row.thread_mm / 2).extrude(-design.holder.screw_length_mm)
    slot = (
        cq.Workplane()
        .workplane(offset=top_mm - row.slot_depth_mm)
        .rect(row.slot_mm, row.head_mm + 2)
        .extrude(row.slot_depth_mm + 1)
    )
    return head.union(shank).cut(slot).val()
