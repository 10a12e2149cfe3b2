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
from collections.abc import Iterator
from dataclasses import dataclass, field, fields, replace
from typing import TYPE_CHECKING

from ...aliases import Point2
from ..kernel import require
from ..part import BOUGHT, GREEN, Part
from ..record import Record, number
from ..rule import Rule
from ..solid_gate import Expected
from . import view

if TYPE_CHECKING:
    from cadquery import Shape

    from ..dimensions import Design

CABLE = "flat, 15 way, 1.0 mm pitch, 16 mm wide"
COMPUTER = "Nvidia Jetson Nano B01"


@dataclass(frozen=True)
class CameraDimensions(Record):
    """The camera (part 5) as an envelope: an IMX219 board in the outline of a Raspberry Pi
    camera, and a fisheye lens. No drawing of the paper's module was found.

    measured: keys that a lab has measured on its own module; they no longer count as unverified.
    """

    board_width_mm: float = number(25.0, "board along x", 5, 100, unverified=True)
    board_length_mm: float = number(23.862, "board along y", 5, 100, unverified=True)
    board_mm: float = number(1.0, "thickness of the board", 0.4, 5, unverified=True)
    hole_mm: float = number(2.2, "holes of the board", 0.5, 10, unverified=True)
    hole_pitch_x_mm: float = number(21.0, "between the holes in x", 3, 100, unverified=True)
    hole_pitch_y_mm: float = number(12.5, "between the holes in y", 3, 100, unverified=True)
    hole_edge_mm: float = number(2.0, "upper holes to the +y edge", 0.5, 50, unverified=True)
    lens_offset_mm: float = number(2.4, "lens from the middle, to -y", 0, 50, unverified=True)
    lens_diameter_mm: float = number(12.0, "lens barrel", 2, 60, unverified=True)
    lens_height_mm: float = number(7.5, "lens above the board", 0.5, 60, unverified=True)
    focal_length_mm: float = number(0.87, "equidistant lens", 0.05, 50, unverified=True)
    pixel_um: float = number(1.12, "pixel of the chip (IMX219)", 0.1, 50)
    binning: int = number(2, "chip pixels a picture's pixel, per side", 1, 8)
    crop_width_px: int = number(1280, "picture along x", 8, 10_000)
    crop_height_px: int = number(720, "picture along y", 8, 10_000)
    connector_width_mm: float = number(23.0, "connector along x", 1, 100, unverified=True)
    connector_length_mm: float = number(6.0, "connector along y", 1, 50, unverified=True)
    connector_height_mm: float = number(2.65, "connector along z", 0.2, 20, unverified=True)
    tolerance_mm: float = number(0.05, "spread of board and lens, +-", 0.0, 1, unverified=True)
    measured: tuple[str, ...] = field(
        default=(), metadata={"meaning": "keys measured on the lab's own module"}
    )

    @property
    def board_top_mm(self) -> float:
        """y of the board's +y edge with the lens on the axis = length / 2 + offset: 14.33."""
        return self.board_length_mm / 2 + self.lens_offset_mm

    @property
    def board_bottom_mm(self) -> float:
        """y of the board's -y edge, where the cable leaves = offset - length / 2: -9.53."""
        return self.lens_offset_mm - self.board_length_mm / 2

    @property
    def hole_rows_mm(self) -> Point2:
        """y of the upper and lower holes: top - edge = 12.33, and a pitch less = -0.17."""
        upper = self.board_top_mm - self.hole_edge_mm
        return upper, upper - self.hole_pitch_y_mm

    @property
    def crop_half_mm(self) -> Point2:
        """Half the picture on the chip = px x binning x pixel / 2: (1.434, 0.806)."""
        per_px = self.binning * self.pixel_um / 1000 / 2
        return self.crop_width_px * per_px, self.crop_height_px * per_px


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


def rules(d: Design) -> Iterator[Rule]:
    """The board among posts and walls, its own holes and lens, and what the lens sees."""
    for rule in _board(d):
        yield on_board(rule)
    yield from view.rules(d)


def on_board(rule: Rule) -> Rule:
    """A rule that rests on the board, whose outline and holes nobody has measured."""
    return replace(rule, rests_on=(*rule.rests_on, *BOARD_KEYS))


def _board(d: Design) -> Iterator[Rule]:
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


def note(d: Design) -> str:
    """What to ask the shop for."""
    return f"Waveshare IMX219-200 or alike; {d.camera.crop_width_px} x {d.camera.crop_height_px}"


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
        derived=("z_lens_mm", "z_board_front_mm", "z_board_back_mm", "eye_distance_mm"),
        rules=rules,
        note=note,
        how="bought",
        look_for="measure lens and board: see what nobody has verified",
    ),
)
