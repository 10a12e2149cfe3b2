"""The dimensioned drawing of a part: ISO first angle, hidden lines removed.

    front    left (or section A-A)
    top      picture, notes, title block

Seen from the front (along +y), the view from above stands below it and the view from the left to
its right (ISO 5456-2). What is dimensioned is in drafting/, as data.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import combinations
from typing import Any

import numpy as np

from ...errors import InputError
from ..dimensions import Design
from ..kernel import guarded, require
from ..part import Part
from .arrangement import Arranged
from .detail import Circle2
from .dimensioning import Detail
from .items import Callouts
from .page import LARGE_MM, SMALL_MM, Page, Point2, Rect, meet, text_width_mm
from .projection import Points, Projected, View, project, sampled
from .sheet import BORDER_MM, LINE_MM, SHEETS, Title, block_rect, draw_frame, wrapped

# ISO 5455, the largest first.
DETAIL_SCALES = {"20:1": 20.0, "10:1": 10.0, "5:1": 5.0, "2:1": 2.0}
DETAIL_MM = 60.0  # a circle on paper is larger only where it must be
SCALES = {"5:1": 5.0, "2:1": 2.0, "1:1": 1.0, "1:2": 0.5, "1:5": 0.2}
WIDE_MM = 150.0  # nothing is enlarged beyond this
GAP_MM = 6.0
PICTURE_MM = 22.0  # a smaller picture of the part is left out
PICTURE_FILLS = 0.8

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
class _Drawn:
    """One view: its projection, its lines, the faces of a section; of a detail, its circle."""

    view: View
    lines: Projected
    hatched: Sequence[Sequence[Points]] = ()
    circle: Circle2 | None = None

    @property
    def box_mm(self) -> tuple[Point2, Point2]:
        if self.circle is not None:
            (x, y), r = self.circle.centre, self.circle.radius
            return (x - r, y - r), (x + r, y + r)
        (x0, y0), (x1, y1) = (c.tolist() for c in self.lines.box_mm)
        return (x0, y0), (x1, y1)


@dataclass(frozen=True)
class _Layout:
    """Views on a sheet: where the upper left corner of each stands, in paper mm."""

    sheet: str
    scale: str
    arranged: dict[str, Arranged]
    at: dict[str, Point2]
    notes: list[str] = field(default_factory=list)

    @property
    def taken(self) -> list[Rect]:
        """What the views take with all that is written around them."""
        rects = []
        for name, view in self.arranged.items():
            (x, y), (w, h) = self.at[name], view.size_mm
            left, top, right, bottom = view.margins
            rects.append((x - left, y - top, x + w + right, y + h + bottom))
        return rects

    @property
    def reserved(self) -> Rect:
        """Title block and notes."""
        left, top, right, bottom = block_rect(self.sheet)
        return left - 2, top - 4 - LINE_MM * len(self.notes), right, bottom

    @property
    def fits(self) -> bool:
        """Whether everything lies on the sheet and nothing on the title block."""
        width, height = SHEETS[self.sheet]
        edge = BORDER_MM + 1
        widest = max(view.size_mm[0] for view in self.arranged.values())
        if SCALES[self.scale] > 1 and widest > WIDE_MM:
            return False
        inside = all(
            x0 >= edge and y0 >= edge and x1 <= width - edge and y1 <= height - edge
            for x0, y0, x1, y1 in self.taken
        )
        rects = [*self.taken, self.reserved]
        return inside and not any(meet(a, b) for a, b in combinations(rects, 2))


def has_drawing(part: Part) -> bool:
    """Whether a machine shop or a laser cutter may make the part, and needs a drawing."""
    return part.callouts is not None


def drawing(part: Part, design: Design, solid: Any) -> Page:
    """The drawing of a part, its solid as built from the design. Same dimensions, same page.

    Raises InputError for a part without a drawing, and where no standard scale fits it on A3;
    RunFailed when the CAD kernel fails.
    """
    if part.callouts is None:
        raise InputError(f"part {part.name!r}: has no drawing; it is {part.process}")
    said = part.callouts(part.source(design))
    with guarded(part.name, {}):
        drawn = _views(solid, said)
    notes = [*said.notes]
    if open_keys := [key for key in said.rests_on if key in design.unverified()]:
        notes.append(f"Rests on unverified values: {', '.join(open_keys)}.")
    layout = _layout(part.name, drawn, said, notes)
    page = Page(SHEETS[layout.sheet], f"{part.name}, {layout.scale}")
    title = Title(
        part.name, _belongs(part), part.material, part.process, part.quantity, layout.scale,
        layout.sheet, said.general_tolerance, design.drawing,
    )  # fmt: skip
    draw_frame(page, title)
    left, top, _, _ = layout.reserved
    for i, line in enumerate(layout.notes):
        page.text((left + 2, top + 2 + LINE_MM * i + SMALL_MM), line)
    drawn |= {detail.letter: _enlarged(drawn[detail.view], detail) for detail in said.details}
    for name, arranged in layout.arranged.items():
        _draw_view(page, name, drawn[name], arranged, layout.at[name])
    for detail in said.details:
        view = layout.arranged[detail.view]
        _draw_mark(page, detail, view, layout.at[detail.view])
    _draw_picture(page, drawn["picture"], layout)
    return page


def _belongs(part: Part) -> str:
    if part.group == "sensor":
        return f"DelTact sensor, part {part.number}" if part.number else "DelTact sensor"
    return {"tools": "casting tools", "bench": "test bench", "indenters": "indenters"}[part.group]


def views_of(said: Callouts) -> dict[str, View]:
    """The views of a drawing by name, those of its details too."""
    views = FLIPPED if said.flipped else VIEWS
    return views | {detail.letter: views[detail.view] for detail in said.details}


def _views(solid: Any, said: Callouts) -> dict[str, _Drawn]:
    """The four projections; the left one cut where the callouts ask for a section."""
    views = FLIPPED if said.flipped else VIEWS
    drawn = {}
    for name, view in views.items():
        if name == "left" and said.cut is not None:
            drawn[name] = _section(solid, view, said.cut.x_mm)
        else:
            drawn[name] = _Drawn(view, project([solid], view.direction, view.up)[0])
    return drawn


def _enlarged(parent: _Drawn, detail: Detail) -> _Drawn:
    """What a detail's circle holds of its view; hidden lines stay behind."""
    u, v = (float(c) for c in parent.view.flat(detail.at))
    circle = Circle2((u, v), detail.radius_mm)
    lines = Projected(
        circle.of_lines(parent.lines.visible), (), circle.of_lines(parent.lines.smooth)
    )
    faces = [circle.of_face(face) for face in parent.hatched]
    return _Drawn(parent.view, lines, [face for face in faces if face], circle)


