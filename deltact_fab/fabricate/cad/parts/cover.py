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
round about the peg's axis would be wider along y than the hole, where no leg bends. The paper
(Mechanical Subsystem) gives the four snap-fit cylinders, the wall and the four screws, no drawing.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from deltact_fab.common import Check

from ..dimensions import Design
from ..drafting.dimensioning import Callouts, fmt, x_of, y_of, z_of
from ..kernel import Extent, Shape, around, cuboid, cylinders, prism, require, without_corners
from ..part import BLACK_RGBA, Part, PrintPose
from ..rule import Length, PlayFit, at_most, below


def box(design: Design) -> Extent:
    """Bounding box, from the back to the higher of bosses and pegs."""
    x, y = (side / 2 for side in design.frame_outer_mm)
    top = max(design.z_boss_mm, design.z_floor_mm + design.peg_length_mm)
    return around(x, y, design.z_back_mm, top)


def build(design: Design) -> Shape:
    """The cover as one solid in the sensor frame, z from the back to the bosses or the pegs."""
    cq = require()
    row, (outer_x, outer_y) = design.screw.row, design.frame_outer_mm
    back_mm, boss_mm = design.z_back_mm, design.z_boss_mm
    body = cuboid(around(outer_x / 2, outer_y / 2, back_mm, boss_mm))
    between = without_corners((outer_x / 2 + 1, outer_y / 2 + 1), design.post_edge_mm)
    body = body.cut(prism(between, design.z_floor_mm, boss_mm - design.z_floor_mm + 1))
    for diameter_mm, low_mm, high_mm in (
        (row.bore_mm, back_mm - 1, design.z_head_mm),
        (row.clearance_mm, back_mm, boss_mm + 1),
    ):
        body = body.cut(cylinders(design.screw_centres_mm, diameter_mm, low_mm, high_mm - low_mm))
    leg = _leg(cq, design)
    for x, y in design.peg_centres_mm:
        for side in (leg, leg.mirror("YZ")):
            body = body.union(cq.Workplane(side.moved(cq.Location((x, y, 0.0)))))
    return body.val()


def _leg(cq: Any, design: Design) -> Any:
    """Return the +x leg of a peg on the z axis, embedded in the floor by half its thickness."""
    cover = design.cover
    low, under = design.z_floor_mm - cover.floor_mm / 2, design.z_floor_mm + design.peg_leg_mm
    # The lip is cylindrical below and conical above, narrower than the peg at its tip as lead-in.
    radius, tip = cover.hole_mm / 2, cover.peg_mm / 2 - cover.lip_mm
    height = cover.lip_height_mm / 2
    bases = [cq.Vector(cover.lip_mm, 0, z) for z in (under, under + height)]
    shaft = cq.Solid.makeCylinder(cover.peg_mm / 2, under - low, cq.Vector(0, 0, low))
    lip = cq.Solid.makeCylinder(radius, height, bases[0])
    cone = cq.Solid.makeCone(radius, tip, height, bases[1])
    width, high = cover.hole_mm + 1, design.peg_length_mm + cover.floor_mm + 2
    half_space, slab = (
        cq.Solid.makeBox(side, 2 * width, high, cq.Vector(cover.slot_mm / 2, -width, low - 1))
        for side in (width, cover.leg_mm)
    )
    # Cut first: in the slot the shaft's round side and the lip's would cross.
    parts = [shaft.intersect(slab), lip.intersect(half_space), cone.intersect(half_space)]
    return parts[0].fuse(*parts[1:]).clean().Solids()[0]


def rules(d: Design) -> Iterator[Check]:
    """Rules of the legs, the slot, and the lips below the light holder's floor."""
    cover = d.cover
    outside = cover.slot_mm / 2 + cover.leg_mm
    yield below("legs-in-peg", "slot_mm / 2 + leg_mm", outside, "peg_mm / 2", cover.peg_mm / 2)
    gap_mm = d.resin_printer.least_gap_mm
    yield at_most("slot-open", "resin_printer.least_gap_mm", gap_mm, "cover.slot_mm", cover.slot_mm)
    lip = "peg_play_mm + lip_height_mm", cover.peg_play_mm + cover.lip_height_mm
    floor_mm = d.camera.board_mm + d.light.floor_mm
    yield at_most("lip", *lip, "camera.board_mm + light.floor_mm", floor_mm)


