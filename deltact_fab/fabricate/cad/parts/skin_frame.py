"""Part 1, the tactile skin base: the black frame that the skin is cast into.

Seen along -z (from the touched side):            Section at x = 0:

    +--------------------------------+               z = -protrusion
    |  o  +--------------------+  o  |  y        +---+     +---+
    |     |                    |     |  ^        |   |     |   |  frame height
    +-----+                    +-----+  |        |  _|     |_  |  z = -thickness: the ledge
      |           window           |    +-> x    +-+         +-+
    +-----+  width x length    +-----+             <-> seat_y
    |     |  less the posts    |     |
    |  o  +--------------------+  o  |        o: blind pilot from below, pilot depth deep, on the
    +--------------------------------+           axis of the square corner post (side post)

The paper gives no drawing. A 3 mm wall cannot hold an M1.6 screw, so each corner has a square post
that cuts off a corner of the window; the skin is notched there below the protrusion. Behind the
skin the window is wider in y (and by seat_x in x), so that the acrylic plate rests on a ledge.
Frame and skin touch without overlap.

The skin: the clear silicone block behind the pattern (paper, Tactile Subsystem).

    z = 0               .--------------------.     edges of the touched face rounded, edge_fillet
                        |   width x length   |
    z = -protrusion     +--+              +--+     above: proud of the frame
                           |              |
    z = -thickness         +--------------+        below: fills the frame's window, notched around
                                                   its corner posts

The vertical edges stay sharp: the mold's cavity is the plain block above the frame.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from deltact_fab.common import Check

from ..dimensions import Design
from ..drafting.dimensioning import SCREWS_CUT, SQUARE_EDGES, Callouts, x_of, y_of, z_of
from ..kernel import Extent, Shape, around, cuboid, cylinders, prism, require, without_corners
from ..part import BLACK_RGBA, CLEAR_RGBA, Part, PrintPose, no_entries
from ..rule import Length, PlayFit, at_most, below
from ..standards import screw_tolerance_mm, thread_text


def box(design: Design) -> Extent:
    """Bounding box, from the joint to the front."""
    x, y = (side / 2 for side in design.frame_outer_mm)
    return around(x, y, design.z_joint_mm, design.z_front_mm)


def build(design: Design) -> Shape:
    """The frame as one solid in the sensor frame, z from the joint to -protrusion."""
    screw, bottom_mm = design.screw, design.z_joint_mm
    x, y = (side / 2 for side in design.frame_outer_mm)
    body = cuboid(around(x, y, bottom_mm, bottom_mm + design.frame_height_mm))
    # Cutters extend beyond the ends: booleans fail on coincident faces.
    low, posts = bottom_mm - 1, design.post_edge_mm
    window = (design.skin.width_mm / 2, design.skin.length_mm / 2)
    if design.skin.thickness_mm > design.skin.protrusion_mm:
        body = body.cut(prism(without_corners(window, posts), low, design.z_front_mm + 1 - low))
    body = body.cut(
        prism(without_corners(design.seat_half_mm, posts), low, design.z_ledge_mm - low)
    )
    pilot = (screw.row.pilot_mm, bottom_mm - 1, screw.pilot_depth_mm + 1)
    return body.cut(cylinders(design.screw_centres_mm, *pilot)).val()


def rules(d: Design) -> Iterator[Check]:
    """Rules of the frame around the skin, and of its pilots."""
    edge, seat = d.post_edge_mm, d.seat_half_mm
    for i, axis in enumerate("xy"):
        yield below(f"posts-{axis}", "0", 0.0, f"room between the posts in {axis}", 2 * edge[i])
        frame = f"half the frame in {axis}", d.frame_outer_mm[i] / 2
        yield below(f"pocket-{axis}", f"half the acrylic's pocket in {axis}", seat[i], *frame)
    hole, pilot = "resin_printer.least_hole_mm", f"pilot of screw.thread {d.screw.thread}"
    yield at_most("least-hole", hole, d.resin_printer.least_hole_mm, pilot, d.screw.row.pilot_mm)
    front_mm = d.skin.thickness_mm - d.skin.protrusion_mm
    wall = "shell.wall_mm, 0 without front", d.shell.wall_mm * (front_mm > 0)
    yield at_most("front", *wall, "skin.thickness_mm - protrusion_mm", front_mm)
    # The face above a pilot seals in the mold and must not be too thin.
    depth = "screw.engagement_mm + screw.tip_clearance_mm", d.screw.pilot_depth_mm
    room_mm = d.frame_height_mm - d.shell.wall_mm
    yield at_most("pilot", *depth, "frame height - shell.wall_mm", room_mm)


def fits(d: Design) -> Iterator[PlayFit]:
    """Fits of the screws in the pilots: they bite, and end before the bottom."""
    printer, screw, row = d.resin_printer, d.screw, d.screw.row
    pilot, major = printer.inner(row.pilot_mm), Length(row.thread_mm)
    parts = "skin-frame, screw"
    yield PlayFit("screw-bites", f"{screw.thread} bites in its pilot", parts, (major,), (pilot,))
    room = (
        printer.tall(d.z_boss_mm - d.z_head_mm),
        printer.tall(d.z_joint_mm - d.z_boss_mm),
        printer.tall(screw.pilot_depth_mm),
    )
    length = Length(screw.length_mm, screw_tolerance_mm(screw.length_mm))
    parts, name = f"{parts}, shell, cover", "screw ends before the pilot, z"
    yield PlayFit("screw-ends", name, parts, room, (length,))


def callouts(d: Design) -> Callouts:
    """Drawing content: frame from its back, section through window and pocket."""
    (sx, sy), (px, py), (ox, oy) = d.screw_at_mm, d.post_edge_mm, d.frame_outer_mm
    seat_x, seat_y = d.seat_half_mm
    window_x = d.skin.width_mm / 2
    lengths = [
        x_of(-ox / 2, ox / 2),
        y_of(-oy / 2, oy / 2),
        x_of(-sx, sx),
        y_of(-sy, sy),
        x_of(-window_x, window_x),
        y_of(-seat_y, seat_y),
        z_of(d.z_joint_mm, d.z_ledge_mm),
    ]
    if d.frame.seat_x_mm > 0:
        lengths.append(x_of(-seat_x, seat_x))
    if d.post_in_window_mm[0] > 0:
        lengths += [x_of(-px, px), y_of(-py, py)]
    rounds = {d.screw.row.pilot_mm: f"{thread_text(d.screw.thread)}, pilot {{}}"}
    notes = (
        f"{SCREWS_CUT} Turn a drill of the pilot's size in each by hand.",
        f"Window (all around) bonds to the silicone: keep it clean. {SQUARE_EDGES}",
    )
    return Callouts(
        tuple(lengths), rounds, fitted=(d.screw.row.pilot_mm,), notes=notes, cut_x_mm=0.0,
        flipped=True,
    )  # fmt: skip


SKIN_FRAME = Part(
    "skin-frame",
    build,
    box,
    number=1,
    explode_mm=28,
    colour=BLACK_RGBA,
    sections=("skin", "frame", "optics", "screw", "shell"),
    derived=(
        "frame_outer_mm", "frame_height_mm", "post_edge_mm", "post_in_window_mm",
        "screw_at_mm", "screw_centres_mm", "seat_half_mm", "z_front_mm", "z_ledge_mm",
        "z_joint_mm",
    ),
    rules=rules,
    fits=fits,
    wall_keys=("shell.wall_mm",),
    in_view=True,
    callouts=callouts,
    pose=PrintPose(
        face="back, where the pilot holes are,", tilt_deg=30,
        supports="on the rim of the back only, none on the front",
    ),
    how="the front seals in the mold",
    look_for="front flat and glossy, no marks in the acrylic's pocket; rub the back flat on fine "
    "paper; a drill of the pilot's size turns freely",
)  # fmt: skip


def skin_box(design: Design) -> Extent:
    """Bounding box of the plain block."""
    skin = design.skin
    return around(skin.width_mm / 2, skin.length_mm / 2, -skin.thickness_mm, 0.0)


def skin_build(design: Design) -> Shape:
    """The skin as one solid in the sensor frame, z from -thickness to 0."""
    cq = require()
    skin = design.skin
    w, h = skin.width_mm / 2, skin.length_mm / 2
    x, y = design.post_in_window_mm
    below_mm = skin.thickness_mm - skin.protrusion_mm
    block = cuboid(around(w, h, -skin.thickness_mm, 0.0))
    block = block.faces(">Z").edges().fillet(skin.edge_fillet_mm)
    if x == 0 or below_mm == 0:
        return block.val()
    # 1 mm longer on the three outer sides, so that no face of the cutter coincides.
    corners = [(sx * (w - (x - 1) / 2), sy * (h - (y - 1) / 2)) for sx in (-1, 1) for sy in (-1, 1)]
    notches = cq.Workplane().workplane(offset=-skin.thickness_mm - 1).pushPoints(corners)
    return block.cut(notches.rect(x + 1, y + 1).extrude(below_mm + 1)).val()


def skin_rules(d: Design) -> Iterator[Check]:
    """Rules that the camera's view ends within the face."""
    for view_mm, px, side in zip(
        d.optics.view_mm, ("width", "height"), ("width", "length"), strict=True
    ):
        view = f"view (optics.image_{px}_px x mm_per_px)"
        face = f"skin.{side}_mm", getattr(d.skin, f"{side}_mm")
        yield at_most(f"view-{side}", view, view_mm, *face)


def skin_note(d: Design) -> str:
    """Volume of silicone per skin."""
    return f"{d.skin_volume_mm3 / 1000:.2f} cm³ each; see Solaris"


PARTS = (
    SKIN_FRAME,
    replace(
        SKIN_FRAME,
        name="transparent-base",
        group="bench",
        number=0,
        explode_mm=0.0,
        rules=no_entries,
        fits=no_entries,
        in_view=False,
        note="for the chessboard; cast with a clear skin, no film, no coats",
        look_for="as the skin frame",
    ),
    Part(
        "skin",
        skin_build,
        skin_box,
        material="Solaris silicone, Shore 15A, clear, 1:1",
        process="cast in the mold",
        explode_mm=46,
        colour=CLEAR_RGBA,
        sections=("skin", "frame", "screw", "shell"),
        derived=("post_in_window_mm",),
        rules=skin_rules,
        note=skin_note,
        how="cast in its frame, step D",
        look_for="clear, dry, bonded to the acrylic",
    ),
)
