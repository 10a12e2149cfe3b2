"""Tips: the surfaces by which an indenter touches the gel, each one definition in numbers.

A tip has its lowest point at z = 0. Its underside rises to `equator_mm`, where its sides turn
vertical; from there a shank of the same outline goes on. `height_mm` is the underside, the CAD
solid is made from the same numbers, and `volume_mm3` is what that solid must hold.

Every tip states:
x_mm, y_mm: where it stands in the indenter's frame.
lowest_mm: (x, y) of a lowest point in the same frame; of a ring it is not the middle.
radius_mm: a ball of this radius fits inside the tip and touches it at its lowest point.
    A grid node within d of that point is met from the depth radius - sqrt(radius^2 - d^2) on.
equator_mm: height at which the height field ends.
half_mm: half sides (x, y) of the box around the tip, seen along z.
corner_mm: smallest radius of the convex parts of its outline.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from .bounded import ShapeError

Field = NDArray[np.float64]
Point2 = tuple[float, float]


class _LowestInTheMiddle:
    """A tip whose lowest point is where it stands."""

    x_mm: float
    y_mm: float

    @property
    def lowest_mm(self) -> Point2:
        """(x, y) of the lowest point."""
        return self.x_mm, self.y_mm


@dataclass(frozen=True)
class SphereTip(_LowestInTheMiddle):
    """One spherical cap of the indenter's face at (x, y), with its lowest point at z = 0."""

    x_mm: float
    y_mm: float
    radius_mm: float

    @property
    def equator_mm(self) -> float:
        """Height at which the sides turn vertical: the radius."""
        return self.radius_mm

    @property
    def half_mm(self) -> Point2:
        """Half sides (x, y) of the box around the tip."""
        return self.radius_mm, self.radius_mm

    @property
    def corner_mm(self) -> float:
        """Smallest convex radius of the outline."""
        return self.radius_mm

    def height_mm(self, x_mm: Field, y_mm: Field) -> Field:
        """Underside above the lowest point, inf beside the tip; indenter frame, one shape."""
        r2 = (x_mm - self.x_mm) ** 2 + (y_mm - self.y_mm) ** 2
        inside = r2 <= self.radius_mm**2
        cap = self.radius_mm - np.sqrt(np.where(inside, self.radius_mm**2 - r2, 0.0))
        return np.where(inside, cap, np.inf)

    def volume_mm3(self, length_mm: float) -> float:
        """Volume of the tip and its shank up to z = length_mm: half a ball, then a cylinder."""
        r = self.radius_mm
        return math.pi * r**2 * (2 / 3 * r + length_mm - r)


@dataclass(frozen=True)
class RidgeTip(_LowestInTheMiddle):
    """A straight ridge along y: a wedge with a rounded nose, and ends turned about its last points.

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
        _positive(self, "radius_mm", "half_width_mm", "length_mm")
        less("0", 0.0, "flank_deg", self.flank_deg)
        less("flank_deg", self.flank_deg, "90", 90.0)
        less("radius_mm cos(flank_deg)", self.nose_half_mm, "half_width_mm", self.half_width_mm)

    @property
    def nose_half_mm(self) -> float:
        """Distance from the ridge's middle at which the nose meets the flank, tangent to it."""
        return self.radius_mm * math.cos(math.radians(self.flank_deg))

    @property
    def nose_height_mm(self) -> float:
        """Height of that place."""
        return self.radius_mm * (1 - math.sin(math.radians(self.flank_deg)))

    @property
    def slope(self) -> float:
        """Rise of the flank over its run."""
        return 1 / math.tan(math.radians(self.flank_deg))

    @property
    def equator_mm(self) -> float:
        """Height at which the sides turn vertical."""
        return self.nose_height_mm + (self.half_width_mm - self.nose_half_mm) * self.slope

    @property
    def half_mm(self) -> Point2:
        """Half sides (x, y) of the box around the tip."""
        return self.half_width_mm, self.length_mm / 2 + self.half_width_mm

    @property
    def corner_mm(self) -> float:
        """Smallest convex radius of the outline: its round ends."""
        return self.half_width_mm

    def height_mm(self, x_mm: Field, y_mm: Field) -> Field:
        """Underside above the lowest point, inf beside the tip; indenter frame, one shape."""
        beyond = np.maximum(np.abs(y_mm - self.y_mm) - self.length_mm / 2, 0.0)
        d = np.hypot(x_mm - self.x_mm, beyond)
        nose = np.minimum(d, self.nose_half_mm)
        round_ = self.radius_mm - np.sqrt(self.radius_mm**2 - nose**2)
        flank = self.nose_height_mm + (d - self.nose_half_mm) * self.slope
        height = np.where(d <= self.nose_half_mm, round_, flank)
        return np.where(d <= self.half_width_mm, height, np.inf)

    def volume_mm3(self, length_mm: float) -> float:
        """Volume of the tip and its shank up to z = length_mm: extruded middle, turned ends."""
        r, n, w = self.radius_mm, self.nose_half_mm, self.half_width_mm
        alpha = math.radians(self.flank_deg)
        run, rise = w - n, self.equator_mm - self.nose_height_mm
        # Below the underside, over one half of the profile: nose, then flank.
        area = r * n - (n * r * math.sin(alpha) + r**2 * (math.pi / 2 - alpha)) / 2
        area += run * (self.nose_height_mm + rise / 2)
        turned = r * n**2 - 2 / 3 * (r**3 - (r * math.sin(alpha)) ** 3)
        turned += self.nose_height_mm * (w**2 - n**2) + rise * run * (n + 2 / 3 * run)
        middle = 2 * (w * length_mm - area) * self.length_mm
        return middle + math.pi * (w**2 * length_mm - turned)


