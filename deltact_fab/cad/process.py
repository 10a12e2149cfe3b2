"""What the machines do to a length: the records of printer and laser, and what they cost a fit.

A design's numbers are what the finished part should measure. Each machine leaves a systematic
error, the bias, and a spread about it; both come from a datasheet or from a coupon (`cad fit`).
"""

from __future__ import annotations

from dataclasses import dataclass, field

from ..shapes.bounded import Bounded, assumed, measured
from .rule import Length


@dataclass(frozen=True)
class ResinPrinterDimensions(Bounded):
    """The resin printer, its resin and its wash: what a printed length may be off.

    Bias: what a finished length measures more than its nominal, after whatever the slicer
    compensates. The spread holds for each length on its own, of whatever size.
    """

    plane_mm: float = assumed(0.10, "spread of a length in the layers, +-", 0.005, 1)
    height_mm: float = assumed(0.15, "spread of a length across the layers, +-", 0.005, 1)
    hole_bias_mm: float = assumed(0.0, "hole or slot over its nominal", -1, 1)
    outside_bias_mm: float = assumed(0.0, "peg or block over its nominal", -1, 1)
    least_wall_mm: float = assumed(0.6, "thinnest wall that prints", 0.05, 5)
    least_gap_mm: float = assumed(0.2, "narrowest gap that stays open", 0.02, 2)
    least_hole_mm: float = assumed(0.5, "smallest hole that stays open", 0.05, 5)
    ceiling_span_mm: float = assumed(21.0, "widest bare ceiling (SLA guides: 21)", 0.5, 200)
    bed_x_mm: float = assumed(145.0, "platform, one side", 20, 2000)
    bed_y_mm: float = assumed(145.0, "platform, other side", 20, 2000)
    bed_z_mm: float = assumed(175.0, "height of the build room", 20, 2000)
    measured: tuple[str, ...] = measured("keys measured on the lab's own printer")

    @property
    def limits_mm(self) -> tuple[float, float]:
        """What a fitted length in the layers may be off, (lower, upper)."""
        return -self.plane_mm, self.plane_mm

    @property
    def tall_limits_mm(self) -> tuple[float, float]:
        """What a fitted length across the layers may be off, (lower, upper)."""
        return -self.height_mm, self.height_mm

    @property
    def general_tolerance(self) -> str:
        """What a drawing says of every length without limits of its own."""
        return f"±{self.plane_mm:.2g} in the layers, ±{self.height_mm:.2g} across"

    def inner(self, nominal_mm: float) -> Length:
        """A printed hole, slot or pocket, in the layers."""
        return Length(nominal_mm + self.hole_bias_mm, self.plane_mm, PLANE)

    def outer(self, nominal_mm: float) -> Length:
        """A printed peg, block or rim, in the layers."""
        return Length(nominal_mm + self.outside_bias_mm, self.plane_mm, PLANE)

    def tall(self, nominal_mm: float) -> Length:
        """A printed length across the layers; what turns at printing counts as this."""
        return Length(nominal_mm, max(self.height_mm, self.plane_mm), HEIGHT)

    def pitch(self, other_mm: float | None = None) -> Length:
        """What two patterns of holes may disagree at one hole, as a diameter.

        Each pattern's pitch is off by the spread in x and in y; centred on each other, either end
        takes half of the sum of both, and a diameter counts twice that: sqrt(2) (a + b), along the
        diagonal. other_mm: the spread of the other pattern where it is not printed.
        """
        apart = self.plane_mm + (self.plane_mm if other_mm is None else other_mm)
        return Length(0.0, 2**0.5 * apart, PLANE)


PLANE = ("resin_printer.plane_mm", "resin_printer.hole_bias_mm", "resin_printer.outside_bias_mm")
HEIGHT = ("resin_printer.height_mm",)
CUT = ("laser.tolerance_mm",)
SHEET = ("laser.sheet_tolerance",)


@dataclass(frozen=True)
class LaserDimensions(Bounded):
    """The laser that cuts the acrylic plate, and the sheet that it is cut from."""

    kerf_mm: float = assumed(0.2, "width of the cut", 0.0, 1)
    tolerance_mm: float = assumed(0.1, "spread of a cut length, kerf compensated, +-", 0.005, 1)
    least_bridge_mm: float = assumed(1.0, "thinnest web between two cuts (guides: 1)", 0.1, 20)
    compensate: bool = field(
        default=False,
        metadata={"description": "the DXF is the laser's path: half a kerf outside the part"},
    )
    sheet_tolerance: float = assumed(
        0.1, "thickness of the sheet, share, +-; measure yours", 0.001, 0.3
    )
    measured: tuple[str, ...] = measured("keys measured on the lab's own laser and sheet")

    @property
    def limits_mm(self) -> tuple[float, float]:
        """What a cut length may be off, (lower, upper)."""
        return -self.tolerance_mm, self.tolerance_mm

    @property
    def general_tolerance(self) -> str:
        """What a drawing says of every length without limits of its own."""
        return f"±{self.tolerance_mm:.2g}; sheet ±{100 * self.sheet_tolerance:.2g} %"

    @property
    def path(self) -> str:
        """What a drawing says of the laser's path."""
        if self.compensate:
            return f"The DXF is the laser's path, {self.kerf_mm / 2:g} outside the finished plate."
        return "The DXF is the finished plate: offset the cut by half the kerf."

    def cut(self, nominal_mm: float) -> Length:
        """An outside length of a plate as it is cut."""
        return Length(nominal_mm, self.tolerance_mm, CUT)

    def sheet(self, nominal_mm: float) -> Length:
        """The thickness of a sheet."""
        return Length(nominal_mm, self.sheet_tolerance * nominal_mm, SHEET)
