"""The independent dimensions: one record a part, each number with its meaning and limits."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, fields
from typing import Any, Literal

from ...shapes.bounded import ShapeError, check_limits, number
from ..standards import CAP_SCREWS, CHEESE_SCREWS, CLEARANCE_MM, WASHER_MM, CapScrew, CheeseScrew

Point2 = tuple[float, float]


def _row(table: dict[str, Any], key: str, name: str) -> Any:
    if name not in table:
        raise ShapeError(f"{key}: one of {', '.join(table)} is right: {name!r} fails")
    return table[name]


def _check_measured(record: Any) -> None:
    """What a lab says it has measured is a key of the record that counts as unverified."""
    open_keys = [f.name for f in fields(record) if f.metadata.get("unverified")]
    for key in record.measured:
        if key not in open_keys:
            raise ShapeError(f"measured: of {', '.join(open_keys)}: {key!r} fails")


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
    tip_clearance_mm: float = number(1.0, "pilot hole beyond the tip", 0.5, 10)

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

    measured: tuple[str, ...] = field(
        default=(), metadata={"meaning": "keys measured on the lab's own finger"}
    )

    def __post_init__(self) -> None:
        check_limits(self)
        _check_measured(self)
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
    axial_fit_mm: float = number(0.2, "play below the acrylic, so that it bears no press", 0.02, 2)
    slot_mm: float = number(3.0, "slot for the wires", 0.5, 20)
    resistor_ohm: float = number(750.0, "in series (paper: 750)", 20, 1e5)
    supply_v: float = number(5.0, "supply of a strip that is cut at every LED", 4.5, 5.5)

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
    measured: tuple[str, ...] = field(
        default=(), metadata={"meaning": "keys measured on the lab's own module"}
    )

    def __post_init__(self) -> None:
        check_limits(self)
        _check_measured(self)

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
    lip_mm: float = number(0.08, "lip of a peg beyond its hole", 0.01, 2)
    lip_height_mm: float = number(0.6, "height of the lip", 0.2, 5)
    strain_limit: float = number(0.02, "what the resin bears once (Tough resins: 2 %)", 1e-3, 0.2)
    fit_mm: float = number(0.1, "clearance between bosses and shell", 0.02, 2)

    @property
    def leg_mm(self) -> float:
        """Thickness of one leg of a peg = (peg - slot) / 2: 1.2."""
        return (self.peg_mm - self.slot_mm) / 2

    @property
    def fibre_mm(self) -> float:
        """Outermost fibre of a leg from its centroid; a leg is a segment of the peg's circle: 0.70.

        Centroid at 2/3 (R^2 - a^2)^1.5 / A, A = R^2 acos(a / R) - a sqrt(R^2 - a^2), a = slot / 2.
        """
        r, a = self.peg_mm / 2, self.slot_mm / 2
        if not a < r:
            return math.nan
        q = math.sqrt(r**2 - a**2)
        centroid = 2 / 3 * q**3 / (r**2 * math.acos(a / r) - a * q)
        return max(r - centroid, centroid - a)

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
    base_mm: float = number(3.0, "below the cavities", 1.5, 50)
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
    wall_mm: float = number(3.0, "between and around the wells", 1.5, 50)
    base_mm: float = number(2.0, "below the wells", 1.5, 50)