@dataclass(frozen=True)
class EllipsoidTip(_LowestInTheMiddle):
    """Half an ellipsoid with its round axis along x: semi-axes a along x, b along y and z.

    A spheroid, for the kernel turns it exactly; of a free ellipsoid it has splines only, and its
    volumes of those are off by a per cent.
    """

    x_mm: float
    y_mm: float
    a_mm: float
    b_mm: float

    def __post_init__(self) -> None:
        _positive(self, "a_mm", "b_mm")

    @property
    def radius_mm(self) -> float:
        """A ball that fits inside and touches the lowest point."""
        return min(self.b_mm, self.a_mm**2 / self.b_mm)

    @property
    def equator_mm(self) -> float:
        """Height at which the sides turn vertical."""
        return self.b_mm

    @property
    def half_mm(self) -> Point2:
        """Half sides (x, y) of the box around the tip."""
        return self.a_mm, self.b_mm

    @property
    def corner_mm(self) -> float:
        """Smallest radius of curvature of the outline, at the ends of its longer axis."""
        low, high = sorted((self.a_mm, self.b_mm))
        return low**2 / high

    def height_mm(self, x_mm: Field, y_mm: Field) -> Field:
        """Underside above the lowest point, inf beside the tip; indenter frame, one shape."""
        s2 = ((x_mm - self.x_mm) / self.a_mm) ** 2 + ((y_mm - self.y_mm) / self.b_mm) ** 2
        inside = s2 <= 1.0
        cap = self.b_mm * (1 - np.sqrt(np.where(inside, 1 - s2, 0.0)))
        return np.where(inside, cap, np.inf)

    def volume_mm3(self, length_mm: float) -> float:
        """Volume of the tip and its shank up to z = length_mm: half an ellipsoid, a cylinder."""
        return math.pi * self.a_mm * self.b_mm * (length_mm - self.b_mm / 3)


