"""Part 5, the camera: an envelope of a board with a lens on it, by default of an IMX219 fisheye.

Seen from the lens (along -z):              From the side, y to the right:

    +-----------------------+  board_top        z_lens          +-----+
    | o                   o |  y                                |lens |
    |       .-----.         |  ^                z_board_front   |     |
    | o     | lens |      o |  |             +------------------+-----+------+
    |       '-----'         |  +-> x         +------+------------------------+  board
    +-----------------------+  board_bottom  | conn |           z_board_back
                                             +------+  -connector_height

It reserves space and is no model of the module. The board's outline and holes are those of the
Raspberry Pi camera v2, the connector the largest known; no drawing of the paper's module was
found: lens diameter and height are assumed (`Design.unverified`).

Part 6, the camera holder: the plate behind the camera's board (paper, Imaging Subsystem).

Seen along -z:                                   y
                 +---------------+               ^     tongue: carries the two pilots, into which
                 |  o         o  |               |     the camera's screws cut their thread
    +------------+   _________   +------------+  +-> x
    | O             |         |             O |
    |               | window  |               |        window: room for the connector, open
    |               |         |               |        towards -y for the cable
    | O             |         |             O |
    +---------------+         +---------------+        O: holes for the cover's pegs

The board lies on its front; the cover's floor bears on its back.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import fields

from deltact_fab.common import Check

from ..bench_sections import PLANE_KEYS
from ..dimensions import Design
from ..drafting.dimensioning import SCREWS_CUT, SQUARE_EDGES, Callouts, x_of, y_of, z_of
from ..kernel import Extent, Shape, cuboid, cylinders, prism
from ..part import BLACK_RGBA, BOUGHT_PROCESS, GREEN_RGBA, Part, PrintPose
from ..rule import Length, PlayFit, at_most, below
from ..sensor_sections import CameraDimensions
from ..standards import screw_tolerance_mm, thread_text

HOST_COMPUTER = "Nvidia Jetson Nano B01"

# Dimensions in the board's plane; they depend on the camera's maker.
BOARD_KEYS = tuple(
    f"camera.{f.name}"
    for f in fields(CameraDimensions)
    if f.name.startswith(("board_", "hole_", "lens_offset_", "connector_"))
)
# Keys that locate the board's two screws.
UPPER_HOLES = (
    "camera.board_length_mm",
    "camera.lens_offset_mm",
    "camera.hole_edge_mm",
    "camera.hole_pitch_x_mm",
)


def box(design: Design) -> Extent:
    """Bounding box of board, lens and connector."""
    cam, half = design.camera, design.camera.board_width_mm / 2
    back = design.z_board_back_mm - cam.connector_height_mm
    return (-half, cam.board_bottom_mm, back), (half, cam.board_top_mm, design.z_lens_mm)


def build(design: Design) -> Shape:
    """The envelope as one solid in the sensor frame, the lens's axis on x = y = 0."""
    cam = design.camera
    back, front, edge = design.z_board_back_mm, design.z_board_front_mm, cam.board_bottom_mm
    half, half_width = cam.board_width_mm / 2, cam.connector_width_mm / 2
    body = cuboid(((-half, edge, back), (half, cam.board_top_mm, front)))
    if cam.hole_mm:
        x = cam.hole_pitch_x_mm / 2
        centres = [(sx * x, y) for y in cam.hole_rows_mm for sx in (-1, 1)]
        body = body.cut(cylinders(centres, cam.hole_mm, back - 1, cam.board_mm + 2))
    lens = cylinders([(0, 0)], cam.lens_diameter_mm, front, cam.lens_height_mm)
    low, end = back - cam.connector_height_mm, edge + cam.connector_length_mm
    return body.union(lens).union(cuboid(((-half_width, edge, low), (half_width, end, back)))).val()


def rules(d: Design) -> Iterator[Check]:
    """Rules of the board's own holes, lens and cable."""
    cam, radius = d.camera, d.camera.hole_mm / 2
    for id, name, value, limit_name, room in (
        ("cable-in-plug", "cable_width_mm", cam.cable_width_mm, "connector_width_mm",
         cam.connector_width_mm),
        ("plug-on-cable", "connector_width_mm / 3", cam.connector_width_mm / 3, "cable_width_mm",
         cam.cable_width_mm),
        # No lens is shorter than its focal length, but a telephoto.
        ("focus-in-lens", "focal_length_mm", cam.focal_length_mm, "lens_height_mm",
         cam.lens_height_mm),
    ):  # fmt: skip
        yield at_most(id, name, value, limit_name, room, ("camera.cable_width_mm", *BOARD_KEYS))
    if not radius:
        head = "head of holder.screw", d.holder.row.head_mm
        yield at_most("no-holes", *head, "none without holes", 0)
        return
    upper, lower = cam.hole_rows_mm
    corner = math.hypot(cam.hole_pitch_x_mm / 2, min(abs(upper), abs(lower)))
    across, half_mm = cam.hole_pitch_x_mm / 2 + radius, cam.board_width_mm / 2
    for id, name, value, limit_name, room in (
        ("hole-in-board", "half hole_mm", radius, "hole_edge_mm", cam.hole_edge_mm),
        ("holes", "half hole_pitch_x_mm + radius", across, "half the board", half_mm),
        ("lower-holes", "the board's -y edge + hole radius", cam.board_bottom_mm + radius,
         "lower holes", lower),
        ("lens", "lens radius + hole radius", cam.lens_diameter_mm / 2 + radius,
         "nearest hole", corner),
    ):  # fmt: skip
        yield below(id, name, value, limit_name, room, ("camera.lens_diameter_mm", *BOARD_KEYS))


