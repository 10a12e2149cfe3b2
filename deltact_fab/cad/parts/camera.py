"""Part 5, the camera: an envelope of a board with a lens on it, by default of an IMX219 fisheye.

Seen from the lens (along -z):              From the side, y to the right:

    +-----------------------+  board_top        z_lens          +-----+
    | o                   o |  y                                |lens |
    |       .-----.         |  ^                z_board_front   |     |
    | o     | lens |      o |  |             +------------------+-----+------+
    |       '-----'         |  +-> x         +------+------------------------+  board
    +-----------------------+  board_bottom  | conn |           z_board_back
                                             +------+  -connector_height

It keeps room; it is no model of the module. The board's outline and holes are those of the
Raspberry Pi camera v2, the connector the largest one seen; no drawing of the paper's module was
found: lens diameter and height are assumed (`Design.unverified`).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import fields

from ..dimensions import Design
from ..kernel import Shape, cuboid, cylinders
from ..part import BOUGHT, GREEN, Part
from ..process import PLANE
from ..rule import Length, PlayFit, Quantity, Rule
from ..sensor_sections import CameraDimensions
from ..solid_gate import Box

COMPUTER = "Nvidia Jetson Nano B01"


# What lies in the board's plane; a camera from another maker has another one.
BOARD_KEYS = tuple(
    f"camera.{f.name}"
    for f in fields(CameraDimensions)
    if f.name.startswith(("board_", "hole_", "lens_offset_", "connector_"))
)
# Where the two screws of the board stand.
UPPER_HOLES = (
    "camera.board_length_mm",
    "camera.lens_offset_mm",
    "camera.hole_edge_mm",
    "camera.hole_pitch_x_mm",
)


def box(design: Design) -> Box:
    """Board, lens and connector."""
    cam, half = design.camera, design.camera.board_width_mm / 2
    back = design.z_board_back_mm - cam.connector_height_mm
    return (-half, cam.board_bottom_mm, back), (half, cam.board_top_mm, design.z_lens_mm)


def build(design: Design) -> Shape:
    """The envelope as one solid in the sensor frame, the lens's axis on x = y = 0."""
    cam = design.camera
    back, front, edge = design.z_board_back_mm, design.z_board_front_mm, cam.board_bottom_mm
    half, wide = cam.board_width_mm / 2, cam.connector_width_mm / 2
    body = cuboid(((-half, edge, back), (half, cam.board_top_mm, front)))
    if cam.hole_mm:
        x = cam.hole_pitch_x_mm / 2
        at = [(sx * x, y) for y in cam.hole_rows_mm for sx in (-1, 1)]
        body = body.cut(cylinders(at, cam.hole_mm, back - 1, cam.board_mm + 2))
    lens = cylinders([(0, 0)], cam.lens_diameter_mm, front, cam.lens_height_mm)
    low, end = back - cam.connector_height_mm, edge + cam.connector_length_mm
    return body.union(lens).union(cuboid(((-wide, edge, low), (wide, end, back)))).val()


def rules(d: Design) -> Iterator[Rule]:
    """The board's own holes and lens, which nothing else looks at."""
    cam, radius = d.camera, d.camera.hole_mm / 2
    if not radius:
        yield Quantity("head of holder.screw", d.holder.row.head_mm).at_most(
            "none without holes", 0
        )
        return
    upper, lower = cam.hole_rows_mm
    corner = math.hypot(cam.hole_pitch_x_mm / 2, min(abs(upper), abs(lower)))
    across = cam.hole_pitch_x_mm / 2 + radius
    for name, least, what, room in (
        ("half hole_mm", radius, "hole_edge_mm", cam.hole_edge_mm),
        ("half hole_pitch_x_mm + radius", across, "half the board", cam.board_width_mm / 2),
        ("the board's -y edge + hole radius", cam.board_bottom_mm + radius, "lower holes", lower),
        ("lens radius + hole radius", cam.lens_diameter_mm / 2 + radius, "nearest hole", corner),
    ):
        yield Quantity(name, least).below(what, room, ("camera.lens_diameter_mm", *BOARD_KEYS))


def fits(d: Design) -> Iterator[PlayFit]:
    """The board in the shell and beside its posts, and the ends of what it sees of the face."""
    cam, printer = d.camera, d.resin_printer
    off, parts = cam.tolerance_mm, "camera, shell"
    sides = cam.board_width_mm, 2 * max(cam.board_top_mm, -cam.board_bottom_mm)
    posts = max(range(2), key=lambda i: 2 * d.post_edge_mm[i] - sides[i])
    for name, room, side in (
        *((f"in the shell, {'xy'[i]}", d.cavity_half_mm[i], sides[i]) for i in range(2)),
        ("beside the posts", d.post_edge_mm[posts], sides[posts]),
    ):
        board = Length(side, 2 * off, BOARD_KEYS)
        yield PlayFit(f"board {name}", parts, (printer.inner(2 * room),), (board,))
    face = d.skin.opening_half_mm
    for i, axis in enumerate("xy"):
        flat = Length(face[i] - d.skin.edge_fillet_mm)
        seen = Length(d.optics.view_mm[i] / 2)
        name = f"view within the face's fillet, {axis}"
        yield PlayFit(name, "camera, camera-holder, shell, skin", (flat,), (seen, *off_axis(d)))


def off_axis(d: Design) -> tuple[Length, Length]:
    """The most that the lens stands off the middle: by holes or bond, by the holder's fit."""
    screw = d.holder.row.thread_mm
    hole_mm = (d.camera.hole_mm - screw) / 2 if screw else d.holder.bonded_mm
    hole = Length(hole_mm, d.camera.tolerance_mm, BOARD_KEYS)
    return hole, Length(d.holder.fit_mm, d.resin_printer.plane_mm, PLANE)


def off_axis_mm(d: Design) -> float:
    """How far the lens may stand off the middle at worst, either way."""
    return sum(length.mean_mm + length.spread_mm for length in off_axis(d))


PARTS = (
    Part(
        "camera",
        "board with its lens",
        BOUGHT,
        build,
        box,
        number=5,
        explode_mm=-48,
        colour=GREEN,
        sections=("camera", "optics"),
        derived=("z_lens_mm", "z_board_front_mm", "z_board_back_mm"),
        rules=rules,
        fits=fits,
        note="{d.camera.name}; {d.camera.crop_width_px} x {d.camera.crop_height_px}",
        look_for="measure lens and board: see what nobody has verified",
    ),
)
