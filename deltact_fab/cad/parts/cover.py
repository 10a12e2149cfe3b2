"""Part 7, the cover: the floor, four bosses for the screw heads, four snap-fit pegs.

A corner, cut through a screw's axis:       A peg, seen along y:

    z_boss   +--+   +--+                              +--. .--+      lead-in cone
             |  |   |  |  clearance hole              |  | |  |      lip
    z_head   | ++   ++ |                              +-+| |+-+      z_board_back
             | | head |--------- z_floor                || ||        in the holder's hole
    z_back   +-+      +---------                     ---++-++---     z_floor

The heads bear at z_head, so the bosses grow where the screws are shorter. A slot along y splits
each peg into two legs that bend along x. The lip of a leg is round about an axis lip_mm further
out than the peg's: when the leg has bent by lip_mm its outline is the hole's own circle. A lip
round about the peg's axis would be wider along y than the hole, where no leg gives way. The paper
(Mechanical Subsystem) has the four snap-fit cylinders, the wall and the four screws, no drawing.
"""

from __future__ import annotations

import math
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from ..checks import Expected
from ..dimensions import Design, Point2
from ..kernel import require
from .planes import cone_segment_mm3, segment_mm2

if TYPE_CHECKING:
    from cadquery import Shape

NAME = "cover"


def expect(design: Design) -> Expected:
    """Closed forms of the cover."""
    row, (outer_x, outer_y) = design.screw.row, design.frame_outer_mm
    boss_mm, head_mm = design.z_boss_mm - design.z_floor_mm, design.z_head_mm - design.z_back_mm
    volume_mm3 = outer_x * outer_y * design.cover.floor_mm + 4 * design.post_mm**2 * boss_mm
    volume_mm3 -= math.pi * row.bore_mm**2 * head_mm
    volume_mm3 -= math.pi * row.clearance_mm**2 * (design.z_boss_mm - design.z_head_mm)
    volume_mm3 += 8 * _leg_mm3(design)
    top = max(design.z_boss_mm, design.z_floor_mm + design.peg_length_mm)
    half = (outer_x / 2, outer_y / 2)
    return Expected(
        (volume_mm3, volume_mm3),
        ((-half[0], -half[1], design.z_back_mm), (half[0], half[1], top)),
        {
            **asdict(design.cover),
            "post_mm": design.post_mm,
            "bore_mm": row.bore_mm,
            "boss_mm": boss_mm,
            "peg_length_mm": design.peg_length_mm,
        },
    )


def build(design: Design) -> Shape:
    """The cover as one solid in the sensor frame, z from the back to the bosses or the pegs."""
    cq = require()
    row, (outer_x, outer_y) = design.screw.row, design.frame_outer_mm
    back_mm = design.z_back_mm
    boss_mm = max(design.z_boss_mm, design.z_floor_mm)
    body = cq.Workplane().workplane(offset=back_mm).rect(outer_x, outer_y)
    body = body.extrude(boss_mm - back_mm)
    if boss_mm > design.z_floor_mm:
        x, y = design.post_edge_mm
        far_x, far_y = outer_x / 2 + 1, outer_y / 2 + 1
        upper = [(far_x, y), (x, y), (x, far_y), (-x, far_y), (-x, y), (-far_x, y)]
        between = upper + [(-px, -py) for px, py in upper]
        plan = cq.Workplane().workplane(offset=design.z_floor_mm).polyline(between).close()
        body = body.cut(plan.extrude(boss_mm - design.z_floor_mm + 1))
    for diameter_mm, low_mm, high_mm in (
        (row.bore_mm, back_mm - 1, design.z_head_mm),
        (row.clearance_mm, back_mm, boss_mm + 1),
    ):
        holes = cq.Workplane().workplane(offset=low_mm).pushPoints(design.screw_centres_mm)
        body = body.cut(holes.circle(diameter_mm / 2).extrude(high_mm - low_mm))
    leg = _leg(cq, design)
    for x, y in design.peg_centres_mm:
        for side in (leg, leg.mirror("YZ")):
            body = body.union(cq.Workplane(side.moved(cq.Location((x, y, 0.0)))))
    return body.val()


def _lip_mm(design: Design) -> tuple[float, float, float]:
    """Radii of a lip below and at the tip, and the height of its round and conical halves.

    At the tip the legs stand no wider than the peg, so that they find the hole.
    """
    cover = design.cover
    return cover.hole_mm / 2, cover.peg_mm / 2 - cover.lip_mm, cover.lip_height_mm / 2


def _leg_mm3(design: Design) -> float:
    """Volume of one leg above the floor: shaft, lip and lead-in, each beyond half the slot."""
    cover, half_slot_mm = design.cover, design.cover.slot_mm / 2
    radius, tip, height_mm = _lip_mm(design)
    shaft_mm3 = segment_mm2(half_slot_mm, cover.peg_mm / 2) * design.holder.clearance_mm
    beyond_mm = half_slot_mm - cover.lip_mm
    lip_mm3 = segment_mm2(beyond_mm, radius) * height_mm
    return shaft_mm3 + lip_mm3 + cone_segment_mm3(beyond_mm, radius, tip, height_mm)


def _leg(cq: Any, design: Design) -> Any:
    """The leg on +x of a peg on the z axis, let into the floor by half of its thickness."""
    cover = design.cover
    low_mm, under_lip_mm = design.z_floor_mm - cover.floor_mm / 2, design.z_board_back_mm
    radius, tip, height_mm = _lip_mm(design)
    at: Point2 = (cover.lip_mm, 0.0)
    shaft = cq.Solid.makeCylinder(
        cover.peg_mm / 2, under_lip_mm - low_mm, cq.Vector(0, 0, low_mm), cq.Vector(0, 0, 1)
    )
    lip = cq.Solid.makeCylinder(radius, height_mm, cq.Vector(*at, under_lip_mm), cq.Vector(0, 0, 1))
    cone = cq.Solid.makeCone(
        radius, tip, height_mm, cq.Vector(*at, under_lip_mm + height_mm), cq.Vector(0, 0, 1)
    )
    wide = cover.hole_mm + 1
    half_space = cq.Solid.makeBox(
        wide, 2 * wide, design.peg_length_mm + cover.floor_mm + 2,
        cq.Vector(cover.slot_mm / 2, -wide, low_mm - 1),
    )  # fmt: skip
    # Cut first: in the slot the shaft's round side and the lip's would cross.
    parts = [piece.intersect(half_space) for piece in (shaft, lip, cone)]
    return parts[0].fuse(*parts[1:]).clean().Solids()[0]