@dataclass(frozen=True)
class PrismTip(_LowestInTheMiddle):
    """A flat face with n equal points, the first on +x: a star, or a regular polygon.

    The outline is smooth: points rounded with corner_mm, notches with notch_mm, straight sides
    between them. The edge of the face is rounded with edge_mm.

    points: number of points. outer_mm: from the middle to the end of a rounded point.
    inner_mm: from the middle to where two sides would meet if the notch were not rounded.
    `PrismTip.polygon` gives the inner_mm at which two sides are in line and no notch is left.
    """

    x_mm: float
    y_mm: float
    points: int
    outer_mm: float
    inner_mm: float
    corner_mm: float = 0.5
    notch_mm: float = 0.5
    edge_mm: float = 0.3

    @classmethod
    def polygon(
        cls, sides: int, outer_mm: float, corner_mm: float = 0.5, edge_mm: float = 0.3
    ) -> PrismTip:
        """A regular polygon on the axis; outer_mm: from the middle to a rounded corner."""
        inner_mm = (outer_mm - corner_mm) * math.cos(math.pi / sides) + corner_mm
        return cls(0.0, 0.0, sides, outer_mm, inner_mm, corner_mm, edge_mm=edge_mm)

    def __post_init__(self) -> None:
        _positive(self, "outer_mm", "inner_mm", "corner_mm", "notch_mm", "edge_mm")
        if self.points < 3:
            raise ShapeError(f"points >= 3: {self.points} fails")
        # Else the rounded edges of a point's two sides would meet, and it would not be flat there.
        less("edge_mm", self.edge_mm, "corner_mm", self.corner_mm)
        less("corner_mm", self.corner_mm, "outer_mm", self.outer_mm)
        straight = (self.outer_mm - self.corner_mm) * math.cos(self._half_angle) + self.corner_mm
        if self.inner_mm > straight + 1e-12:
            raise ShapeError(
                f"inner_mm <= that of a polygon: {self.inner_mm:g} <= {straight:g} fails"
            )
        less("corner_mm", self.corner_mm, "inner_mm", self.inner_mm)
        less("0", 0.0, "length of a straight side", self._side.length_mm)
        less("edge_mm", self.edge_mm, "radius_mm", self.radius_mm)

    @property
    def _half_angle(self) -> float:
        return math.pi / self.points

    @cached_property
    def _side(self) -> _Side:
        return _side(self)

    @property
    def radius_mm(self) -> float:
        """A ball that fits inside and touches the face: it reaches the deepest notch."""
        return self._side.notch_r_mm - self.notch_mm

    @property
    def equator_mm(self) -> float:
        """Height at which the sides turn vertical: the radius of the face's edge."""
        return self.edge_mm

    @property
    def half_mm(self) -> Point2:
        """Half sides (x, y) of the box around the tip."""
        core = self.outer_mm - self.corner_mm
        angles = [2 * math.pi * k / self.points for k in range(self.points)]
        return (
            core * max(abs(math.cos(a)) for a in angles) + self.corner_mm,
            core * max(abs(math.sin(a)) for a in angles) + self.corner_mm,
        )

    def inset_mm(self, x_mm: Field, y_mm: Field) -> Field:
        """Distance to the outline, positive inside; exact outside and within corner_mm of it."""
        x, y = x_mm - self.x_mm, y_mm - self.y_mm
        r, half = np.hypot(x, y), self._half_angle
        # All sides fold onto one half of a point, with its middle on +x.
        angle = np.abs(np.mod(np.arctan2(y, x) + half, 2 * half) - half)
        side = self._side
        u, v = r * np.cos(angle) - side.corner_x_mm, r * np.sin(angle)
        along = u * side.along[0] + v * side.along[1]
        out = u * side.normal[0] + v * side.normal[1]
        notch = np.hypot(
            r * np.cos(angle) - side.notch_r_mm * math.cos(half),
            r * np.sin(angle) - side.notch_r_mm * math.sin(half),
        )
        inset = self.corner_mm - out
        inset = np.where(along < 0, self.corner_mm - np.hypot(u, v), inset)
        return np.where(along > side.length_mm, notch - self.notch_mm, inset)

    def height_mm(self, x_mm: Field, y_mm: Field) -> Field:
        """Underside above the lowest point, inf beside the tip; indenter frame, one shape."""
        inset, rho = self.inset_mm(x_mm, y_mm), self.edge_mm
        short = np.clip(rho - inset, 0.0, rho)
        return np.where(inset >= 0, rho - np.sqrt(rho**2 - short**2), np.inf)

    def outline(self) -> tuple[Point2, list[tuple[str, tuple[Point2, ...]]]]:
        """The outline about the tip's own middle: a start, then what is drawn from there.

        Each entry is ("line", (end,)) or ("arc", (middle, end)); it closes at the start.
        """
        side, half = self._side, self._half_angle
        c, q = self.corner_mm, self.notch_mm
        start = (side.corner_x_mm + c * side.normal[0], c * side.normal[1])
        notch = (side.notch_r_mm * math.cos(half), side.notch_r_mm * math.sin(half))
        notch_start = (notch[0] - q * side.normal[0], notch[1] - q * side.normal[1])
        notch_middle = (notch[0] - q * math.cos(half), notch[1] - q * math.sin(half))
        notch_end = _turned(_mirrored(notch_start), 2 * half)
        drawn: list[tuple[str, tuple[Point2, ...]]] = []
        for k in range(self.points):
            turn = 2 * half * k
            if self._notch_angle > 1e-6:
                drawn.append(("line", (_turned(notch_start, turn),)))
                drawn.append(("arc", (_turned(notch_middle, turn), _turned(notch_end, turn))))
            tip = _turned((self.outer_mm, 0.0), turn + 2 * half)
            drawn.append(("line", (_turned(_mirrored(start), turn + 2 * half),)))
            drawn.append(("arc", (tip, _turned(start, turn + 2 * half))))
        return start, drawn

    @property
    def _notch_angle(self) -> float:
        """Angle (rad) by which half a notch turns the outline back; 0 for a polygon."""
        normal = math.atan2(self._side.normal[1], self._side.normal[0])
        return normal - self._half_angle

    def volume_mm3(self, length_mm: float) -> float:
        """Volume of the tip and its shank up to z = length_mm.

        What the rounded edge takes away is integrated over the curves parallel to the outline:
        at inset t they are shorter by 2 pi t.
        """
        side, half, n, rho = self._side, self._half_angle, self.points, self.edge_mm
        c, q, back = self.corner_mm, self.notch_mm, max(self._notch_angle, 0.0)
        turn = half + back
        perimeter = 2 * n * (c * turn + side.length_mm + q * back)
        # Half a point, as triangles from the middle: under the arc, the side and the notch's arc.
        start = (side.corner_x_mm + c * side.normal[0], c * side.normal[1])
        end = (start[0] + side.length_mm * side.along[0], start[1] + side.length_mm * side.along[1])
        notch = side.notch_r_mm - q
        foot = (notch * math.cos(half), notch * math.sin(half))
        area = (_cross((self.outer_mm, 0.0), start) + _cross(start, end) + _cross(end, foot)) / 2
        area += (turn - math.sin(turn)) / 2 * c**2 - (back - math.sin(back)) / 2 * q**2
        first = rho**2 * (1 - math.pi / 4)
        second = rho * first - rho**3 / 6
        return 2 * n * area * length_mm - perimeter * first + 2 * math.pi * second


