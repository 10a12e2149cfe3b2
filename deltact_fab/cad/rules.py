"""Inequalities between dimensions, checked before the kernel runs: it fails silently on most.

Each states itself with its numbers, so that a refusal says what to change.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Literal

from ..errors import InputError
from ..optics import half_angle_rad
from .dimensions import Design
from .standards import CAP_SCREWS

Side = tuple[str, float]
SLACK = 1e-9  # sums of decimal fractions
GRAZING_DEG = 80.0  # there the first face of the acrylic alone reflects 39 % (Fresnel)
SHOWN = 4  # one line has room for no more


@dataclass(frozen=True)
class Rule:
    """`left < right` or `left <= right`, of one part; NaN fails.

    rests_on: keys of unverified values that it uses.
    """

    part: str
    left: Side
    relation: Literal["<", "<="]
    right: Side
    rests_on: tuple[str, ...] = ()

    @property
    def holds(self) -> bool:
        """Whether it holds, `<=` to rounding."""
        a, b = self.left[1], self.right[1]
        return a < b - SLACK if self.relation == "<" else a <= b + SLACK

    @property
    def text(self) -> str:
        """The inequality in words and in numbers."""
        a, b = self.left, self.right
        return f"{a[0]} {self.relation} {b[0]}: {a[1]:.4g} {self.relation} {b[1]:.4g}"


def enforce(rules: Iterable[Rule], source: str = "") -> None:
    """Raise InputError in one line with the first rules that fail, unless all hold."""
    broken = [f"{rule.part}: {rule.text} fails" for rule in rules if not rule.holds]
    if broken:
        more = len(broken) - SHOWN
        told = broken[:SHOWN] + ([f"and {more} more"] if more > 0 else [])
        raise InputError((f"{source}: " if source else "") + " | ".join(told))


def of_design(design: Design) -> list[Rule]:
    """Every rule of the sensor, the mold and the test bench."""
    unverified = set(design.unverified())
    kept = []
    for rule in _all(design):
        rests_on = tuple(key for key in rule.rests_on if key in unverified)
        kept.append(Rule(rule.part, rule.left, rule.relation, rule.right, rests_on))
    return kept


def _all(d: Design) -> Iterator[Rule]:
    # What cannot be made smaller comes first: it is what a reader must hear of.
    yield from _camera(d)
    yield from _skin(d)
    yield from _screw(d)
    yield from _shell(d)
    yield from _light(d)
    yield from _holder(d)
    yield from _cover(d)
    yield from _view(d)
    yield from _tools(d)


def _skin(d: Design) -> Iterator[Rule]:
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


def _screw(d: Design) -> Iterator[Rule]:
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


def _shell(d: Design) -> Iterator[Rule]:
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


def _light(d: Design) -> Iterator[Rule]:
    part, light = "light-holder", d.light
    yield Rule(
        part,
        ("led_count x pitch", light.strip_mm),
        "<=",
        ("2 pi strip radius", 2 * math.pi * max(d.strip_radius_mm, 0.0)),
    )
    lens = d.camera.lens_diameter_mm / 2
    yield Rule(
        part,
        ("lens radius + 0.3", lens + 0.3),
        "<=",
        ("bore radius", d.light_bore_mm),
        ("camera.lens_diameter_mm",),
    )
    depth = d.z_joint_mm - d.z_board_front_mm - light.floor_mm
    yield Rule(
        part,
        ("strip_width_mm", light.strip_width_mm),
        "<=",
        ("depth of the channel", depth),
        ("camera.lens_height_mm",),
    )
    head = d.holder.row.head_height_mm + 0.1
    yield Rule(part, (f"{d.holder.screw} head + 0.1", head), "<=", ("floor_mm", light.floor_mm))
    # A relief that does not reach the ring's edge leaves a strip of floor, and that is a wall.
    away = math.hypot(*d.camera_screw_centres_mm[0])
    for name, rest in (
        ("outside", d.light_radius_mm - away - d.head_relief_mm),
        ("inside", away - d.head_relief_mm - d.light_bore_mm),
    ):
        if rest > 0:
            left = ("wall_mm", light.wall_mm)
            yield Rule(
                part, left, "<=", (f"floor {name} the reliefs (holder.head_clearance_mm)", rest)
            )
    corner = math.hypot(*d.post_edge_mm)
    yield Rule(
        part,
        ("outer radius + fit_mm", d.light_radius_mm + light.fit_mm),
        "<=",
        ("inner corner of the posts", corner),
    )
    yield Rule(part, ("slot_mm", light.slot_mm), "<", ("bore radius", d.light_bore_mm))


def _camera(d: Design) -> Iterator[Rule]:
    part, cam = "camera", d.camera
    fit = d.holder.fit_mm
    half = cam.board_width_mm / 2
    # The board's upper corners stand beside the posts of the shell and the bosses of the cover.
    clear = max(d.post_edge_mm[0] - half, d.post_edge_mm[1] - cam.board_top_mm)
    yield Rule(
        part, ("fit_mm", fit), "<=", ("room between the camera's board and the corner posts", clear)
    )
    for name, edge, room in (
        ("half the board in x", half, d.cavity_half_mm[0]),
        ("the board's +y edge", cam.board_top_mm, d.cavity_half_mm[1]),
        ("the board's -y edge", -cam.board_bottom_mm, d.cavity_half_mm[1]),
    ):
        yield Rule(part, (f"{name} + fit", edge + fit), "<=", ("half the shell's cavity", room))
    yield Rule(
        part,
        ("connector_height_mm", cam.connector_height_mm),
        "<=",
        ("holder.clearance_mm", d.holder.clearance_mm),
    )
    yield Rule(
        part,
        ("connector_width_mm", cam.connector_width_mm),
        "<=",
        ("board_width_mm", cam.board_width_mm),
    )
    upper, lower = cam.hole_rows_mm
    radius = cam.hole_mm / 2
    yield Rule(part, ("half hole_mm", radius), "<", ("hole_edge_mm", cam.hole_edge_mm))
    yield Rule(
        part,
        ("half hole pitch in x + radius", cam.hole_pitch_x_mm / 2 + radius),
        "<",
        ("half the board", half),
    )
    yield Rule(
        part,
        ("the board's -y edge + hole radius", cam.board_bottom_mm + radius),
        "<",
        ("lower holes", lower),
    )
    yield Rule(part, ("hole_mm", cam.hole_mm), "<", ("hole_pitch_y_mm", upper - lower))
    corner = math.hypot(cam.hole_pitch_x_mm / 2, min(abs(upper), abs(lower)))
    yield Rule(
        part,
        ("lens radius + hole radius", cam.lens_diameter_mm / 2 + radius),
        "<",
        ("lens axis to the nearest hole", corner),
        ("camera.lens_diameter_mm",),
    )
    for name, edge in (("+y", cam.board_top_mm), ("-y", -cam.board_bottom_mm), ("x", half)):
        yield Rule(
            part,
            ("lens radius", cam.lens_diameter_mm / 2),
            "<=",
            (f"lens axis to the board's {name} edge", edge),
            ("camera.lens_diameter_mm",),
        )
    # The heads stand on the board's front, beside the posts and the cover's bosses.
    head = d.holder.row.head_mm / 2
    beside = max(
        d.post_edge_mm[0] - cam.hole_pitch_x_mm / 2 - head, d.post_edge_mm[1] - abs(upper) - head
    )
    yield Rule(
        "camera-screw",
        ("holder.fit_mm", fit),
        "<=",
        ("room between the heads and the corner posts", beside),
    )
    yield Rule(
        "camera-screw",
        ("upper holes + head / 2 + fit", abs(upper) + head + fit),
        "<=",
        ("half the shell's cavity in y", d.cavity_half_mm[1]),
    )
    yield Rule(
        "camera-screw",
        ("head + 2 holder.head_clearance_mm", 2 * d.head_relief_mm),
        "<=",
        ("camera.hole_pitch_x_mm", cam.hole_pitch_x_mm),
    )


def _holder(d: Design) -> Iterator[Rule]:
    part, holder, cam = "camera-holder", d.holder, d.camera
    yield Rule(
        part,
        ("half the window + 0.5", d.holder_window_half_mm + 0.5),
        "<=",
        ("half the board", cam.board_width_mm / 2),
    )
    yield Rule(
        part,
        ("half the window + wall_mm", d.holder_window_half_mm + holder.wall_mm),
        "<=",
        ("peg axis - hole / 2", d.peg_at_mm[0] - d.cover.hole_mm / 2),
    )
    tongue, top = d.holder_tongue_mm
    yield Rule(
        part,
        ("half the tongue", tongue),
        "<=",
        ("corner posts - cover.fit_mm", d.post_edge_mm[0] - d.cover.fit_mm),
    )
    yield Rule(
        part,
        ("the tongue's edge + fit_mm", top + holder.fit_mm),
        "<=",
        ("half the shell's cavity in y", d.cavity_half_mm[1]),
    )
    arm, window_top = d.holder_arm_mm, d.holder_window_top_mm
    yield Rule(
        part,
        ("peg_y_mm + hole / 2 + wall", arm),
        "<=",
        ("corner posts - cover.fit_mm", d.post_edge_mm[1] - d.cover.fit_mm),
    )
    yield Rule(
        part,
        ("the connector's upper edge", cam.board_bottom_mm + cam.connector_length_mm),
        "<=",
        ("the window's upper edge", window_top),
    )
    yield Rule(part, ("the window's upper edge", window_top), "<", ("the arms' edge", arm))
    grip = holder.screw_length_mm - cam.board_mm
    yield Rule(
        part,
        (f"thread {holder.screw}", holder.row.thread_mm),
        "<=",
        ("screw_length_mm - board", grip),
    )
    yield Rule(part, ("screw_length_mm - board", grip), "<=", ("clearance_mm", holder.clearance_mm))
    (px, py), (sx, sy) = d.peg_at_mm, d.camera_screw_centres_mm[1]
    apart = min(math.hypot(px - sx, py - sy), math.hypot(px - sx, py + sy))
    yield Rule(
        part,
        (
            "half a peg's hole + half a pilot + wall_mm",
            (d.cover.hole_mm + holder.row.pilot_mm) / 2 + holder.wall_mm,
        ),
        "<=",
        ("peg axis to screw axis", apart),
    )
    yield Rule(
        part,
        ("hole of a peg + wall_mm", d.cover.hole_mm + holder.wall_mm),
        "<=",
        ("2 cover.peg_y_mm", 2 * d.cover.peg_y_mm),
    )


def _cover(d: Design) -> Iterator[Rule]:
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


def _view(d: Design) -> Iterator[Rule]:
    part, (vx, vy) = "camera", d.optics.view_mm
    path = d.optics.air_gap_mm, d.optics.acrylic_mm, d.skin.thickness_mm
    half = {"x": vx / 2, "y": vy / 2, "corner": math.hypot(vx, vy) / 2}
    angle = {name: half_angle_rad(r, *path) for name, r in half.items()}
    f, (cx, cy) = d.camera.focal_length_mm, d.camera.crop_half_mm
    rests_on = ("camera.focal_length_mm", "camera.lens_height_mm")
    corner_x, corner_y = (s / 2 / half["corner"] for s in (vx, vy))
    for name, seen, room in (
        ("focal length x half angle in x", f * angle["x"], cx),
        ("focal length x half angle in y", f * angle["y"], cy),
        ("focal length x half angle to the corner, along x", f * angle["corner"] * corner_x, cx),
        ("focal length x half angle to the corner, along y", f * angle["corner"] * corner_y, cy),
    ):
        yield Rule(
            part, (f"{name} (mm on the chip)", seen), "<=", ("half the crop", room), rests_on
        )
    degrees = math.degrees(min(angle["corner"], math.pi))
    yield Rule(
        part,
        ("half angle to the corner in degrees", degrees),
        "<=",
        ("what enters the acrylic well", GRAZING_DEG),
        ("camera.lens_height_mm",),
    )
    widest = d.optics.air_gap_mm * math.tan(min(angle["corner"], math.pi / 2 - 1e-6))
    yield Rule(
        "light-holder",
        ("view cone at the acrylic", widest),
        "<=",
        ("bore radius", d.light_bore_mm),
        ("camera.lens_height_mm",),
    )
    for size, side, axis in ((vx, d.skin.width_mm, "x"), (vy, d.skin.length_mm, "y")):
        yield Rule("skin", (f"view in {axis}", size), "<=", ("the skin's side", side))


def _tools(d: Design) -> Iterator[Rule]:
    mold, table, coupon = d.mold, d.table, d.coupon
    yield Rule("mold", ("fit_mm + 2", mold.fit_mm + 2.0), "<=", ("web_mm / 2", mold.web_mm / 2))
    yield Rule("mold", ("pry_mm", mold.pry_mm), "<", ("web_mm / 2", mold.web_mm / 2))
    yield Rule("mold", ("seat_mm", mold.seat_mm), "<", ("frame height", d.frame_height_mm))
    yield Rule("mold", ("pry_width_mm", mold.pry_width_mm), "<", ("outer x", d.frame_outer_mm[0]))
    yield Rule(
        "testing-shell",
        ("table: hole + 2 x 3", table.hole_mm + 6.0),
        "<=",
        ("tab_mm", table.tab_mm),
    )
    yield Rule(
        "testing-shell",
        ("table: pitch + hole + 2 x 3", table.hole_pitch_mm + table.hole_mm + 6.0),
        "<=",
        ("width_mm", table.width_mm),
    )
    yield Rule(
        "testing-shell",
        ("table: hole + 3", table.hole_mm + 3.0),
        "<=",
        ("hole_pitch_mm", table.hole_pitch_mm),
    )
    yield Rule(
        "testing-shell", ("table: width_mm", table.width_mm), "<=", ("outer y", d.frame_outer_mm[1])
    )
    yield Rule(
        "testing-shell",
        ("cover + 2", d.cover.floor_mm + 2.0),
        "<=",
        ("table.height_mm", table.height_mm),
    )
    yield Rule(
        "testing-shell",
        ("table.height_mm", table.height_mm),
        "<=",
        ("cover and shell", d.z_joint_mm - d.z_back_mm),
    )
    yield Rule("coupon-mold", ("2", 2.0), "<=", ("diameter_mm", coupon.diameter_mm))
    # Two notches face each other across a web; half a wall of 1.5 stays on either side.
    yield Rule(
        "mold",
        ("fit_mm + pry_mm + 0.75", mold.fit_mm + mold.pry_mm + 0.75),
        "<=",
        ("web_mm / 2", mold.web_mm / 2),
    )


def stock_note(d: Design) -> str:
    """What to say of a screw length that no shop stocks; empty when it is stocked."""
    row = CAP_SCREWS[d.screw.thread]
    if d.screw.length_mm in row.stock_mm:
        return ""
    longest = row.stock_mm[-1]
    name = f"{d.screw.thread} x {d.screw.length_mm:g}"
    return f"{name} is not stocked; the longest sold is {longest:g} mm"
