"""Layout of the dimensions and labels around one view, without overlaps."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise, product
from typing import Any

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
    Text,
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
LABEL_STEP_MM, LABEL_STEPS = 2.6, 16  # between the places tried for a label; up and down
# Of a leader, by hand: through a text, across a leader, across a line, level, on each mm.
TEXT_COST, LEADER_COST, LINE_COST, LEVEL_COST, LENGTH_COST = 1000.0, 200.0, 6.0, 8.0, 0.4
REACH_COST = 0.3  # by hand, on each mm of a label beyond the view: smaller needs larger sheets
MIN_SLOPE = 0.08  # by hand: a flatter leader hides in level lines
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


@dataclass(frozen=True)
class _Label:
    """A label at its place: where its text begins or ends, and its leader, paper mm."""

    text: str
    side: str
    end: Point2
    path: tuple[Point2, Point2, Point2]  # tip, knee, before the text
    rect: Rect


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
    labels: list[_Label] = field(default_factory=list)
    margins: Rect = (0.0, 0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        occupied: list[Rect] = []
        for side in PAPER_SIDES:
            lines = [self._line(i) for i in self.items if isinstance(i, Linear) and i.side == side]
            self.lines[side] = self._levels(side, lines, occupied)
            occupied += [self._rect(side, line) for line in self.lines[side]]
        (width, height), rects = self.size_mm, list(occupied)
        self._place_labels(occupied)
        rects += [label.rect for label in self.labels]
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

    def _place_labels(self, occupied: Sequence[Rect]) -> None:
        """Place each label beside the view, where its leader meets least."""
        import shapely

        width, _ = self.size_mm
        columns = {
            "left": (-2.0, min([-2.0, *(r[0] for r in occupied)])),
            "right": (width + 2.0, max([width + 2.0, *(r[2] for r in occupied)])),
        }
        view = self.projection
        dimension_area = shapely.union_all([shapely.box(*r) for r in occupied])
        sides = [(side, line) for side in PAPER_SIDES for line in self.lines[side]]
        text_area = shapely.union_all([shapely.box(*self._text(*line).box) for line in sides])
        strokes: list[Any] = [stroke for line in sides for stroke in self._strokes(*line)]
        strokes += on_paper((*view.visible, *view.hidden), view, self.scale, (0.0, 0.0))
        pairs = [pair for stroke in strokes for pair in pairwise(np.asarray(stroke).tolist())]
        stroke_tree = shapely.STRtree(shapely.linestrings(pairs))
        leaders = [i for i in self.items if isinstance(i, Leader)]
        for leader in sorted(leaders, key=lambda i: (*self.local(i.point)[::-1], i.text)):
            options = [o for side in columns for o in self._options(leader, side, columns[side])]
            paths = shapely.linestrings([option.path for option in options])
            rects = shapely.box(*np.transpose([option.rect for option in options]))
            cost = TEXT_COST * shapely.intersects(paths, text_area)
            cost += TEXT_COST * shapely.intersects(rects, dimension_area)
            cost += REACH_COST * np.array([max(-o.rect[0], o.rect[2] - width) for o in options])
            cost += LENGTH_COST * shapely.length(paths)
            for shapes in (paths, rects):
                crossings, _ = stroke_tree.query(shapes, predicate="intersects")
                cost += LINE_COST * np.bincount(crossings, minlength=len(options))
            dx, dy = np.abs(np.diff([o.path[:2] for o in options], axis=1)[:, 0]).T
            cost += LEVEL_COST * (dy < MIN_SLOPE * dx)
            for label in self.labels:
                cost += LEADER_COST * shapely.intersects(paths, shapely.linestrings(label.path))
                box = shapely.box(*label.rect).buffer((TEXT_LINE_MM + 1.0 - TEXT_MM) / 2)
                cost += TEXT_COST * (
                    shapely.intersects(rects, box) | shapely.intersects(paths, box)
                )
                cost += TEXT_COST * shapely.intersects(shapely.linestrings(label.path), rects)
            self.labels.append(options[int(np.argmin(cost.round(6)))])

    def _options(self, leader: Leader, side: str, columns: Sequence[float]) -> list[_Label]:
        """Return the places for a label on one side."""
        sign = -1.0 if side == "left" else 1.0
        width = text_width_mm(leader.text)
        steps = sorted(range(-LABEL_STEPS, LABEL_STEPS + 1), key=abs)
        options = []
        for point in (leader.point, *leader.alternatives):
            cx, cy = self.local(point)
            for column, step in product(sorted(set(columns)), steps):
                x = column + sign * LABEL_COLUMN_MM
                y = cy - LABEL_RISE_MM + LABEL_STEP_MM * step
                knee = x - sign * 2.5, y - TEXT_MM / 2
                dx, dy = knee[0] - cx, knee[1] - cy
                rim = leader.radius_mm * self.scale / math.hypot(dx, dy)
                path = (cx + dx * rim, cy + dy * rim), knee, (x - sign * 0.8, knee[1])
                rect = min(x, x + sign * width), y - TEXT_MM, max(x, x + sign * width), y
                options.append(_Label(leader.text, side, (x, y), path, rect))
        return options

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
        for label in self.labels:
            path = [page_point(*point) for point in label.path]
            page.path([path], "leader")
            page.arrow(path[0], (path[0][0] - path[1][0], path[0][1] - path[1][1]))
            anchor = "end" if label.side == "left" else "start"
            page.text(page_point(*label.end), label.text, TEXT_MM, anchor)
        if self.heading:
            middle = page_point(self.size_mm[0] / 2, -self.margins[1] + TITLE_MM)
            page.text(middle, self.heading, TITLE_MM, "middle")

    def _strokes(self, side: PaperSide, line: _Line) -> list[list[Point2]]:
        """Return the extension lines and the dimension line, in the view's frame."""
        across = self._across(side, line.level)
        overrun = LINE_OVERRUN_MM if side in ("bottom", "right") else -LINE_OVERRUN_MM
        strokes = [[(line.span[0], across), (line.span[1], across)]]
        for point in (line.item.a, line.item.b):
            along, start = self.local(point)[:: 1 if side in ("top", "bottom") else -1]
            gap = 0.6 if across > start else -0.6
            strokes.append([(along, start + gap), (along, across + 2 * overrun)])
        return [[_to_view(side, *point) for point in stroke] for stroke in strokes]

    def _text(self, side: PaperSide, line: _Line) -> Text:
        """Return the text of a dimension, in the view's frame."""
        place = _to_view(side, line.text_at, self._across(side, line.level) - 1.0)
        upright = side in ("left", "right")
        return Text(place, line.item.text, TEXT_MM, "middle", upright)

    def _draw_line(self, page: DrawingPage, origin: Point2, side: PaperSide, line: _Line) -> None:
        flat = side in ("top", "bottom")
        across = self._across(side, line.level)

        def page_point(along: float, over: float) -> Point2:
            x, y = _to_view(side, along, over)
            return origin[0] + x, origin[1] + y

        for stroke in self._strokes(side, line):
            page.path(np.add(stroke, origin)[None], "thin")
        sign = 1.0 if line.inside else -1.0
        for end, direction in ((line.low, -sign), (line.high, sign)):
            page.arrow(page_point(end, across), (direction, 0.0) if flat else (0.0, direction))
        middle = page_point(line.text_at, across - 1.0)
        page.text(middle, line.item.text, anchor="middle", upright=not flat)

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


def _to_view(side: PaperSide, along: float, over: float) -> Point2:
    """Return x, y of a point along and across the dimension lines of a side."""
    return (along, over) if side in ("top", "bottom") else (over, along)


def on_paper(lines: Sequence[Field], view: DrawnView, scale: float, corner: Point2) -> list[Field]:
    """Map lines of a view's plane to paper, the upper left corner of its box to `corner`."""
    (x0, _), (_, y1) = view.box_mm
    return [np.add(corner, (line - (x0, y1)) * (scale, -scale)) for line in lines]
