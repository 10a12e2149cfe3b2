"""Layout of the dimensions and labels around one view, without overlaps."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from deltact_fab.common import Field, Point, Point2

from .dimensioning import CentreLine, Item, Leader, Linear, PaperSide
from .page import (
    ARROW_HEAD_MM,
    TEXT_LINE_MM,
    TEXT_MM,
    TITLE_MM,
    DrawingPage,
    Rect,
    overlap,
    text_width_mm,
)
from .projection import DrawnView

PAPER_SIDES: tuple[PaperSide, ...] = ("left", "right", "top", "bottom")
# By hand, paper mm: smaller values crowd the texts, larger ones need a larger sheet.
FIRST_LEVEL_MM = 9.0  # from the view to its first dimension line
NEXT_LEVEL_MM = 7.0  # from one dimension line to the next
CUT_ROOM_MM = 7.0  # for the letters of a cutting plane
LABEL_COLUMN_MM = 7.0  # from the outermost dimension to the labels of leaders
LABEL_RISE_MM = 3.0  # label over its arrow's tip; a level leader would hide in extension lines
ARROW_TAIL_MM = 5.0  # line behind an arrow that points inwards from outside
LINE_OVERRUN_MM = 0.7  # half of an extension line's length beyond the dimension line


@dataclass(frozen=True)
class _Line:
    """A linear dimension on its level: its extent along its side, paper mm."""

    item: Linear
    low: float
    high: float
    text_at: float
    inside: bool  # arrows inside
    span: tuple[float, float]
    level: int = 0


@dataclass
class ArrangedView:
    """One view on paper with its items.

    margins: room of the items around the view's box: left, top, right, bottom, paper mm.
    """

    projection: DrawnView
    scale: float
    items: Sequence[Item]
    cut_x: float | None = None  # on the model's plane, where this view shows the cutting plane
    heading: str = ""
    lines: dict[PaperSide, list[_Line]] = field(default_factory=dict)
    labels: list[tuple[Leader, float, float]] = field(default_factory=list)
    margins: Rect = (0.0, 0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        occupied: list[Rect] = []
        for side in PAPER_SIDES:
            lines = [self._line(i) for i in self.items if isinstance(i, Linear) and i.side == side]
            self.lines[side] = self._levels(side, lines, occupied)
            occupied += [self._rect(side, line) for line in self.lines[side]]
        (width, height), rects = self.size_mm, list(occupied)
        for side in ("left", "right"):
            edge = max((r[2] - width if side == "right" else -r[0] for r in occupied), default=2.0)
            x = width + edge + LABEL_COLUMN_MM if side == "right" else -edge - LABEL_COLUMN_MM
            for leader, y in self._column(side):
                self.labels.append((leader, x, y))
                text_mm = text_width_mm(leader.text)
                x_text = x if side == "right" else x - text_mm
                rects.append((x_text, y - TEXT_MM, x_text + text_mm, y))
        cut_room = CUT_ROOM_MM if self.cut_x is not None else 0.0
        rects.append((-2.0, -cut_room - 2, width + 2, height + cut_room + 2))
        low, high = min(r[1] for r in rects), max(r[3] for r in rects)
        self.margins = (
            -min(r[0] for r in rects), (7.0 if self.heading else 0.0) - low,
            max(r[2] for r in rects) - width, high - height,
        )  # fmt: skip

    def extent(self, corner: Point2) -> Rect:
        """Rectangle of the view with all its items, for the view's upper left corner."""
        (x, y), (w, h), (left_mm, top_mm, right_mm, bottom_mm) = corner, self.size_mm, self.margins
        return x - left_mm, y - top_mm, x + w + right_mm, y + h + bottom_mm

    @property
    def size_mm(self) -> Point2:
        """Width and height of the view itself on paper."""
        (x0, y0), (x1, y1) = self.projection.box_mm
        return (x1 - x0) * self.scale, (y1 - y0) * self.scale

    def local(self, point: Point) -> Point2:
        """Project a point of the part to paper, from the view's upper left corner, y down."""
        u, v = (float(c) for c in self.projection.view.flat(point))
        (x0, _), (_, y1) = self.projection.box_mm
        return (u - x0) * self.scale, (y1 - v) * self.scale

    def _across(self, side: PaperSide, level: int) -> float:
        """Coordinate of a level's dimension line, from the view's upper left corner."""
        cut = CUT_ROOM_MM if self.cut_x is not None and side in ("top", "bottom") else 0.0
        offset, (width, height) = FIRST_LEVEL_MM + cut + NEXT_LEVEL_MM * level, self.size_mm
        return {"top": -offset, "bottom": height + offset, "left": -offset,
                "right": width + offset}[side]  # fmt: skip

    def _rect(self, side: PaperSide, line: _Line) -> Rect:
        """Rectangle of a dimension line and its text, which stands above it or to its left."""
        across, (a, b) = self._across(side, line.level), line.span
        low, high = across - TEXT_MM - 1.5, across + 1.5
        return (a, low, b, high) if side in ("top", "bottom") else (low, a, high, b)

    def _levels(self, side: PaperSide, lines: list[_Line], occupied: list[Rect]) -> list[_Line]:
        """Assign levels: short dimensions nearest to the view, without overlaps."""
        levelled: list[_Line] = []
        for line in sorted(lines, key=lambda i: (round(i.high - i.low, 6), i.low, i.item.text)):
            a, b = line.span
            overlapping = [p.level for p in levelled if p.span[0] < b + 1.5 and a < p.span[1] + 1.5]
            line = replace(line, level=1 + max(overlapping) if overlapping else 0)
            # A dimension of the neighbouring side may reach round the corner.
            while any(overlap(self._rect(side, line), rect) for rect in occupied):
                line = replace(line, level=line.level + 1)
            levelled.append(line)
        return levelled

    def _line(self, item: Linear) -> _Line:
        along = 0 if item.side in ("top", "bottom") else 1
        low, high = sorted((self.local(item.a)[along], self.local(item.b)[along]))
        width, room = text_width_mm(item.text) + 1.0, high - low
        inside = room >= 2 * ARROW_HEAD_MM[0] + 2.0 and room >= width + 2.0
        span = (low, high) if inside else (low - ARROW_TAIL_MM, high + ARROW_TAIL_MM)
        middle = (low + high) / 2
        if room >= width:
            return _Line(item, low, high, middle, inside, span)
        # Beside the arrows, away from the view's middle.
        if middle < self.size_mm[along] / 2 - 1e-6:
            text_centre = low - ARROW_TAIL_MM - width / 2
            return _Line(item, low, high, text_centre, False, (text_centre - width / 2, span[1]))
        text_centre = high + ARROW_TAIL_MM + width / 2
        return _Line(item, low, high, text_centre, False, (span[0], text_centre + width / 2))

    def _column(self, side: PaperSide) -> Iterable[tuple[Leader, float]]:
        """Yield the labels of one side from the top down, with their base lines' y."""
        leaders = [i for i in self.items if isinstance(i, Leader) and i.side == side]
        y_min = -math.inf
        for leader in sorted(leaders, key=lambda i: self.local(i.point)[::-1]):
            y = max(self.local(leader.point)[1] - LABEL_RISE_MM, y_min)
            yield leader, y
            y_min = y + TEXT_LINE_MM + 1.0

    def draw(self, page: DrawingPage, name: str, origin: Point2) -> None:
        """Draw the view with its dimensions, labels and centre lines; origin: upper left corner."""
        (ox, oy), view = origin, self.projection
        page.group = f"view-{name}"
        for loops in view.hatched:
            page.hatch(on_paper(loops, view, self.scale, origin))
        for style in ("hidden", "smooth", "visible"):
            page.path(on_paper(getattr(view, style), view, self.scale, origin), style)
        page.group = f"dimensions-{name}"

        def page_point(x: float, y: float) -> Point2:
            return ox + x, oy + y

        for item in self.items:
            if isinstance(item, CentreLine):
                (x0, y0), (x1, y1) = self.local(item.a), self.local(item.b)
                share = item.beyond_mm / math.hypot(x1 - x0, y1 - y0)
                dx, dy = (x1 - x0) * share, (y1 - y0) * share
                page.line(page_point(x0 - dx, y0 - dy), page_point(x1 + dx, y1 + dy), "centre")
        self._draw_cut(page, origin)
        for side in self.lines:
            for line in self.lines[side]:
                self._draw_line(page, origin, side, line)
        for leader, x, y in self.labels:
            self._draw_label(page, origin, leader, page_point(x, y))
        if self.heading:
            middle = page_point(self.size_mm[0] / 2, -self.margins[1] + TITLE_MM)
            page.text(middle, self.heading, TITLE_MM, "middle")

    def _draw_line(self, page: DrawingPage, origin: Point2, side: PaperSide, line: _Line) -> None:
        flat = side in ("top", "bottom")
        across = self._across(side, line.level)
        overrun = LINE_OVERRUN_MM if side in ("bottom", "right") else -LINE_OVERRUN_MM

        def page_point(along: float, over: float) -> Point2:
            x, y = (along, over) if flat else (over, along)
            return origin[0] + x, origin[1] + y

        for point in (line.item.a, line.item.b):
            x, y = self.local(point)
            along, start = (x, y) if flat else (y, x)
            gap = 0.6 if across > start else -0.6
            page.line(page_point(along, start + gap), page_point(along, across + 2 * overrun))
        sign = 1.0 if line.inside else -1.0
        page.line(page_point(line.span[0], across), page_point(line.span[1], across))
        for end, direction in ((line.low, -sign), (line.high, sign)):
            page.arrow(page_point(end, across), (direction, 0.0) if flat else (0.0, direction))
        middle = page_point(line.text_at, across - 1.0)
        page.text(middle, line.item.text, anchor="middle", upright=not flat)

    def _draw_label(self, page: DrawingPage, origin: Point2, leader: Leader, end: Point2) -> None:
        """Draw a label and its leader, which ends in an arrow at the feature's rim."""
        sign = -1.0 if leader.side == "left" else 1.0
        knee = (end[0] - sign * 2.5, end[1] - TEXT_MM / 2)
        cx, cy = (o + c for o, c in zip(origin, self.local(leader.point), strict=True))
        dx, dy = knee[0] - cx, knee[1] - cy
        rim_share = leader.radius_mm * self.scale / math.hypot(dx, dy)
        tip = (cx + dx * rim_share, cy + dy * rim_share)
        page.path([[tip, knee, (end[0] - sign * 0.8, knee[1])]], "thin")
        page.arrow(tip, (-dx, -dy))
        page.text(end, leader.text, TEXT_MM, "end" if leader.side == "left" else "start")

    def _draw_cut(self, page: DrawingPage, origin: Point2) -> None:
        """Draw the cutting plane (ISO 128-44): wide ends, arrows in the viewing direction."""
        if self.cut_x is None:
            return
        x = origin[0] + (self.cut_x - self.projection.box_mm[0][0]) * self.scale
        top, bottom = origin[1], origin[1] + self.size_mm[1]
        page.line((x, top - 2), (x, bottom + 2), "cut")
        for y, base in ((top, top - 3.2), (bottom, bottom + 6.7)):
            outward = -1.0 if y == top else 1.0
            page.line((x, y + outward), (x, y + 5 * outward), "visible")
            page.line((x - 5.0, y + 5 * outward), (x, y + 5 * outward))
            page.arrow((x, y + 5 * outward), (1.0, 0.0))
            page.text((x - 5.8, base), "A", TITLE_MM, "end")


def on_paper(lines: Sequence[Field], view: DrawnView, scale: float, corner: Point2) -> list[Field]:
    """Map lines of a view's plane to paper, the upper left corner of its box to `corner`."""
    (x0, _), (_, y1) = view.box_mm
    return [np.add(corner, (line - (x0, y1)) * (scale, -scale)) for line in lines]
