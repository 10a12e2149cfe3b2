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

import math
from collections.abc import Iterator
from dataclasses import asdict

from ..dimensions import Design
from ..drafting.items import SQUARE_EDGES, Callouts, x_of, y_of, z_of
from ..fit import Length, PlayFit
from ..kernel import Shape
from ..part import BLACK, PRINT, RESIN, Part
from ..print_orientation import PrintPose
from ..rule import Quantity, Rule
from ..solid_gate import Expected
from .camera import UPPER_HOLES, on_board
from .solids import cylinders, prism


def expect(design: Design) -> Expected:
    """Closed forms of the plate."""
    holder, half_x, arm = design.holder, design.holder_half_x_mm, design.holder_arm_mm
    tongue, top = design.holder_tongue_mm
    window_mm2 = 2 * design.holder_window_half_mm * (arm + design.holder_window_top_mm)
    area_mm2 = 4 * half_x * arm + 2 * tongue * max(top - arm, 0.0) - window_mm2
    area_mm2 -= math.pi * design.cover.hole_mm**2
    area_mm2 -= math.pi / 2 * holder.row.pilot_mm**2
    volume_mm3 = area_mm2 * holder.clearance_mm
    numbers = {key: value for key, value in asdict(holder).items() if key.endswith("_mm")}
    return Expected.exact(
        volume_mm3,
        ((-half_x, -arm, design.z_floor_mm), (half_x, max(arm, top), design.z_board_back_mm)),
        {
            **numbers,
            "holder_half_x_mm": half_x,
            "holder_arm_mm": arm,
            "holder_window_half_mm": design.holder_window_half_mm,
            "holder_window_top_mm": design.holder_window_top_mm,
            "peg_hole_mm": design.cover.hole_mm,
        },
    )


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
        body = body.cut(cylinders(centres, diameter_mm, low - 1, deep + 2))
    return body.val()


@on_board
def rules(d: Design) -> Iterator[Rule]:
    """Window, tongue, arms and screws."""
    holder, cam = d.holder, d.camera
    yield Quantity(
        "half the window + window_rest_mm", d.holder_window_half_mm + holder.window_rest_mm
    ).at_most("half the board", cam.board_width_mm / 2)
    yield Quantity("half the window + wall_mm", d.holder_window_half_mm + holder.wall_mm).at_most(
        "peg axis - hole / 2", d.peg_at_mm[0] - d.cover.hole_mm / 2
    )
    tongue, top = d.holder_tongue_mm
    yield Quantity("half the tongue (camera.hole_pitch_x_mm)", tongue).at_most(
        "corner posts", d.post_edge_mm[0]
    )
    yield Quantity("the tongue's edge + fit_mm", top + holder.fit_mm).at_most(
        "half the shell's cavity in y", d.cavity_half_mm[1]
    )
    arm, window_top = d.holder_arm_mm, d.holder_window_top_mm
    yield Quantity("peg_y_mm + hole / 2 + wall", arm).at_most("corner posts", d.post_edge_mm[1])
    yield Quantity(
        "the connector's upper edge", cam.board_bottom_mm + cam.connector_length_mm
    ).at_most("the window's upper edge", window_top)
    yield Quantity("the window's upper edge", window_top).below("the arms' edge", arm)
    grip = holder.screw_length_mm - cam.board_mm
    yield Quantity(f"thread {holder.screw}", holder.row.thread_mm).at_most(
        "screw_length_mm - board", grip
    )
    yield Quantity("screw_length_mm - board", grip).at_most("clearance_mm", holder.clearance_mm)
    (px, py), (sx, sy) = d.peg_at_mm, d.camera_screw_centres_mm[1]
    apart = min(math.hypot(px - sx, py - sy), math.hypot(px - sx, py + sy))
    yield Quantity(
        "half a peg's hole + half a pilot + wall_mm",
        (d.cover.hole_mm + holder.row.pilot_mm) / 2 + holder.wall_mm,
    ).at_most("peg axis to screw axis", apart)
    yield Quantity("hole of a peg + wall_mm", d.cover.hole_mm + holder.wall_mm).at_most(
        "2 cover.peg_y_mm", 2 * d.cover.peg_y_mm
    )


