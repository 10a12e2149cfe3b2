"""Where the lengths and labels of a scheme stand: which view shows best what each one ends on.

A length goes to the view and the side of it where both of its ends are seen, near the edge, and not
many others stand yet; an end that is hidden counts most. A label goes to the view that looks along
its round.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Literal

import numpy as np

from deltact_fab.common import Field, Point

from ..features import OtherFace, Round, SolidFeatures
from .dimensioning import Callouts, CentreLine, Item, Leader, Linear, Side, Told, toleranced
from .projection import DrawnView
from .scheme import SAME_MM, Rounds, Scheme

# The views in which a length along an axis lies across or upright, the better one first.
SEEN_IN = ({"top": 0, "front": 0}, {"top": 1, "left": 0}, {"front": 1, "left": 1})
ALONG = ("left", "front", "top")  # the view that looks along an axis
NEAR_MM = 2e-3  # of a drawn line
HIDDEN, FAR = 10.0, 6.0
CROWDED = (2.0, 0.7)  # a level more across, and upright: a sheet is wider than it is high
SIDES: tuple[tuple[Side, Side], ...] = (("bottom", "top"), ("left", "right"))


# A point on which a length may end, and the points of which one shows that it is seen.
Anchor = tuple[Point, tuple[Point, ...]]


class Placing:
    """Items for the views of one part.

    off_mm: what a fitted length may be off along each axis, 0 where the general tolerance holds.
    """

    def __init__(
        self,
        found: SolidFeatures,
        said: Callouts,
        drawn: Mapping[str, DrawnView],
        off_mm: Sequence[float],
    ) -> None:
        self._found, self._said, self._drawn, self._off_mm = found, said, drawn, off_mm
        self._count: dict[tuple[str, Side], int] = {}

    def items(self, plan: Scheme) -> Iterator[Item]:
        """All that stands around the views."""
        yield from self._said.labels
        for alike, words in plan.others:
            yield self._of_face(alike, words)
        for length in sorted(plan.lengths, key=lambda t: t.value_mm):
            a, b = (self._anchors(length.axis, end) for end in (length.a_mm, length.b_mm))
            yield self._taken(self._best(length, a, b))
        for group in plan.rounds:
            yield from self._label(group)
        yield from self._centre_lines(plan)

    def _best(self, told: Told, a: list[Anchor], b: list[Anchor]) -> tuple[float, Linear]:
        """The length in the view and on the side that cost least."""
        found, words = [], told.words(self._off_mm[told.axis])
        for view, along in SEEN_IN[told.axis].items():
            for side in SIDES[along]:
                (one_cost, one), (other_cost, other) = (
                    self._nearest(view, side, ends) for ends in (a, b)
                )
                crowd = CROWDED[along] * self._count.get((view, side), 0)
                item = Linear(view, one, other, side, words)
                found.append((round(one_cost + other_cost + crowd, 6), item))
        return min(found, key=lambda f: f[0])

    def _taken(self, best: tuple[float, Linear]) -> Linear:
        item = best[1]
        self._count[item.view, item.side] = self._count.get((item.view, item.side), 0) + 1
        return item

    def _nearest(self, view: str, side: Side, anchors: Sequence[Anchor]) -> tuple[float, Point]:
        """The cheapest end in a view: its cost and itself."""
        drawn = self._drawn[view]
        (x0, y0), (x1, y1) = drawn.box_mm
        flat = drawn.view.flat(np.array([at for at, _ in anchors]))
        seen = [drawn.shows(drawn.view.flat(np.array(by)), NEAR_MM).any() for _, by in anchors]
        away = {
            "left": (flat[:, 0] - x0) / (x1 - x0), "right": (x1 - flat[:, 0]) / (x1 - x0),
            "bottom": (flat[:, 1] - y0) / (y1 - y0), "top": (y1 - flat[:, 1]) / (y1 - y0),
        }[side]  # fmt: skip
        cost = HIDDEN * ~np.array(seen) + FAR * away
        k = int(np.argmin(cost.round(6)))
        return float(cost[k]), anchors[k][0]

    def _anchors(self, axis: int, at_mm: float) -> list[Anchor]:
        """Corners of faces and centres of rounds at a coordinate; sides of rounds; the middle."""
        found = self._found
        anchors: list[Anchor] = [
            (point, (point,))
            for plane in found.planes
            if plane.axis == axis and abs(plane.at_mm - at_mm) < SAME_MM
            for point in map(_point, plane.corners)
        ]
        across = [r for r in (*found.rounds, *found.edges) if r.axis != axis]
        for r in across:
            if abs(r.low_mm[axis] - at_mm) < SAME_MM:
                for end in (r.low_mm, r.high_mm):
                    anchors.append((end, tuple(_sides(r, end))))
            elif abs(abs(r.low_mm[axis] - at_mm) - r.radius_mm) < SAME_MM:
                for end in (r.low_mm, r.high_mm):
                    side = _moved(end, axis, at_mm)
                    anchors.append((side, (side,)))
        if not anchors:  # an axis of the part, or the end of a face of another kind
            low, high = found.low_mm, found.high_mm
            middle = _point([(a + b) / 2 for a, b in zip(low, high, strict=True)])
            for other in {0, 1, 2} - {axis}:
                for bound in (low[other], high[other]):
                    point = _moved(_moved(middle, other, bound), axis, at_mm)
                    anchors.append((point, (point,)))
        return anchors

    def _label(self, group: Rounds) -> Iterator[Item]:
        """A diameter across, or a label with an arrow and crosses over the centres."""
        r = group.first
        fitted = any(abs(d - 2 * r.radius_mm) < 1e-6 for d in self._said.fitted)
        if group.about_middle:
            yield self._taken(self._diameter(group, fitted))
            return
        view, drawn = ALONG[r.axis], self._drawn[ALONG[r.axis]]
        words = group.words
        if fitted:
            said, with_limits = (toleranced(2 * r.radius_mm, off) for off in (0.0, self._off_mm[0]))
            words = words.replace(f"Ø{said}", f"Ø{with_limits}", 1)
        if r.turn_deg > 180:
            for one in group.alike:
                yield from self._cross(view, np.array(one.high_mm), r.radius_mm)
        (x0, _), (x1, _) = drawn.box_mm

        def cost(one: Round) -> tuple[float, float]:
            u, v = drawn.view.flat(one.point if one.turn_deg < 360 else one.high_mm)
            shown = drawn.shows(drawn.view.flat(np.array(list(_sides(one, one.high_mm)))), NEAR_MM)
            return HIDDEN * (not shown.any()) + FAR * min(u - x0, x1 - u) / (x1 - x0), -v

        nearest = min(group.alike, key=cost)
        u = drawn.view.flat(nearest.high_mm)[0]
        side: Literal["left", "right"] = "right" if x1 - u <= u - x0 + 1e-6 else "left"
        if nearest.turn_deg < 180:
            yield Leader(view, nearest.point, 0, words, side)
        else:
            yield Leader(view, nearest.high_mm, nearest.radius_mm, words, side)

    def _cross(self, view: str, centre: Field, radius_mm: float) -> Iterator[CentreLine]:
        """Over a circle; the cutting plane is a centre line already."""
        right, up, _ = (radius_mm * axis for axis in self._drawn[view].view.axes)
        yield CentreLine(view, _point(centre - right), _point(centre + right), 1.5)
        cut = self._said.cut_x_mm if view == "top" else None
        if cut is None or abs(centre[0] - cut) > 1e-6:
            yield CentreLine(view, _point(centre + up), _point(centre - up), 1.5)

    def _of_face(self, alike: Sequence[OtherFace], words: str) -> Leader:
        """A label with an arrow to one of equal faces of another kind."""
        drawn = self._drawn["front"]
        (x0, _), (x1, _) = drawn.box_mm
        right = 2 * drawn.view.flat(alike[0].point)[0] >= x0 + x1
        return Leader("front", alike[0].point, 0, words, "right" if right else "left")

    def _diameter(self, group: Rounds, fitted: bool) -> tuple[float, Linear]:
        """A diameter as a length, in a view from the side where one shows both of its ends."""
        r = group.first
        after = group.words.partition(f"Ø{toleranced(2 * r.radius_mm)}")[2]
        found = []
        for across in (i for i in range(3) if i != r.axis):
            after = after.removeprefix(" through")
            told = Told(across, -r.radius_mm, r.radius_mm, after, fitted, before="Ø")
            a, b = (
                [_moved(end, across, at) for end in (r.low_mm, r.high_mm)]
                for at in (-r.radius_mm, r.radius_mm)
            )
            cost, item = self._best(told, [(p, (p,)) for p in a], [(p, (p,)) for p in b])
            found.append((cost + FAR * (item.view == ALONG[r.axis]), item))
        return min(found, key=lambda f: f[0])

    def _centre_lines(self, plan: Scheme) -> Iterator[Item]:
        """Axes of rounds seen from the side, and the middle of what is even about it."""
        cut = self._said.cut_x_mm
        said: set[tuple[str, float]] = set()
        for r in self._found.rounds:
            if r.axis != 2 or not r.full_turn:
                continue
            for name, across in (("front", 0), ("left", 1)):
                place = (name, round(r.low_mm[across], 3))
                hidden = name == "left" and cut is not None and abs(r.low_mm[0] - cut) > SAME_MM
                if place not in said and not hidden:
                    said.add(place)
                    yield CentreLine(name, r.low_mm, r.high_mm)
        middles = [(axis, 0.0) for axis in plan.middle if axis < 2]
        if cut is not None and abs(cut) < SAME_MM:
            middles = [(axis, at_mm) for axis, at_mm in middles if axis != 0]
        for axis, at_mm in (*middles, *self._said.axes):
            a, b = (_moved(box, axis, at_mm) for box in (self._found.low_mm, self._found.high_mm))
            yield CentreLine("top", a, b)


def _point(p: Sequence[float] | Field) -> Point:
    return float(p[0]), float(p[1]), float(p[2])


def _moved(point: Point, axis: int, at_mm: float) -> Point:
    """The point with one coordinate replaced."""
    return _point([at_mm if i == axis else c for i, c in enumerate(point)])


def _sides(r: Round, end: Point) -> Iterator[Point]:
    """Four points of its circle at an end."""
    for i in range(3):
        if i != r.axis:
            for sign in (-1, 1):
                yield _moved(end, i, end[i] + sign * r.radius_mm)
