"""Presses that are each other's mirror image: one is solved and serves all.

Gel and block are their own images in the planes x = 0 and y = 0. Where an indenter is too, a press
at (-x, y) whose path is the image of another's needs no solve of its own.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

from numpy.typing import NDArray

from ..gel.footprint import is_mirrored
from ..shapes import Indenter
from .trajectory import Line, Point, PressPath, Solved


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
        """The image of displacements (ny, nx, 3) on a lattice that is centred on 0."""
        if not (self.x or self.y):
            return u
        u = u[:: -1 if self.y else 1, :: -1 if self.x else 1].copy()
        for axis, flipped in enumerate((self.x, self.y)):
            if flipped:
                u[..., axis] *= -1
        return u

    def solved(self, knot: Solved) -> Solved:
        """The image of a solved knot."""
        u = knot.displacement_mm
        return replace(
            knot,
            force_n=self.point(knot.force_n),
            torque_nmm=self.torque(knot.torque_nmm),
            displacement_mm=None if u is None else self.field(u),
        )

    def path(self, path: PressPath) -> PressPath:
        """The image of a press's path; it keeps its name."""
        lines = tuple(
            Line(self.point(at.start_mm), self.point(at.end_mm), at.seconds, at.dwell_s)
            for at in path.lines
        )
        return replace(path, at_mm=self.point((*path.at_mm, 0.0))[:2], lines=lines)


def to_solved(path: PressPath, indenter: Indenter) -> Mirror:
    """What takes a press to the one of its images that is solved: it leaves 0 towards +x and +y."""
    flip = []
    for axis in (0, 1):
        along = (p[axis] for line in path.lines for p in (line.start_mm, line.end_mm))
        first = next((v for v in along if v != 0), 0.0)
        flip.append(first < 0 and is_mirrored(indenter, axis))
    return Mirror(*flip)