def fits(d: Design) -> Iterator[PlayFit]:
    """Fits of the board in the shell and between its posts, and of the view within the face."""
    cam, printer = d.camera, d.resin_printer
    tolerance, parts = cam.tolerance_mm, "camera, shell"
    sides = cam.board_width_mm, 2 * max(cam.board_top_mm, -cam.board_bottom_mm)
    posts = max(range(2), key=lambda i: 2 * d.post_edge_mm[i] - sides[i])
    for id, name, room, side in (
        ("in-shell-x", "in the shell, x", d.cavity_half_mm[0], sides[0]),
        ("in-shell-y", "in the shell, y", d.cavity_half_mm[1], sides[1]),
        ("beside-posts", "beside the posts", d.post_edge_mm[posts], sides[posts]),
    ):
        board = Length(side, 2 * tolerance, BOARD_KEYS)
        yield PlayFit(f"board-{id}", f"board {name}", parts, (printer.inner(2 * room),), (board,))
    face = d.skin.opening_half_mm
    for i, axis in enumerate("xy"):
        flat = Length(face[i] - d.skin.edge_fillet_mm)
        half_view = Length(d.optics.view_mm[i] / 2)
        name, stack = f"view within the face's fillet, {axis}", "camera, camera-holder, shell, skin"
        yield PlayFit(f"view-{axis}", name, stack, (flat,), (half_view, *off_axis(d)))


def off_axis(d: Design) -> tuple[Length, Length]:
    """Largest offset of the lens from the middle: from holes or bond, from the holder's fit."""
    screw = d.holder.row.thread_mm
    hole_mm = (d.camera.hole_mm - screw) / 2 if screw else d.holder.bonded_mm
    hole = Length(hole_mm, d.camera.tolerance_mm, BOARD_KEYS)
    return hole, Length(d.holder.fit_mm, d.resin_printer.plane_mm, PLANE_KEYS)


def off_axis_mm(d: Design) -> float:
    """Worst-case offset of the lens from the middle, +-."""
    return sum(length.mean_mm + length.spread_mm for length in off_axis(d))


def holder_box(design: Design) -> Extent:
    """Bounding box of arms and tongue."""
    half_x, arm, top = design.holder_half_x_mm, design.holder_arm_mm, design.holder_tongue_mm[1]
    return (-half_x, -arm, design.z_floor_mm), (half_x, max(arm, top), design.z_board_back_mm)


def holder_build(design: Design) -> Shape:
    """The plate as one solid in the sensor frame, z from the cover's floor to the board's back."""
    half_x, arm = design.holder_half_x_mm, design.holder_arm_mm
    tongue, top = design.holder_tongue_mm
    window, window_top = design.holder_window_half_mm, design.holder_window_top_mm
    outline = [(-window, window_top), (-window, -arm), (-half_x, -arm), (-half_x, arm)]
    if top > arm:
        outline += [(-tongue, arm), (-tongue, top)]
    outline += [(-x, y) for x, y in reversed(outline)]
    low, deep = design.z_floor_mm, design.holder.clearance_mm
    body = prism(outline, low, deep)
    for centres, diameter_mm in (
        (design.peg_centres_mm, design.cover.hole_mm),
        (design.camera_screw_centres_mm, design.holder.row.pilot_mm),
    ):
        if centres:
            body = body.cut(cylinders(centres, diameter_mm, low - 1, deep + 2))
    return body.val()


def holder_rules(d: Design) -> Iterator[Check]:
    """Rules of the board's rest beside the window, and of the arms around it."""
    half = d.holder_window_half_mm + d.holder.window_rest_mm
    board = "half the board", d.camera.board_width_mm / 2
    yield at_most("board-on-window", "half the window + window_rest_mm", half, *board, BOARD_KEYS)
    arms = "the arms' edge", d.holder_arm_mm
    yield below("window", "the window's upper edge", d.holder_window_top_mm, *arms, BOARD_KEYS)


