"""Every dimension of the hardware: independent ones with their limits, derived ones as properties.

Frame: origin at the centre of the resting outer face, z out of the sensor, so the back of the
sensor is at z = -30 by default. From the face backwards:

    z = 0        face            skin          12
    -12          ledge           acrylic        2
    -14          joint           air gap        3     frame above, shell below
    -17          lens            lens          7.5
    -24.5        board_front     board          1
    -25.5        board_back      clearance      3     camera holder
    -28.5        floor           cover         1.5
    -30          back
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, fields
from typing import Any, Literal

from ..shapes.bounded import ShapeError, check_limits, number
from ..shapes.sensor import SensorDimensions
from .standards import CAP_SCREWS, CHEESE_SCREWS, CLEARANCE_MM, WASHER_MM, CapScrew, CheeseScrew

Point2 = tuple[float, float]


def _row(table: dict[str, Any], key: str, name: str) -> Any:
    if name not in table:
        raise ShapeError(f"{key}: one of {', '.join(table)} is right: {name!r} fails")
    return table[name]


@dataclass(frozen=True)
class _Record:
    __pydantic_config__ = {"extra": "forbid"}  # noqa: RUF012 - read by catalog.validate

    def __post_init__(self) -> None:
        check_limits(self)


@dataclass(frozen=True)
class ScrewDimensions(_Record):
    """The four screws that hold cover, shell and frame together (paper: M1.6, 19 mm)."""

    thread: str = field(default="M1.6", metadata={"meaning": "ISO 4762 thread"})
    length_mm: float = number(19.0, "below the head; 16 is the longest M1.6 sold", 3, 60)
    engagement_mm: float = number(4.6, "length that grips the frame", 1, 20)
    tip_clearance_mm: float = number(1.0, "pilot hole beyond the tip", 0, 10)

    def __post_init__(self) -> None:
        check_limits(self)
        _row(CAP_SCREWS, "thread", self.thread)

    @property
    def row(self) -> CapScrew:
        """The screw's row in the table of standards."""
        return CAP_SCREWS[self.thread]

    @property
    def pilot_depth_mm(self) -> float:
        """Depth of the frame's blind holes = engagement + tip clearance: 4.6 + 1 = 5.6."""
        return self.engagement_mm + self.tip_clearance_mm


@dataclass(frozen=True)
class ShellDimensions(_Record):
    """The sensor shell (part 3): opaque, 1.5 mm walls."""

    wall_mm: float = number(1.5, "wall of shell, cover and bosses (paper: 1.5)", 0.5, 20)
    ledge_mm: float = number(1.5, "ledge in y that carries the acrylic's edge", 0.2, 20)
    ledge_height_mm: float = number(2.0, "height of that ledge", 0.5, 20)
    cable_width_mm: float = number(17.0, "notch for the camera's flat cable (16 mm)", 1, 60)
    cable_height_mm: float = number(2.0, "height of that notch", 0.5, 20)


@dataclass(frozen=True)
class MountDimensions(_Record):
    """The end-effector mount on the shell's +y side (paper: 20 mm long).

    kind: `block`, a bar with two through holes along z; `franka`, a bar with a flange for a finger
    of the Franka hand (hole pattern unverified); `plate`, a blank plate to be drilled.
    """

    kind: Literal["block", "franka", "plate"] = field(
        default="block", metadata={"meaning": "block, franka or plate"}
    )
    length_mm: float = number(20.0, "along y, from the shell, flange and all", 2, 100)
    width_mm: float = number(20.0, "along x", 4, 200)
    height_mm: float = number(10.0, "along z, from the shell's back", 3, 60)
    screw: str = field(default="M3", metadata={"meaning": "screws through the mount"})
    hole_pitch_mm: float = number(10.0, "between the two holes", 3, 100)
    flange_mm: float = number(5.0, "franka: thickness of the flange", 1, 50)
    flange_width_mm: float = number(20.0, "franka: flange along x", 4, 200, unverified=True)
    flange_height_mm: float = number(20.0, "franka: flange along z", 4, 200, unverified=True)
    flange_pitch_mm: float = number(
        13.0, "franka: between the two holes along z", 3, 100, unverified=True
    )
    arm_mm: float = number(6.0, "franka: height of the arm, between the two screws", 1, 60)

    def __post_init__(self) -> None:
        check_limits(self)
        _row(CLEARANCE_MM, "screw", self.screw)

    @property
    def hole_mm(self) -> float:
        """Through hole of the mount's screws (ISO 273 medium)."""
        return CLEARANCE_MM[self.screw]

    @property
    def washer_mm(self) -> float:
        """Washer of the mount's screws (ISO 7089): what a head or a nut needs around its hole."""
        return WASHER_MM[self.screw]