def fits(d: Design) -> Iterator[PlayFit]:
    """Fits of pegs in the holder, lips over its holes, heads in their bores."""
    printer, cover, row = d.resin_printer, d.cover, d.screw.row
    parts, pitch = "cover, camera-holder", printer.pitch()
    hole = printer.inner(cover.hole_mm)
    yield PlayFit("peg", "peg in its hole", parts, (hole,), (printer.outer(cover.peg_mm), pitch))
    # Over both lips of a peg centred in its hole.
    lips = printer.outer(cover.hole_mm + 2 * cover.lip_mm)
    over = PlayFit("lips-over-hole", "lips over their hole", parts, (lips,), (hole,))
    yield over
    largest = Length(over.range_mm[1] / 2, 0.0, lips.rests_on)
    bends = Length(cover.strain_limit * d.peg_leg_mm**2 / (3 * cover.fibre_mm))
    yield PlayFit("lip-strain", "largest lip within the strain", parts, (bends,), (largest,))
    legs = printer.tall(d.peg_leg_mm)
    holder = printer.tall(d.holder.clearance_mm)
    yield PlayFit("legs-through-holder", "legs through the holder, z", parts, (legs,), (holder,))
    slot = printer.inner(cover.slot_mm)
    yield PlayFit("legs-bent", "slot when both legs bend", "cover", (slot,), (largest, largest))
    head, bore = Length(row.head_mm), printer.inner(row.bore_mm)
    parts, name = "cover, screw, skin-frame", "screw head in its bore"
    yield PlayFit("head", name, parts, (bore,), (head, pitch))


def callouts(d: Design) -> Callouts:
    """Drawing content: cover, section through two of the bosses."""
    row, cover = d.screw.row, d.cover
    (ox, oy), (sx, sy), (px, py) = d.frame_outer_mm, d.screw_at_mm, d.peg_at_mm
    floor = d.z_floor_mm
    slot, lip = cover.slot_mm / 2, cover.hole_mm / 2 + cover.lip_mm
    side = slot + cover.leg_mm
    lengths = (
        x_of(-sx, sx),
        y_of(-sy, sy),
        x_of(-px, px),
        y_of(-py, py),
        x_of(ox / 2 - d.post_mm, ox / 2),
        y_of(oy / 2 - d.post_mm, oy / 2),
        x_of(px - slot, px + slot, " slot", fitted=False),
        x_of(px - side, px + side, " over both legs"),
        x_of(px - lip, px + lip, " over both lips"),
        z_of(floor, floor + d.peg_leg_mm),
    )
    notes = (
        "Four equal pegs, slots along y, legs flat outside. Lips flat underneath, "
        f"{fmt(cover.lip_mm)} beyond the hole of Ø{fmt(cover.hole_mm)}.",
        f"Strain of a peg when snapped in: {fmt(100 * d.snap_strain)} %. Pegs without support "
        "marks. Opaque.",
    )
    rounds = {
        row.bore_mm: "for the heads",
        cover.peg_mm: "pegs",
        cover.hole_mm: "lips, two on each peg",
    }
    fitted = (row.clearance_mm, row.bore_mm, cover.peg_mm)
    return Callouts(lengths, rounds, fitted, notes, cut_x_mm=-sx)


PARTS = (
    Part(
        "cover",
        build,
        box,
        number=7,
        explode_mm=-78,
        colour=BLACK_RGBA,
        sections=("cover", "screw", "shell"),
        derived=(
            "frame_outer_mm", "post_mm", "post_edge_mm", "screw_at_mm", "screw_centres_mm",
            "peg_at_mm", "peg_centres_mm", "peg_leg_mm", "peg_length_mm", "snap_strain",
            "z_floor_mm", "z_back_mm", "z_head_mm", "z_boss_mm",
        ),
        rules=rules,
        fits=fits,
        wall_keys=("shell.wall_mm",),
        callouts=callouts,
        pose=PrintPose(face="outer face"),
        look_for="slots of all pegs open: a folded paper passes",
    ),
)  # fmt: skip
