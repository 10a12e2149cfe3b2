"""The views of a part: four projections, one of them cut."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...aliases import Point2, Points
from ..kernel import ordered, require
from .dimensioning import Callouts
from .projection import ProjectedLines, View, project, sampled

VIEWS = {
    "front": View((0, 1, 0), (0, 0, 1)),
    "top": View((0, 0, -1), (0, 1, 0)),
    "left": View((1, 0, 0), (0, 0, 1)),
    "picture": View((1, 1, -0.8), (0, 0, 1)),
}
# The part turned half about x.
FLIPPED = {
    name: View(*((x, -y, -z) for x, y, z in (view.direction, view.up)))
    for name, view in VIEWS.items()
}


@dataclass(frozen=True)
class DrawnView:
    """One view: its projection, its lines, the faces of a section."""

    view: View
    lines: ProjectedLines
    hatched: Sequence[Sequence[Points]] = ()

    @property
    def box_mm(self) -> tuple[Point2, Point2]:
        (x0, y0), (x1, y1) = (c.tolist() for c in self.lines.box_mm)
        return (x0, y0), (x1, y1)

    def shows(self, points: Points, near_mm: float) -> NDArray[np.bool_]:
        """Which points (n, 2) on the model's plane lie on a visible line."""
        import shapely

        return np.asarray(shapely.distance(self._shown, shapely.points(points)) < near_mm)

    @cached_property
    def _shown(self) -> Any:
        import shapely

        return shapely.MultiLineString([*self.lines.visible, *self.lines.smooth])


def views(solid: Any, said: Callouts) -> dict[str, DrawnView]:
    """The four projections; the left one cut where the callouts ask for a section."""
    drawn = {}
    for name, view in (FLIPPED if said.flipped else VIEWS).items():
        if name == "left" and said.cut is not None:
            drawn[name] = _section(solid, view, said.cut.x_mm)
        else:
            drawn[name] = DrawnView(view, project([solid], view)[0])
    return drawn


def _section(solid: Any, view: View, x_mm: float) -> DrawnView:
    """What is left on the far side of the plane x = x_mm, and the faces that the plane cuts."""
    cq = require()
    box = solid.BoundingBox()
    low = cq.Vector(x_mm, box.ymin - 1, box.zmin - 1)
    kept = solid.intersect(cq.Solid.makeBox(box.xmax + 1 - x_mm, box.ylen + 2, box.zlen + 2, low))
    lines = project([kept], view)[0]
    faces = []
    for face in kept.Faces():
        bounds = face.BoundingBox()
        if abs(bounds.xmin - x_mm) < 1e-4 and abs(bounds.xmax - x_mm) < 1e-4:
            wires = [face.outerWire(), *face.innerWires()]
            faces.append([view.flat(_outline(wire)) for wire in wires])
    faces.sort(key=lambda loops: [loop.min(axis=0).round(4).tolist() for loop in loops])
    return DrawnView(view, ProjectedLines(lines.visible, (), lines.smooth), faces)


def _outline(wire: Any) -> Points:
    """A closed wire as points (n, 3), its edges end to end."""
    from OCP.TopAbs import TopAbs_REVERSED

    points = []
    for edge in ordered(wire):
        along = sampled(edge)
        points.append(along[::-1] if edge.Orientation() == TopAbs_REVERSED else along)
    return np.concatenate(points)
