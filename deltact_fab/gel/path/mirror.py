"""Presses that are each other's mirror image: one is solved and serves all.

Gel and block are their own images in the planes x = 0 and y = 0. Where an indenter is too, a press
at (-x, y) whose path is the image of another's needs no solve of its own.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from numpy.typing import NDArray

from ...aliases import Point
from ...shapes import Indenter
from ..footprint import is_mirrored
from .knots import KnotPose, SolvedKnot


@dataclass(frozen=True)
class Mirror:
    """The reflection that changes the sign of x, of y or of both; its own inverse."""

    x: bool = False
    y: bool = False

    def point(self, p: Point) -> Point:
        """The image of a point or of a polar vector (force)."""
        # + 0.0: no -0.0, which the store would take for another press.
        return (-p[0] if self.x else p[0]) + 0.0, (-p[1] if self.y else p[1]) + 0.0, p[2]

    def torque(self, t: Point) -> Point:
        """The image of an axial vector: a reflection keeps its part along the plane's normal."""
        sign = -1 if self.x != self.y else 1
        x, y, z = self.point(t)
        return sign * x, sign * y, sign * z

    def field(self, u: NDArray[Any]) -> NDArray[Any]:
        """The image of vectors (ny, nx, 3), or numbers, on a lattice that is centred on 0."""
        if not (self.x or self.y):
            return u
        u = u[:: -1 if self.y else 1, :: -1 if self.x else 1].copy()
        for axis, flipped in enumerate((self.x, self.y)):
            if flipped and u.ndim == 3:
                u[..., axis] *= -1
        return u

    def solved(self, knot: SolvedKnot) -> SolvedKnot:
        u, t, zone_map = knot.displacement_mm, knot.traction_mpa, knot.zone_map
        return replace(
            knot,
            force_n=self.point(knot.force_n),
            torque_nmm=self.torque(knot.torque_nmm),
            displacement_mm=None if u is None else self.field(u),
            traction_mpa=None if t is None else self.field(t),
            zones=replace(knot.zones, centroid_mm=self.point((*knot.zones.centroid_mm, 0.0))[:2]),
            zone_map=None if zone_map is None else self.field(zone_map),
        )


def to_solved(poses: Sequence[KnotPose], indenter: Indenter) -> Mirror:
    """What takes a press to the one of its images that is solved: it leaves 0 towards +x and +y."""
    flip = []
    for axis in (0, 1):
        first = next((p.tip_mm[axis] for p in poses if p.tip_mm[axis] != 0), 0.0)
        flip.append(first < 0 and is_mirrored(indenter, axis))
    return Mirror(*flip)
