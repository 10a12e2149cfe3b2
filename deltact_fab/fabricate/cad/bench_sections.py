"""The sections of a design for tools, coupons and the bench, and for the machines that make parts.

A design's numbers are what the finished part should measure. Each machine leaves a systematic
error, the bias, and a spread about it; both come from a datasheet or from a coupon (`cad fit`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from deltact_fab.common import Point2
from deltact_fab.sensor import Bounded, Indenter, bounded_number

from .rule import Length
from .sensor_sections import assumed_length, measured_keys
from .standards import CAP_SCREWS, METRIC_THREADS, Thread

PLANE_KEYS = tuple(f"resin_printer.{k}_mm" for k in ("plane", "hole_bias", "outside_bias"))
HEIGHT_KEYS = ("resin_printer.height_mm",)
CUT_KEYS = ("laser.tolerance_mm",)
SHEET_KEYS = ("laser.sheet_tolerance",)
SENSOR_BOLT = CAP_SCREWS["M2"]  # into the force sensor
FLANGE_SCREW = CAP_SCREWS["M3"]  # of the tool holder's flange


@dataclass(frozen=True)
class CouponDimensions(Bounded):
    """Open wells of the same resin, to see whether it inhibits the cure of the silicone."""

    wells: int = bounded_number(4, "number of wells", 1, 12)
    diameter_mm: float = bounded_number(15.0, "diameter of a well", 3, 100)
    depth_mm: float = bounded_number(4.0, "depth of a well", 0.5, 50)
    wall_mm: float = bounded_number(3.0, "wall between and around the wells", 1.5, 50)
    base_mm: float = bounded_number(2.0, "floor below the wells", 1.5, 50)


@dataclass(frozen=True)
class FitCouponDimensions(Bounded):
    """Holes, slots, a block and a peg, by which a printer is measured."""

    count: int = bounded_number(6, "number of holes, and of slots", 3, 20)
    first_mm: float = bounded_number(3.0, "smallest hole and slot", 1, 20)
    step_mm: float = bounded_number(0.1, "step between two sizes", 0.02, 1)
    pitch_mm: float = bounded_number(7.0, "pitch of holes and slots", 3, 50)
    slot_mm: float = bounded_number(8.0, "depth of the slots, from the edge", 2, 50)
    base_mm: float = bounded_number(3.0, "thickness of the base", 1.5, 20)
    block_mm: float = bounded_number(8.0, "side of the block", 4, 50)
    block_height_mm: float = bounded_number(10.0, "height of the block above the base", 2, 50)
    peg_mm: float = bounded_number(3.0, "diameter of the peg", 1, 20)
    peg_height_mm: float = bounded_number(5.0, "height of the peg above the block", 1, 20)

    @property
    def sizes_mm(self) -> tuple[float, ...]:
        """Holes and slots = first + i step: 3.0 to 3.5."""
        return tuple(self.first_mm + i * self.step_mm for i in range(self.count))

    @property
    def outer_mm(self) -> Point2:
        """Sides of the base = pitches and block, slots and the row of holes: 53.5 x 23."""
        row = max(self.sizes_mm[-1], self.block_mm) + self.pitch_mm
        return self.count * self.pitch_mm + self.block_mm + self.pitch_mm / 2, self.slot_mm + row

    @property
    def block_x_mm(self) -> float:
        """x of the block's middle, half a pitch from the end."""
        return self.outer_mm[0] / 2 - (self.pitch_mm + self.block_mm) / 2


@dataclass(frozen=True)
class KerfCouponDimensions(Bounded):
    """A strip of the plate's own sheet, by which a laser is measured."""

    length_mm: float = bounded_number(40.0, "strip along x", 5, 200)
    width_mm: float = bounded_number(10.0, "strip along y, measured as a stack", 2, 100)


@dataclass(frozen=True)
class MoldDimensions(Bounded):
    """The mold (paper: four at a time); each frame is an insert, outer face down."""

    columns: int = bounded_number(2, "cavities along x", 1, 8)
    rows: int = bounded_number(2, "cavities along y", 1, 8)
    web_mm: float = bounded_number(8.0, "web between and around the frames", 1, 100)
    base_mm: float = bounded_number(3.0, "floor below the cavities", 1.5, 50)
    seat_mm: float = bounded_number(3.0, "depth of a frame's seat", 0.5, 30)
    fit_mm: float = bounded_number(0.1, "clearance of a frame, per side", 0.02, 2)
    floor_flatness_mm: float = bounded_number(
        0.05, "flatness of a floor, the touched face", 0.005, 1
    )
    floor_roughness_um: float = bounded_number(0.8, "Ra of a floor, the touched face", 0.01, 12.5)
    pry_width_mm: float = bounded_number(10.0, "notch to lift a frame out, along x", 2, 100)
    pry_mm: float = bounded_number(2.5, "the same notch along y", 0.5, 20)


