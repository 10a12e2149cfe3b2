"""Part 5, the camera: an envelope of an IMX219 board with a fisheye lens, unverified.

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
from collections.abc import Callable, Iterator
from dataclasses import fields, replace
from functools import wraps

from ..dimensions import Design
from ..kernel import Shape, require
from ..part import BOUGHT, GREEN, Part
from ..rule import Quantity, Rule
from ..sensor_sections import CameraDimensions
from ..solid_gate import Expected
from . import view
from .solids import cylinders

CABLE = "flat, 15 way, 1.0 mm pitch, 16 mm wide"
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


def expect(design: Design) -> Expected:
    """Closed forms of the envelope. A hole above the connector ends at the board's back."""
    cam = design.camera
    board_mm2 = cam.board_width_mm * cam.board_length_mm - math.pi * cam.hole_mm**2
    volume_mm3 = board_mm2 * cam.board_mm
    volume_mm3 += math.pi / 4 * cam.lens_diameter_mm**2 * cam.lens_height_mm
    volume_mm3 += cam.connector_width_mm * cam.connector_length_mm * cam.connector_height_mm
    half = cam.board_width_mm / 2
    return Expected.exact(
        volume_mm3,
        (
            (-half, cam.board_bottom_mm, design.z_board_back_mm - cam.connector_height_mm),
            (half, cam.board_top_mm, design.z_lens_mm),
        ),
        {key: getattr(cam, key) for key in SHOWN},
    )


def build(design: Design) -> Shape:
    """The envelope as one solid in the sensor frame, the lens's axis on x = y = 0."""
    cq = require()
    cam = design.camera
    upper, lower = cam.hole_rows_mm
    x = cam.hole_pitch_x_mm / 2
    board = (
        cq.Workplane()
        .workplane(offset=design.z_board_back_mm)
        .center(0, cam.board_bottom_mm + cam.board_length_mm / 2)
        .rect(cam.board_width_mm, cam.board_length_mm)
        .extrude(cam.board_mm)
    )
    at = [(sx * x, y) for y in (upper, lower) for sx in (-1, 1)]
    holes = cylinders(at, cam.hole_mm, design.z_board_back_mm - 1, cam.board_mm + 2)
    lens = cylinders([(0, 0)], cam.lens_diameter_mm, design.z_board_front_mm, cam.lens_height_mm)
    connector = (
        cq.Workplane()
        .workplane(offset=design.z_board_back_mm)
        .center(0, cam.board_bottom_mm + cam.connector_length_mm / 2)
        .rect(cam.connector_width_mm, cam.connector_length_mm)
        .extrude(-cam.connector_height_mm)
    )
    return board.cut(holes).union(lens).union(connector).val()


SHOWN = (
    "board_width_mm", "board_length_mm", "board_mm", "hole_mm", "hole_pitch_x_mm",
    "hole_pitch_y_mm", "hole_edge_mm", "lens_offset_mm", "lens_diameter_mm", "lens_height_mm",
    "connector_width_mm", "connector_length_mm", "connector_height_mm",
)  # fmt: skip


def rules(d: Design) -> Iterator[Rule]:
    """The board among posts and walls, its own holes and lens, and what the lens sees."""
    yield from _board(d)
    yield from view.rules(d)


def on_board(rules: Callable[[Design], Iterator[Rule]]) -> Callable[[Design], Iterator[Rule]]:
    """Rules that rest on the board, whose outline and holes nobody has measured."""

    @wraps(rules)
    def resting(d: Design) -> Iterator[Rule]:
        return (replace(rule, rests_on=(*rule.rests_on, *BOARD_KEYS)) for rule in rules(d))

    return resting


@on_board
def _board(d: Design) -> Iterator[Rule]:
    """Board, lens and screws among posts and walls."""
    cam = d.camera
    fit = d.holder.fit_mm
    half = cam.board_width_mm / 2
    # The board's upper corners stand beside the posts of the shell and the bosses of the cover.
    clear = max(d.post_edge_mm[0] - half, d.post_edge_mm[1] - cam.board_top_mm)
    yield Quantity("fit_mm", fit).at_most(
        "room between the camera's board and the corner posts", clear
    )
    for name, edge, room in (
        ("half the board in x", half, d.cavity_half_mm[0]),
        ("the board's +y edge", cam.board_top_mm, d.cavity_half_mm[1]),
        ("the board's -y edge", -cam.board_bottom_mm, d.cavity_half_mm[1]),
    ):
        yield Quantity(f"{name} + fit", edge + fit).at_most("half the shell's cavity", room)
    yield Quantity("connector_height_mm", cam.connector_height_mm).at_most(
        "holder.clearance_mm", d.holder.clearance_mm
    )
    yield Quantity("connector_width_mm", cam.connector_width_mm).at_most(
        "board_width_mm", cam.board_width_mm
    )
    upper, lower = cam.hole_rows_mm
    radius = cam.hole_mm / 2
    yield Quantity("half hole_mm", radius).below("hole_edge_mm", cam.hole_edge_mm)
    yield Quantity("half hole pitch in x + radius", cam.hole_pitch_x_mm / 2 + radius).below(
        "half the board", half
    )
    yield Quantity("the board's -y edge + hole radius", cam.board_bottom_mm + radius).below(
        "lower holes", lower
    )
    yield Quantity("hole_mm", cam.hole_mm).below("hole_pitch_y_mm", upper - lower)
    corner = math.hypot(cam.hole_pitch_x_mm / 2, min(abs(upper), abs(lower)))
    yield Quantity("lens radius + hole radius", cam.lens_diameter_mm / 2 + radius).below(
        "lens axis to the nearest hole", corner, ("camera.lens_diameter_mm",)
    )
    for name, edge in (("+y", cam.board_top_mm), ("-y", -cam.board_bottom_mm), ("x", half)):
        yield Quantity("lens radius", cam.lens_diameter_mm / 2).at_most(
            f"lens axis to the board's {name} edge", edge, ("camera.lens_diameter_mm",)
        )


PARTS = (
    Part(
        "camera",
        "IMX219 board with a 200 degree lens",
        BOUGHT,
        build,
        expect,
        number=5,
        explode_mm=-48,
        colour=GREEN,
        sections=("camera", "optics"),
        derived=(
            "z_lens_mm",
            "z_board_front_mm",
            "z_board_back_mm",
            "eye_distance_mm",
            "focal_px",
            "raw_size_px",
        ),
        rules=rules,
        note="Waveshare IMX219-200 or alike; {d.camera.crop_width_px} x {d.camera.crop_height_px}",
        how="bought",
        look_for="measure lens and board: see what nobody has verified",
    ),
)
