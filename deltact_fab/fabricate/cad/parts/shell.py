"""Part 3, the sensor shell (paper, Mechanical Subsystem: opaque, walls of 1.5 mm).

Section below z_boss, seen along -z:     Section at x = 0:

            +-------+
            | mount |    y                z_joint  +-+-+               +-+-+
        +---+-------+---+  ^                       | |_| ledge         |_| |
    +---+   wall, ledge +---+                      | |                   | +-------+
    |   +---------------+   | +-> x                | |      cavity       | | mount |
    | |                   | |                      +-+                   | |       |
    | |      cavity       | |             z_floor  (cable notch)         +-+-------+
    | |                   | |
    |   +---------------+   |
    +---+  cable notch  +---+             -> y to the right (shell.cable_side -y)

In each corner stands a post with a through hole on a screw's axis, from z_boss to the joint. Below
z_boss the cover's boss replaces post and wall, with `cover.fit_mm` to the shell. The ledges
carry the acrylic's edges from behind, those in x (not drawn) like those in y: on two edges it would
deflect twice as far.
"""

from __future__ import annotations

from collections.abc import Iterator

from deltact_fab.common import Check

from ..dimensions import Design
from ..drafting.dimensioning import SQUARE_EDGES, Callouts, Span, fmt, x_of, y_of, z_of
from ..kernel import (
    Extent,
    Shape,
    Workplane,
    around,
    cuboid,
    cylinders,
    enclosing,
    prism,
    without_corners,
)
from ..part import BLACK_RGBA, Part, PrintPose
from ..rule import Length, PlayFit, at_most, below
from . import mount
from .camera import BOARD_KEYS
from .light_holder import WIRE_OUTER
from .mount import boss_room


def box(design: Design) -> Extent:
    """Bounding box of shell and mount."""
    x, y = (side / 2 for side in design.frame_outer_mm)
    return enclosing([around(x, y, design.z_floor_mm, design.z_joint_mm), *mount.bars(design)])


def build(design: Design) -> Shape:
    """The shell with its mount as one solid in the sensor frame."""
    return body(design).union(mount.build(design)).val()


def body(design: Design) -> Workplane:
    """Return the shell without mount and tabs; the cavity's notched corners leave the posts."""
    shell, (x, y) = design.shell, design.cavity_half_mm
    outer_x, outer_y = design.frame_outer_mm
    floor, joint = design.z_floor_mm, design.z_joint_mm
    ledge = joint - shell.ledge_height_mm
    body = cuboid(((-outer_x / 2, -outer_y / 2, floor), (outer_x / 2, outer_y / 2, joint)))
    # Nested cutters: between the ledges the cavity is only narrower.
    inward = design.ledge_reach_mm
    for (dx, dy), high in (((0.0, 0.0), ledge), (inward, joint + 1)):
        low = floor - 1
        outline = without_corners((x - dx, y - dy), design.post_edge_mm)
        body = body.cut(prism(outline, low, high - low))
    if shell.ledge_drop_mm > 0:
        drop = shell.ledge_drop_mm
        body = body.cut(prism(without_corners((x, y), design.post_edge_mm), joint - drop, drop + 1))
    body = body.cut(boss_room(design))
    clearance, deep = design.screw.row.clearance_mm, design.shell_depth_mm
    holes = cylinders(design.screw_centres_mm, clearance, floor - 1, deep + 2)
    return body.cut(holes).cut(cuboid(cable_notch(design)))


def cable_notch(design: Design) -> Extent:
    """Cutter of the cable's notch, in the middle of the -y side or at the -y end of another.

    In x the flat cable, which leaves the board towards -y, folds beside the camera holder: its
    notch lies as far from the holder as a post and a wall let it.
    """
    shell, half, low = design.shell, design.shell.cable_width_mm / 2, design.z_floor_mm - 1
    across, along = (0, 1) if shell.cable_side == "-y" else (1, 0)
    outer_mm, inner_mm = design.frame_outer_mm[along] / 2 + 1, design.cavity_half_mm[along] - 1
    margin_mm = design.post_edge_mm[1] - shell.wall_mm - design.cover.fit_mm
    ends = {
        across: (-half, half) if along else (-margin_mm, 2 * half - margin_mm),
        along: (inner_mm, outer_mm) if shell.cable_side[0] == "+" else (-outer_mm, -inner_mm),
    }
    (x0, x1), (y0, y1) = ends[0], ends[1]
    return (x0, y0, low), (x1, y1, low + 1 + shell.cable_height_mm)


