"""How the dimensions and labels of one view are arranged around it, so that none overlap."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

from ...aliases import Point2, Vector
from .dimensioning import Axis, Centres, Detail, Item, Leader, Linear, Side, shown
from .page import ARROW_MM, SMALL_MM, DrawingPage, Rect, meet, text_width_mm
from .projection import View
from .sheet import LINE_MM

SIDES: tuple[Side, ...] = ("left", "right", "top", "bottom")
FIRST_MM = 9.0  # from the view to its first dimension line
NEXT_MM = 7.0
CUT_ROOM_MM = 7.0  # for the letters of a cutting plane
COLUMN_MM = 7.0  # from the outermost dimension to the labels of leaders
# Of a label's base line from what its leader points to: slanted, for a level leader would lie on
# extension lines; the first is taken that crosses no dimension's text.
RISES_MM = (-3.0, 5.5, -8.0, 10.5, -13.0, 15.5, -18.0, 20.5)
AIR_MM = 0.6  # between a leader and a text
TAIL_MM = 5.0  # of arrows that point inwards from outside
SHORT_MM = 0.7
LETTER_MM = 6.0  # around a detail's circle
# Of a label's parts behind its words: the frame's height, the check mark's width, the gaps.
FRAME_MM = 4.5
CHECK_MM = 3.2
PART_GAP_MM = 2.0


@dataclass(frozen=True)
class _Line:
    """A linear dimension on its level: where it stands along its side, in paper mm."""

    item: Linear
    words: str
    low: float
    high: float
    text_at: float
    inside: bool  # arrows inside
    takes: tuple[float, float]
    level: int = 0


@dataclass
class ArrangedView:
    """One view on paper: its items, and the room that they take beyond the view's box.

    box_mm: lower left and upper right corner on the model's plane. margins: left, top, right,
    bottom, paper mm.
    """

    name: str
    view: View
    scale: float
    box_mm: tuple[Point2, Point2]
    items: Sequence[Item]
    cut_x: float | None = None  # on the model's plane, where this view shows the cutting plane
    heading: str = ""
    details: Sequence[Detail] = ()  # whose circles and letters stand in this view
    lines: dict[Side, list[_Line]] = field(default_factory=dict)
    labels: list[tuple[Leader, float, float]] = field(default_factory=list)
    margins: Rect = (0.0, 0.0, 0.0, 0.0)
    inner: Rect = (0.0, 0.0, 0.0, 0.0)  # the margins without the labels

    def __post_init__(self) -> None:
        taken: list[Rect] = []
        for side in SIDES:
            mine = [i for i in self.items if isinstance(i, Linear) and i.side == side]
            self.lines[side] = self._levels(side, [self._line(item) for item in mine], taken)
            taken += [self._rect(side, line) for line in self.lines[side]]
        left, right = self._reach("left"), self._reach("right")
        top, bottom = self._reach("top"), self._reach("bottom")
        for line in self.lines["top"] + self.lines["bottom"]:
            left, right = max(left, -line.takes[0]), max(right, line.takes[1] - self.size_mm[0])
        for line in self.lines["left"] + self.lines["right"]:
            top, bottom = max(top, -line.takes[0]), max(bottom, line.takes[1] - self.size_mm[1])
        inner = (left, right)
        beside: tuple[Literal["left", "right"], ...] = ("left", "right")
        for side in beside:
            room = left if side == "left" else right
            column = self._column(side, room)
            self.labels += column
            if column:
                widest = max(label_width_mm(leader) for leader, _, _ in column)
                if side == "left":
                    left = room + COLUMN_MM + widest
                else:
                    right = room + COLUMN_MM + widest
                top = max(top, SMALL_MM - min(y for _, _, y in column))
                bottom = max(bottom, max(y for _, _, y in column) - self.size_mm[1])
        if self.heading:
            top += 7.0
        for detail in self.details:
            (x, y), reach = self.local(detail.at), detail.radius_mm * self.scale + LETTER_MM
            left, top = max(left, reach - x), max(top, reach - y)
            right = max(right, x + reach - self.size_mm[0])
            bottom = max(bottom, y + reach - self.size_mm[1])
        self.margins = (left, top, right, bottom)
        self.inner = (inner[0], top, inner[1], bottom)
        if self.details:
            self.inner = self.margins

    def taken(self, at: Point2) -> list[Rect]:
        """What the view takes with its dimensions, and each of its labels, in paper mm."""
        (x, y), (w, h), (left, top, right, bottom) = at, self.size_mm, self.inner
        rects = [(x - left, y - top, x + w + right, y + h + bottom)]
        for leader, lx, ly in self.labels:
            wide = label_width_mm(leader)
            low = x + lx - (wide if leader.side == "left" else 0.0)
            rects.append((low, y + ly - SMALL_MM - 1.0, low + wide, y + ly + 1.0))
        return rects

    @property
    def size_mm(self) -> Point2:
        """Width and height of the view itself on paper."""
        (x0, y0), (x1, y1) = self.box_mm
        return (x1 - x0) * self.scale, (y1 - y0) * self.scale

    def local(self, point: Vector) -> Point2:
        """A point of the part on paper, from the view's upper left corner, y downwards."""
        u, v = (float(c) for c in self.view.flat(point))
        return (u - self.box_mm[0][0]) * self.scale, (self.box_mm[1][1] - v) * self.scale

    def _offset(self, side: Side, level: int) -> float:
        cut = CUT_ROOM_MM if self.cut_x is not None and side in ("top", "bottom") else 0.0
        return FIRST_MM + cut + NEXT_MM * level

    def _reach(self, side: Side) -> float:
        """Room that the dimension lines of a side take, with their texts."""
        lines = self.lines[side]
        if not lines:
            return CUT_ROOM_MM + 2 if self.cut_x is not None and side in ("top", "bottom") else 2.0
        text = SMALL_MM + 1.5 if side in ("top", "left") else 1.5
        return self._offset(side, max(line.level for line in lines)) + text

    def _across(self, side: Side, level: int) -> float:
        """Where a dimension line of a level runs, from the view's upper left corner."""
        offset, (width, height) = self._offset(side, level), self.size_mm
        return {"top": -offset, "bottom": height + offset, "left": -offset,
                "right": width + offset}[side]  # fmt: skip

    def _rect(self, side: Side, line: _Line) -> Rect:
        """What a dimension line takes with its text, which stands above it or to its left."""
        across, (a, b) = self._across(side, line.level), line.takes
        low, high = across - SMALL_MM - 1.0, across + 1.0
        return (a, low, b, high) if side in ("top", "bottom") else (low, a, high, b)

    def _levels(self, side: Side, lines: Iterable[_Line], taken: list[Rect]) -> list[_Line]:
        """Short dimensions nearest to the view; none where another one is in its way."""
        placed: list[_Line] = []
        for line in sorted(lines, key=lambda i: (round(i.high - i.low, 6), i.low, i.words)):
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
        words = item.words(self.view)
        width, room = text_width_mm(words) + 1.0, high - low
        inside = room >= 2 * ARROW_MM[0] + 2.0 and room >= width + 2.0
        takes = (low, high) if inside else (low - TAIL_MM, high + TAIL_MM)
        middle = (low + high) / 2
        if room >= width:
            return _Line(item, words, low, high, middle, inside, takes)
        # Beside the arrows, away from the view's middle.
        if middle < self.size_mm[along] / 2 - 1e-6:
            at = low - TAIL_MM - width / 2
            return _Line(item, words, low, high, at, False, (at - width / 2, takes[1]))
        at = high + TAIL_MM + width / 2
        return _Line(item, words, low, high, at, False, (takes[0], at + width / 2))

    def _column(
        self, side: Literal["left", "right"], room: float
    ) -> list[tuple[Leader, float, float]]:
        """Labels of one side with the x at which they begin or end, and their base lines' y."""
        import shapely

        mine = [i for i in self.items if isinstance(i, Leader) and i.side == side]
        if not mine:
            return []
        mine.sort(key=lambda leader: (self.local(leader.at)[1], self.local(leader.at)[0]))
        x = -room - COLUMN_MM if side == "left" else self.size_mm[0] + room + COLUMN_MM
        texts = shapely.union_all([shapely.box(*self._text_rect(li)) for li in self.lines[side]])
        column: list[tuple[Leader, float, float]] = []
        for leader in mine:
            least = column[-1][2] + LINE_MM + 1.0 if column else -math.inf
            wanted = [self.local(leader.at)[1] + rise for rise in RISES_MM]
            wanted = [y for y in wanted if y >= least] or [least]
            free = [
                y
                for y in wanted
                if not texts.intersects(shapely.LineString(self._leader(leader, x, y)))
            ]
            column.append((leader, x, (free or wanted)[0]))
        return column

    def _text_rect(self, line: _Line) -> Rect:
        """What the text of a dimension at the left or right takes."""
        across, half = (
            self._across(line.item.side, line.level),
            text_width_mm(line.words) / 2 + AIR_MM,
        )
        left, right = across - 1.0 - SMALL_MM - AIR_MM, across - 1.0 + AIR_MM
        return left, line.text_at - half, right, line.text_at + half

    def _leader(self, leader: Leader, x: float, y: float) -> tuple[Point2, Point2]:
        """A leader's arrow tip and its knee beside the label that begins or ends at (x, y)."""
        cx, cy = self.local(leader.at)
        way = -1.0 if leader.side == "left" else 1.0
        knee = (x - way * 2.5, y - SMALL_MM / 2)
        dx, dy = knee[0] - cx, knee[1] - cy
        away = leader.radius_mm * self.scale / math.hypot(dx, dy)
        return (cx + dx * away, cy + dy * away), knee

    def draw(self, page: DrawingPage, origin: Point2) -> None:
        """Dimensions, labels and centre lines, the view's upper left corner at `origin`."""
        ox, oy = origin

        def at(x: float, y: float) -> Point2:
            return ox + x, oy + y

        for item in self.items:
            if isinstance(item, Centres):
                for centre in item.at:
                    x, y = self.local(centre)
                    arm = item.radius_mm * self.scale + 1.5
                    page.line(at(x - arm, y), at(x + arm, y), "centre")
                    # The cutting plane is a centre line already.
                    if self.cut_x is None or abs(self.view.flat(centre)[0] - self.cut_x) > 1e-6:
                        page.line(at(x, y - arm), at(x, y + arm), "centre")
            elif isinstance(item, Axis):
                (ax, ay), (bx, by) = self.local(item.a), self.local(item.b)
                length = math.hypot(bx - ax, by - ay)
                dx, dy = (bx - ax) / length * 2, (by - ay) / length * 2
                page.line(at(ax - dx, ay - dy), at(bx + dx, by + dy), "centre")
        self._draw_cut(page, origin)
        for side in self.lines:
            for line in self.lines[side]:
                self._draw_line(page, origin, side, line)
        for leader, x, y in self.labels:
            self._draw_label(page, origin, leader, x, y)
        if self.heading:
            page.text(at(self.size_mm[0] / 2, -self.margins[1] + 3.5), self.heading, 3.5, "middle")

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
        low = min(line.takes[0], line.low) if not line.inside else line.low
        high = max(line.takes[1], line.high) if not line.inside else line.high
        page.line(at(low, across), at(high, across))
        for end, way in ((line.low, -sign), (line.high, sign)):
            page.arrow(at(end, across), (way, 0.0) if flat else (0.0, way))
        page.text(at(line.text_at, across - 1.0), line.words, SMALL_MM, "middle", upright=not flat)

    def _draw_label(
        self, page: DrawingPage, origin: Point2, leader: Leader, x: float, y: float
    ) -> None:
        tip, knee = self._leader(leader, x, y)
        way = -1.0 if leader.side == "left" else 1.0
        points = [tip, knee, (x - way * 0.8, knee[1])]
        page.path([[(origin[0] + px, origin[1] + py) for px, py in points]], "thin")
        page.arrow((origin[0] + tip[0], origin[1] + tip[1]), (tip[0] - knee[0], tip[1] - knee[1]))
        left = x - label_width_mm(leader) if leader.side == "left" else x
        _draw_words(page, (origin[0] + left, origin[1] + y), leader)

    def _draw_cut(self, page: DrawingPage, origin: Point2) -> None:
        """The cutting plane as ISO 128-44 has it: ends wide, arrows the way one looks."""
        if self.cut_x is None:
            return
        x = origin[0] + (self.cut_x - self.box_mm[0][0]) * self.scale
        top, bottom = origin[1], origin[1] + self.size_mm[1]
        page.line((x, top - 2), (x, bottom + 2), "cut")
        for y, base in ((top, top - 3.2), (bottom, bottom + 6.7)):
            away = -1.0 if y == top else 1.0
            page.line((x, y + away), (x, y + 5 * away), "visible")
            page.line((x - 5.0, y + 5 * away), (x, y + 5 * away))
            page.arrow((x, y + 5 * away), (1.0, 0.0))
            page.text((x - 5.8, base), "A", 3.5, "end")