@dataclass(frozen=True)
class AdapterDimensions(Bounded):
    """The plate between tool holder and force sensor (ATI Nano17: measure yours)."""

    thickness_mm: float = bounded_number(8.0, "thickness of the plate", 3, 40)
    sensor_mm: float = assumed_length(17.0, "diameter of the force sensor", 8, 100)
    sensor_height_mm: float = assumed_length(14.5, "height of the force sensor", 5, 100)
    bolt_circle_mm: float = assumed_length(12.7, "bolt circle of the sensor (three M2)", 4, 90)
    bolt_turn_deg: float = assumed_length(90.0, "angle of the first screw from +x", -360, 360)
    bolt_hole_mm: float = bounded_number(
        SENSOR_BOLT.clearance_mm, "through hole of the sensor's screws", 1, 8
    )
    bolt_bore_mm: float = bounded_number(SENSOR_BOLT.bore_mm, "counterbore for their heads", 2, 15)
    bolt_bore_depth_mm: float = bounded_number(3.0, "counterbore depth, from the flange", 1, 30)
    pilot_mm: float = bounded_number(2.5, "pilot holes of the flange's screws (M3)", 1, 6)
    measured: tuple[str, ...] = measured_keys("keys measured on the lab's own sensor")

    @property
    def bolt_centres_mm(self) -> list[Point2]:
        """The sensor's three screws."""
        turns = [math.radians(self.bolt_turn_deg + 120 * k) for k in range(3)]
        r = self.bolt_circle_mm / 2
        return [(r * math.cos(t), r * math.sin(t)) for t in turns]


@dataclass(frozen=True)
class StagePlateDimensions(Bounded):
    """The plate between the stage's table and the testing shell; it grows with the sensor."""

    grid_mm: float = assumed_length(25.0, "grid of the table's threads or T-slots", 5, 200)
    slot_mm: float = assumed_length(6.6, "width of a slot (M6)", 2, 20)
    slot_travel_mm: float = bounded_number(10.0, "length of a slot between end centres", 1, 100)
    edge_mm: float = bounded_number(7.0, "margin around slots and testing shell", 2, 100)
    thickness_mm: float = bounded_number(6.0, "thickness of the plate", 3, 30)
    least_wall_mm: float = assumed_length(0.8, "thinnest milled wall (guides, metal: 0.8)", 0.1, 10)
    thread_hole_mm: float = bounded_number(3.3, "tapping drill of the tabs' screws (M4)", 1, 10)
    measured: tuple[str, ...] = measured_keys("keys measured on the lab's own table")

    @property
    def slot_length_mm(self) -> float:
        """A slot from end to end = travel + width."""
        return self.slot_travel_mm + self.slot_mm


@dataclass(frozen=True)
class TableDimensions(Bounded):
    """Tabs of the testing shell, by which it is screwed to a table, one on each x side."""

    screw: Thread = field(default="M4", metadata={"description": "screws into the table"})
    tab_mm: float = bounded_number(14.0, "tab along x, from the shell", 4, 100)
    width_mm: float = bounded_number(30.0, "tab along y", 4, 200)
    height_mm: float = bounded_number(6.0, "tab along z, from the sensor's back", 2, 60)
    edge_mm: float = bounded_number(3.0, "margin around a hole", 0.5, 20)
    hole_pitch_mm: float = bounded_number(18.0, "distance of a tab's two holes, along y", 3, 190)

    @property
    def hole_mm(self) -> float:
        """Through hole of the table's screws (ISO 273 medium)."""
        return METRIC_THREADS[self.screw].clearance_mm


@dataclass(frozen=True)
class ToolDimensions(Bounded):
    """The tool holder: a bore for the indenter's stem, and the flange it hangs from."""

    fit_mm: float = bounded_number(0.2, "clearance of the stem, radial and at its flat", 0.02, 1)
    depth_mm: float = bounded_number(21.0, "depth of the bore, longer than the stem", 5, 100)
    body_mm: float = bounded_number(16.0, "diameter of the body", 8, 60)
    flange_mm: float = bounded_number(5.0, "thickness of the flange", 2, 30)
    flange_diameter_mm: float = bounded_number(32.0, "diameter of the flange", 15, 120)
    bolt_circle_mm: float = bounded_number(24.0, "bolt circle of the flange's four screws", 10, 110)
    roof_mm: float = bounded_number(3.0, "roof above the bore", 1.5, 30)
    clamp_z_mm: float = bounded_number(8.0, "height of the set screw above the mouth", 2, 90)
    clamp_mm: float = bounded_number(2.5, "pilot hole of the set screw (M3)", 1, 6)
    screw_hole_mm: float = bounded_number(
        FLANGE_SCREW.clearance_mm, "through hole of the flange's screws (M3)", 2, 8
    )
    pin_mm: float = bounded_number(2.0, "dowel pin on the bolt circle at +x", 1, 6)
    pin_fit_mm: float = bounded_number(0.4, "hole in the flange minus pin, diameters", 0.02, 1)

    @property
    def height_mm(self) -> float:
        """Mouth to flange = depth + roof."""
        return self.depth_mm + self.roof_mm

    @property
    def bore_mm(self) -> float:
        """Radius of the bore = half the stem + fit."""
        return Indenter.stem_diameter_mm / 2 + self.fit_mm

    @property
    def flat_mm(self) -> float:
        """Bore's flat from the axis = stem's flat + fit."""
        return Indenter.stem_flat_at_mm + self.fit_mm

    @property
    def screw_centres_mm(self) -> list[Point2]:
        """The flange's screws, between the axes, as the adapter's pilots."""
        offset_mm = self.bolt_circle_mm / 2 * math.sqrt(0.5)
        return [(sx * offset_mm, sy * offset_mm) for sy in (-1, 1) for sx in (-1, 1)]

    @property
    def pin_at_mm(self) -> Point2:
        """Position of the pin."""
        return self.bolt_circle_mm / 2, 0.0


