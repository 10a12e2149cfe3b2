"""Callouts of acrylic, skin frame, shell and testing shell."""

from __future__ import annotations

from ..dimensions import Design
from .dimensioning import Axis, Cut, Item, Leader, Linear, shown
from .items import SQUARE_EDGES, Callouts, holes, x_of, y_of, z_of
from .projection import Vector


def acrylic(d: Design) -> Callouts:
    """The plate: outline, notches, thickness."""
    (x, y), (nx, ny) = d.acrylic_half_mm, d.acrylic_notch_mm
    back, front = d.z_joint_mm, d.z_ledge_mm
    items: list[Item] = [
        x_of("top", -x, x, "bottom", -y),
        y_of("top", -y, y, "left", -x),
        z_of("front", back, front, "left", -x),
    ]
    if nx > 0:
        items += [
            Linear("top", (x - nx, y, 0), (x, y - ny, 0), "top", after=" (4×)"),
            Linear("top", (x, y - ny, 0), (x - nx, y, 0), "right", after=" (4×)"),
        ]
    notes = (
        "Cut from cast PMMA, clear on both faces; protective film stays on until bonding.",
        "Plan dimensions are those of the finished plate: offset the cut by half the kerf.",
    )
    return Callouts(tuple(items), notes)


def skin_frame(d: Design) -> Callouts:
    """The frame, seen from its back; section through window and pocket."""
    ox, oy = (s / 2 for s in d.frame_outer_mm)
    sx, sy = d.screw_at_mm
    w, h = d.skin.width_mm / 2, d.skin.length_mm / 2
    px, py = d.post_edge_mm
    seat = d.seat_half_mm[1]
    back, ledge, front = d.z_joint_mm, d.z_ledge_mm, d.z_front_mm
    pilot = d.screw.row.pilot_mm
    items: list[Item] = [
        x_of("top", -ox, ox, "bottom", oy),
        y_of("top", -oy, oy, "left", -ox),
        x_of("top", -sx, sx, "bottom", sy),
        y_of("top", -sy, sy, "left", -sx),
        x_of("top", -w, w, "top"),
        *holes(d.screw_centres_mm, back, pilot, f" depth {shown(d.screw.pilot_depth_mm)}"),
        z_of("front", back, front, "left", -ox),
        z_of("front", back, back + d.screw.pilot_depth_mm, "right", sx),
        *(Axis("front", (s * sx, 0, back), (s * sx, 0, back + d.screw.pilot_depth_mm))
          for s in (-1, 1)),
        y_of("left", -h, h, "top", 0, front),
        y_of("left", -seat, seat, "bottom", 0, back),
        z_of("left", back, ledge, "right", 0, oy),
        z_of("left", back, front, "right", 0, oy),
    ]  # fmt: skip
    if d.post_in_window_mm[0] > 0:
        items += [
            x_of("top", -px, px, "top", -py),
            y_of("top", -py, py, "right", px),
        ]
    notes = (
        f"Holes: {d.screw.thread} cuts its own thread; ream, do not tap.",
        f"Window (all around) bonds to the silicone: keep it clean. {SQUARE_EDGES}",
    )
    return Callouts(tuple(items), notes, Cut(0.0), flipped=True)


def _shell_body(d: Design) -> list[Item]:
    """What shell and testing shell have in common."""
    shell = d.shell
    ox, oy = (s / 2 for s in d.frame_outer_mm)
    (sx, sy), (cx, cy) = d.screw_at_mm, d.cavity_half_mm
    px, py = d.post_edge_mm
    floor, joint, boss = d.z_floor_mm, d.z_joint_mm, d.z_boss_mm
    cable = shell.cable_width_mm / 2
    items: list[Item] = [
        x_of("top", -sx, sx, "bottom", -sy),
        y_of("top", -sy, sy, "left", -sx),
        y_of("top", -oy, oy, "left", -ox),
        *holes(d.screw_centres_mm, joint, d.screw.row.clearance_mm, " through"),
        x_of("top", -px, px, "top", py),
        y_of("top", -py, py, "right", px),
        x_of("front", -cable, cable, "bottom", -oy, floor),
        z_of("front", floor, floor + shell.cable_height_mm, "right", cable, -oy),
        *(Axis("front", (s * sx, -sy, floor), (s * sx, -sy, joint)) for s in (-1, 1)),
        z_of("left", joint - shell.ledge_height_mm, joint, "right", 0, shell.ledge_mm - cy),
        y_of("left", -cy, cy, "bottom", 0, floor),
        y_of("left", -(cy - shell.ledge_mm), cy - shell.ledge_mm, "top", 0, joint),
        x_of("top", -cx, cx, "top", 0),
    ]
    if boss > floor:
        room = d.boss_room_mm
        items += [
            z_of("front", floor, boss, "right", ox, -oy),
            x_of("front", -ox, -ox + room, "bottom", -oy, floor, after=" (4×, x and y)"),
        ]
    return items


