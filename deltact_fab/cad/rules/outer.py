"""Rules of what is seen from outside: frame, acrylic, screws, shell and mount."""

from __future__ import annotations

from collections.abc import Iterator

from ..dimensions import Design
from .rule import Rule


def skin(d: Design) -> Iterator[Rule]:
    """Frame, ledge and acrylic around the skin."""
    part = "skin-frame"
    edge, seat = d.post_edge_mm, d.seat_half_mm
    for i, axis in enumerate("xy"):
        yield Rule(part, ("0", 0.0), "<", (f"room between the posts in {axis}", 2 * edge[i]))
    left = ("frame.seat_y_mm + shell.wall_mm", d.frame.seat_y_mm + d.shell.wall_mm)
    yield Rule(part, left, "<=", ("frame.wall_y_mm", d.frame.wall_y_mm))
    plate = ("half acrylic in y - half ledge opening", d.acrylic_half_mm[1] - d.skin.length_mm / 2)
    yield Rule("acrylic", ("0.5", 0.5), "<=", plate)
    notch = d.acrylic_notch_mm
    for i, axis in enumerate("xy"):
        yield Rule(
            "acrylic",
            (f"notch in {axis} + 2", notch[i] + 2.0),
            "<",
            (f"half the plate in {axis}", d.acrylic_half_mm[i]),
        )
    for i, axis in enumerate("xy"):
        yield Rule(
            part,
            (f"half the acrylic's pocket in {axis}", seat[i]),
            "<",
            (f"half the frame in {axis}", d.frame_outer_mm[i] / 2),
        )


def screw(d: Design) -> Iterator[Rule]:
    """The four screws from head to tip."""
    screw, row = d.screw, d.screw.row
    depth = ("screw.engagement_mm + screw.tip_clearance_mm", screw.pilot_depth_mm)
    cap = ("frame height - shell.wall_mm", d.frame_height_mm - d.shell.wall_mm)
    yield Rule("skin-frame", depth, "<=", cap)
    yield Rule(
        "screw",
        (f"2 x thread {screw.thread}", 2 * row.thread_mm),
        "<=",
        ("screw.engagement_mm", screw.engagement_mm),
    )
    yield Rule(
        "screw", ("screw.engagement_mm", screw.engagement_mm), "<", ("length_mm", screw.length_mm)
    )
    yield Rule(
        "screw",
        ("back of the sensor", d.z_back_mm),
        "<=",
        ("back of the screw heads", d.z_head_mm - row.head_height_mm),
    )
    yield Rule("shell", ("floor", d.z_floor_mm), "<=", ("back of the posts", d.z_boss_mm))
    yield Rule("shell", ("back of the posts + 2", d.z_boss_mm + 2.0), "<", ("joint", d.z_joint_mm))


