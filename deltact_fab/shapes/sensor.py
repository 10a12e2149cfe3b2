"""Dimensions of the sensor that more than one side of the product needs (paper, Hardware Design).

Sensor frame: origin at the centre of the resting outer face, x along the width (36 mm), y along
the length (34 mm), z out of the sensor. All lengths in millimetres.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, fields

N_SILICONE = 1.41
N_ACRYLIC = 1.49


class ShapeError(ValueError):
    """A dimension breaks an inequality; the text states the inequality with its numbers."""


@dataclass(frozen=True)
class SkinDimensions:
    """The clear silicone block behind the pattern (paper: 36 x 34 x 12, edges filleted)."""

    width_mm: float = 36.0
    length_mm: float = 34.0
    thickness_mm: float = 12.0
    edge_fillet_mm: float = 2.0
    protrusion_mm: float = 6.0  # height that stands proud of the frame and can be touched

    __pydantic_config__ = {"extra": "forbid"}  # noqa: RUF012 - read by catalog.validate

    def __post_init__(self) -> None:
        _positive(self)
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

    @property
    def opening_half_mm(self) -> tuple[float, float]:
        """Half sides of the face, inside which footprint and shear must stay (x, y)."""
        return (self.width_mm / 2, self.length_mm / 2)


@dataclass(frozen=True)
class FrameDimensions:
    """The black tactile skin base that holds the skin: an outer box with a window."""

    height_mm: float = 8.0
    wall_x_mm: float = 1.5  # (39 - 36) / 2: the frame sits flush on the shell
    wall_y_mm: float = 3.0  # (40 - 34) / 2
    pilot_diameter_mm: float = 1.35  # the M1.6 screws cut their thread here
    pilot_depth_mm: float = 4.6  # = screw engagement
    post_mm: float = 6.4  # square corner posts: 2 x (bore / 2 + wall)

    __pydantic_config__ = {"extra": "forbid"}  # noqa: RUF012

    def __post_init__(self) -> None:
        _positive(self)
        if not self.pilot_depth_mm < self.height_mm:
            raise ShapeError(
                "pilot_depth_mm < height_mm (a blind hole): "
                f"{self.pilot_depth_mm} < {self.height_mm} fails"
            )


@dataclass(frozen=True)
class OpticsDimensions:
    """What the camera looks through, and how much of the face it sees."""

    air_gap_mm: float = 3.0
    acrylic_mm: float = 2.0
    mm_per_px: float = 0.0378  # at rest, on the outer face
    image_width_px: int = 798
    image_height_px: int = 586

    __pydantic_config__ = {"extra": "forbid"}  # noqa: RUF012

    def __post_init__(self) -> None:
        _positive(self)

    @property
    def view_mm(self) -> tuple[float, float]:
        """Size of the field of view on the resting face, (x, y)."""
        return (self.image_width_px * self.mm_per_px, self.image_height_px * self.mm_per_px)


@dataclass(frozen=True)
class SensorDimensions:
    """The whole sensor; derived lengths are properties with their equation."""

    skin: SkinDimensions = field(default_factory=SkinDimensions)
    frame: FrameDimensions = field(default_factory=FrameDimensions)
    optics: OpticsDimensions = field(default_factory=OpticsDimensions)

    __pydantic_config__ = {"extra": "forbid"}  # noqa: RUF012

    @property
    def frame_outer_mm(self) -> tuple[float, float]:
        """Outer sides of the frame = skin + 2 walls: 36 + 2 x 1.5 = 39 and 34 + 2 x 3 = 40."""
        return (
            self.skin.width_mm + 2 * self.frame.wall_x_mm,
            self.skin.length_mm + 2 * self.frame.wall_y_mm,
        )

    @property
    def eye_distance_mm(self) -> float:
        """Apparent distance of the face from the lens: g + t_acrylic / n + t_silicone / n.

        Paraxial Snell; the pinhole camera of this level of the optics stands there.
        """
        return (
            self.optics.air_gap_mm
            + self.optics.acrylic_mm / N_ACRYLIC
            + self.skin.thickness_mm / N_SILICONE
        )


def _positive(record: object) -> None:
    """Every number of a dimension record is finite and above zero; NaN included."""
    for f in fields(record):  # type: ignore[arg-type]
        value = getattr(record, f.name)
        if not (math.isfinite(value) and value > 0):
            raise ShapeError(f"{f.name} > 0 and finite: {value} fails")
