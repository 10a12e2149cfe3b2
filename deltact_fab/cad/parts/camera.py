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
from dataclasses import fields
from typing import TYPE_CHECKING

from ..checks import Expected
from ..dimensions import Design
from ..kernel import require

if TYPE_CHECKING:
    from cadquery import Shape

NAME = "camera"


def expect(design: Design) -> Expected:
    """Closed forms of the envelope. A hole above the connector ends at the board's back."""
    cam = design.camera
    board_mm2 = cam.board_width_mm * cam.board_length_mm - math.pi * cam.hole_mm**2
    volume_mm3 = board_mm2 * cam.board_mm
    volume_mm3 += math.pi / 4 * cam.lens_diameter_mm**2 * cam.lens_height_mm
    volume_mm3 += cam.connector_width_mm * cam.connector_length_mm * cam.connector_height_mm
    half = cam.board_width_mm / 2
    return Expected(
        (volume_mm3, volume_mm3),
        (
            (-half, cam.board_bottom_mm, design.z_board_back_mm - cam.connector_height_mm),
            (half, cam.board_top_mm, design.z_lens_mm),
        ),
        {f.name: getattr(cam, f.name) for f in fields(cam) if f.name in SHOWN},
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
    holes = (
        cq.Workplane()
        .workplane(offset=design.z_board_back_mm - 1)
        .pushPoints([(sx * x, y) for y in (upper, lower) for sx in (-1, 1)])
        .circle(cam.hole_mm / 2)
        .extrude(cam.board_mm + 2)
    )
    lens = (
        cq.Workplane()
        .workplane(offset=design.z_board_front_mm)
        .circle(cam.lens_diameter_mm / 2)
        .extrude(cam.lens_height_mm)
    )
    connector = (
        cq.Workplane()
        .workplane(offset=design.z_board_back_mm)
        .center(0, cam.board_bottom_mm + cam.connector_length_mm / 2)
        .rect(cam.connector_width_mm, cam.connector_length_mm)
        .extrude(-cam.connector_height_mm)
    )
    return board.cut(holes).union(lens).union(connector).val()


SHOWN = (
    "board_width_mm",
    "board_length_mm",
    "board_mm",
    "hole_mm",
    "hole_pitch_x_mm",
    "hole_pitch_y_mm",
    "hole_edge_mm",
    "lens_offset_mm",
    "lens_diameter_mm",
    "lens_height_mm",
    "connector_width_mm",
    "connector_length_mm",
    "connector_height_mm",
)
