"""Flat prismatic tips with equal points: stars and regular polygons; see `tips`."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from deltact_fab.common import Field, Point2

from .bounded import ShapeError
from .tips import LowestInTheMiddle, check_less, require_positive

MIN_NOTCH_RAD = 1e-6  # by hand: rounding; notches below this angle are none


@dataclass(frozen=True)
class PrismTip(LowestInTheMiddle):
    """Flat tip with n equal points, the first on +x: a star or a regular polygon.

    Points are rounded with corner_mm, notches with notch_mm, the edge of the face with edge_mm;
    sides are straight.

    points: number of points. outer_mm: from the centre to the end of a rounded point.
    inner_mm: from the centre to the intersection of two sides at a notch.
    `PrismTip.polygon` sets the inner_mm at which two sides are in line, without notch.
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
        """Regular polygon on the axis; outer_mm: from the centre to a rounded corner."""
        inner_mm = (outer_mm - corner_mm) * math.cos(math.pi / sides) + corner_mm
        return cls(0.0, 0.0, sides, outer_mm, inner_mm, corner_mm, edge_mm=edge_mm)

    def __post_init__(self) -> None:
        require_positive(self, "outer_mm", "inner_mm", "corner_mm", "notch_mm", "edge_mm")
        if self.points < 3:
            raise ShapeError(f"points >= 3: {self.points} fails")
        # Else the rounded edges of a point's two sides would meet, leaving no flat.
        check_less("edge_mm", self.edge_mm, "corner_mm", self.corner_mm)
        check_less("corner_mm", self.corner_mm, "outer_mm", self.outer_mm)
        straight = (self.outer_mm - self.corner_mm) * math.cos(self._half_angle) + self.corner_mm
        if self.inner_mm > straight + 1e-12:
            raise ShapeError(
                f"inner_mm <= that of a polygon: {self.inner_mm:g} <= {straight:g} fails"
            )
        check_less("corner_mm", self.corner_mm, "inner_mm", self.inner_mm)
        check_less("0", 0.0, "length of a straight side", self._side.length_mm)
        check_less("edge_mm", self.edge_mm, "radius_mm", self.radius_mm)

    @property
    def _half_angle(self) -> float:
        return math.pi / self.points

    @cached_property
    def _side(self) -> _Side:
        """Tangent from the sharp notch to the point's arc."""
        cos, sin = math.cos(self._half_angle), math.sin(self._half_angle)
        c, q, corner_x = self.corner_mm, self.notch_mm, self.outer_mm - self.corner_mm
        dx, dy = self.inner_mm * cos - corner_x, self.inner_mm * sin
        d2 = dx**2 + dy**2
        check_less("corner_mm", c, "from the point's arc centre to the notch", math.sqrt(d2))
        t = math.sqrt(d2 - c**2)
        normal = (c * dx + t * dy) / d2, (c * dy - t * dx) / d2
        along = (t * dx - c * dy) / d2, (t * dy + c * dx) / d2
        notch_r = (c + q + normal[0] * corner_x) / (normal[0] * cos + normal[1] * sin)
        length = (notch_r * cos - corner_x) * along[0] + notch_r * sin * along[1]
        return _Side(along, normal, corner_x, notch_r, length)

    @property
    def radius_mm(self) -> float:
        """Radius of the largest ball inside that touches the face, up to the notches."""
        return self._side.notch_r_mm - self.notch_mm

    @property
    def equator_mm(self) -> float:
        return self.edge_mm

    @property
    def half_mm(self) -> Point2:
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
        # Fold all sides onto one half of a point, with its axis on +x.
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
        # A polygon has no notch; rounding would find one on the line through a side's centre.
        notched = (along > side.length_mm) & (self._notch_angle > MIN_NOTCH_RAD)
        return np.where(notched, notch - self.notch_mm, inset)

    def height_mm(self, x_mm: Field, y_mm: Field) -> Field:
        inset, rho = self.inset_mm(x_mm, y_mm), self.edge_mm
        short = np.clip(rho - inset, 0.0, rho)
        return np.where(inset >= 0, rho - np.sqrt(rho**2 - short**2), np.inf)

    def outline(self) -> tuple[Point2, list[tuple[str, tuple[Point2, ...]]]]:
        """Closed outline about the tip's centre: start point and segments.

        Each segment is ("line", (end,)) or ("arc", (middle, end)).
        """
        side, half = self._side, self._half_angle
        c, q = self.corner_mm, self.notch_mm
        start = (side.corner_x_mm + c * side.normal[0], c * side.normal[1])
        notch = (side.notch_r_mm * math.cos(half), side.notch_r_mm * math.sin(half))
        notch_start = (notch[0] - q * side.normal[0], notch[1] - q * side.normal[1])
        notch_middle = (notch[0] - q * math.cos(half), notch[1] - q * math.sin(half))
        notch_end = _rotate(_mirror_y(notch_start), 2 * half)
        segments: list[tuple[str, tuple[Point2, ...]]] = []
        for k in range(self.points):
            turn = 2 * half * k
            if self._notch_angle > MIN_NOTCH_RAD:
                segments.append(("line", (_rotate(notch_start, turn),)))
                segments.append(("arc", (_rotate(notch_middle, turn), _rotate(notch_end, turn))))
            tip = _rotate((self.outer_mm, 0.0), turn + 2 * half)
            segments.append(("line", (_rotate(_mirror_y(start), turn + 2 * half),)))
            segments.append(("arc", (tip, _rotate(start, turn + 2 * half))))
        return start, segments

    @property
    def _notch_angle(self) -> float:
        """Angle (rad) of half a notch; 0 for a polygon."""
        normal = math.atan2(self._side.normal[1], self._side.normal[0])
        return normal - self._half_angle


@dataclass(frozen=True)
class _Side:
    """Straight side of a prism, between the arcs of the point on +x and the next notch.

    along, normal: unit vectors, along from the point to the notch, normal outwards.
    corner_x_mm: x of the point's arc centre, on +x. notch_r_mm: distance of the notch's arc
    centre from the tip's centre. length_mm: of the straight part.
    """

    along: Point2
    normal: Point2
    corner_x_mm: float
    notch_r_mm: float
    length_mm: float


def _rotate(p: Point2, angle: float) -> Point2:
    c, s = math.cos(angle), math.sin(angle)
    return c * p[0] - s * p[1], s * p[0] + c * p[1]


def _mirror_y(p: Point2) -> Point2:
    return p[0], -p[1]
