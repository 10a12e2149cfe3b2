"""The dimensioned drawing of a part: ISO first angle, hidden lines removed.

    front    left (or section A-A)
    top      picture, notes, title block

Seen from the front (along +y), the view from above stands below it and the view from the left to
its right (ISO 5456-2). What is dimensioned is in the part's own file, as data.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from ...aliases import Point2, Points
from ...errors import InputError
from ..dimensions import Design
from ..features import features_of
from ..kernel import guarded
from ..part import LASER_CUT, PRINT, Part
from .arrangement import ArrangedView
from .dimensioning import GENERAL_TOLERANCE, Detail, Limits
from .layout import Layout, free_square, laid_out
from .page import LARGE_MM, SMALL_MM, DrawingPage, text_width_mm
from .placing import Placing
from .scheme import scheme
from .sheet import LINE_MM, SHEETS, Title, draw_frame
from .views import DrawnView, enlarged, views

PICTURE_MM = 22.0  # a smaller picture of the part is left out
PICTURE_FILLS = 0.8


def drawing(part: Part, design: Design, solid: Any) -> DrawingPage:
    """The drawing of a part, its solid as built from the design. Same dimensions, same page.

    Raises InputError for a part without a drawing, and where no standard scale fits it on A3;
    RunFailed when the CAD kernel fails.
    """
    if part.callouts is None:
        raise InputError(f"part {part.name!r}: has no drawing; it is {part.process}")
    said = part.callouts(part.source(design))
    with guarded(part.name):
        drawn = views(solid, said)
    notes = [*said.notes]
    if open_keys := [key for key in said.rests_on if key in design.unverified()]:
        notes.append(f"Rests on unverified values: {', '.join(open_keys)}.")
    found = features_of(solid)
    placing = Placing(found, said, drawn, _limits(part, design))
    items = tuple(placing.items(scheme(found, said)))
    layout = laid_out(part.name, drawn, said, items, notes)
    page = DrawingPage(SHEETS[layout.sheet], f"{part.name}, {layout.scale}")
    title = Title(
        part.name, _belongs(part), part.material, part.process, part.quantity, layout.scale,
        layout.sheet, _general_tolerance(part, design), design.drawing,
    )  # fmt: skip
    draw_frame(page, title)
    left, top, _, _ = layout.reserved
    for i, line in enumerate(layout.notes):
        page.text((left + 2, top + 2 + LINE_MM * i + SMALL_MM), line)
    drawn |= {detail.letter: enlarged(drawn[detail.view], detail) for detail in said.details}
    for name, arranged in layout.arranged.items():
        _draw_view(page, name, drawn[name], arranged, layout.at[name])
    for detail in said.details:
        view = layout.arranged[detail.view]
        _draw_mark(page, detail, view, layout.at[detail.view])
    _draw_picture(page, drawn["picture"], layout)
    return page


def _general_tolerance(part: Part, design: Design) -> str:
    """Of every length without limits of its own: what the part's machine does."""
    if part.process == PRINT:
        return design.resin_printer.general_tolerance
    if part.process == LASER_CUT:
        return design.laser.general_tolerance
    return GENERAL_TOLERANCE


def _limits(part: Part, design: Design) -> tuple[Limits | None, Limits | None, Limits | None]:
    """Of a fitted length along x, y and z."""
    if part.process == PRINT:
        plan = design.resin_printer.limits_mm
        return plan, plan, design.resin_printer.tall_limits_mm
    if part.process == LASER_CUT:
        sheet_mm = design.laser.sheet_tolerance * design.optics.acrylic_mm
        return design.laser.limits_mm, design.laser.limits_mm, (-sheet_mm, sheet_mm)
    return None, None, None


def _belongs(part: Part) -> str:
    if part.group == "sensor":
        return f"DelTact sensor, part {part.number}" if part.number else "DelTact sensor"
    return {"electronics": "electronics", "tools": "casting tools", "bench": "test bench",
            "indenters": "indenters"}[part.group]  # fmt: skip


def _draw_view(
    page: DrawingPage, name: str, drawn: DrawnView, arranged: ArrangedView, at: Point2
) -> None:
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


def _draw_mark(page: DrawingPage, detail: Detail, parent: ArrangedView, at: Point2) -> None:
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


def _draw_picture(page: DrawingPage, drawn: DrawnView, layout: Layout) -> None:
    """The part seen from a corner, in the largest free rectangle; not to scale."""
    free = free_square(layout)
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
