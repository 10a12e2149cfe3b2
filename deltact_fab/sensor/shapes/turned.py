"""Tips of revolution: cylinder, ring, toy hat (paper, Fig. of shape reconstruction).

    ring                 cylinder             hat
     |  |   |  |          |       |        __|       |__    equator_mm
      \\/     \\/           \\_____/            \\_   _/
                                               \\_/          z = 0

The profile is the half right of the axis: lines and arcs (d, z) from the innermost point outwards.
Attributes as in `tips`; there is no underside in a hole.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from deltact_fab.common import Field, Point2

from .tips import check_less

RELATIVE_ROUNDING = 1e-9  # by hand: of sums and roots of decimal fractions


@dataclass(frozen=True)
class ProfilePiece:
    """Piece of a profile from the end of the previous one: a line, or an arc about centre_mm.

    Points are (d, z): distance from the axis, height. An arc bulges downwards unless its centre
    lies below both of its ends' heights.
    """

    end_mm: Point2
    centre_mm: Point2 | None = None


@dataclass(frozen=True)
class TurnedTip:
    """Surface of revolution about the vertical axis at (x, y): a height field on a disc or ring.

    radius_mm: a ball of this radius fits inside and touches `lowest_mm`.
    start_mm: innermost point (d, z) of the profile; d > 0 leaves a hole. pieces: the rest of it.
    """

    x_mm: float
    y_mm: float
    radius_mm: float
    start_mm: Point2
    pieces: tuple[ProfilePiece, ...]

    @classmethod
    def cylinder(cls, radius_mm: float, edge_mm: float) -> TurnedTip:
        """Vertical cylinder with a flat end and an edge rounded with edge_mm."""
        check_less("0", 0.0, "edge_mm", edge_mm)
        check_less("edge_mm", edge_mm, "radius_mm", radius_mm)
        flat = radius_mm - edge_mm
        edge = ProfilePiece((radius_mm, edge_mm), (flat, edge_mm))
        return cls(0.0, 0.0, radius_mm, (0.0, 0.0), (ProfilePiece((flat, 0.0)), edge))

    @classmethod
    def ring(cls, radius_mm: float, tube_mm: float) -> TurnedTip:
        """Lower half of a torus with outer radius radius_mm and tube radius tube_mm."""
        check_less("0", 0.0, "tube_mm", tube_mm)
        check_less("2 tube_mm", 2 * tube_mm, "radius_mm", radius_mm)
        middle = radius_mm - tube_mm
        half = ProfilePiece((radius_mm, tube_mm), (middle, tube_mm))
        return cls(0.0, 0.0, tube_mm, (middle - tube_mm, tube_mm), (half,))

    @classmethod
    def hat(
        cls,
        radius_mm: float,
        crown_radius_mm: float,
        crown_mm: float,
        flank_deg: float,
        edge_mm: float,
    ) -> TurnedTip:
        """Hat: a flat brim of radius_mm and a crown, a spherical dome with a conical flank.

        crown_radius_mm, crown_mm: radius of the crown at the brim, and its height. flank_deg: angle
        of the flank from the horizontal. edge_mm: rounding of the brim's edge. The dome's radius
        follows: (crown_radius tan(flank) - crown) / (1 / cos(flank) - 1).
        """
        check_less("1", 1.0, "flank_deg", flank_deg)
        check_less("flank_deg", flank_deg, "90", 90.0)
        check_less("0", 0.0, "crown_mm", crown_mm)
        check_less("0", 0.0, "edge_mm", edge_mm)
        check_less("crown_radius_mm + edge_mm", crown_radius_mm + edge_mm, "radius_mm", radius_mm)
        flank = math.radians(flank_deg)
        high = crown_radius_mm * math.tan(flank)
        check_less("crown_mm", crown_mm, "crown_radius_mm tan(flank_deg)", high)
        dome = (high - crown_mm) / (1 / math.cos(flank) - 1)
        tangent = dome * math.sin(flank), dome * (1 - math.cos(flank))
        check_less("edge of the dome", tangent[0], "crown_radius_mm", crown_radius_mm)
        flat = radius_mm - edge_mm
        pieces = (
            ProfilePiece(tangent, (0.0, dome)),
            ProfilePiece((crown_radius_mm, crown_mm)),
            ProfilePiece((flat, crown_mm)),
            ProfilePiece((radius_mm, crown_mm + edge_mm), (flat, crown_mm + edge_mm)),
        )
        return cls(0.0, 0.0, dome, (0.0, 0.0), pieces)

    def __post_init__(self) -> None:
        check_less("0", 0.0, "radius_mm", self.radius_mm)
        for a, piece in self._segments():
            check_less("d of a point", a[0], "d of the next", piece.end_mm[0])

    @property
    def rim_mm(self) -> float:
        """Outer radius."""
        return self.pieces[-1].end_mm[0]

    @property
    def lowest_mm(self) -> Point2:
        """(x, y) of a lowest point; for a circle of them, the one at +x."""
        points = [self.start_mm]
        for a, piece in self._segments():
            if piece.centre_mm is not None and a[0] < piece.centre_mm[0] < piece.end_mm[0]:
                m, n = piece.centre_mm
                points.append((m, n + _bulge_sign(a, piece) * math.dist(a, piece.centre_mm)))
            points.append(piece.end_mm)
        return self.x_mm + min(points, key=lambda p: p[1])[0], self.y_mm

    @property
    def equator_mm(self) -> float:
        """Height of the rim, or of the rim of the hole if lower."""
        outer = self.pieces[-1].end_mm[1]
        return min(outer, self.start_mm[1]) if self.start_mm[0] > 0 else outer

    @property
    def half_mm(self) -> Point2:
        return self.rim_mm, self.rim_mm

    @property
    def corner_mm(self) -> float:
        return self.rim_mm

    def height_mm(self, x_mm: Field, y_mm: Field) -> Field:
        d = np.hypot(x_mm - self.x_mm, y_mm - self.y_mm)
        height = np.full(d.shape, np.inf)
        for a, piece in self._segments():
            inside = (d >= a[0]) & (d <= piece.end_mm[0])
            height = np.where(inside, _height(a, piece, d), height)
        return height

    def profile(self) -> tuple[Point2, list[tuple[str, tuple[Point2, ...]]]]:
        """Profile for drawing: start and segments ("line", (end,)) or ("arc", (middle, end))."""
        segments: list[tuple[str, tuple[Point2, ...]]] = []
        for a, piece in self._segments():
            if piece.centre_mm is None:
                segments.append(("line", (piece.end_mm,)))
            else:
                segments.append(("arc", (_middle(a, piece), piece.end_mm)))
        return self.start_mm, segments

    def _segments(self) -> list[tuple[Point2, ProfilePiece]]:
        """Pairs of start point and piece."""
        starts = (self.start_mm, *(p.end_mm for p in self.pieces))
        return list(zip(starts, self.pieces, strict=False))


def _bulge_sign(a: Point2, piece: ProfilePiece) -> int:
    """Return -1 for an arc that bulges downwards, 1 upwards."""
    assert piece.centre_mm is not None
    n = piece.centre_mm[1]
    slack = RELATIVE_ROUNDING * (math.dist(a, piece.centre_mm) + abs(n))
    return 1 if max(a[1], piece.end_mm[1]) > n + slack else -1


def _height(a: Point2, piece: ProfilePiece, d: Field) -> Field:
    """Height of a piece that starts at `a`, at distances d from the axis within it."""
    (d0, z0), (d1, z1) = a, piece.end_mm
    if piece.centre_mm is None:
        return z0 + (d - d0) * ((z1 - z0) / (d1 - d0))
    m, n = piece.centre_mm
    r2 = (d0 - m) ** 2 + (z0 - n) ** 2
    return n + _bulge_sign(a, piece) * np.sqrt(np.maximum(r2 - (d - m) ** 2, 0.0))


def _middle(a: Point2, piece: ProfilePiece) -> Point2:
    """Midpoint of an arc of at most half a turn that starts at `a`."""
    assert piece.centre_mm is not None
    (m, n), r = piece.centre_mm, math.dist(a, piece.centre_mm)
    # Perpendicular to the chord, on the side of the arc.
    dx, dz = piece.end_mm[0] - a[0], piece.end_mm[1] - a[1]
    reach = _bulge_sign(a, piece) * r / math.hypot(dx, dz)
    return m - reach * dz, n + reach * dx