def fits(d: Design) -> Iterator[PlayFit]:
    """In the shell, between the cover's bosses, under the board."""
    part, printer, cam = "camera-holder", d.resin_printer, d.camera
    cavity_x, cavity_y = d.cavity_half_mm
    tongue, top = d.holder_tongue_mm
    keys = "holder.fit_mm"
    inner, outer = printer.inner, printer.outer
    room = inner(2 * cavity_x)
    plate = outer(2 * d.holder_half_x_mm)
    yield PlayFit("camera holder in the shell, x", f"{part}, shell", (room,), (plate,), keys)
    beyond = inner(cavity_y)
    reach = outer(max(top, d.holder_arm_mm))
    yield PlayFit("camera holder in the shell, y", f"{part}, shell", (beyond,), (reach,), keys)
    for i, (axis, half, key) in enumerate(
        (("x", tongue, "holder.wall_mm"), ("y", d.holder_arm_mm, "cover.peg_y_mm"))
    ):
        bosses = inner(2 * d.post_edge_mm[i])
        yield PlayFit(
            f"camera holder between the bosses, {axis}",
            f"{part}, cover",
            (bosses,),
            (outer(2 * half),),
            key,
        )
    off = cam.tolerance_mm
    connector = Length(cam.connector_width_mm, off, ("camera.connector_width_mm",))
    window = inner(2 * d.holder_window_half_mm)
    yield PlayFit(
        "connector in the window",
        f"{part}, camera",
        (window,),
        (connector,),
        "holder.window_fit_mm",
    )
    hole = Length(cam.hole_mm, off, ("camera.hole_mm",))
    # Two screws in a row along x: only that pitch can disagree, and either end takes half of it.
    pitch = Length(0.0, printer.plane_mm + off, ("resin_printer.plane_mm",))
    screw = Length(d.holder.row.thread_mm)
    yield PlayFit(
        f"{d.holder.screw} through the board",
        f"camera, camera-screw, {part}",
        (hole,),
        (screw, pitch),
        "camera.hole_mm, holder.screw",
    )
    deep = printer.tall(d.holder.clearance_mm)
    high = Length(cam.connector_height_mm, off, ("camera.connector_height_mm",))
    yield PlayFit(
        "connector above the cover, z",
        "camera, camera-holder, cover",
        (deep,),
        (high,),
        "holder.clearance_mm",
    )


def callouts(d: Design) -> Callouts:
    """The plate behind the board."""
    (px, py), pitch = d.peg_at_mm, d.camera.hole_pitch_x_mm / 2
    half_x, window, tongue = d.holder_half_x_mm, d.holder_window_half_mm, d.holder_tongue_mm[0]
    lengths = (
        x_of(-half_x, half_x),
        x_of(-px, px),
        x_of(-window, window),
        x_of(-tongue, tongue),
        x_of(-pitch, pitch),
        y_of(-py, py),
        z_of(d.z_floor_mm, d.z_board_back_mm),
    )
    rounds = {
        d.cover.hole_mm: "for the cover's pegs",
        d.holder.row.pilot_mm: f"pilot, {d.holder.screw} cuts its own thread",
    }
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
        expect,
        number=6,
        explode_mm=-64,
        colour=BLACK,
        sections=("holder", "camera", "cover", "shell"),
        derived=(
            "holder_half_x_mm", "holder_window_half_mm", "holder_window_top_mm", "holder_arm_mm",
            "holder_tongue_mm", "peg_centres_mm", "camera_screw_centres_mm", "z_board_back_mm",
            "z_floor_mm",
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
