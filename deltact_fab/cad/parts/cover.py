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
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

from ..checks import Expected
from ..drafting.dimensioning import Axis, Cut, Item, Linear, shown
from ..drafting.items import Callouts, holes, x_of, y_of, z_of
from ..kernel import require
from ..lying import Lying
from ..part import BLACK, PRINT, RESIN, Part
from ..record import Point2, Record, number
from ..rule import Rule
from .planes import cone_segment_mm3, segment_mm2

if TYPE_CHECKING:
    from cadquery import Shape

    from ..dimensions import Design


@dataclass(frozen=True)
class CoverDimensions(Record):
    """The cover (part 7): floor, four bosses for the screw heads, four snap-fit pegs."""

    floor_mm: float = number(1.5, "floor (paper: walls of 1.5)", 0.5, 20)
    peg_mm: float = number(3.0, "diameter of a peg", 1, 10)
    peg_y_mm: float = number(8.0, "pegs at +-y", 1, 90)
    peg_clearance_mm: float = number(0.1, "radial clearance of a peg in its hole", 0.01, 1)
    slot_mm: float = number(0.6, "slot that splits a peg", 0.2, 5)
    lip_mm: float = number(0.08, "lip of a peg beyond its hole", 0.01, 2)
    lip_height_mm: float = number(0.6, "height of the lip", 0.2, 5)
    strain_limit: float = number(0.02, "what the resin bears once (Tough resins: 2 %)", 1e-3, 0.2)
    fit_mm: float = number(0.1, "clearance between bosses and shell", 0.02, 2)

    @property
    def leg_mm(self) -> float:
        """Thickness of one leg of a peg = (peg - slot) / 2: 1.2."""
        return (self.peg_mm - self.slot_mm) / 2

    @property
    def fibre_mm(self) -> float:
        """Outermost fibre of a leg from its centroid; a leg is a segment of the peg's circle: 0.70.

        Centroid at 2/3 (R^2 - a^2)^1.5 / A, A = R^2 acos(a / R) - a sqrt(R^2 - a^2), a = slot / 2.
        """
        r, a = self.peg_mm / 2, self.slot_mm / 2
        if not a < r:
            return math.nan
        q = math.sqrt(r**2 - a**2)
        centroid = 2 / 3 * q**3 / (r**2 * math.acos(a / r) - a * q)
        return max(r - centroid, centroid - a)

    @property
    def hole_mm(self) -> float:
        """Hole in the camera holder = peg + 2 clearance: 3.2."""
        return self.peg_mm + 2 * self.peg_clearance_mm


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


def rules(d: Design) -> Iterator[Rule]:
    """Pegs: strain, legs and lips."""
    part, cover = "cover", d.cover
    yield Rule(part, ("strain of a peg", d.snap_strain), "<=", ("strain_limit", cover.strain_limit))
    yield Rule(part, ("0.6", 0.6), "<=", ("leg of a peg", cover.leg_mm))
    # Both legs bend inwards by the lip before they touch.
    yield Rule(part, ("2 lip_mm", 2 * cover.lip_mm), "<", ("slot_mm", cover.slot_mm))
    yield Rule(
        part, ("lip_height_mm", cover.lip_height_mm), "<=", ("camera.board_mm", d.camera.board_mm)
    )
    lip = cover.hole_mm / 2 + cover.lip_mm
    yield Rule(
        part,
        ("board / 2 + lip radius", d.camera.board_width_mm / 2 + lip),
        "<=",
        ("peg axis in x", d.peg_at_mm[0]),
    )
    yield Rule(
        part,
        ("lip radius", lip),
        "<=",
        ("peg axis to the shell", d.cavity_half_mm[0] - d.peg_at_mm[0]),
    )


def callouts(d: Design) -> Callouts:
    """The cover; section through two of the bosses."""
    row, cover = d.screw.row, d.cover
    ox, oy = (s / 2 for s in d.frame_outer_mm)
    (sx, sy), (px, py) = d.screw_at_mm, d.peg_at_mm
    post = d.post_mm
    back, floor, boss, head = d.z_back_mm, d.z_floor_mm, d.z_boss_mm, d.z_head_mm
    tip = floor + d.peg_length_mm
    pegs = [(s * px, t * py) for s in (-1, 1) for t in (-1, 1)]
    items: list[Item] = [
        x_of("top", -ox, ox, "bottom", -oy),
        x_of("top", -sx, sx, "bottom", -sy),
        x_of("top", -px, px, "top", py),
        x_of("top", ox - post, ox, "top", oy, after=" (4×)"),
        y_of("top", -oy, oy, "left", -ox),
        y_of("top", -sy, sy, "left", -sx),
        y_of("top", -py, py, "left", -px),
        y_of("top", oy - post, oy, "right", ox),
        *holes(d.screw_centres_mm, boss, row.clearance_mm, " through"),
        *holes(pegs, tip, cover.peg_mm, f" peg, slot {shown(cover.slot_mm)} along y"),
        Linear("front", (-ox, 0, back), (-px - cover.peg_mm / 2, 0, tip), "left"),
        z_of("front", back, boss, "left", -ox),
        z_of("front", back, floor, "right", ox - post),
        z_of("front", floor, tip, "right", px + cover.peg_mm / 2),
        z_of("left", back, head, "right", 0, -sy),
        y_of("left", -sy - row.bore_mm / 2, -sy + row.bore_mm / 2, "bottom", 0, back,
           before="Ø", after=" (4×)"),
        *(Axis("left", (-sx, s * sy, back), (-sx, s * sy, boss)) for s in (-1, 1)),
    ]  # fmt: skip
    notes = (
        f"Pegs: legs {shown(cover.leg_mm)} thick, lip {shown(cover.lip_mm)} beyond the hole of "
        f"Ø{shown(cover.hole_mm)}, {shown(cover.lip_height_mm)} high, flat underneath; "
        f"strain when snapped in {shown(100 * d.snap_strain)} %.",
        "Pegs without support marks. Opaque.",
    )
    return Callouts(tuple(items), notes, Cut(-sx))


def wall_mm(d: Design) -> float:
    """The shell's; the legs of the pegs have a limit of their own."""
    return d.shell.wall_mm


PARTS = (
    Part(
        "cover",
        f"{RESIN}, black",
        PRINT,
        build,
        expect,
        number=7,
        explode_mm=-78,
        colour=BLACK,
        sections=("cover", "screw", "shell"),
        derived=(
            "post_mm", "screw_at_mm", "peg_at_mm", "peg_length_mm", "snap_strain", "z_floor_mm",
            "z_back_mm", "z_head_mm", "z_boss_mm",
        ),
        rules=rules,
        wall_mm=wall_mm,
        callouts=callouts,
        lies=Lying(face="outer face"),
        look_for="every peg has its slot open: a folded paper passes",
    ),
)  # fmt: skip