def holder_fits(d: Design) -> Iterator[PlayFit]:
    """Fits in the shell, between the cover's bosses, under the board, around its screws."""
    part, printer, cam, screw = "camera-holder", d.resin_printer, d.camera, d.holder.row
    (cavity_x, cavity_y), (tongue, top) = d.cavity_half_mm, d.holder_tongue_mm
    inner, outer, tolerance = printer.inner, printer.outer, cam.tolerance_mm
    for id, name, neighbour, room, body in (
        ("in-shell-x", "in the shell, x", "shell", 2 * cavity_x, 2 * d.holder_half_x_mm),
        ("in-shell-y", "in the shell, y", "shell", cavity_y, max(top, d.holder_arm_mm)),
        ("between-bosses-x", "between the bosses, x", "cover", 2 * d.post_edge_mm[0], 2 * tongue),
        ("between-bosses-y", "between the bosses, y", "cover", 2 * d.post_edge_mm[1],
         2 * d.holder_arm_mm),
    ):  # fmt: skip
        parts = f"{part}, {neighbour}"
        yield PlayFit(id, f"camera holder {name}", parts, (inner(room),), (outer(body),))
    connector = Length(cam.connector_width_mm, tolerance, ("camera.connector_width_mm",))
    window = inner(2 * d.holder_window_half_mm)
    yield PlayFit("plug", "connector in the window", f"{part}, camera", (window,), (connector,))
    deep = printer.tall(d.holder.clearance_mm)
    high = Length(cam.connector_height_mm, tolerance, ("camera.connector_height_mm",))
    stack = "camera, camera-holder, cover"
    yield PlayFit("plug-above-cover", "connector above the cover, z", stack, (deep,), (high,))
    if not d.camera_screw_centres_mm:
        return
    hole = Length(cam.hole_mm, tolerance, ("camera.hole_mm",))
    # Two screws in a row along x: only that pitch can differ, half of it at either end.
    pitch = Length(0.0, printer.plane_mm + tolerance, ("resin_printer.plane_mm",))
    screws, shank = f"camera, camera-screw, {part}", Length(screw.thread_mm)
    yield PlayFit("screws", f"{d.holder.screw} through the board", screws, (hole,), (shank, pitch))
    length_mm = d.holder.screw_length_mm
    tip = Length(length_mm, screw_tolerance_mm(length_mm))
    board = Length(cam.board_mm, tolerance, ("camera.board_mm",))
    screws, name = f"{screws}, cover", "camera's screws above the cover, z"
    yield PlayFit("screw-tips", name, screws, (board, deep), (tip,))


def holder_callouts(d: Design) -> Callouts:
    """Drawing content of the camera holder."""
    (px, py), pitch = d.peg_at_mm, d.camera.hole_pitch_x_mm / 2
    half_x, window, tongue = d.holder_half_x_mm, d.holder_window_half_mm, d.holder_tongue_mm[0]
    lengths = (
        x_of(-half_x, half_x),
        x_of(-px, px),
        x_of(-window, window),
        x_of(-tongue, tongue),
        *((x_of(-pitch, pitch),) if d.camera_screw_centres_mm else ()),
        y_of(-py, py),
        z_of(d.z_floor_mm, d.z_board_back_mm),
    )
    rounds = {d.cover.hole_mm: "for the cover's pegs"}
    if d.camera_screw_centres_mm:
        thread = thread_text(d.holder.screw)
        rounds[d.holder.row.pilot_mm] = f"{thread}, pilot {{}}"
    notes = (f"{SCREWS_CUT} {SQUARE_EDGES}" if d.camera_screw_centres_mm else SQUARE_EDGES,)
    rests_on = ("camera.connector_width_mm", *UPPER_HOLES)
    return Callouts(lengths, rounds, fitted=(d.cover.hole_mm,), notes=notes, rests_on=rests_on)


PARTS = (
    Part(
        "camera",
        build,
        box,
        material="board with its lens",
        process=BOUGHT_PROCESS,
        number=5,
        explode_mm=-48,
        colour=GREEN_RGBA,
        sections=("camera", "optics"),
        derived=("z_lens_mm", "z_board_front_mm", "z_board_back_mm"),
        rules=rules,
        fits=fits,
        note="{d.camera.name}; {d.camera.crop_width_px} x {d.camera.crop_height_px}",
        look_for="measure lens and board; see the unverified keys",
    ),
    Part(
        "camera-holder",
        holder_build,
        holder_box,
        number=6,
        explode_mm=-64,
        colour=BLACK_RGBA,
        sections=("holder", "camera", "cover", "shell"),
        derived=(
            "holder_half_x_mm", "holder_window_half_mm", "holder_window_top_mm", "holder_arm_mm",
            "holder_tongue_mm", "peg_at_mm", "peg_centres_mm", "camera_screw_centres_mm",
            "z_board_back_mm", "z_floor_mm",
        ),
        rules=holder_rules,
        fits=holder_fits,
        wall_keys=("holder.wall_mm",),
        in_view=True,
        callouts=holder_callouts,
        pose=PrintPose(face="back"),
        look_for="flat to 0.1 mm on a glass plate",
    ),
)  # fmt: skip
