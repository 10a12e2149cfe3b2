"""Part 6, the camera holder: the plate behind the camera's board (paper, Imaging Subsystem).

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

from collections.abc import Iterator

from ..dimensions import Design
from ..drafting.dimensioning import SQUARE_EDGES, Callouts, x_of, y_of, z_of
from ..kernel import Shape, cylinders, prism
from ..part import BLACK, PRINT, RESIN, Part, PrintPose
from ..rule import Length, PlayFit, Quantity, Rule
from ..solid_gate import Box
from ..standards import screw_tolerance_mm
from .camera import BOARD_KEYS, UPPER_HOLES


def box(design: Design) -> Box:
    """Arms and tongue."""
    half_x, arm, top = design.holder_half_x_mm, design.holder_arm_mm, design.holder_tongue_mm[1]
    return (-half_x, -arm, design.z_floor_mm), (half_x, max(arm, top), design.z_board_back_mm)


def build(design: Design) -> Shape:
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


def rules(d: Design) -> Iterator[Rule]:
    """The board rests on either side of the window, which the arms close."""
    holder = d.holder
    half = d.holder_window_half_mm + holder.window_rest_mm
    yield Quantity("half the window + window_rest_mm", half).at_most(
        "half the board", d.camera.board_width_mm / 2, BOARD_KEYS
    )
    yield Quantity("the window's upper edge", d.holder_window_top_mm).below(
        "the arms' edge", d.holder_arm_mm, BOARD_KEYS
    )


def fits(d: Design) -> Iterator[PlayFit]:
    """In the shell, between the cover's bosses, under the board, round the board's screws."""
    part, printer, cam, screw = "camera-holder", d.resin_printer, d.camera, d.holder.row
    (cavity_x, cavity_y), (tongue, top) = d.cavity_half_mm, d.holder_tongue_mm
    inner, outer, off = printer.inner, printer.outer, cam.tolerance_mm
    for name, other, room, body in (
        ("in the shell, x", "shell", 2 * cavity_x, 2 * d.holder_half_x_mm),
        ("in the shell, y", "shell", cavity_y, max(top, d.holder_arm_mm)),
        ("between the bosses, x", "cover", 2 * d.post_edge_mm[0], 2 * tongue),
        ("between the bosses, y", "cover", 2 * d.post_edge_mm[1], 2 * d.holder_arm_mm),
    ):
        parts = f"{part}, {other}"
        yield PlayFit(f"camera holder {name}", parts, (inner(room),), (outer(body),))
    connector = Length(cam.connector_width_mm, off, ("camera.connector_width_mm",))
    window = inner(2 * d.holder_window_half_mm)
    yield PlayFit("connector in the window", f"{part}, camera", (window,), (connector,))
    deep = printer.tall(d.holder.clearance_mm)
    high = Length(cam.connector_height_mm, off, ("camera.connector_height_mm",))
    stack = "camera, camera-holder, cover"
    yield PlayFit("connector above the cover, z", stack, (deep,), (high,))
    if not d.camera_screw_centres_mm:
        return
    hole = Length(cam.hole_mm, off, ("camera.hole_mm",))
    # Two screws in a row along x: only that pitch can disagree, and either end takes half of it.
    pitch = Length(0.0, printer.plane_mm + off, ("resin_printer.plane_mm",))
    screws, shank = f"camera, camera-screw, {part}", Length(screw.thread_mm)
    yield PlayFit(f"{d.holder.screw} through the board", screws, (hole,), (shank, pitch))
    length_mm = d.holder.screw_length_mm
    tip = Length(length_mm, screw_tolerance_mm(length_mm))
    board = Length(cam.board_mm, off, ("camera.board_mm",))
    yield PlayFit("camera's screws above the cover, z", f"{screws}, cover", (board, deep), (tip,))


def callouts(d: Design) -> Callouts:
    """The plate behind the board."""
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
        rounds[d.holder.row.pilot_mm] = f"pilot, {d.holder.screw} cuts its own thread"
    rests_on = ("camera.connector_width_mm", *UPPER_HOLES)
    return Callouts(
        lengths, rounds, fitted=(d.cover.hole_mm,), notes=(SQUARE_EDGES,), rests_on=rests_on
    )


PARTS = (
    Part(
        "camera-holder",
        f"{RESIN}, black",
        PRINT,
        build,
        box,
        number=6,
        explode_mm=-64,
        colour=BLACK,
        sections=("holder", "camera", "cover", "shell"),
        derived=(
            "holder_half_x_mm", "holder_window_half_mm", "holder_window_top_mm", "holder_arm_mm",
            "holder_tongue_mm", "peg_at_mm", "peg_centres_mm", "camera_screw_centres_mm",
            "z_board_back_mm", "z_floor_mm",
        ),
        rules=rules,
        fits=fits,
        wall_keys=("holder.wall_mm",),
        in_view=True,
        callouts=callouts,
        lies=PrintPose(face="back"),
        look_for="flat to 0.1 mm on a glass plate",
    ),
)  # fmt: skip