def rules(d: Design) -> Iterator[Check]:
    """Rules of posts, cable notch, ledge and mount."""
    shell, posts = d.shell, d.z_joint_mm - d.z_boss_mm
    # The board is between the cable's notch and the light holder.
    room = "holder.clearance_mm", d.holder.clearance_mm
    yield at_most("notch-height", "cable_height_mm", shell.cable_height_mm, *room)
    ledge = "ledge_height_mm", shell.ledge_height_mm
    yield below("drop", "ledge_drop_mm", shell.ledge_drop_mm, *ledge)
    beside_mm = d.cover.fit_mm + shell.wall_mm
    if shell.cable_side == "-y":
        width = shell.cable_width_mm + 2 * beside_mm
        words = "cable_width_mm + 2 (cover.fit_mm + wall_mm)"
        yield at_most("cable-room", words, width, "room between the posts", 2 * d.post_edge_mm[0])
    else:  # it folds beside board and holder
        inside_mm = max(d.holder_arm_mm, -d.camera.board_bottom_mm) + d.holder.fit_mm
        width = inside_mm + shell.cable_width_mm + beside_mm
        words = "holder or board + fit_mm + cable_width_mm + cover.fit_mm + wall_mm"
        room = f"posts in y (cable_side {shell.cable_side})", d.post_edge_mm[1]
        yield at_most("cable-turn", words, width, *room, BOARD_KEYS)
    high = shell.cable_height_mm + shell.ledge_height_mm + shell.wall_mm
    words = "cable_height_mm + ledge_height_mm + wall_mm"
    yield at_most("notch-below-ledge", words, high, "depth of the shell", d.shell_depth_mm)
    # The ledge ends on the posts, in both directions.
    yield at_most("ledge", *ledge, "height of the posts", posts)
    words, free_mm = "ledge_mm + its distance from the wall", d.post_mm - shell.wall_mm
    yield at_most("ledge-on-posts", words, max(d.ledge_reach_mm), "posts beyond the wall", free_mm)
    yield below("posts-above-floor", "floor", d.z_floor_mm, "back of the posts", d.z_boss_mm)
    yield below("post-height", "2", 2.0, "height of the posts", posts)
    yield from mount.rules(d)


def fits(d: Design) -> Iterator[PlayFit]:
    """Fits of the cover's bosses, the screws into the frame, and cables in the notch."""
    printer, shell, row, cam = d.resin_printer, d.shell, d.screw.row, d.camera
    corner, boss = printer.inner(d.boss_room_mm), printer.outer(d.post_mm)
    yield PlayFit("boss-in-corner", "boss in its corner", "shell, cover", (corner,), (boss,))
    shank, hole = (Length(row.thread_mm), printer.pitch()), (printer.inner(row.clearance_mm),)
    for name in ("shell", "cover"):
        parts = f"{name}, screw, skin-frame"
        yield PlayFit(f"screw-{name}", f"{d.screw.thread} through the {name}", parts, hole, shank)
    width, high = printer.inner(shell.cable_width_mm), printer.tall(shell.cable_height_mm)
    flat, thick = cam.cable_width_mm, cam.cable_height_mm
    keys = ("camera.cable_width_mm", "camera.cable_height_mm")
    cable = Length(flat, 0.1, keys[:1])
    across = "x" if shell.cable_side == "-y" else "y"
    name = f"camera's cable in its notch, {across}"
    yield PlayFit("cable", name, "shell, cable", (width,), (cable,))
    # The light holder's wires leave there too, over the cable.
    through = (Length(thick, 0.05, keys[1:]), WIRE_OUTER)
    name = "cable and wires in the notch, z"
    yield PlayFit("wires", name, "shell, cable, wires", (high,), through)
    # Foam keeps light out; a plug shorter than twice the notch's height comes out with the cable.
    foam, plug = Length(shell.cable_foam_mm), Length(2 * shell.cable_height_mm)
    yield PlayFit("foam", "shell.cable_foam_mm, twice the notch", "shell, cable", (foam,), (plug,))
    yield from mount.fits(d)


def body_lengths(d: Design) -> list[Span]:
    """Return the dimensions common to shell and testing shell."""
    shell, room = d.shell, d.boss_room_mm
    (sx, sy), (cx, _), (px, py) = d.screw_at_mm, d.cavity_half_mm, d.post_edge_mm
    (ox, oy), ledge_y = (side / 2 for side in d.frame_outer_mm), d.ledge_half_mm[1]
    joint = d.z_joint_mm
    lengths = [
        x_of(-sx, sx),
        y_of(-sy, sy),
        x_of(-cx, cx),
        x_of(-px, px),
        y_of(-py, py),
        y_of(-ledge_y, ledge_y),
        z_of(d.z_floor_mm, joint),
        z_of(joint - shell.ledge_height_mm, joint, fitted=False),
        x_of(ox - room, ox),
        y_of(-oy, room - oy),
    ]
    if shell.ledge_drop_mm > 0:
        lengths.append(z_of(joint - shell.ledge_drop_mm, joint))
    return lengths


def callouts(d: Design) -> Callouts:
    """Drawing content: shell with mount, section through cable notch, ledge and mount."""
    notes = (
        f"Walls {fmt(d.shell.wall_mm)} all around. Opaque: no light through the walls.",
        SQUARE_EDGES,
    )
    lengths = (*body_lengths(d), *mount.lengths(d))
    return Callouts(
        lengths, fitted=(d.screw.row.clearance_mm,), notes=notes, cut_x_mm=0.0,
        rests_on=mount.FLANGE_KEYS,
    )  # fmt: skip


PARTS = (
    Part(
        "shell",
        build,
        box,
        number=3,
        colour=BLACK_RGBA,
        sections=("shell", "cover", "mount", "screw", "skin", "frame"),
        derived=(
            "frame_outer_mm", "cavity_half_mm", "ledge_half_mm", "ledge_reach_mm", "post_mm",
            "post_edge_mm", "boss_room_mm", "screw_at_mm", "screw_centres_mm",
            "shell_depth_mm", "flange_arm_z_mm", "flange_top_mm", "flange_middle_mm", "z_joint_mm",
            "z_boss_mm", "z_floor_mm", "z_back_mm",
        ),
        rules=rules,
        fits=fits,
        wall_keys=("shell.wall_mm",),
        in_view=True,
        callouts=callouts,
        # At 20 degrees large shells hold a cup beside a ledge.
        pose=PrintPose(face="back", tilt_deg=45, supports="outside only"),
        look_for="the light holder slides in by hand; the four holes pass a screw without cutting",
    ),
)  # fmt: skip
