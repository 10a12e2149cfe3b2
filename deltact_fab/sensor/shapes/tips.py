"""Tips: surfaces by which an indenter touches the gel, defined parametrically.

A tip has its lowest point at z = 0. Its underside rises to `equator_mm`, where its sides turn
vertical; a shank of the same outline continues from there. `height_mm` is the underside; the CAD
solid has the same parameters.

Attributes of every tip:
x_mm, y_mm: position in the indenter's frame.
lowest_mm: (x, y) of a lowest point in the same frame; for a ring not its centre.
radius_mm: a ball of this radius fits inside the tip and touches it at its lowest point.
    A grid node within d of that point is touched from depth radius - sqrt(radius^2 - d^2).
equator_mm: height at which the height field ends.
half_mm: half sides (x, y) of the box around the tip, seen along z.
corner_mm: smallest radius of the convex parts of its outline.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from deltact_fab.common import Field, Point2

from .bounded import ShapeError


class LowestInTheMiddle:
    """Tip with its lowest point at its position."""

    x_mm: float
    y_mm: float

    @property
    def lowest_mm(self) -> Point2:
        return self.x_mm, self.y_mm


@dataclass(frozen=True)
class SphereTip(LowestInTheMiddle):
    """Spherical tip at (x, y), with its lowest point at z = 0."""

    x_mm: float
    y_mm: float
    radius_mm: float

    @property
    def equator_mm(self) -> float:
        return self.radius_mm

    @property
    def half_mm(self) -> Point2:
        return self.radius_mm, self.radius_mm

    @property
    def corner_mm(self) -> float:
        return self.radius_mm

    def height_mm(self, x_mm: Field, y_mm: Field) -> Field:
        r2 = (x_mm - self.x_mm) ** 2 + (y_mm - self.y_mm) ** 2
        inside = r2 <= self.radius_mm**2
        cap = self.radius_mm - np.sqrt(np.where(inside, self.radius_mm**2 - r2, 0.0))
        return np.where(inside, cap, np.inf)


@dataclass(frozen=True)
class RidgeTip(LowestInTheMiddle):
    """Straight ridge along y: a wedge with a rounded nose and round ends.

        seen along y             seen along z
         |     |  equator_mm        ___
          \\   /                    /   \\   half_width_mm
           \\_/  radius_mm          | | |
                                   | | |  length_mm between the centres of the ends
                                    \\___/

    radius_mm: radius of the nose. flank_deg: angle of the flanks with the vertical.
    """

    x_mm: float
    y_mm: float
    radius_mm: float
    half_width_mm: float
    length_mm: float
    flank_deg: float = 45.0

    def __post_init__(self) -> None:
        require_positive(self, "radius_mm", "half_width_mm", "length_mm")
        check_less("0", 0.0, "flank_deg", self.flank_deg)
        check_less("flank_deg", self.flank_deg, "90", 90.0)
        half_mm = self.half_width_mm
        check_less("radius_mm cos(flank_deg)", self.nose_half_mm, "half_width_mm", half_mm)

    @property
    def nose_half_mm(self) -> float:
        """Distance from the ridge's centre line where the nose meets the flank tangentially."""
        return self.radius_mm * math.cos(math.radians(self.flank_deg))

    @property
    def nose_height_mm(self) -> float:
        """Height where the nose meets the flank."""
        return self.radius_mm * (1 - math.sin(math.radians(self.flank_deg)))

    @property
    def slope(self) -> float:
        """Slope of the flank, dz/dx."""
        return 1 / math.tan(math.radians(self.flank_deg))

    @property
    def equator_mm(self) -> float:
        return self.nose_height_mm + (self.half_width_mm - self.nose_half_mm) * self.slope

    @property
    def half_mm(self) -> Point2:
        return self.half_width_mm, self.length_mm / 2 + self.half_width_mm

    @property
    def corner_mm(self) -> float:
        return self.half_width_mm

    def height_mm(self, x_mm: Field, y_mm: Field) -> Field:
        overhang = np.maximum(np.abs(y_mm - self.y_mm) - self.length_mm / 2, 0.0)
        d = np.hypot(x_mm - self.x_mm, overhang)
        nose = np.minimum(d, self.nose_half_mm)
        round_ = self.radius_mm - np.sqrt(self.radius_mm**2 - nose**2)
        flank = self.nose_height_mm + (d - self.nose_half_mm) * self.slope
        height = np.where(d <= self.nose_half_mm, round_, flank)
        return np.where(d <= self.half_width_mm, height, np.inf)


@dataclass(frozen=True)
class EllipsoidTip(LowestInTheMiddle):
    """Half a spheroid with its axis along x: semi-axes a along x, b along y and z.

    A spheroid because the CAD kernel revolves it exactly; a general ellipsoid is a spline there,
    with a volume error of 1 %.
    """

    x_mm: float
    y_mm: float
    a_mm: float
    b_mm: float

    def __post_init__(self) -> None:
        require_positive(self, "a_mm", "b_mm")

    @property
    def radius_mm(self) -> float:
        return min(self.b_mm, self.a_mm**2 / self.b_mm)

    @property
    def equator_mm(self) -> float:
        return self.b_mm

    @property
    def half_mm(self) -> Point2:
        return self.a_mm, self.b_mm

    @property
    def corner_mm(self) -> float:
        """Smallest radius of curvature of the outline, at the ends of its longer axis."""
        low, high = sorted((self.a_mm, self.b_mm))
        return low**2 / high

    def height_mm(self, x_mm: Field, y_mm: Field) -> Field:
        s2 = ((x_mm - self.x_mm) / self.a_mm) ** 2 + ((y_mm - self.y_mm) / self.b_mm) ** 2
        inside = s2 <= 1.0
        cap = self.b_mm * (1 - np.sqrt(np.where(inside, 1 - s2, 0.0)))
        return np.where(inside, cap, np.inf)


def require_positive(record: object, *names: str) -> None:
    """Raise ShapeError naming the first of a record's fields that is not finite and above 0."""
    for name in names:
        value = getattr(record, name)
        if not (math.isfinite(value) and value > 0):
            raise ShapeError(f"{name} > 0 and finite: {value} fails")


def check_less(small: str, a: float, large: str, b: float) -> None:
    """Raise ShapeError stating `a < b` with its numbers unless it holds (NaN fails)."""
    if not a < b:
        raise ShapeError(f"{small} < {large}: {a:g} < {b:g} fails")