def label_width_mm(leader: Leader) -> float:
    """Width of a leader's words with what stands behind them."""
    parts = [text_width_mm(leader.words)] if leader.words else []
    if leader.flatness_mm:
        parts.append(FRAME_MM + text_width_mm(shown(leader.flatness_mm)) + 2.0)
    if leader.roughness_um:
        parts.append(CHECK_MM + text_width_mm(_roughness(leader)) + 0.5)
    return sum(parts) + PART_GAP_MM * (len(parts) - 1)


def _roughness(leader: Leader) -> str:
    return f"Ra {shown(leader.roughness_um)}"


def _draw_words(page: DrawingPage, at: Point2, leader: Leader) -> None:
    """Words, flatness in its frame and the check mark of a surface's roughness, left to right."""
    x, y = at
    middle = y - SMALL_MM / 2
    if leader.words:
        page.text((x, y), leader.words)
        x += text_width_mm(leader.words) + PART_GAP_MM
    if leader.flatness_mm:
        words = shown(leader.flatness_mm)
        low, high = middle - FRAME_MM / 2, middle + FRAME_MM / 2
        width = FRAME_MM + text_width_mm(words) + 2.0
        page.path([[(x, low), (x + width, low), (x + width, high), (x, high)]], "thin", closed=True)
        page.line((x + FRAME_MM, low), (x + FRAME_MM, high))
        signs = [(0.6, 0.9), (1.8, -0.9), (3.9, -0.9), (2.7, 0.9)]
        page.path([[(x + dx, middle + dy) for dx, dy in signs]], "thin", closed=True)
        page.text((x + FRAME_MM + 1.0, y), words)
        x += width + PART_GAP_MM
    if leader.roughness_um:
        words = _roughness(leader)
        end = x + CHECK_MM + text_width_mm(words) + 0.5
        stroke = [(x, y - 1.2), (x + 1.0, y + 0.6), (x + 3.2, y - 3.2), (end, y - 3.2)]
        page.path([stroke, [(x, y - 1.2), (x + 2.05, y - 1.2)]], "thin")
        page.text((x + CHECK_MM, y), words)