def shell(d: Design) -> Iterator[Rule]:
    """Shell, its cable notch and ledge, and the mount."""
    part, shell, mount = "shell", d.shell, d.mount
    room_x = 2 * d.post_edge_mm[0]
    yield Rule(
        part, ("cable_width_mm", shell.cable_width_mm), "<", ("room between the posts", room_x)
    )
    # The board stands between the cable's notch and the room of the light holder.
    room_z = d.holder.clearance_mm
    yield Rule(
        part, ("cable_height_mm", shell.cable_height_mm), "<=", ("holder.clearance_mm", room_z)
    )
    yield Rule(
        part,
        ("ledge_height_mm + 2", shell.ledge_height_mm + 2.0),
        "<",
        ("depth of the shell", d.z_joint_mm - d.z_floor_mm),
    )
    held = d.acrylic_half_mm[1] - (d.cavity_half_mm[1] - shell.ledge_mm)
    yield Rule(part, ("0.5", 0.5), "<=", ("acrylic's edge on the ledge", held))
    yield Rule(
        part,
        ("mount.height_mm", mount.height_mm),
        "<=",
        ("depth of the shell", d.z_joint_mm - d.z_floor_mm),
    )
    yield Rule(part, ("mount.width_mm", mount.width_mm), "<=", ("outer x", d.frame_outer_mm[0]))
    yield Rule(
        part,
        (
            "cable_width_mm + 2 (cover.fit_mm + wall_mm)",
            shell.cable_width_mm + 2 * (d.cover.fit_mm + shell.wall_mm),
        ),
        "<=",
        ("room between the posts", room_x),
    )
    yield Rule(
        part,
        (
            "cable_height_mm + ledge_height_mm + wall_mm",
            shell.cable_height_mm + shell.ledge_height_mm + shell.wall_mm,
        ),
        "<=",
        ("depth of the shell", d.shell_depth_mm),
    )
    # The ledge ends on the posts, in both directions.
    yield Rule(
        part,
        ("ledge_height_mm", shell.ledge_height_mm),
        "<=",
        ("height of the posts", d.z_joint_mm - d.z_boss_mm),
    )
    yield Rule(
        part,
        ("ledge_mm", shell.ledge_mm),
        "<=",
        ("posts beyond the wall", d.post_mm - shell.wall_mm),
    )
    # Where the mount stands over the cover's bosses it keeps their fit.
    solid = {
        "block": (mount.length_mm - mount.hole_pitch_mm - mount.hole_mm) / 2,
        "franka": mount.length_mm - mount.flange_mm,
        "plate": mount.length_mm,
    }
    yield Rule(
        part,
        ("cover.fit_mm", d.cover.fit_mm),
        "<",
        ("solid length of the mount", solid[mount.kind]),
    )
    wall = 1.5
    if mount.kind == "plate":
        return
    along = mount.length_mm if mount.kind == "block" else mount.flange_height_mm
    pitch = mount.hole_pitch_mm if mount.kind == "block" else mount.flange_pitch_mm
    key = "hole_pitch_mm" if mount.kind == "block" else "flange_pitch_mm"
    side = "length_mm" if mount.kind == "block" else "flange_height_mm"
    rests_on = () if mount.kind == "block" else ("mount.flange_pitch_mm", "mount.flange_height_mm")
    yield Rule(
        part,
        (f"mount.{key} + hole + 2 x 1.5", pitch + mount.hole_mm + 2 * wall),
        "<=",
        (f"mount.{side}", along),
        rests_on,
    )
    yield Rule(
        part,
        ("mount: hole + 1.5", mount.hole_mm + wall),
        "<=",
        (f"mount.{key}", pitch),
        rests_on,
    )
    width = mount.width_mm if mount.kind == "block" else mount.flange_width_mm
    yield Rule(
        part, ("mount: hole + 2 x 1.5", mount.hole_mm + 2 * wall), "<=", ("mount's width", width)
    )
    if mount.kind == "franka":
        yield Rule(
            part,
            ("mount.flange_mm + 2", mount.flange_mm + 2.0),
            "<",
            ("mount.length_mm", mount.length_mm),
        )
        yield Rule(
            part,
            ("mount.flange_height_mm", mount.flange_height_mm),
            "<=",
            ("height of the sensor", -d.z_floor_mm),
            ("mount.flange_height_mm",),
        )
        yield Rule(
            part,
            ("mount.flange_width_mm", mount.flange_width_mm),
            "<=",
            ("outer x", d.frame_outer_mm[0]),
            ("mount.flange_width_mm",),
        )
        # A head or a nut behind the flange has its place above and below the arm.
        yield Rule(
            part,
            (f"mount.arm_mm + washer {mount.screw}", mount.arm_mm + mount.washer_mm),
            "<=",
            ("mount.flange_pitch_mm", mount.flange_pitch_mm),
            rests_on,
        )
        yield Rule(
            part,
            (
                f"mount.flange_mm + 2.5 x {mount.screw}",
                mount.flange_mm + 2.5 * float(mount.screw.removeprefix("M")),
            ),
            "<=",
            ("gap between shell and flange", mount.length_mm - mount.flange_mm),
        )
        yield Rule(
            part,
            ("front of the mount's arm", d.flange_arm_z_mm[1]),
            "<=",
            ("joint", d.z_joint_mm),
            ("mount.flange_height_mm",),
        )
        return
    # A head or a washer beside the shell, and two of them side by side.
    yield Rule(
        part,
        (f"mount.hole_pitch_mm + washer {mount.screw}", mount.hole_pitch_mm + mount.washer_mm),
        "<=",
        ("mount.length_mm", mount.length_mm),
    )
    yield Rule(
        part,
        (f"mount: washer {mount.screw}", mount.washer_mm),
        "<=",
        ("mount.hole_pitch_mm", mount.hole_pitch_mm),
    )
