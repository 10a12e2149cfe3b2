"""Placement of a scheme's lengths and labels in the views that show their ends best.

A length goes to the view and side of least cost: hidden ends cost most, then ends far from the
edge, then lengths already there. A label goes to the view along its round's axis.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from deltact_fab.common import Field, Point

from ..features import OtherFace, Round, SolidFeatures
from ..rays import ExactRays
from .dimensioning import Callouts, CentreLine, Item, Leader, Linear, PaperSide, Span, toleranced
from .projection import SHEET_CHORD_MM, DrawnView
from .scheme import GRID_MM, Rounds, Scheme

# By definition: views of a length along each axis, better one first; 0: horizontal, 1: vertical.
LENGTH_VIEWS = ({"top": 0, "front": 0}, {"top": 1, "left": 0}, {"front": 1, "left": 1})
AXIAL_VIEWS = ("left", "front", "top")  # the view along each axis
ON_LINE_MM = 2e-3  # of a drawn line, by hand: more takes points beside a line for visible
# By hand: hidden ends outweigh distance, distance outweighs levels; a sheet is wider than high.
HIDDEN_COST, FAR_COST, CROWD_COST = 10.0, 6.0, (2.0, 0.7)
CLEAR_MM = 0.02  # by hand, from a face into the air: above rounding, below any gap
OUTLINE_MM = 0.05  # by hand, from an outline: a leader's tip seems to be on it
RIM_POINTS = 9  # by hand: fewer call a circle hidden that a corner covers
MAX_TARGETS = 8  # by hand, of equal features a label may point to: more take longer
LENGTH_SIDES: tuple[tuple[PaperSide, PaperSide], ...] = (("bottom", "top"), ("left", "right"))


# End point of a length, and points of which one must be visible for the end to be seen.
Anchor = tuple[Point, tuple[Point, ...]]


class Placing:
    """Items for the views of one part.

    off_mm: limits of fitted lengths along each axis, 0: general tolerance.
    """

    def __init__(
        self,
        features: SolidFeatures,
        callouts: Callouts,
        projections: Mapping[str, DrawnView],
        off_mm: Sequence[float],
        solid: Any,
    ) -> None:
        self._features, self._callouts = features, callouts
        self._projections, self._off_mm = projections, off_mm
        self._rays = ExactRays(solid)
        self._views = [name for name in projections if name != "picture"]
        self._count: dict[tuple[str, PaperSide], int] = {}

    def items(self, plan: Scheme) -> Iterator[Item]:
        """Yield all items of the views."""
        yield from self._callouts.labels
        for faces, text in plan.other_faces:
            yield self._face_label(faces, text)
        for length in sorted(plan.lengths, key=lambda t: t.value_mm):
            a, b = (self._anchors(length.axis, end) for end in (length.a_mm, length.b_mm))
            yield self._register(self._cheapest(length, a, b))
        for group in plan.rounds:
            yield from self._label(group)
        yield from self._centre_lines(plan)

    def _cheapest(self, length: Span, a: list[Anchor], b: list[Anchor]) -> tuple[float, Linear]:
        """Return the placement of least cost: view and side."""
        options, words = [], length.text(self._off_mm[length.axis])
        for view, along in LENGTH_VIEWS[length.axis].items():
            for side in LENGTH_SIDES[along]:
                (start_cost, start), (end_cost, end) = (
                    self._nearest(view, side, ends) for ends in (a, b)
                )
                crowd = CROWD_COST[along] * self._count.get((view, side), 0)
                item = Linear(view, start, end, side, words)
                options.append((round(start_cost + end_cost + crowd, 6), item))
        return min(options, key=lambda f: f[0])

    def _register(self, best: tuple[float, Linear]) -> Linear:
        item = best[1]
        self._count[item.view, item.side] = self._count.get((item.view, item.side), 0) + 1
        return item

    def _nearest(self, view: str, side: PaperSide, anchors: list[Anchor]) -> tuple[float, Point]:
        """Return cost and point of the cheapest end in a view."""
        projection = self._projections[view]
        (x0, y0), (x1, y1) = projection.box_mm
        flat = projection.view.flat(np.array([point for point, _ in anchors]))
        visible = [projection.shows(witnesses, ON_LINE_MM).any() for _, witnesses in anchors]
        distance = {
            "left": (flat[:, 0] - x0) / (x1 - x0), "right": (x1 - flat[:, 0]) / (x1 - x0),
            "bottom": (flat[:, 1] - y0) / (y1 - y0), "top": (y1 - flat[:, 1]) / (y1 - y0),
        }[side]  # fmt: skip
        cost = HIDDEN_COST * ~np.array(visible) + FAR_COST * distance
        k = int(np.argmin(cost.round(6)))
        return float(cost[k]), anchors[k][0]

    def _anchors(self, axis: int, at_mm: float) -> list[Anchor]:
        """Find ends at a coordinate: corners of faces, centres and sides of rounds, the middle."""
        features = self._features
        anchors: list[Anchor] = [
            (point, (point,))
            for plane in features.planes
            if plane.axis == axis and abs(plane.at_mm - at_mm) < GRID_MM
            for point in map(_point, plane.corners)
        ]
        across = [r for r in (*features.rounds, *features.edges) if r.axis != axis]
        for r in across:
            if abs(r.low_mm[axis] - at_mm) < GRID_MM:
                for end in (r.low_mm, r.high_mm):
                    anchors.append((end, tuple(_sides(r, end))))
            elif abs(abs(r.low_mm[axis] - at_mm) - r.radius_mm) < GRID_MM:
                for end in (r.low_mm, r.high_mm):
                    side = _replace(end, axis, at_mm)
                    anchors.append((side, (side,)))
        if not anchors:  # an axis of the part, or the end of a face of another kind
            low, high = features.low_mm, features.high_mm
            middle = _point([(a + b) / 2 for a, b in zip(low, high, strict=True)])
            for other_axis in {0, 1, 2} - {axis}:
                for bound in (low[other_axis], high[other_axis]):
                    point = _replace(_replace(middle, other_axis, bound), axis, at_mm)
                    anchors.append((point, (point,)))
        return anchors

    def _label(self, group: Rounds) -> Iterator[Item]:
        """Yield a diameter as a length, or a label with an arrow and centre crosses."""
        r = group.first
        fitted = any(abs(d - 2 * r.radius_mm) < 1e-6 for d in self._callouts.fitted)
        if group.about_middle:
            yield self._register(self._diameter(group, fitted))
            return
        text = group.label
        if fitted:
            plain, limits = (toleranced(2 * r.radius_mm, mm) for mm in (0.0, self._off_mm[0]))
            text = text.replace(f"Ø{plain}", f"Ø{limits}", 1)
        axial = AXIAL_VIEWS[r.axis]
        cut = self._callouts.cut_x_mm if axial == "left" else None
        for member in group.members:
            if r.by_diameter and (cut is None or member.high_mm[0] > cut):
                yield from self._cross(axial, np.array(member.high_mm), r.radius_mm)
        yield self._leader(group.members, text)

    def _is_visible(
        self, view: str, point: Point, outward: Field, near_mm: float = ON_LINE_MM + SHEET_CHORD_MM
    ) -> bool:
        """True if a point of the solid lies on a visible line of a view and nothing hides it."""
        projection, cut = self._projections[view], self._callouts.cut_x_mm
        if not projection.shows([point], near_mm)[0]:
            return False
        start = np.array(point) + CLEAR_MM * outward
        hidden_at_mm, _ = self._rays.first(start, projection.view.axes[2])
        if view == "left" and cut is not None:  # the half before the section hides nothing
            kept_mm = point[0] - cut
            return kept_mm > -GRID_MM and hidden_at_mm > kept_mm - CLEAR_MM
        return hidden_at_mm == math.inf

    def _leader(self, rounds: Sequence[Round], text: str) -> Leader:
        """Label equal rounds in a view that shows one: along its axis, else from the side."""
        first, axial = rounds[0], AXIAL_VIEWS[rounds[0].axis]
        for view in sorted(self._views, key=lambda name: name != axial):
            circle, visible = view == axial and first.full_turn, []
            for r in rounds:
                rim = [p for p in _rim(r) if self._is_visible(view, p, _outward(r, p))]
                visible += [r.high_mm] * (2 * len(rim) > RIM_POINTS) if circle else rim
            if visible:
                return _leader_to(view, visible, circle * first.radius_mm, text)
        return Leader(axial, first.point, 0.0, text)

    def _cross(self, view: str, centre: Field, radius_mm: float) -> Iterator[CentreLine]:
        """Yield the cross over a circle; the cutting plane is a centre line already."""
        right, up, _ = (radius_mm * axis for axis in self._projections[view].view.axes)
        yield CentreLine(view, _point(centre - right), _point(centre + right), 1.5)
        cut = self._callouts.cut_x_mm if view == "top" else None
        if cut is None or abs(centre[0] - cut) > 1e-6:
            yield CentreLine(view, _point(centre + up), _point(centre - up), 1.5)

    def _face_label(self, faces: Sequence[OtherFace], text: str) -> Leader:
        """Label equal faces, neither flat nor round, in a view that shows the outline of one."""
        rim = [place for face in faces for place in face.rim]
        for view in self._views:
            visible = [p for p, n in rim if self._is_visible(view, p, np.array(n), OUTLINE_MM)]
            if visible:
                return _leader_to(view, visible, 0.0, text)
        return Leader("front", faces[0].point, 0.0, text)

    def _diameter(self, group: Rounds, fitted: bool) -> tuple[float, Linear]:
        """Place a diameter as a length, preferably in a view from the side."""
        r = group.first
        suffix = group.label.partition(f"Ø{toleranced(2 * r.radius_mm)}")[2]
        options = []
        for across in (i for i in range(3) if i != r.axis):
            suffix = suffix.removeprefix(" through")
            length = Span(across, -r.radius_mm, r.radius_mm, suffix, fitted, prefix="Ø")
            a, b = (
                [_replace(end, across, side_mm) for end in (r.low_mm, r.high_mm)]
                for side_mm in (-r.radius_mm, r.radius_mm)
            )
            cost, item = self._cheapest(length, [(p, (p,)) for p in a], [(p, (p,)) for p in b])
            options.append((cost + FAR_COST * (item.view == AXIAL_VIEWS[r.axis]), item))
        return min(options, key=lambda f: f[0])

    def _centre_lines(self, plan: Scheme) -> Iterator[Item]:
        """Yield axes of rounds seen from the side, and axes of symmetry."""
        cut = self._callouts.cut_x_mm
        places: set[tuple[str, float]] = set()
        for r in self._features.rounds:
            if r.axis != 2 or not r.full_turn:
                continue
            for name, across in (("front", 0), ("left", 1)):
                place = (name, round(r.low_mm[across], 3))
                hidden = name == "left" and cut is not None and abs(r.low_mm[0] - cut) > GRID_MM
                if place not in places and not hidden:
                    places.add(place)
                    yield CentreLine(name, r.low_mm, r.high_mm)
        middles = [(axis, 0.0) for axis in plan.middle if axis < 2]
        if cut is not None and abs(cut) < GRID_MM:
            middles = [(axis, at_mm) for axis, at_mm in middles if axis != 0]
        for axis, at_mm in (*middles, *self._callouts.axes):
            low, high = self._features.low_mm, self._features.high_mm
            a, b = (_replace(end, axis, at_mm) for end in (low, high))
            yield CentreLine("top", a, b)


def _point(p: Sequence[float] | Field) -> Point:
    return float(p[0]), float(p[1]), float(p[2])


def _replace(point: Point, axis: int, at_mm: float) -> Point:
    """Return the point with one coordinate replaced."""
    return _point([at_mm if i == axis else c for i, c in enumerate(point)])


def _sides(r: Round, end: Point) -> Iterator[Point]:
    """Yield four points of the circle at an end."""
    for i in range(3):
        if i != r.axis:
            for sign in (-1, 1):
                yield _replace(end, i, end[i] + sign * r.radius_mm)


def _rim(r: Round) -> list[Point]:
    """Return points around the middle of a round, of an arc near the middle of a face."""
    out = np.eye(3)[r.axis - 1] if r.full_turn else _outward(r, r.point) * (-1 if r.hole else 1)
    centre = _replace(r.low_mm, r.axis, r.point[r.axis])
    across = np.cross(np.eye(3)[r.axis], out)
    reach = math.pi if r.full_turn else math.radians(min(r.turn_deg / 8, 20.0))
    turns = np.linspace(-reach, reach, RIM_POINTS)[:, None]
    return [*map(_point, centre + r.radius_mm * (np.cos(turns) * out + np.sin(turns) * across))]


def _outward(r: Round, point: Point) -> Field:
    """Return the unit normal of a round at a point, away from the solid."""
    normal = np.subtract(point, r.low_mm)
    normal[r.axis] = 0.0
    return np.asarray(normal / np.linalg.norm(normal) * (-1.0 if r.hole else 1.0))


def _leader_to(view: str, points: Sequence[Point], radius_mm: float, text: str) -> Leader:
    """Return a label of equal features, visible at these points."""
    first, *further = points[:: math.ceil(len(points) / MAX_TARGETS)]
    return Leader(view, first, radius_mm, text, tuple(further))
