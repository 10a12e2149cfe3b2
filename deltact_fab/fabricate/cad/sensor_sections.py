"""Sections of a design for the sensor's own parts, one record each."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any, Literal

from deltact_fab.common import InputError, Point2
from deltact_fab.sensor import Bounded, ShapeError, bounded_number

from .standards import (
    CAP_SCREWS,
    CHEESE_SCREWS,
    FLANGE_SCREWS_MM,
    METRIC_THREADS,
    CableSide,
    CapScrew,
    CapThread,
    CheeseScrew,
    CheeseThread,
    HolePattern,
    MetricThread,
    Thread,
    next_e24,
    parse_holes,
)

FLANGE_EDGE_MM = 2.0  # by hand, from washer to edge: less chips when the screw is tightened
HEAD_PLAY_MM = 1.0  # by hand, washer to the shell's wall: less takes no key


def assumed_length(default: float, meaning: str, low: float, high: float) -> Any:
    """Return a field for an assumed number, which counts as unverified."""
    return bounded_number(default, meaning, low, high, unverified=True)


def measured_keys(meaning: str) -> Any:
    """Return the field for keys that a lab has measured: they no longer count as unverified."""
    return field(default=(), metadata={"description": meaning})


@dataclass(frozen=True)
class PlateDimensions(Bounded):
    """The acrylic plate (part 2): its seat, loads and material."""

    fit_mm: float = bounded_number(0.1, "clearance in the frame's pocket, per side", 0.02, 2)
    ledge_mm: float = bounded_number(0.5, "least overlap of the plate on a ledge", 0.1, 10)
    force_n: float = bounded_number(49.0, "design force of a press", 0.1, 5000)
    depth_mm: float = bounded_number(5.0, "depth of the design press", 0.1, 60)
    spread_mm: float = assumed_length(22.0, "diameter of the loaded disc", 1, 100)
    deflection_share: float = bounded_number(0.05, "limit of deflection / depth", 1e-3, 1)
    youngs_modulus_mpa: float = assumed_length(3000.0, "Young's modulus of cast PMMA", 100, 1e5)
    poisson: float = bounded_number(0.37, "Poisson's ratio of cast PMMA", 0.0, 0.49)
    stress_limit_mpa: float = assumed_length(35.0, "stress limit: half of PMMA's strength", 1, 1000)
    bead_modulus_mpa: float = assumed_length(1.15, "modulus of the bead: Shore A 30", 0.05, 1e4)
    measured: tuple[str, ...] = measured_keys("keys measured on the lab's own plate")


@dataclass(frozen=True)
class CameraDimensions(Bounded):
    """The camera (part 5) as an envelope: an IMX219 board in the outline of a Raspberry Pi
    camera, and a fisheye lens. No drawing of the paper's module was found; others stand in
    cad/cameras.toml.
    """

    name: str = field(
        default="Waveshare IMX219-200", metadata={"description": "maker and module, to order"}
    )
    board_width_mm: float = assumed_length(25.0, "board along x", 5, 100)
    board_length_mm: float = assumed_length(23.862, "board along y", 5, 100)
    board_mm: float = assumed_length(1.0, "thickness of the board", 0.4, 5)
    hole_mm: float = assumed_length(2.2, "diameter of the holes, 0: none", 0, 10)
    hole_pitch_x_mm: float = assumed_length(21.0, "distance of the holes in x", 3, 100)
    hole_pitch_y_mm: float = assumed_length(12.5, "distance of the holes in y", 3, 100)
    hole_edge_mm: float = assumed_length(2.0, "upper holes from the +y edge", 0.5, 50)
    lens_offset_mm: float = assumed_length(2.4, "lens offset from the middle, to -y", 0, 50)
    lens_diameter_mm: float = assumed_length(12.0, "diameter of the lens barrel", 2, 60)
    lens_height_mm: float = assumed_length(7.5, "height of the lens above the board", 0.5, 60)
    focal_length_mm: float = assumed_length(0.87, "focal length of the lens", 0.05, 50)
    projection: Literal["equidistant", "rectilinear"] = field(
        default="equidistant",
        metadata={"description": "equidistant (fisheye) or rectilinear (keeps lines straight)"},
    )
    f_number: float = assumed_length(2.8, "f-number; such lenses have 2.0 to 2.8", 0.7, 32)
    nearest_mm: float = bounded_number(0.0, "nearest focus; 0: adjustable by hand", 0.0, 1000)
    pixel_um: float = bounded_number(1.12, "pixel pitch of the chip (IMX219)", 0.1, 50)
    binning: int = bounded_number(2, "chip pixels per image pixel, per side", 1, 8)
    crop_width_px: int = bounded_number(1280, "image width", 8, 10_000)
    crop_height_px: int = bounded_number(720, "image height", 8, 10_000)
    connector_width_mm: float = assumed_length(23.0, "connector along x", 1, 100)
    connector_length_mm: float = assumed_length(6.0, "connector along y", 1, 50)
    connector_height_mm: float = assumed_length(2.65, "connector along z", 0.5, 20)
    cable: str = field(
        default="flat, 15 way, 1.0 mm pitch, 16 mm wide",
        metadata={"description": "matching cable, to order"},
    )
    cable_width_mm: float = assumed_length(
        16.0, "width of the cable, with its end stiffener", 0.5, 60
    )
    cable_height_mm: float = assumed_length(0.3, "thickness of the cable, likewise", 0.05, 20)
    tolerance_mm: float = assumed_length(0.05, "tolerance of board and lens, +-", 0.0, 1)
    source: str = field(default="", metadata={"description": "source documents of the values"})
    measured: tuple[str, ...] = measured_keys(
        "keys measured on the lab's own module, or from its maker's document"
    )

    def angle_rad(self, at_mm: float) -> float:
        """Return the angle from the axis that the lens images at_mm from the middle of the chip."""
        angle = at_mm / self.focal_length_mm
        return math.atan(angle) if self.projection == "rectilinear" else angle

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
class HolderDimensions(Bounded):
    """The camera holder (part 6) behind the board, which is screwed or bonded to it."""

    clearance_mm: float = bounded_number(3.0, "thickness, with room for the connector", 1, 30)
    fit_mm: float = bounded_number(0.2, "clearance in the shell", 0.02, 2)
    window_fit_mm: float = bounded_number(0.1, "clearance of the connector, per side", 0.02, 2)
    window_rest_mm: float = bounded_number(0.5, "overlap of the board beside the window", 0.1, 5)
    wall_mm: float = bounded_number(1.5, "least wall beside a hole", 0.5, 10)
    screw: CheeseThread = field(
        default="M2", metadata={"description": "ISO 1207 thread, or none: the board is bonded"}
    )
    screw_length_mm: float = bounded_number(3.0, "length below the head", 2, 20)
    head_clearance_mm: float = bounded_number(
        0.3, "clearance around the heads, below the light holder", 0.02, 2
    )
    bonded_mm: float = assumed_length(0.3, "largest offset of a bonded board", 0.01, 3)
    measured: tuple[str, ...] = measured_keys("keys measured on the lab's own boards")

    @property
    def row(self) -> CheeseScrew:
        """The screw's row in the table of standards."""
        return CHEESE_SCREWS[self.screw]