@dataclass(frozen=True)
class ResinPrinterDimensions(Bounded):
    """Tolerances of the resin printer with its resin and its wash.

    Bias: finished length minus nominal, after the slicer's compensation. The spread holds for
    each length on its own, of any size.
    """

    plane_mm: float = assumed_length(0.10, "spread of a length in the layers, +-", 0.005, 1)
    height_mm: float = assumed_length(0.15, "spread of a length across the layers, +-", 0.005, 1)
    hole_bias_mm: float = assumed_length(0.0, "hole or slot minus its nominal", -1, 1)
    outside_bias_mm: float = assumed_length(0.0, "peg or block minus its nominal", -1, 1)
    least_wall_mm: float = assumed_length(0.6, "thinnest wall that prints", 0.05, 5)
    least_gap_mm: float = assumed_length(0.2, "narrowest gap that stays open", 0.02, 2)
    least_hole_mm: float = assumed_length(0.5, "smallest hole that stays open", 0.05, 5)
    ceiling_span_mm: float = assumed_length(21.0, "widest bare ceiling (SLA guides: 21)", 0.5, 200)
    bed_x_mm: float = assumed_length(145.0, "platform, one side", 20, 2000)
    bed_y_mm: float = assumed_length(145.0, "platform, other side", 20, 2000)
    bed_z_mm: float = assumed_length(175.0, "height of the build room", 20, 2000)
    measured: tuple[str, ...] = measured_keys("keys measured on the lab's own printer")

    def inner(self, nominal_mm: float) -> Length:
        """A printed hole, slot or pocket, in the layers."""
        return Length(nominal_mm + self.hole_bias_mm, self.plane_mm, PLANE_KEYS)

    def outer(self, nominal_mm: float) -> Length:
        """A printed peg, block or rim, in the layers."""
        return Length(nominal_mm + self.outside_bias_mm, self.plane_mm, PLANE_KEYS)

    def tall(self, nominal_mm: float) -> Length:
        """A printed length across the layers, also of parts that are printed tilted."""
        return Length(nominal_mm, max(self.height_mm, self.plane_mm), HEIGHT_KEYS)

    def pitch(self, other_mm: float | None = None) -> Length:
        """Mismatch of two hole patterns at one hole, as a diameter.

        Each pattern's pitch is off by the spread in x and in y; centred on each other, either end
        takes half of the sum of both, and a diameter counts twice that: sqrt(2) (a + b), along the
        diagonal. other_mm: the spread of the other pattern where it is not printed.
        """
        sum_mm = self.plane_mm + (self.plane_mm if other_mm is None else other_mm)
        return Length(0.0, 2**0.5 * sum_mm, PLANE_KEYS)


@dataclass(frozen=True)
class LaserDimensions(Bounded):
    """The laser that cuts the acrylic plate, and the sheet that it is cut from."""

    kerf_mm: float = assumed_length(0.2, "width of the cut", 0.0, 1)
    tolerance_mm: float = assumed_length(
        0.1, "tolerance of a cut length, kerf compensated, +-", 0.005, 1
    )
    least_bridge_mm: float = assumed_length(
        1.0, "thinnest web between two cuts (guides: 1)", 0.1, 20
    )
    compensate: bool = field(
        default=False,
        metadata={"description": "the DXF is the laser's path: half a kerf outside the part"},
    )
    sheet_tolerance: float = assumed_length(
        0.1, "tolerance of the sheet's thickness, share, +-; measure yours", 0.001, 0.3
    )
    measured: tuple[str, ...] = measured_keys("keys measured on the lab's own laser and sheet")

    @property
    def path(self) -> str:
        """Note on the laser's path for the drawing."""
        if self.compensate:
            return f"The DXF is the laser's path, {self.kerf_mm / 2:g} outside the finished plate."
        return "The DXF is the finished plate: offset the cut by half the kerf."

    def cut(self, nominal_mm: float) -> Length:
        """An outside length of a plate as it is cut."""
        return Length(nominal_mm, self.tolerance_mm, CUT_KEYS)

    def sheet(self, nominal_mm: float) -> Length:
        """The thickness of a sheet."""
        return Length(nominal_mm, self.sheet_tolerance * nominal_mm, SHEET_KEYS)