@dataclass(frozen=True)
class _Side:
    """One straight side of a prism, between the arc of a point on +x and that of the next notch.

    along, normal: unit vectors, along from the point to the notch, normal outwards.
    corner_x_mm: x of the point's arc centre, on +x. notch_r_mm: distance of the notch's arc
    centre from the middle. length_mm: of the straight part.
    """

    along: Point2
    normal: Point2
    corner_x_mm: float
    notch_r_mm: float
    length_mm: float


def _side(tip: PrismTip) -> _Side:
    """The line from the sharp notch that touches the point's arc."""
    half, c, q = math.pi / tip.points, tip.corner_mm, tip.notch_mm
    corner_x = tip.outer_mm - c
    dx, dy = tip.inner_mm * math.cos(half) - corner_x, tip.inner_mm * math.sin(half)
    d2 = dx**2 + dy**2
    less("corner_mm", c, "from the point's arc centre to the notch", math.sqrt(d2))
    t = math.sqrt(d2 - c**2)
    normal = (c * dx + t * dy) / d2, (c * dy - t * dx) / d2
    along = (t * dx - c * dy) / d2, (t * dy + c * dx) / d2
    cosine = normal[0] * math.cos(half) + normal[1] * math.sin(half)
    notch_r = (c + q + normal[0] * corner_x) / cosine
    length = (notch_r * math.cos(half) - corner_x) * along[0] + notch_r * math.sin(half) * along[1]
    return _Side(along, normal, corner_x, notch_r, length)


def _cross(a: Point2, b: Point2) -> float:
    return a[0] * b[1] - a[1] * b[0]


def _turned(p: Point2, angle: float) -> Point2:
    c, s = math.cos(angle), math.sin(angle)
    return c * p[0] - s * p[1], s * p[0] + c * p[1]


def _mirrored(p: Point2) -> Point2:
    return p[0], -p[1]


def _positive(record: object, *names: str) -> None:
    for name in names:
        value = getattr(record, name)
        if not (math.isfinite(value) and value > 0):
            raise ShapeError(f"{name} > 0 and finite: {value} fails")


def less(small: str, a: float, large: str, b: float) -> None:
    """Raise ShapeError stating `a < b` with its numbers unless it holds (NaN fails)."""
    if not a < b:
        raise ShapeError(f"{small} < {large}: {a:g} < {b:g} fails")