@dataclass(frozen=True)
class TableDimensions(_Record):
    """Tabs of the testing shell, by which it is screwed to a table, one on each x side."""

    screw: str = field(default="M4", metadata={"meaning": "screws into the table"})
    tab_mm: float = number(14.0, "along x, from the shell", 4, 100)
    width_mm: float = number(30.0, "along y", 4, 200)
    height_mm: float = number(6.0, "along z, from the plane of the sensor's back", 2, 60)
    hole_pitch_mm: float = number(18.0, "between the two holes of a tab, along y", 3, 190)

    def __post_init__(self) -> None:
        check_limits(self)
        _row(CLEARANCE_MM, "screw", self.screw)

    @property
    def hole_mm(self) -> float:
        """Through hole of the table's screws (ISO 273 medium)."""
        return CLEARANCE_MM[self.screw]


@dataclass(frozen=True)
class LightDimensions(_Record):
    """The light holder (part 4): a translucent ring with a channel for the LED strip."""

    led_count: int = number(5, "LEDs (paper: five 5050)", 1, 200)
    leds_per_m: float = number(60.0, "LEDs of a metre of strip", 10, 400)
    strip_width_mm: float = number(8.0, "width of the strip", 3, 20)
    channel_mm: float = number(2.2, "radial room for strip and LED", 1, 10)
    diffuser_mm: float = number(1.5, "wall between LED and camera", 0.4, 10)
    wall_mm: float = number(1.5, "outer wall", 0.4, 10)
    floor_mm: float = number(1.5, "floor below the strip", 0.4, 10)
    fit_mm: float = number(0.2, "radial clearance in the shell", 0.02, 2)
    slot_mm: float = number(3.0, "slot for the wires", 0.5, 20)
    resistor_ohm: float = number(750.0, "in series (paper: 750)", 0, 1e6)
    supply_v: float = number(5.0, "supply (paper: 5)", 1, 60)

    @property
    def pitch_mm(self) -> float:
        """Between two LEDs = 1000 / LEDs per metre: 16.67."""
        return 1000 / self.leds_per_m

    @property
    def strip_mm(self) -> float:
        """Length of strip = count x pitch: 83.3."""
        return self.led_count * self.pitch_mm


@dataclass(frozen=True)
class CameraDimensions(_Record):
    """The camera (part 5) as an envelope: an IMX219 board in the outline of a Raspberry Pi
    camera, and a fisheye lens. No drawing of the paper's module was found.

    measured: keys that a lab has measured on its own module; they no longer count as unverified.
    """

    board_width_mm: float = number(25.0, "board along x", 5, 100)
    board_length_mm: float = number(23.862, "board along y", 5, 100)
    board_mm: float = number(1.0, "thickness of the board", 0.4, 5)
    hole_mm: float = number(2.2, "holes of the board", 0.5, 10)
    hole_pitch_x_mm: float = number(21.0, "between the holes in x", 3, 100)
    hole_pitch_y_mm: float = number(12.5, "between the holes in y", 3, 100)
    hole_edge_mm: float = number(2.0, "upper holes to the board's +y edge", 0.5, 50)
    lens_offset_mm: float = number(2.4, "lens below the board's middle, to -y", 0, 50)
    lens_diameter_mm: float = number(12.0, "lens barrel", 2, 60, unverified=True)
    lens_height_mm: float = number(7.5, "lens above the board", 0.5, 60, unverified=True)
    focal_length_mm: float = number(0.87, "equidistant lens", 0.05, 50, unverified=True)
    pixel_um: float = number(1.12, "pixel of the chip (IMX219)", 0.1, 50)
    binning: int = number(2, "chip pixels a picture's pixel, per side", 1, 8)
    crop_width_px: int = number(1280, "picture along x", 8, 10_000)
    crop_height_px: int = number(720, "picture along y", 8, 10_000)
    connector_width_mm: float = number(23.0, "connector on the back along x, at worst", 1, 100)
    connector_length_mm: float = number(6.0, "connector along y", 1, 50)
    connector_height_mm: float = number(2.65, "connector below the board", 0.2, 20)
    measured: tuple[str, ...] = field(
        default=(), metadata={"meaning": "keys measured on the lab's own module"}
    )

    def __post_init__(self) -> None:
        check_limits(self)
        open_keys = [f.name for f in fields(self) if f.metadata.get("unverified")]
        for key in self.measured:
            if key not in open_keys:
                raise ShapeError(f"measured: of {', '.join(open_keys)}: {key!r} fails")

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