def _section(solid: Any, view: View, x_mm: float) -> _Drawn:
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
    return _Drawn(view, Projected(lines.visible, (), lines.smooth), faces)


def _outline(wire: Any) -> Points:
    """A closed wire as points (n, 3), its edges end to end."""
    from OCP.BRepTools import BRepTools_WireExplorer
    from OCP.TopAbs import TopAbs_REVERSED

    points = []
    walk = BRepTools_WireExplorer(wire.wrapped)
    while walk.More():
        edge = walk.Current()
        along = sampled(edge)
        points.append(along[::-1] if edge.Orientation() == TopAbs_REVERSED else along)
        walk.Next()
    return np.concatenate(points)


def _layout(part: str, drawn: dict[str, _Drawn], said: Callouts, notes: list[str]) -> _Layout:
    """The largest scale that fits a sheet, on the smallest sheet that takes it."""
    left, _, right, _ = block_rect("A4")
    lines = [line for note in notes for line in wrapped(note, right - left - 6)]
    for scale in SCALES:
        for sheet in SHEETS:
            layout = _placed(sheet, scale, drawn, said, lines)
            if layout.fits:
                return layout
    (x0, y0), (x1, y1) = drawn["top"].box_mm
    raise InputError(
        f"{part}: its drawing fits no A3 sheet at 1:5 ({x1 - x0:.0f} x {y1 - y0:.0f} mm)"
    )


