"""One press of a protocol as the stage drives it, and the solver of its path."""

from __future__ import annotations

from dataclasses import dataclass

from ..aliases import Point
from ..gel.path.solver import PathSolver

SAME_MM = 2e-3  # a point of the stage is the plan's within a motor step and its rounding


@dataclass(frozen=True, eq=False)
class PlannedPress:
    """solver: of the path's knots. name: `indenter/position`. waypoints: ends of the planned lines.

    One that is not planned has neither name nor waypoints.
    """

    solver: PathSolver
    name: str = ""
    waypoints: tuple[Point, ...] = ()

    def snapped(self, point: Point) -> Point:
        """The planned point that this one is but for a motor step, else the point itself."""
        for planned in self.waypoints:
            if all(abs(p - q) <= SAME_MM for p, q in zip(planned, point, strict=True)):
                return planned
        return point

    def rest_after(self, key: int) -> float | None:
        """Seconds that the tip rests after a planned knot before the next; None: no knot for it."""
        poses = self.solver.poses
        if 0 < key < len(poses) and poses[key].part == 0:
            return poses[key].seconds
        return None