@dataclass(frozen=True)
class HolderDimensions(_Record):
    """The camera holder (part 6) behind the board; the board is locked by two screws."""

    clearance_mm: float = number(3.0, "thickness, and room for the connector", 1, 30)
    fit_mm: float = number(0.2, "clearance to the shell", 0.02, 2)
    wall_mm: float = number(1.5, "least wall beside a hole", 0.5, 10)
    screw: str = field(default="M2", metadata={"meaning": "ISO 1207 thread"})
    screw_length_mm: float = number(4.0, "below the head", 2, 20)
    head_clearance_mm: float = number(0.3, "around the heads, below the light holder", 0.02, 2)

    def __post_init__(self) -> None:
        check_limits(self)
        _row(CHEESE_SCREWS, "screw", self.screw)

    @property
    def row(self) -> CheeseScrew:
        """The screw's row in the table of standards."""
        return CHEESE_SCREWS[self.screw]


@dataclass(frozen=True)
class CoverDimensions(_Record):
    """The cover (part 7): floor, four bosses for the screw heads, four snap-fit pegs."""

    floor_mm: float = number(1.5, "floor (paper: walls of 1.5)", 0.5, 20)
    peg_mm: float = number(3.0, "diameter of a peg", 1, 10)
    peg_y_mm: float = number(8.0, "pegs at +-y", 1, 90)
    peg_clearance_mm: float = number(0.1, "radial clearance of a peg in its hole", 0.01, 1)
    slot_mm: float = number(0.6, "slot that splits a peg", 0.2, 5)
    lip_mm: float = number(0.12, "lip of a peg beyond its hole", 0.01, 2)
    lip_height_mm: float = number(0.6, "height of the lip", 0.2, 5)
    strain_limit: float = number(0.02, "what the resin bears once (Tough resins: 2 %)", 1e-3, 0.2)
    fit_mm: float = number(0.1, "clearance between bosses and shell", 0.02, 2)

    @property
    def leg_mm(self) -> float:
        """Thickness of one leg of a peg = (peg - slot) / 2: 1.2."""
        return (self.peg_mm - self.slot_mm) / 2

    @property
    def hole_mm(self) -> float:
        """Hole in the camera holder = peg + 2 clearance: 3.2."""
        return self.peg_mm + 2 * self.peg_clearance_mm


@dataclass(frozen=True)
class EnvelopeDimensions(_Record):
    """What the whole sensor must fit into (paper: 39 x 60 x 30)."""

    width_mm: float = number(39.0, "along x", 5, 500)
    length_mm: float = number(60.0, "along y", 5, 500)
    height_mm: float = number(30.0, "along z", 2, 200)


@dataclass(frozen=True)
class MoldDimensions(_Record):
    """The mold (paper: four at a time); each frame is an insert, outer face down."""

    columns: int = number(2, "cavities along x", 1, 8)
    rows: int = number(2, "cavities along y", 1, 8)
    web_mm: float = number(8.0, "between two frames, and around them", 1, 100)
    base_mm: float = number(3.0, "below the cavities", 0.5, 50)
    seat_mm: float = number(3.0, "depth by which a frame is let in", 0.5, 30)
    fit_mm: float = number(0.1, "clearance of a frame, per side", 0.02, 2)
    pry_width_mm: float = number(10.0, "notch to lift a frame out, along x", 2, 100)
    pry_mm: float = number(2.5, "that notch along y", 0.5, 20)


@dataclass(frozen=True)
class CouponDimensions(_Record):
    """Open wells of the same resin, to see whether it inhibits the cure of the silicone."""

    wells: int = number(4, "wells in a row", 1, 12)
    diameter_mm: float = number(15.0, "of a well", 3, 100)
    depth_mm: float = number(4.0, "of a well", 0.5, 50)
    wall_mm: float = number(3.0, "between and around the wells", 0.5, 50)
    base_mm: float = number(2.0, "below the wells", 0.5, 50)


