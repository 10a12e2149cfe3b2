"""The dimensioned drawing of a part: ISO first angle, hidden lines removed.

    front    left (or section A-A)
    top      picture, notes, title block

Seen from the front (along +y), the view from above stands below it and the view from the left to
its right (ISO 5456-2). What is dimensioned is in the part's own file, as data.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ...aliases import Point2, Points
from ...errors import InputError
from ..dimensions import Design
from ..features import features_of
from ..kernel import guarded
from ..part import LASER_CUT, PRINT, Part
from .dimensioning import GENERAL_TOLERANCE, Limits
from .layout import laid_out
from .page import SMALL_MM, DrawingPage, Rect
from .placing import Placing
from .scheme import scheme
from .sheet import LINE_MM, SHEETS, Title, draw_frame
from .views import DrawnView, views

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
    general, limits = _tolerances(part, design)
    placing = Placing(found, said, drawn, limits)
    layout = laid_out(part.name, drawn, said, tuple(placing.items(scheme(found, said))), notes)
    page = DrawingPage(SHEETS[layout.sheet], f"{part.name}, {layout.scale}")
    title = Title(
        part.name, _belongs(part), part.material, part.process, part.quantity, layout.scale,
        layout.sheet, general, design.drawing,
    )  # fmt: skip
    draw_frame(page, title)
    left, top, _, _ = layout.reserved
    for i, line in enumerate(layout.notes):
        page.text((left + 2, top + 2 + LINE_MM * i + SMALL_MM), line)
    for name, arranged in layout.arranged.items():
        page.group = f"view-{name}"
        lines, at = drawn[name].lines, layout.at[name]
        for loops in drawn[name].hatched:
            page.hatch(_paper(loops, arranged.box_mm, arranged.scale, at))
        for style in ("hidden", "smooth", "visible"):
            page.path(_paper(getattr(lines, style), arranged.box_mm, arranged.scale, at), style)
        page.group = f"dimensions-{name}"
        arranged.draw(page, at)
    page.group = "picture"
    _draw_picture(page, drawn["picture"], layout.picture)
    return page


def _tolerances(part: Part, design: Design) -> tuple[str, tuple[Limits | None, ...]]:
    """What the part's machine does to every length, and to a fitted one along x, y and z."""
    printer, laser = design.resin_printer, design.laser
    if part.process == PRINT:
        limits = (printer.limits_mm, printer.limits_mm, printer.tall_limits_mm)
        return printer.general_tolerance, limits
    if part.process == LASER_CUT:
        sheet_mm = laser.sheet_tolerance * design.optics.acrylic_mm
        return laser.general_tolerance, (laser.limits_mm, laser.limits_mm, (-sheet_mm, sheet_mm))
    return GENERAL_TOLERANCE, (None, None, None)


def _belongs(part: Part) -> str:
    if part.group == "sensor":
        return f"DelTact sensor, part {part.number}" if part.number else "DelTact sensor"
    return {"electronics": "electronics", "tools": "casting tools", "bench": "test bench",
            "indenters": "indenters"}[part.group]  # fmt: skip


def _paper(
    lines: Sequence[Points], box_mm: tuple[Point2, Point2], scale: float, at: Point2
) -> list[Points]:
    """Lines of the model's plane on paper: the box's upper left corner comes to `at`."""
    (left, _), (_, top) = box_mm
    return [np.add(at, (line - (left, top)) * (scale, -scale)) for line in lines]


def _draw_picture(page: DrawingPage, drawn: DrawnView, free: Rect) -> None:
    """The part seen from a corner, in the middle of a free rectangle; not to scale."""
    (x0, y0), (x1, y1) = drawn.box_mm
    width, height = free[2] - free[0], free[3] - free[1]
    if min(width, height) < PICTURE_MM:
        return
    scale = PICTURE_FILLS * min(width / (x1 - x0), height / (y1 - y0), 90 / (x1 - x0))
    left, top = (
        free[0] + (width - (x1 - x0) * scale) / 2,
        free[1] + (height - (y1 - y0) * scale) / 2,
    )
    for lines, style in ((drawn.lines.smooth, "thin"), (drawn.lines.visible, "picture")):
        page.path(_paper(lines, drawn.box_mm, scale, (left, top)), style)
