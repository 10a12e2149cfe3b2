"""Rules of what the shell holds: light holder, camera, camera holder, and the cover's pegs."""

from __future__ import annotations

import math
from collections.abc import Iterator

from ..dimensions import Design
from .rule import Rule


def light(d: Design) -> Iterator[Rule]:
    """Light holder: strip, bore, floor and reliefs."""
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
    depth = d.z_light_mm - d.z_board_front_mm - light.floor_mm
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


def camera(d: Design) -> Iterator[Rule]:
    """Board, lens and screws among posts and walls."""
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


def holder(d: Design) -> Iterator[Rule]:
    """Camera holder: window, tongue, arms and screws."""
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


def cover(d: Design) -> Iterator[Rule]:
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