@dataclass(frozen=True)
class Design(SensorDimensions):
    """The whole hardware. `skin`, `frame` and `optics` are those of SensorDimensions."""

    screw: ScrewDimensions = field(default_factory=ScrewDimensions)
    shell: ShellDimensions = field(default_factory=ShellDimensions)
    mount: MountDimensions = field(default_factory=MountDimensions)
    table: TableDimensions = field(default_factory=TableDimensions)
    light: LightDimensions = field(default_factory=LightDimensions)
    camera: CameraDimensions = field(default_factory=CameraDimensions)
    holder: HolderDimensions = field(default_factory=HolderDimensions)
    cover: CoverDimensions = field(default_factory=CoverDimensions)
    envelope: EnvelopeDimensions = field(default_factory=EnvelopeDimensions)
    mold: MoldDimensions = field(default_factory=MoldDimensions)
    coupon: CouponDimensions = field(default_factory=CouponDimensions)

    __pydantic_config__ = {"extra": "forbid"}  # noqa: RUF012

    # Heights, from the face backwards.

    @property
    def z_front_mm(self) -> float:
        """Front of the frame = -protrusion: -6."""
        return -self.skin.protrusion_mm

    @property
    def z_ledge_mm(self) -> float:
        """Back of the skin, front of the acrylic = -thickness: -12."""
        return -self.skin.thickness_mm

    @property
    def z_joint_mm(self) -> float:
        """Back of acrylic and frame, front of the shell = ledge - acrylic: -14."""
        return self.z_ledge_mm - self.optics.acrylic_mm

    @property
    def z_lens_mm(self) -> float:
        """Front of the lens = joint - air gap: -17."""
        return self.z_joint_mm - self.optics.air_gap_mm

    @property
    def z_board_front_mm(self) -> float:
        """Front of the camera's board, back of the light holder = lens - lens height: -24.5."""
        return self.z_lens_mm - self.camera.lens_height_mm

    @property
    def z_board_back_mm(self) -> float:
        """Back of the board, front of the camera holder = board front - board: -25.5."""
        return self.z_board_front_mm - self.camera.board_mm

    @property
    def z_floor_mm(self) -> float:
        """Front of the cover's floor, back of holder and shell = board back - clearance: -28.5."""
        return self.z_board_back_mm - self.holder.clearance_mm

    @property
    def z_back_mm(self) -> float:
        """Back of the sensor = floor - cover: -30."""
        return self.z_floor_mm - self.cover.floor_mm

    @property
    def z_head_mm(self) -> float:
        """Where the screw heads bear = joint + engagement - screw length: -28.4."""
        return self.z_joint_mm + self.screw.engagement_mm - self.screw.length_mm

    @property
    def z_boss_mm(self) -> float:
        """Front of the cover's bosses, back of the shell's posts = heads bear + wall: -26.9."""
        return self.z_head_mm + self.shell.wall_mm

    # Plan.

    @property
    def post_mm(self) -> float:
        """Side of the square corner posts = head bore + 2 walls: 3.4 + 3 = 6.4."""
        return self.screw.row.bore_mm + 2 * self.shell.wall_mm

    @property
    def screw_at_mm(self) -> Point2:
        """Axis of the screw at +x, +y = (outer - post) / 2: (16.3, 16.8)."""
        x, y = self.frame_outer_mm
        return (x - self.post_mm) / 2, (y - self.post_mm) / 2

    @property
    def screw_centres_mm(self) -> list[Point2]:
        """The four axes of the screws, row by row."""
        x, y = self.screw_at_mm
        return [(sx * x, sy * y) for sy in (-1, 1) for sx in (-1, 1)]

    @property
    def post_edge_mm(self) -> Point2:
        """Inner edges of the post at +x, +y = outer / 2 - post: (13.1, 13.6)."""
        x, y = self.frame_outer_mm
        return x / 2 - self.post_mm, y / 2 - self.post_mm

    @property
    def post_in_window_mm(self) -> Point2:
        """Sides by which a post reaches into the frame's window = post - wall: (4.9, 3.4).

        (0, 0) when the walls hold the posts.
        """
        x = self.post_mm - self.frame.wall_x_mm
        y = self.post_mm - self.frame.wall_y_mm
        return (x, y) if min(x, y) > 0 else (0.0, 0.0)

    @property
    def cavity_half_mm(self) -> Point2:
        """Half sides of the shell's cavity = outer / 2 - wall: (18, 18.5)."""
        x, y = self.frame_outer_mm
        return x / 2 - self.shell.wall_mm, y / 2 - self.shell.wall_mm

    @property
    def seat_half_mm(self) -> Point2:
        """Half sides of the frame's pocket for the acrylic = (width / 2, length / 2 + seat)."""
        return self.skin.width_mm / 2, self.skin.length_mm / 2 + self.frame.seat_y_mm

    @property
    def acrylic_half_mm(self) -> Point2:
        """Half sides of the acrylic plate = pocket - ACRYLIC_FIT: (17.9, 18.4)."""
        x, y = self.seat_half_mm
        return x - ACRYLIC_FIT_MM, y - ACRYLIC_FIT_MM

    @property
    def acrylic_notch_mm(self) -> Point2:
        """Sides of the acrylic's corner notches, so that it clears the posts: (4.9, 4.9).

        Plate half side - (post edge - ACRYLIC_FIT); 0 where the walls hold the posts.
        """
        (x, y), (px, py) = self.acrylic_half_mm, self.post_edge_mm
        nx, ny = x - px + ACRYLIC_FIT_MM, y - py + ACRYLIC_FIT_MM
        return (nx, ny) if min(nx, ny) > 0 else (0.0, 0.0)

    @property
    def boss_room_mm(self) -> float:
        """Side of the corners that the shell leaves to the cover's bosses = post + fit: 6.5."""
        return self.post_mm + self.cover.fit_mm

    @property
    def shell_depth_mm(self) -> float:
        """Height of the shell = joint - floor: 14.5."""
        return self.z_joint_mm - self.z_floor_mm

    @property
    def flange_arm_z_mm(self) -> Point2:
        """Back and front of the arm of a flanged mount, in the flange's middle: (-21.5, -15.5)."""
        middle = self.z_floor_mm + self.mount.flange_height_mm / 2
        return middle - self.mount.arm_mm / 2, middle + self.mount.arm_mm / 2

    # Light holder.

    @property
    def light_radius_mm(self) -> float:
        """Outer radius of the light holder = least half cavity inside the ledge - fit: 16.8."""
        x, y = self.cavity_half_mm
        return min(x, y - self.shell.ledge_mm) - self.light.fit_mm

    @property
    def strip_radius_mm(self) -> float:
        """Radius of the LED strip's back = outer radius - wall: 15.3."""
        return self.light_radius_mm - self.light.wall_mm

    @property
    def light_bore_mm(self) -> float:
        """Inner radius of the light holder = strip radius - channel - diffuser: 11.6."""
        return self.strip_radius_mm - self.light.channel_mm - self.light.diffuser_mm

    @property
    def channel_inner_mm(self) -> float:
        """Inner radius of the strip's channel = strip radius - channel: 13.1."""
        return self.strip_radius_mm - self.light.channel_mm

    @property
    def head_relief_mm(self) -> float:
        """Radius of the light holder's reliefs = camera screw's head / 2 + clearance: 2.2."""
        return self.holder.row.head_mm / 2 + self.holder.head_clearance_mm

    # Camera holder and pegs.

    @property
    def camera_screw_centres_mm(self) -> list[Point2]:
        """The two axes of the camera's screws, in the board's upper holes: (+-10.5, 12.33)."""
        x, y = self.camera.hole_pitch_x_mm / 2, self.camera.hole_rows_mm[0]
        return [(-x, y), (x, y)]

    @property
    def peg_centres_mm(self) -> list[Point2]:
        """The four axes of the pegs, row by row."""
        x, y = self.peg_at_mm
        return [(sx * x, sy * y) for sy in (-1, 1) for sx in (-1, 1)]

    @property
    def holder_half_x_mm(self) -> float:
        """Half width of the camera holder = half cavity - fit: 17.8."""
        return self.cavity_half_mm[0] - self.holder.fit_mm

    @property
    def peg_at_mm(self) -> Point2:
        """Axis of the peg at +x, +y; x = holder's edge - wall - hole / 2: (14.7, 8)."""
        x = self.holder_half_x_mm - self.holder.wall_mm - self.cover.hole_mm / 2
        return x, self.cover.peg_y_mm

    @property
    def peg_length_mm(self) -> float:
        """Height of a peg above the cover's floor = holder + lip: 3.6."""
        return self.holder.clearance_mm + self.cover.lip_height_mm

    @property
    def snap_strain(self) -> float:
        """Strain of a leg that gives way by the lip = 1.5 leg lip / length^2 (a cantilever)."""
        return 1.5 * self.cover.leg_mm * self.cover.lip_mm / self.peg_length_mm**2

    @property
    def holder_window_half_mm(self) -> float:
        """Half width of the holder's window = half the connector + 0.1: 11.6."""
        return self.camera.connector_width_mm / 2 + 0.1

    @property
    def holder_window_top_mm(self) -> float:
        """Upper edge of the window = upper screw holes - pilot / 2 - wall: 10.0."""
        upper = self.camera.hole_rows_mm[0]
        return upper - self.holder.row.pilot_mm / 2 - self.holder.wall_mm

    @property
    def holder_arm_mm(self) -> float:
        """Edges of the arms in y = +-(peg + hole / 2 + wall): 11.1."""
        return self.cover.peg_y_mm + self.cover.hole_mm / 2 + self.holder.wall_mm

    @property
    def holder_tongue_mm(self) -> Point2:
        """Half width and upper edge of the tongue that holds the two screws: (12.8, 14.7)."""
        beside = self.holder.row.pilot_mm / 2 + self.holder.wall_mm
        return self.camera.hole_pitch_x_mm / 2 + beside, self.camera.hole_rows_mm[0] + beside

    # The whole.

    @property
    def outer_mm(self) -> tuple[float, float, float]:
        """Size of the whole sensor = (frame, frame + mount, face to back): 39 x 60 x 30."""
        x, y = self.frame_outer_mm
        return max(x, self.mount.width_mm), y + self.mount.length_mm, -self.z_back_mm

    @property
    def mold_outer_mm(self) -> tuple[float, float, float]:
        """Size of the mold = n frames + (n + 1) webs; base + protrusion + seat: 102 x 104 x 12."""
        x, y = self.frame_outer_mm
        mold = self.mold
        return (
            mold.columns * x + (mold.columns + 1) * mold.web_mm,
            mold.rows * y + (mold.rows + 1) * mold.web_mm,
            mold.base_mm + self.skin.protrusion_mm + mold.seat_mm,
        )

    @property
    def coupon_outer_mm(self) -> tuple[float, float, float]:
        """Size of the coupon mold = n wells + (n + 1) walls; base + depth: 75 x 21 x 6."""
        coupon = self.coupon
        return (
            coupon.wells * coupon.diameter_mm + (coupon.wells + 1) * coupon.wall_mm,
            coupon.diameter_mm + 2 * coupon.wall_mm,
            coupon.base_mm + coupon.depth_mm,
        )

    @property
    def skin_volume_mm3(self) -> float:
        """Volume of one skin: block - rounded edges - what the posts take of it.

        A fillet of radius R around a w x l face takes 2 (w + l) R^2 (1 - pi/4) - 4 R^3
        (5/3 - pi/2): the second term is what two cylinders share where they meet in a mitre.
        """
        skin, (x, y) = self.skin, self.post_in_window_mm
        r = skin.edge_fillet_mm
        rounded = 2 * (skin.width_mm + skin.length_mm) * r**2 * (1 - math.pi / 4)
        rounded -= 4 * r**3 * (5 / 3 - math.pi / 2)
        block = skin.width_mm * skin.length_mm * skin.thickness_mm
        return block - rounded - 4 * x * y * (skin.thickness_mm - skin.protrusion_mm)

    def unverified(self) -> list[str]:
        """Keys (`camera.focal_length_mm`) whose values were assumed and not measured.

        Of the mount, only where its kind uses them.
        """
        keys = []
        for section in fields(self):
            record = getattr(self, section.name)
            for f in fields(record):
                if not f.metadata.get("unverified") or f.name in getattr(record, "measured", ()):
                    continue
                if section.name == "mount" and self.mount.kind != "franka":
                    continue
                keys.append(f"{section.name}.{f.name}")
        return keys


ACRYLIC_FIT_MM = 0.1
