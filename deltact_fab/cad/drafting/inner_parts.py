"""Callouts of light holder, camera holder and cover."""

from __future__ import annotations

import math

from ..dimensions import Design
from .dimensioning import Axis, Centres, Cut, Item, Leader, Linear, shown
from .items import SQUARE_EDGES, Callouts, holes, x_of, y_of, z_of

# Where the two screws of the board stand.
UPPER_HOLES = (
    "camera.board_length_mm",
    "camera.lens_offset_mm",
    "camera.hole_edge_mm",
    "camera.hole_pitch_x_mm",
)


def light_holder(d: Design) -> Callouts:
    """The ring; section through channel, floor and wire slot."""
    light = d.light
    back, front = d.z_board_front_mm, d.z_light_mm
    radii = {
        "outer": d.light_radius_mm,
        "channel": d.strip_radius_mm,
        "diffuser": d.channel_inner_mm,
        "bore": d.light_bore_mm,
    }
    slot = light.slot_mm / 2
    floor = back + light.floor_mm
    upper, screws = d.camera.hole_rows_mm[0], d.camera_screw_centres_mm
    relief = d.head_relief_mm
    r = radii["outer"]
    # The ring ends inside the relief: the arrow goes to the side of the relief that it keeps.
    (x, y), inward = screws[1], 1 - relief / math.hypot(*screws[1])
    near = (x * inward, y * inward)
    items: list[Item] = [
        Centres("top", ((0, 0, front),), r),
        y_of("left", -r, r, "bottom", 0, back, before="Ø"),
        y_of("left", -radii["channel"], radii["channel"], "top", 0, front, before="Ø"),
        y_of("left", -radii["diffuser"], radii["diffuser"], "top", 0, front, before="Ø"),
        y_of("left", -radii["bore"], radii["bore"], "bottom", 0, back, before="Ø"),
        z_of("left", back, front, "left", 0, r),
        z_of("left", back, floor, "left", 0, radii["channel"]),
        x_of("top", -slot, slot, "bottom", -r, front),
        x_of("top", screws[0][0], screws[1][0], "top", upper, back),
        y_of("top", 0, upper, "left", screws[0][0], back),
        Centres("top", tuple((x, y, back) for x, y in screws), relief),
        Leader("top", (*near, back), 0, f"2× Ø{shown(2 * relief)} through the floor, from below"),
        z_of("front", floor, front, "left", -slot, -r),
        Axis("left", (0, 0, back), (0, 0, front)),
    ]
    notes = (
        "Translucent white; the inner wall is the diffuser: no polish, no paint.",
        f"Slot at -y through the outer wall only. {SQUARE_EDGES}",
    )
    return Callouts(
        tuple(items), notes, Cut(0.0),
        rests_on=("camera.lens_diameter_mm", "camera.lens_height_mm", *UPPER_HOLES),
    )  # fmt: skip


def camera_holder(d: Design) -> Callouts:
    """The plate behind the board."""
    back, front = d.z_floor_mm, d.z_board_back_mm
    x, arm = d.holder_half_x_mm, d.holder_arm_mm
    tongue, top = d.holder_tongue_mm
    window, window_top = d.holder_window_half_mm, d.holder_window_top_mm
    (px, py), upper = d.peg_at_mm, d.camera.hole_rows_mm[0]
    pitch = d.camera.hole_pitch_x_mm / 2
    row = d.holder.row
    items: list[Item] = [
        x_of("top", -x, x, "bottom", -arm),
        x_of("top", -px, px, "bottom", -py),
        x_of("top", -window, window, "bottom", -arm),
        x_of("top", -tongue, tongue, "top", top),
        x_of("top", -pitch, pitch, "top", upper),
        y_of("top", -arm, arm, "left", -x),
        y_of("top", -py, py, "left", -px),
        y_of("top", -arm, top, "left", -tongue),
        y_of("top", 0, window_top, "right", window),
        y_of("top", 0, upper, "right", pitch),
        *holes([(s * px, t * py) for s in (-1, 1) for t in (-1, 1)], front, d.cover.hole_mm,
                " through"),
        *holes([(-pitch, upper), (pitch, upper)], front, row.pilot_mm, " through"),
        Axis("top", (0, -arm, 0), (0, top, 0)),
        Axis("top", (-x, 0, 0), (x, 0, 0)),
        z_of("front", back, front, "left", -x),
    ]  # fmt: skip
    notes = (
        f"Ø{shown(row.pilot_mm)}: {d.holder.screw} cuts its own thread. "
        f"Ø{shown(d.cover.hole_mm)}: for the pegs of the cover.",
        SQUARE_EDGES,
    )
    return Callouts(tuple(items), notes, rests_on=("camera.connector_width_mm", *UPPER_HOLES))


def cover(d: Design) -> Callouts:
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