@dataclass(frozen=True)
class CoverDimensions(Bounded):
    """The cover (part 7): floor, four bosses for the screw heads, four snap-fit pegs."""

    floor_mm: float = bounded_number(1.5, "floor (paper: walls of 1.5)", 0.5, 20)
    peg_mm: float = bounded_number(2.7, "diameter of a peg", 1, 10)
    peg_y_mm: float = bounded_number(8.0, "y of the pegs, +-", 1, 90)
    peg_clearance_mm: float = bounded_number(0.25, "radial clearance of a peg in its hole", 0.01, 1)
    slot_mm: float = bounded_number(1.0, "width of the slot that splits a peg", 0.2, 5)
    leg_mm: float = bounded_number(0.6, "thickness of a leg, flat on both sides", 0.2, 5)
    lip_mm: float = bounded_number(0.12, "overhang of a peg's lip over its hole", 0.01, 2)
    peg_play_mm: float = bounded_number(
        0.3, "axial play of the legs beyond the camera holder, for its tolerance", 0.0, 5
    )
    lip_height_mm: float = bounded_number(0.8, "height of the lip", 0.2, 5)
    strain_limit: float = bounded_number(
        0.02, "allowed strain, one-time (Tough resins: 2 %)", 1e-3, 0.2
    )
    fit_mm: float = bounded_number(0.2, "clearance between bosses and shell", 0.02, 2)

    @property
    def fibre_mm(self) -> float:
        """Distance of a leg's outermost fibre from its centroid; a leg is a slab of the peg: 0.26.

        Between the chords at a = slot / 2 and b = a + leg: centroid at 2/3 ((R^2 - a^2)^1.5 -
        (R^2 - b^2)^1.5) / A, A the area between them.
        """
        r, a, b = self.peg_mm / 2, self.slot_mm / 2, self.slot_mm / 2 + self.leg_mm
        if not b <= r:
            return math.nan
        moment = 2 / 3 * ((r**2 - a**2) ** 1.5 - (r**2 - b**2) ** 1.5)
        centroid = moment / (_segment_mm2(a, r) - _segment_mm2(b, r))
        return max(b - centroid, centroid - a)

    @property
    def hole_mm(self) -> float:
        """Hole in the camera holder = peg + 2 clearance: 3.2."""
        return self.peg_mm + 2 * self.peg_clearance_mm


