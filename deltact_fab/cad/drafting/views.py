"""The views of a part: four projections, one of them cut, and what details enlarge of them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...aliases import Point2, Points
from ..kernel import ordered, require
from .dimensioning import Callouts, Detail
from .projection import ProjectedLines, View, project, sampled

SIDES = 120


@dataclass(frozen=True)
class Circle2:
    """A circle on the model's plane; what it cuts off ends on a polygon of SIDES sides in it."""

    centre: tuple[float, float]
    radius: float

    @cached_property
    def _clip(self) -> Any:
        from ezdxf.math import Vec2
        from ezdxf.math.clipping import ConvexClippingPolygon2d

        turn = 2 * np.pi * np.arange(SIDES) / SIDES
        ring = np.stack([np.cos(turn), np.sin(turn)], axis=1) * self.radius + self.centre
        return ConvexClippingPolygon2d(Vec2.list(ring.tolist()))

    def of_lines(self, lines: Iterable[Points]) -> tuple[Points, ...]:
        """Polylines (n, 2), cut where they leave the circle."""
        from ezdxf.math import Vec2

        pieces = (p for line in lines for p in self._clip.clip_polyline(Vec2.list(line.tolist())))
        return tuple(_points(piece) for piece in pieces if len(piece) > 1)

    def of_face(self, loops: Sequence[Points]) -> list[Points]:
        """Loops around and within a face, cut likewise and closed along the circle."""
        from ezdxf.math import Vec2

        pieces = (p for loop in loops for p in self._clip.clip_polygon(Vec2.list(loop.tolist())))
        return [_points(piece) for piece in pieces if len(piece) > 2]


def _points(piece: Sequence[Any]) -> Points:
    return np.array([(p.x, p.y) for p in piece])


VIEWS = {
    "front": View((0, 1, 0), (0, 0, 1)),
    "top": View((0, 0, -1), (0, 1, 0)),
    "left": View((1, 0, 0), (0, 0, 1)),
    "picture": View((1, 1, -0.8), (0, 0, 1)),
}
FLIPPED = {
    "front": View((0, -1, 0), (0, 0, -1)),
    "top": View((0, 0, 1), (0, -1, 0)),
    "left": View((1, 0, 0), (0, 0, -1)),
    "picture": View((1, -1, 0.8), (0, 0, -1)),
}


@dataclass(frozen=True)
class DrawnView:
    """One view: its projection, its lines, the faces of a section; of a detail, its circle."""

    view: View
    lines: ProjectedLines
    hatched: Sequence[Sequence[Points]] = ()
    circle: Circle2 | None = None

    @property
    def box_mm(self) -> tuple[Point2, Point2]:
        if self.circle is not None:
            (x, y), r = self.circle.centre, self.circle.radius
            return (x - r, y - r), (x + r, y + r)
        (x0, y0), (x1, y1) = (c.tolist() for c in self.lines.box_mm)
        return (x0, y0), (x1, y1)

    def shows(self, points: Points, near_mm: float) -> NDArray[np.bool_]:
        """Which points (n, 2) on the model's plane lie on a visible line."""
        a, b = self._segments
        way = b - a
        length = np.maximum(np.einsum("ij,ij->i", way, way), 1e-18)
        t = np.einsum("nij,ij->ni", points[:, None] - a, way) / length
        off = points[:, None] - (a + np.clip(t, 0, 1)[..., None] * way)
        return np.asarray(np.hypot(off[..., 0], off[..., 1]).min(axis=1) < near_mm)

    @cached_property
    def _segments(self) -> tuple[Points, Points]:
        lines = [*self.lines.visible, *self.lines.smooth]
        return np.concatenate([p[:-1] for p in lines]), np.concatenate([p[1:] for p in lines])


def views(solid: Any, said: Callouts) -> dict[str, DrawnView]:
    """The four projections; the left one cut where the callouts ask for a section."""
    views = FLIPPED if said.flipped else VIEWS
    drawn = {}
    for name, view in views.items():
        if name == "left" and said.cut is not None:
            drawn[name] = _section(solid, view, said.cut.x_mm)
        else:
            drawn[name] = DrawnView(view, project([solid], view.direction, view.up)[0])
    return drawn


def enlarged(parent: DrawnView, detail: Detail) -> DrawnView:
    """What a detail's circle holds of its view; hidden lines stay behind."""
    u, v = (float(c) for c in parent.view.flat(detail.at))
    circle = Circle2((u, v), detail.radius_mm)
    lines = ProjectedLines(
        circle.of_lines(parent.lines.visible), (), circle.of_lines(parent.lines.smooth)
    )
    faces = [circle.of_face(face) for face in parent.hatched]
    return DrawnView(parent.view, lines, [face for face in faces if face], circle)


def _section(solid: Any, view: View, x_mm: float) -> DrawnView:
    """What is left on the far side of the plane x = x_mm, and the faces that the plane cuts."""
    cq = require()
    box = solid.BoundingBox()
    low = cq.Vector(x_mm, box.ymin - 1, box.zmin - 1)
    kept = solid.intersect(cq.Solid.makeBox(box.xmax + 1 - x_mm, box.ylen + 2, box.zlen + 2, low))
    lines = project([kept], view.direction, view.up)[0]
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