def shell(d: Design) -> Callouts:
    """The shell with its mount; section through cable notch, ledge and mount."""
    mount, shell = d.mount, d.shell
    ox, oy = (s / 2 for s in d.frame_outer_mm)
    floor, joint = d.z_floor_mm, d.z_joint_mm
    end = oy + mount.length_mm
    reach = -{"block": mount.width_mm / 2, "franka": mount.flange_width_mm / 2, "plate": ox}[
        mount.kind
    ]
    items = _shell_body(d)
    items += [
        x_of("top", -ox, ox, "bottom", -oy),
        Linear("top", (-ox, -oy, 0), (reach, end, 0), "left"),
        z_of("front", floor, joint, "left", -ox, -oy),
        y_of("left", oy, end, "bottom", 0, floor),
    ]
    rests_on: tuple[str, ...] = ()
    if mount.kind == "plate":
        items.append(z_of("left", floor, joint, "left", 0, end))
    elif mount.kind == "block":
        half, top = mount.width_mm / 2, floor + mount.height_mm
        middle, pitch = oy + mount.length_mm / 2, mount.hole_pitch_mm / 2
        items += [
            x_of("top", -half, half, "top", end, top),
            z_of("left", floor, top, "left", 0, end),
            y_of("top", middle - pitch, middle + pitch, "right", half, top),
            y_of("top", middle + pitch, end, "right", half, top),
            *holes([(0, middle - pitch), (0, middle + pitch)], top, mount.hole_mm, " through"),
        ]
    else:
        half, wide = mount.width_mm / 2, mount.flange_width_mm / 2
        low, high = d.flange_arm_z_mm
        top = floor + mount.flange_height_mm
        middle, pitch = floor + mount.flange_height_mm / 2, mount.flange_pitch_mm / 2
        bores: tuple[Vector, ...] = ((0, end, middle - pitch), (0, end, middle + pitch))
        items += [
            x_of("top", -half, half, "top", end - mount.flange_mm),
            x_of("top", -wide, wide, "top", end),
            y_of("left", end - mount.flange_mm, end, "top", 0, top),
            z_of("left", floor, top, "left", 0, end),
            z_of("left", middle - pitch, middle + pitch, "left", 0, end),
            z_of("left", low, high, "left", 0, end),
            *(Axis("left", (0, end - mount.flange_mm, at[2]), at) for at in bores),
            Leader("left", bores[1], 0, f"2× Ø{shown(mount.hole_mm)} through", "left"),
        ]
        rests_on = tuple(f"mount.flange_{key}_mm" for key in ("width", "height", "pitch"))
    notes = (
        f"Walls {shown(shell.wall_mm)} all around. Opaque: no light through the walls.",
        SQUARE_EDGES,
    )
    return Callouts(tuple(items), notes, Cut(0.0), rests_on=rests_on)


def testing_shell(d: Design) -> Callouts:
    """The shell with its two table tabs."""
    table, shell = d.table, d.shell
    ox = d.frame_outer_mm[0] / 2
    back, joint = d.z_back_mm, d.z_joint_mm
    end, middle = ox + table.tab_mm, ox + table.tab_mm / 2
    half, pitch, top = table.width_mm / 2, table.hole_pitch_mm / 2, back + table.height_mm
    fit = d.cover.fit_mm
    bores = [(s * middle, t * pitch) for s in (-1, 1) for t in (-1, 1)]
    items = _shell_body(d)
    items += [
        x_of("top", -ox, ox, "top", 0),
        x_of("top", -middle, middle, "bottom", -pitch, top),
        x_of("top", -end, end, "bottom", -half, top),
        y_of("top", -half, half, "right", end, top),
        y_of("top", -pitch, pitch, "right", middle, top),
        *holes(bores, top, table.hole_mm, " through"),
        Linear("front", (-end, 0, back), (-ox, 0, joint), "left"),
        z_of("front", back, top, "right", end),
        z_of("front", back, d.z_floor_mm, "left", -ox),
    ]
    notes = (
        f"Walls {shown(shell.wall_mm)} all around. Tabs clear the cover by {shown(fit)}.",
        f"Undersides of both tabs level and flat: they stand on the table. {SQUARE_EDGES}",
    )
    return Callouts(tuple(items), notes, Cut(0.0))