@dataclass(frozen=True)
class LightDimensions(Bounded):
    """The light holder (part 4): a translucent ring with a channel for the LED strip."""

    led_count: int = bounded_number(6, "number of LEDs, whole cuts (paper: five 5050)", 1, 200)
    leds_per_m: float = bounded_number(120.0, "LEDs per metre of strip", 10, 400)
    leds_per_cut: int = bounded_number(
        3, "LEDs from cut to cut, in series (5 V: 1, 12 V: 3, 24 V: 6)", 1, 20
    )
    strip_w_per_m: float = assumed_length(9.6, "rated power of the strip, W per metre", 0.5, 100)
    strip_width_mm: float = bounded_number(8.0, "width of the strip", 3, 20)
    strip_thickness_mm: float = bounded_number(0.3, "thickness of strip and adhesive", 0.05, 2)
    led_width_mm: float = bounded_number(3.5, "longer side of an LED (2835: 3.5)", 0.5, 20)
    led_height_mm: float = bounded_number(0.8, "height of an LED on the strip (2835: 0.8)", 0.2, 10)
    led_tolerance_mm: float = bounded_number(0.1, "tolerance of LED and strip, +-", 0.0, 1)
    channel_mm: float = bounded_number(2.4, "radial room for strip and LED", 1, 10)
    diffuser_mm: float = bounded_number(1.5, "wall between LED and camera", 0.4, 10)
    wall_mm: float = bounded_number(1.5, "outer wall", 0.4, 10)
    floor_mm: float = bounded_number(1.5, "floor below the strip", 0.4, 10)
    fit_mm: float = bounded_number(0.2, "radial clearance in the shell", 0.02, 2)
    axial_fit_mm: float = bounded_number(1.0, "play below the acrylic: takes no load", 0.02, 5)
    lens_clearance_mm: float = bounded_number(0.3, "radial clearance of the lens", 0.02, 5)
    lip_clearance_mm: float = bounded_number(0.25, "clearance of the cover's lips", 0.02, 2)
    head_room_mm: float = bounded_number(
        0.1, "floor above the heads of the camera's screws", 0.0, 5
    )
    slot_mm: float = bounded_number(3.0, "width of the slot for the wires", 0.5, 20)
    resistor_ohm: float = bounded_number(750.0, "series resistor (paper: 750)", 20, 1e5)
    supply_v: float = bounded_number(12.0, "supply, the rated voltage of the strip", 4.5, 26)
    supply_tolerance: float = assumed_length(
        0.05, "tolerance of the supply, share (plug supplies: 0.05)", 0, 0.2
    )
    supply_rating_ma: float = assumed_length(
        500.0, "limit of a sensor's LED current (12 V, 6 W plug)", 1, 1e5
    )
    resistor_rating_w: float = assumed_length(
        0.25, "power rating of the resistor; used up to half", 0.01, 100
    )
    led_v: float = assumed_length(2.95, "forward voltage of a white chip at a few mA", 0.1, 10)
    led_spread_v: float = assumed_length(0.2, "tolerance of the forward voltage, +-", 0, 2)
    wire_mm: float = bounded_number(500.0, "length of each wire, from ring to supply", 50, 10_000)
    measured: tuple[str, ...] = measured_keys("keys measured, or from a data sheet")

    @property
    def pitch_mm(self) -> float:
        """Between two LEDs = 1000 / LEDs per metre: 8.33."""
        return 1000 / self.leds_per_m

    @property
    def strip_mm(self) -> float:
        """Length of strip = count x pitch: 50."""
        return self.led_count * self.pitch_mm

    @property
    def cut_mm(self) -> float:
        """Length of a cut = LEDs per cut x pitch: 25."""
        return self.leds_per_cut * self.pitch_mm

    @property
    def cuts(self) -> int:
        """Number of cuts, in parallel = count / LEDs per cut, at least 1: 2."""
        return max(self.led_count // self.leds_per_cut, 1)

    @property
    def cut_rated_ma(self) -> float:
        """Rated current of a cut = power per metre x length / supply: 20."""
        return self.strip_w_per_m * self.cut_mm / self.supply_v

    @property
    def string_v(self) -> float:
        """Forward voltage of a cut = LEDs per cut x led_v: 8.85."""
        return self.leds_per_cut * self.led_v

    @property
    def strip_resistor_ohm(self) -> float:
        """The strip's own resistance of a cut = (supply - string) / rated current: 158."""
        return max(self.supply_v - self.string_v, 0.0) / self.cut_rated_ma * 1000

    @property
    def most_v(self) -> float:
        """Maximum voltage over the resistors = supply (1 + tolerance) - string + spread: 4.35."""
        spread_v = self.leds_per_cut * self.led_spread_v
        return self.supply_v * (1 + self.supply_tolerance) - self.string_v + spread_v

    @property
    def circuit_ohm(self) -> float:
        """Total resistance = resistor + strip's own / cuts (in parallel): 829."""
        return self.resistor_ohm + self.strip_resistor_ohm / self.cuts

    @property
    def total_ma(self) -> float:
        """Current of all cuts = (supply - string) / total resistance, at least 0: 3.80."""
        return max(self.supply_v - self.string_v, 0.0) / self.circuit_ohm * 1000

    @property
    def least_ma(self) -> float:
        """Minimum current of all cuts, at minimum supply and maximum led_v, at least 0: 2.35."""
        spread_v = self.leds_per_cut * self.led_spread_v
        v = self.supply_v * (1 - self.supply_tolerance) - self.string_v - spread_v
        return max(v, 0.0) / self.circuit_ohm * 1000

    @property
    def most_ma(self) -> float:
        """Maximum current of all cuts = maximum voltage / total resistance, at least 0: 5.25."""
        return max(self.most_v, 0.0) / self.circuit_ohm * 1000

    @property
    def cut_most_ma(self) -> float:
        """Maximum current of a cut, evenly shared = maximum / cuts: 2.62."""
        return self.most_ma / self.cuts

    @property
    def resistor_most_w(self) -> float:
        """Maximum dissipation of the resistor = maximum current squared x resistor: 0.0207."""
        return (self.most_ma / 1000) ** 2 * self.resistor_ohm

    @property
    def least_resistor_ohm(self) -> float:
        """Smallest E24 value within rated currents of strip and supply at worst: 30."""
        most_ma = min(self.cut_rated_ma * self.cuts, self.supply_rating_ma)
        own_ohm = self.strip_resistor_ohm / self.cuts
        return next_e24(max(self.most_v, 0.0) / most_ma * 1000 - own_ohm)


@dataclass(frozen=True)
class MountDimensions(Bounded):
    """The end-effector mount on the shell's +y side (paper: 20 mm long).

    kind: `block`, a bar with two through holes along z; `franka`, a bar with a flange for a finger
    of the Franka hand (hole pattern unverified); `plate`, a blank plate to be drilled; `flange`, a
    plate with the pattern `holes`, its back in the plane of the sensor's back.
    """

    kind: Literal["block", "franka", "plate", "flange"] = field(
        default="block", metadata={"description": "type of mount: block, franka, plate or flange"}
    )
    holes: str = field(
        default="30x30 M3",
        metadata={"description": "flange: `30x30 M3`, `circle 50 6xM4` or `ISO 9409-1-50-4-M6`"},
    )
    length_mm: float = bounded_number(20.0, "mount along y, including a flange", 2, 100)
    width_mm: float = bounded_number(20.0, "mount along x", 4, 200)
    height_mm: float = bounded_number(10.0, "mount along z, from the shell's back", 3, 60)
    screw: Thread = field(default="M3", metadata={"description": "screws through the mount"})
    hole_pitch_mm: float = bounded_number(10.0, "distance of the two holes", 3, 100)
    flange_mm: float = bounded_number(6.5, "franka: thickness of the flange", 1, 50)
    flange_width_mm: float = assumed_length(30.0, "franka: flange along x", 4, 200)
    flange_height_mm: float = assumed_length(23.0, "franka: flange along z", 4, 200)
    flange_pitch_mm: float = assumed_length(12.0, "franka: distance of its holes, along z", 3, 100)
    flange_hole_mm: float = assumed_length(4.3, "franka: diameter of its holes", 1, 20)
    counterbore_mm: float = bounded_number(8.0, "franka: diameter of the counterbore", 2, 40)
    counterbore_depth_mm: float = bounded_number(4.0, "franka: depth of the counterbore", 0.5, 40)
    arm_mm: float = bounded_number(3.6, "franka: height of the arm between the heads", 1, 60)
    stress_limit_mpa: float = assumed_length(
        40.0, "franka: limit of the arm's bending stress", 1, 500
    )

    measured: tuple[str, ...] = measured_keys("keys measured on the lab's own finger")

    def __post_init__(self) -> None:
        super().__post_init__()
        try:
            parse_holes(self.holes, "holes")
        except InputError as error:
            raise ShapeError(str(error)) from error

    @property
    def pattern(self) -> HolePattern:
        """Holes of a flange."""
        return parse_holes(self.holes)

    @property
    def thread(self) -> MetricThread:
        """The screws' row in the table of standards."""
        return METRIC_THREADS[self.pattern.thread if self.kind == "flange" else self.screw]

    @property
    def pattern_size_mm(self) -> Point2:
        """Least width and length of a flange: holes, half a washer and EDGE_MM beside them.

        Towards the shell the washers keep HEAD_PLAY_MM from its wall.
        """
        (x, y), washer = self.pattern.half_mm, self.thread.washer_mm
        edge = washer / 2 + FLANGE_EDGE_MM
        return 2 * (x + edge), HEAD_PLAY_MM + washer / 2 + 2 * y + edge

    @property
    def flange_screw_mm(self) -> float:
        """Shortest screw on sale through flange and washer with 1 d of grip: 12 for M3."""
        least_mm = self.height_mm + self.thread.washer_height_mm + self.thread.thread_mm
        return next((mm for mm in FLANGE_SCREWS_MM if mm >= least_mm - 1e-9), math.nan)

    @property
    def hole_mm(self) -> float:
        """Through hole of the mount's screws: ISO 273 medium, in a flange what its finger has."""
        return self.flange_hole_mm if self.kind == "franka" else self.thread.clearance_mm

    @property
    def head_mm(self) -> float:
        """Head of a cap screw = 1.5 d + 1 (ISO 4762, M3 to M5): 7 for M4."""
        return 1.5 * self.thread.thread_mm + 1.0


@dataclass(frozen=True)
class ScrewDimensions(Bounded):
    """The four screws that hold cover, shell and frame together (paper: M1.6, 19 mm)."""

    thread: CapThread = field(default="M1.6", metadata={"description": "ISO 4762 thread"})
    length_mm: float = bounded_number(
        16.0, "length below the head; M1.6 is sold up to 16 (paper: 19)", 3, 60
    )
    cut: bool = field(
        default=False,
        metadata={"description": "made from a longer screw or rod: a length that is not sold"},
    )
    engagement_mm: float = bounded_number(4.6, "thread engagement in the frame", 1, 20)
    tip_clearance_mm: float = bounded_number(1.0, "depth of the pilot hole beyond the tip", 0.5, 10)

    @property
    def row(self) -> CapScrew:
        """The screw's row in the table of standards."""
        return CAP_SCREWS[self.thread]

    @property
    def pilot_depth_mm(self) -> float:
        """Depth of the frame's blind holes = engagement + tip clearance: 4.6 + 1 = 5.6."""
        return self.engagement_mm + self.tip_clearance_mm


@dataclass(frozen=True)
class ShellDimensions(Bounded):
    """The sensor shell (part 3): opaque, 1.5 mm walls."""

    wall_mm: float = bounded_number(1.5, "wall of shell, cover, bosses (paper: 1.5)", 0.5, 20)
    ledge_mm: float = bounded_number(2.8, "ledges in y behind the acrylic, width", 0.2, 20)
    ledge_x_mm: float = bounded_number(2.3, "the same ledges in x, 0: none", 0, 20)
    ledge_height_mm: float = bounded_number(2.0, "height of the ledges", 0.5, 20)
    ledge_drop_mm: float = bounded_number(
        0.5, "ledges behind the joint, for a thick plate; filled by adhesive", 0.0, 5
    )
    cable_side: CableSide = field(
        default="-y", metadata={"description": "side of the cable's notch: -y, -x or +x"}
    )
    cable_width_mm: float = bounded_number(17.0, "width of the notch for the flat cable", 1, 60)
    cable_height_mm: float = bounded_number(2.0, "height of the cable notch", 0.5, 20)
    cable_foam_mm: float = bounded_number(
        5.0, "length of the black foam in the cable notch, 0: none", 0, 30
    )


def _segment_mm2(from_mm: float, radius_mm: float) -> float:
    """Area of the disc's segment beyond x = from_mm, within the disc."""
    c, r = from_mm, radius_mm
    return r**2 * math.acos(c / r) - c * math.sqrt(r**2 - c**2)