def _placed(
    sheet: str, scale: str, drawn: dict[str, _Drawn], said: Callouts, notes: list[str]
) -> _Layout:
    arranged = {
        name: Arranged(
            name,
            drawn[name].view,
            SCALES[scale],
            drawn[name].box_mm,
            [item for item in said.items if item.view == name],
            said.cut.x_mm if said.cut is not None and name == "top" else None,
            "A–A" if said.cut is not None and name == "left" else "",
            [detail for detail in said.details if detail.view == name],
        )
        for name in ("front", "top", "left")
    }
    front, top, left = (arranged[name] for name in ("front", "top", "left"))
    # Front and top share their x, front and left their height: the margins of a row or column
    # are the larger ones of both.
    column = max(front.margins[0], top.margins[0])
    row = max(front.margins[1], left.margins[1])
    x = column
    y = row
    x_left = x + max(front.size_mm[0] + front.margins[2], 0) + GAP_MM + left.margins[0]
    below = max(front.margins[3], left.margins[3] if _over(left, top, x_left - x) else 0.0)
    y_top = y + front.size_mm[1] + below + GAP_MM + top.margins[1]
    width = max(x_left + left.size_mm[0] + left.margins[2], x + top.size_mm[0] + top.margins[2])
    height = y_top + top.size_mm[1] + top.margins[3]
    # What is left over goes between the border and the views, and no more than looks well.
    spare_x = min((SHEETS[sheet][0] - 2 * BORDER_MM - width) / 3, 30.0)
    spare_y = min((SHEETS[sheet][1] - 2 * BORDER_MM - height) / 3, 20.0)
    ox, oy = BORDER_MM + spare_x, BORDER_MM + spare_y
    at = {
        "front": (ox + x, oy + y),
        "left": (ox + x_left + spare_x, oy + y),
        "top": (ox + x, oy + y_top + spare_y),
    }
    layout = _Layout(sheet, scale, arranged, at, notes)
    for detail in said.details:
        _place_detail(layout, detail, drawn[detail.view], said)
    return layout


def _place_detail(layout: _Layout, detail: Detail, parent: _Drawn, said: Callouts) -> None:
    """Put a detail where the sheet is free, as large as goes; where nothing goes, off the sheet."""
    items = [item for item in said.items if item.view == detail.letter]
    drawn = _enlarged(parent, detail)
    layout.at[detail.letter] = SHEETS[layout.sheet]
    larger = {n: scale for n, scale in DETAIL_SCALES.items() if scale > SCALES[layout.scale]}
    for name, scale in larger.items():
        if 2 * detail.radius_mm * scale > DETAIL_MM and scale > min(larger.values()):
            continue
        arranged = Arranged(
            detail.letter, drawn.view, scale, drawn.box_mm, items,
            heading=f"{detail.letter} ({name})",
        )  # fmt: skip
        layout.arranged[detail.letter] = arranged
        left, top, right, bottom = arranged.margins
        width, height = arranged.size_mm
        room = left + width + right, top + height + bottom
        if (corner := _free_place(layout, room, but=detail.letter)) is not None:
            layout.at[detail.letter] = corner[0] + left, corner[1] + top
            return


def _free_place(layout: _Layout, room: Point2, but: str) -> Point2 | None:
    """The upper left corner of a free rectangle of a size, towards the upper right of the sheet."""
    width, height = SHEETS[layout.sheet]
    edge, gap = BORDER_MM + 4, 3.0
    taken = [r for name, r in zip(layout.arranged, layout.taken, strict=True) if name != but]
    taken = [(a - gap, b - gap, c + gap, d + gap) for a, b, c, d in [*taken, layout.reserved]]
    xs = {edge, width - edge - room[0], *(r[2] for r in taken), *(r[0] - room[0] for r in taken)}
    ys = {edge, height - edge - room[1], *(r[3] for r in taken), *(r[1] - room[1] for r in taken)}
    found = [
        (x, y)
        for x in xs
        for y in ys
        if edge <= x <= width - edge - room[0]
        and edge <= y <= height - edge - room[1]
        and not any(meet((x, y, x + room[0], y + room[1]), r) for r in taken)
    ]
    return min(found, key=lambda p: (round(p[1] - p[0], 3), p), default=None)


def _over(left: Arranged, top: Arranged, apart: float) -> bool:
    """Whether the left view, `apart` to the right, stands over what is beside the top view."""
    return apart - left.margins[0] < top.size_mm[0] + top.margins[2] + GAP_MM


