"""How the dimensions and labels of one view are arranged around it, so that none overlap."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from deltact_fab.common import Field, Point, Point2

from .dimensioning import CentreLine, Item, Leader, Linear, Side
from .page import ARROW_MM, LARGE_MM, LINE_MM, SMALL_MM, DrawingPage, Rect, meet, text_width_mm
from .projection import DrawnView

SIDES: tuple[Side, ...] = ("left", "right", "top", "bottom")
FIRST_MM = 9.0  # from the view to its first dimension line
NEXT_MM = 7.0
CUT_ROOM_MM = 7.0  # for the letters of a cutting plane
COLUMN_MM = 7.0  # from the outermost dimension to the labels of leaders
RISE_MM = 3.0  # of a label over its arrow's tip: a level leader would lie on extension lines
TAIL_MM = 5.0  # of arrows that point inwards from outside
SHORT_MM = 0.7


@dataclass(frozen=True)
class _Line:
    """A linear dimension on its level: where it stands along its side, in paper mm."""

    item: Linear
    low: float
    high: float
    text_at: float
    inside: bool  # arrows inside
    takes: tuple[float, float]
    level: int = 0


@dataclass
class ArrangedView:
    """One view on paper: its items, and the room that they take beyond the view's box.

    margins: left, top, right, bottom, paper mm.
    """

    drawn: DrawnView
    scale: float
    items: Sequence[Item]
    cut_x: float | None = None  # on the model's plane, where this view shows the cutting plane
    heading: str = ""
    lines: dict[Side, list[_Line]] = field(default_factory=dict)
    labels: list[tuple[Leader, float, float]] = field(default_factory=list)
    margins: Rect = (0.0, 0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        taken: list[Rect] = []
        for side in SIDES:
            mine = [i for i in self.items if isinstance(i, Linear) and i.side == side]
            self.lines[side] = self._levels(side, [self._line(item) for item in mine], taken)
            taken += [self._rect(side, line) for line in self.lines[side]]
        (width, height), rects = self.size_mm, list(taken)
        for side in ("left", "right"):
            edge = max((r[2] - width if side == "right" else -r[0] for r in taken), default=2.0)
            x = width + edge + COLUMN_MM if side == "right" else -edge - COLUMN_MM
            for leader, y in self._column(side):
                self.labels.append((leader, x, y))
                wide = text_width_mm(leader.words)
                left = x if side == "right" else x - wide
                rects.append((left, y - SMALL_MM, left + wide, y))
        beyond = CUT_ROOM_MM if self.cut_x is not None else 0.0
        rects.append((-2.0, -beyond - 2, width + 2, height + beyond + 2))
        low, high = min(r[1] for r in rects), max(r[3] for r in rects)
        self.margins = (
            -min(r[0] for r in rects), (7.0 if self.heading else 0.0) - low,
            max(r[2] for r in rects) - width, high - height,
        )  # fmt: skip

    def taken(self, at: Point2) -> Rect:
        """What the view takes with all that is written around it, its corner at a point."""
        (x, y), (w, h), (left, top, right, bottom) = at, self.size_mm, self.margins
        return x - left, y - top, x + w + right, y + h + bottom

    @property
    def size_mm(self) -> Point2:
        """Width and height of the view itself on paper."""
        (x0, y0), (x1, y1) = self.drawn.box_mm
        return (x1 - x0) * self.scale, (y1 - y0) * self.scale

    def local(self, point: Point) -> Point2:
        """A point of the part on paper, from the view's upper left corner, y downwards."""
        u, v = (float(c) for c in self.drawn.view.flat(point))
        (left, _), (_, top) = self.drawn.box_mm
        return (u - left) * self.scale, (top - v) * self.scale

    def _across(self, side: Side, level: int) -> float:
        """Where a dimension line of a level runs, from the view's upper left corner."""
        cut = CUT_ROOM_MM if self.cut_x is not None and side in ("top", "bottom") else 0.0
        offset, (width, height) = FIRST_MM + cut + NEXT_MM * level, self.size_mm
        return {"top": -offset, "bottom": height + offset, "left": -offset,
                "right": width + offset}[side]  # fmt: skip

    def _rect(self, side: Side, line: _Line) -> Rect:
        """What a dimension line takes with its text, which stands above it or to its left."""
        across, (a, b) = self._across(side, line.level), line.takes
        low, high = across - SMALL_MM - 1.5, across + 1.5
        return (a, low, b, high) if side in ("top", "bottom") else (low, a, high, b)

    def _levels(self, side: Side, lines: Iterable[_Line], taken: Sequence[Rect]) -> list[_Line]:
        """Short dimensions nearest to the view; none where another one is in its way."""
        placed: list[_Line] = []
        for line in sorted(lines, key=lambda i: (round(i.high - i.low, 6), i.low, i.item.words)):
            a, b = line.takes
            met = [p.level for p in placed if p.takes[0] < b + 1.5 and a < p.takes[1] + 1.5]
            line = replace(line, level=1 + max(met) if met else 0)
            # Round a corner of the view another side's may stand.
            while any(meet(self._rect(side, line), rect) for rect in taken):
                line = replace(line, level=line.level + 1)
            placed.append(line)
        return placed

    def _line(self, item: Linear) -> _Line:
        along = 0 if item.side in ("top", "bottom") else 1
        low, high = sorted((self.local(item.a)[along], self.local(item.b)[along]))
        width, room = text_width_mm(item.words) + 1.0, high - low
        inside = room >= 2 * ARROW_MM[0] + 2.0 and room >= width + 2.0
        takes = (low, high) if inside else (low - TAIL_MM, high + TAIL_MM)
        middle = (low + high) / 2
        if room >= width:
            return _Line(item, low, high, middle, inside, takes)
        # Beside the arrows, away from the view's middle.
        if middle < self.size_mm[along] / 2 - 1e-6:
            at = low - TAIL_MM - width / 2
            return _Line(item, low, high, at, False, (at - width / 2, takes[1]))
        at = high + TAIL_MM + width / 2
        return _Line(item, low, high, at, False, (takes[0], at + width / 2))

    def _column(self, side: Side) -> Iterable[tuple[Leader, float]]:
        """Labels of one side from the top down, with their base lines' y."""
        mine = [i for i in self.items if isinstance(i, Leader) and i.side == side]
        least = -math.inf
        for leader in sorted(mine, key=lambda i: (self.local(i.at)[1], self.local(i.at)[0])):
            y = max(self.local(leader.at)[1] - RISE_MM, least)
            yield leader, y
            least = y + LINE_MM + 1.0

    def draw(self, page: DrawingPage, name: str, origin: Point2) -> None:
        """The view, its dimensions, labels and centre lines, its upper left corner at `origin`."""
        ox, oy = origin
        page.group = f"view-{name}"
        for loops in self.drawn.hatched:
            page.hatch(on_paper(loops, self.drawn, self.scale, origin))
        for style in ("hidden", "smooth", "visible"):
            page.path(on_paper(getattr(self.drawn, style), self.drawn, self.scale, origin), style)
        page.group = f"dimensions-{name}"

        def at(x: float, y: float) -> Point2:
            return ox + x, oy + y

        for item in self.items:
            if isinstance(item, CentreLine):
                (ax, ay), (bx, by) = self.local(item.a), self.local(item.b)
                share = item.beyond_mm / math.hypot(bx - ax, by - ay)
                dx, dy = (bx - ax) * share, (by - ay) * share
                page.line(at(ax - dx, ay - dy), at(bx + dx, by + dy), "centre")
        self._draw_cut(page, origin)
        for side in self.lines:
            for line in self.lines[side]:
                self._draw_line(page, origin, side, line)
        for leader, x, y in self.labels:
            self._draw_label(page, origin, leader, at(x, y))
        if self.heading:
            middle = at(self.size_mm[0] / 2, -self.margins[1] + LARGE_MM)
            page.text(middle, self.heading, LARGE_MM, "middle")

    def _draw_line(self, page: DrawingPage, origin: Point2, side: Side, line: _Line) -> None:
        flat = side in ("top", "bottom")
        across = self._across(side, line.level)
        beyond = SHORT_MM if side in ("bottom", "right") else -SHORT_MM

        def at(along: float, over: float) -> Point2:
            x, y = (along, over) if flat else (over, along)
            return origin[0] + x, origin[1] + y

        for point in (line.item.a, line.item.b):
            x, y = self.local(point)
            along, start = (x, y) if flat else (y, x)
            gap = 0.6 if across > start else -0.6
            page.line(at(along, start + gap), at(along, across + 2 * beyond))
        sign = 1.0 if line.inside else -1.0
        page.line(at(line.takes[0], across), at(line.takes[1], across))
        for end, way in ((line.low, -sign), (line.high, sign)):
            page.arrow(at(end, across), (way, 0.0) if flat else (0.0, way))
        page.text(
            at(line.text_at, across - 1.0), line.item.words, SMALL_MM, "middle", upright=not flat
        )

    def _draw_label(self, page: DrawingPage, origin: Point2, leader: Leader, at: Point2) -> None:
        """The words, and a leader with an arrow to the rim of what they tell."""
        way = -1.0 if leader.side == "left" else 1.0
        knee = (at[0] - way * 2.5, at[1] - SMALL_MM / 2)
        cx, cy = (o + c for o, c in zip(origin, self.local(leader.at), strict=True))
        dx, dy = knee[0] - cx, knee[1] - cy
        away = leader.radius_mm * self.scale / math.hypot(dx, dy)
        tip = (cx + dx * away, cy + dy * away)
        page.path([[tip, knee, (at[0] - way * 0.8, knee[1])]], "thin")
        page.arrow(tip, (-dx, -dy))
        page.text(at, leader.words, SMALL_MM, "end" if leader.side == "left" else "start")

    def _draw_cut(self, page: DrawingPage, origin: Point2) -> None:
        """The cutting plane as ISO 128-44 has it: ends wide, arrows the way one looks."""
        if self.cut_x is None:
            return
        x = origin[0] + (self.cut_x - self.drawn.box_mm[0][0]) * self.scale
        top, bottom = origin[1], origin[1] + self.size_mm[1]
        page.line((x, top - 2), (x, bottom + 2), "cut")
        for y, base in ((top, top - 3.2), (bottom, bottom + 6.7)):
            away = -1.0 if y == top else 1.0
            page.line((x, y + away), (x, y + 5 * away), "visible")
            page.line((x - 5.0, y + 5 * away), (x, y + 5 * away))
            page.arrow((x, y + 5 * away), (1.0, 0.0))
            page.text((x - 5.8, base), "A", LARGE_MM, "end")


def on_paper(lines: Sequence[Field], drawn: DrawnView, scale: float, at: Point2) -> list[Field]:
    """Lines of a view's plane on paper: the upper left corner of the view's box comes to `at`."""
    (left, _), (_, top) = drawn.box_mm
    return [np.add(at, (line - (left, top)) * (scale, -scale)) for line in lines]
