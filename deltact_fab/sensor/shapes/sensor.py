"""Dimensions of the sensor shared by several subsystems (paper, Hardware Design).

Sensor frame: origin at the centre of the resting outer face, x along the width (36 mm), y along
the length (34 mm), z out of the sensor. All lengths in millimetres.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

from .bounded import Bounded, ShapeError, bounded_number

N_SILICONE = 1.41  # by hand: typical refractive index of clear silicone; scales depths seen
N_ACRYLIC = 1.49  # by hand: typical refractive index of PMMA


@dataclass(frozen=True)
class SkinDimensions(Bounded):
    """Clear silicone block behind the pattern (paper: 36 x 34 x 12, edges filleted)."""

    film_margin_mm: ClassVar[float] = 10.0
    """Margin of the pattern film on each side (assumed): for handling, trimmed when dry."""
    width_mm: float = bounded_number(36.0, "side along x", 5, 200)
    length_mm: float = bounded_number(34.0, "side along y", 5, 200)
    thickness_mm: float = bounded_number(12.0, "distance of outer face to acrylic", 0.5, 60)
    edge_fillet_mm: float = bounded_number(2.0, "rounding of the touched face's edges", 0.05, 50)
    protrusion_mm: float = bounded_number(6.0, "protrusion above the frame", 0.1, 60)

    def __post_init__(self) -> None:
        super().__post_init__()
        limit_mm = min(self.width_mm, self.length_mm) / 2
        if not self.edge_fillet_mm < limit_mm:
            raise ShapeError(
                f"edge_fillet_mm < half the shorter side: {self.edge_fillet_mm} < {limit_mm} fails"
            )
        if not self.edge_fillet_mm < self.protrusion_mm <= self.thickness_mm:
            raise ShapeError(
                "edge_fillet_mm < protrusion_mm <= thickness_mm: "
                f"{self.edge_fillet_mm} < {self.protrusion_mm} <= {self.thickness_mm} fails"
            )

    def film_mm(self, margin_mm: float = film_margin_mm) -> tuple[float, float]:
        """Sides (x, y) of the pattern film: the face with a margin all around.

        Used by the bill of materials, the guide and the print sheets.
        """
        return (self.width_mm + 2 * margin_mm, self.length_mm + 2 * margin_mm)

    @property
    def face_mm(self) -> tuple[float, float]:
        """Sides (x, y) of the face."""
        return (self.width_mm, self.length_mm)

    @property
    def opening_half_mm(self) -> tuple[float, float]:
        """Half sides (x, y) of the face, which footprint and shear must not exceed."""
        return (self.width_mm / 2, self.length_mm / 2)


@dataclass(frozen=True)
class FrameDimensions(Bounded):
    """Black frame that holds the skin: an outer box with a window."""

    wall_x_mm: float = bounded_number(1.5, "wall next to the skin in x; (39 - 36) / 2", 0.5, 50)
    wall_y_mm: float = bounded_number(3.0, "wall next to the skin in y; (40 - 34) / 2", 0.5, 50)
    seat_y_mm: float = bounded_number(1.5, "ledge in y that the acrylic rests on", 0.2, 50)
    seat_x_mm: float = bounded_number(
        0.0, "excess width of the acrylic's pocket over the skin", 0, 50
    )


@dataclass(frozen=True)
class OpticsDimensions(Bounded):
    """Optical path of the camera, and its field of view on the face."""

    air_gap_mm: float = bounded_number(3.0, "distance of lens to acrylic", 0.1, 50)
    acrylic_mm: float = bounded_number(2.0, "thickness of the acrylic plate", 0.5, 20)
    mm_per_px: float = bounded_number(0.0378, "scale of the resting face", 1e-3, 1)  # about 675 mm2
    image_width_px: int = bounded_number(798, "image's side along x, rectified", 8, 10_000)
    image_height_px: int = bounded_number(586, "image's side along y, rectified", 8, 10_000)
    least_view_share: float = bounded_number(0.5, "smallest visible share of the face", 0.01, 1)

    @property
    def view_mm(self) -> tuple[float, float]:
        """Size of the field of view on the resting face, (x, y) = image in px x mm_per_px."""
        return (self.image_width_px * self.mm_per_px, self.image_height_px * self.mm_per_px)

    def print_shortfall(self, side_mm: float) -> str | None:
        """Return why a square print of side_mm does not fill the view; None if it does.

        Without a print no motion is visible.
        """
        if side_mm >= max(self.view_mm):
            return None
        x, y = self.view_mm
        return (
            f"a print of {side_mm:.4g} mm is smaller than the view of {x:.4g} x {y:.4g} mm; "
            f"{max(self.view_mm):.4g} mm or more are needed"
        )


@dataclass(frozen=True)
class SensorDimensions(Bounded):
    """Optical part of the sensor; derived lengths are properties with their equation."""

    skin: SkinDimensions = field(default_factory=SkinDimensions)
    frame: FrameDimensions = field(default_factory=FrameDimensions)
    optics: OpticsDimensions = field(default_factory=OpticsDimensions)

    @property
    def focal_px(self) -> float:
        """Focal length in px of the raw image: 0.87 mm of 2.24 um pixels; overridden by designs."""
        return 870 / 2.24

    @property
    def lens_terms(self) -> tuple[float, float, float, float]:
        """k1 to k4 of r = f theta (1 + k1 theta^2 + ...); 0 for an equidistant lens."""
        return 0.0, 0.0, 0.0, 0.0

    @property
    def raw_size_px(self) -> tuple[int, int]:
        """Width and height of the raw image; a design overrides it with its camera's."""
        return 1280, 720

    @property
    def frame_outer_mm(self) -> tuple[float, float]:
        """Outer sides of the frame = skin + 2 walls: 36 + 2 x 1.5 = 39 and 34 + 2 x 3 = 40."""
        return (
            self.skin.width_mm + 2 * self.frame.wall_x_mm,
            self.skin.length_mm + 2 * self.frame.wall_y_mm,
        )

    @property
    def frame_height_mm(self) -> float:
        """Height of the frame = skin below the protrusion + acrylic: 12 - 6 + 2 = 8."""
        return self.skin.thickness_mm - self.skin.protrusion_mm + self.optics.acrylic_mm

    @property
    def eye_distance_mm(self) -> float:
        """Apparent distance of the face from the lens: g + t_acrylic / n + t_silicone / n.

        Paraxial Snell; position of the pinhole camera.
        """
        return (
            self.optics.air_gap_mm
            + self.optics.acrylic_mm / N_ACRYLIC
            + self.skin.thickness_mm / N_SILICONE
        )