def _draw_view(page: Page, name: str, drawn: _Drawn, arranged: Arranged, at: Point2) -> None:
    scale = arranged.scale
    (x0, _), (_, y1) = arranged.box_mm

    def on_paper(lines: Sequence[Points]) -> list[Points]:
        return [_paper(line, (x0, y1), scale, at) for line in lines]

    page.open(f"view-{name}", scale=scale)
    if drawn.circle is not None:
        radius = drawn.circle.radius * scale
        page.circle((at[0] + radius, at[1] + radius), radius)
    for loops in drawn.hatched:
        page.path(on_paper(loops), "hatch", closed=True)
    page.path(on_paper(drawn.lines.hidden), "hidden")
    page.path(on_paper(drawn.lines.smooth), "smooth")
    page.path(on_paper(drawn.lines.visible), "visible")
    page.close()
    page.open(f"dimensions-{name}")
    arranged.draw(page, at)
    page.close()


def _paper(line: Points, corner_mm: Point2, scale: float, at: Point2) -> Points:
    """Points of the model's plane on paper: the view's upper left corner comes to `at`."""
    return np.stack(
        [at[0] + (line[:, 0] - corner_mm[0]) * scale, at[1] + (corner_mm[1] - line[:, 1]) * scale],
        axis=1,
    )


def _draw_mark(page: Page, detail: Detail, parent: Arranged, at: Point2) -> None:
    """The circle in the parent view that a detail shows, its letter where the page is free."""
    x, y = parent.local(detail.at)
    x, y, radius = at[0] + x, at[1] + y, detail.radius_mm * parent.scale
    page.circle((x, y), radius)
    half = text_width_mm(detail.letter, LARGE_MM) / 2
    away = radius + 3.0
    ways = [math.pi * k / 6 for k in (2, 1, 3, 4, 0, 5, 6, -1, -2, -3, -4, -5)]
    places = [(x + away * math.cos(a), y - away * math.sin(a) + LARGE_MM / 2) for a in ways]
    boxes = [(px - half - 0.5, py - LARGE_MM - 0.5, px + half + 0.5, py + 0.5) for px, py in places]
    met = [page.crossings(box) for box in boxes]
    page.open(f"detail-{detail.letter}")
    page.text(places[met.index(min(met))], detail.letter, LARGE_MM, "middle")
    page.close()


def _draw_picture(page: Page, drawn: _Drawn, layout: _Layout) -> None:
    """The part seen from a corner, in the largest free rectangle; not to scale."""
    free = _free(layout)
    (x0, y0), (x1, y1) = drawn.box_mm
    width, height = free[2] - free[0], free[3] - free[1]
    scale = PICTURE_FILLS * min(width / (x1 - x0), height / (y1 - y0), 90 / (x1 - x0))
    if min(width, height) < PICTURE_MM:
        return
    at = (
        (free[0] + free[2] - (x1 - x0) * scale) / 2,
        (free[1] + free[3] - (y1 - y0) * scale) / 2,
    )
    page.open("picture")
    for lines, style in ((drawn.lines.smooth, "thin"), (drawn.lines.visible, "picture")):
        page.path([_paper(line, (x0, y1), scale, at) for line in lines], style)
    page.close()


def _free(layout: _Layout) -> Rect:
    """The free rectangle in which a square fits best."""
    width, height = SHEETS[layout.sheet]
    b = BORDER_MM + 2
    taken = [*layout.taken, layout.reserved]
    xs = sorted({b, width - b, *(v for r in taken for v in (r[0], r[2]) if b < v < width - b)})
    ys = sorted({b, height - b, *(v for r in taken for v in (r[1], r[3]) if b < v < height - b)})
    best = (0.0, 0.0, 0.0, 0.0)
    for i, x0 in enumerate(xs):
        for x1 in xs[i + 1 :]:
            for j, y0 in enumerate(ys):
                for y1 in ys[j + 1 :]:
                    if min(x1 - x0, y1 - y0) > min(
                        best[2] - best[0], best[3] - best[1]
                    ) and not any(meet((x0, y0, x1, y1), rect) for rect in taken):
                        best = (x0, y0, x1, y1)
    return best
