"""The dimensioned drawing of a part: ISO first angle, hidden lines removed.

    front    left (or section A-A)
    top      picture, notes, title block

Seen from the front (along +y), the view from above stands below it and the view from the left to
its right (ISO 5456-2), at the largest scale that fits, on the smallest sheet. Fitted dimensions
come from the part's own file, as data.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any

from deltact_fab.common import InputError, Point2

from ..dimensions import Design
from ..features import features_of
from ..kernel import guarded
from ..part import LASER_CUT, PRINT_PROCESS, Part
from .arrangement import ArrangedView, on_paper
from .dimensioning import GENERAL_TOLERANCE, Callouts, Item
from .page import (
    BORDER_MM,
    FORMATS_MM,
    TEXT_LINE_MM,
    TEXT_MM,
    DrawingPage,
    Rect,
    block_rect,
    draw_frame,
    overlap,
    wrapped,
)
from .placing import Placing
from .projection import DrawnView, project_views
from .scheme import scheme

# By hand: a smaller picture shows nothing and is not drawn; a fuller one touches its neighbours.
MIN_PICTURE_MM, PICTURE_FILLS = 22.0, 0.8
# ISO 5455, the largest first.
STANDARD_SCALES = {"5:1": 5.0, "2:1": 2.0, "1:1": 1.0, "1:2": 0.5, "1:5": 0.2}
# By hand: width up to which parts are enlarged, gap between views, and room shared out around the
# views, first the generous one: larger values need a larger sheet.
MAX_ENLARGED_MM, VIEW_GAP_MM, VIEW_SPARE_MM = 150.0, 6.0, (25.0, 2.0)


@dataclass(frozen=True)
class Layout:
    """Views on a sheet; origins: their upper left corners, paper mm."""

    sheet: str
    scale: str
    arranged: dict[str, ArrangedView]
    origins: dict[str, Point2]
    notes: Sequence[str]

    @property
    def extents(self) -> dict[str, Rect]:
        """Rectangle of each view with all its items."""
        return {name: view.extent(self.origins[name]) for name, view in self.arranged.items()}

    @property
    def reserved(self) -> Rect:
        """Rectangle of title block and notes."""
        x0, y0, x1, y1 = block_rect(self.sheet)
        return x0 - 2, y0 - 4 - TEXT_LINE_MM * len(self.notes), x1, y1

    @property
    def fits(self) -> bool:
        """True if all views lie on the sheet, clear of each other and of the title block."""
        (width, height), edge, rects = FORMATS_MM[self.sheet], BORDER_MM + 1, self.extents.values()
        widest = max(view.size_mm[0] for view in self.arranged.values())
        if STANDARD_SCALES[self.scale] > 1 and widest > MAX_ENLARGED_MM:
            return False
        return all(
            x0 >= edge and y0 >= edge and x1 <= width - edge and y1 <= height - edge
            for x0, y0, x1, y1 in rects
        ) and not any(overlap(a, b) for a, b in combinations([*rects, self.reserved], 2))

    @property
    def picture(self) -> Rect:
        """The larger free rectangle, below or beside the left view."""
        (width, _), (_, above, _, _) = FORMATS_MM[self.sheet], self.reserved
        _, _, x_top, _ = self.extents["top"]
        _, _, right, below = self.extents["left"]
        edge, above = width - BORDER_MM - 2, above - 2
        free = ((x_top + 2, below + 2, edge, above), (right + 2, BORDER_MM + 2, edge, above))
        return max(free, key=lambda r: min(r[2] - r[0], r[3] - r[1]))


def drawing(part: Part, design: Design, solid: Any, document: str = "part drawing") -> DrawingPage:
    """Draw a part from its built solid. Same dimensions, same page.

    document: kind of document in the title block.

    Raises InputError for a part without a drawing, and where no standard scale fits it on A3;
    RunFailed when the CAD kernel fails.
    """
    if part.callouts is None:
        raise InputError(f"part {part.name!r}: no drawing ({part.process})")
    callouts = part.callouts(part.source(design))
    with guarded(part.name):
        projections = project_views(solid, callouts)
    notes = [*callouts.notes]
    if open_keys := [key for key in callouts.rests_on if key in design.unverified()]:
        notes.append(f"Depends on unverified values: {', '.join(open_keys)}.")
    features = features_of(solid)
    general, off_mm = _tolerances(part, design)
    placing = Placing(features, callouts, projections, off_mm, solid)
    items = list(placing.items(scheme(features, callouts)))
    layout = _fit_layout(part.name, projections, callouts, items, notes)
    page = DrawingPage(FORMATS_MM[layout.sheet], f"{part.name}, {layout.scale}")
    cells = {
        "Material": part.material, "Process": part.process, "Quantity": str(part.quantity),
        "General tolerances": general, "Scale": layout.scale, "Document": document,
        "Belongs to": _group_text(part),
    }  # fmt: skip
    draw_frame(page, layout.sheet, part.name, design.drawing, cells)
    note_x, note_y, _, _ = layout.reserved
    for i, line in enumerate(layout.notes):
        page.text((note_x + 2, note_y + 2 + TEXT_LINE_MM * i + TEXT_MM), line)
    for name, arranged in layout.arranged.items():
        arranged.draw(page, name, layout.origins[name])
    page.group = "picture"
    _draw_picture(page, projections["picture"], layout.picture)
    return page


def _tolerances(part: Part, design: Design) -> tuple[str, tuple[float, float, float]]:
    """Return the general tolerance as text, and limits of fitted lengths along x, y, z, mm."""
    if part.process == PRINT_PROCESS:
        plane, height = design.resin_printer.plane_mm, design.resin_printer.height_mm
        return f"±{plane:.2g} in the layers, ±{height:.2g} across", (plane, plane, height)
    if part.process == LASER_CUT:
        cut, share = design.laser.tolerance_mm, design.laser.sheet_tolerance
        general = f"±{cut:.2g}; sheet ±{100 * share:.2g} %"
        return general, (cut, cut, share * design.optics.acrylic_mm)
    return GENERAL_TOLERANCE, (0.0, 0.0, 0.0)


def _group_text(part: Part) -> str:
    if part.group == "sensor":
        return f"DelTact sensor, part {part.number}" if part.number else "DelTact sensor"
    return {"tools": "casting tools", "bench": "test bench"}.get(part.group, part.group)


def _fit_layout(
    part: str,
    projections: Mapping[str, DrawnView],
    callouts: Callouts,
    items: Sequence[Item],
    notes: Sequence[str],
) -> Layout:
    """Choose the largest scale that fits, and the smallest sheet for it."""
    left_mm, _, right_mm, _ = block_rect("A4")
    lines = [line for note in notes for line in wrapped(note, right_mm - left_mm - 6)]
    for scale in STANDARD_SCALES:
        arranged = {
            name: ArrangedView(
                projections[name],
                STANDARD_SCALES[scale],
                [item for item in items if item.view == name],
                callouts.cut_x_mm if name == "top" else None,
                "A–A" if callouts.cut_x_mm is not None and name == "left" else "",
            )
            for name in ("front", "top", "left")
        }
        for sheet in FORMATS_MM:
            for spare_mm in VIEW_SPARE_MM:
                origins = _origins(sheet, arranged, spare_mm)
                layout = Layout(sheet, scale, arranged, origins, lines)
                if layout.fits:
                    return layout
    (x0, y0), (x1, y1) = projections["top"].box_mm
    raise InputError(
        f"{part}: its drawing fits no A3 sheet at 1:5 ({x1 - x0:.0f} x {y1 - y0:.0f} mm)"
    )


def _origins(sheet: str, views: Mapping[str, ArrangedView], spare_mm: float) -> dict[str, Point2]:
    """Return the origins of the views: front and top share x, front and left share y."""
    front, top, side = (views[name] for name in ("front", "top", "left"))
    x = max(front.margins[0], top.margins[0])
    y = max(front.margins[1], side.margins[1])
    x_left = x + front.size_mm[0] + front.margins[2] + VIEW_GAP_MM + side.margins[0]
    below = max(front.margins[3], side.margins[3])
    y_top = y + front.size_mm[1] + below + VIEW_GAP_MM + top.margins[1]
    width = max(x_left + side.size_mm[0] + side.margins[2], x + top.size_mm[0] + top.margins[2])
    height = y_top + top.size_mm[1] + top.margins[3]
    spare_x = min((FORMATS_MM[sheet][0] - 2 * BORDER_MM - width) / 3, spare_mm)
    spare_y = min((FORMATS_MM[sheet][1] - 2 * BORDER_MM - height) / 3, spare_mm)
    x, y = BORDER_MM + spare_x + x, BORDER_MM + spare_y + y
    x_left, y_top = BORDER_MM + 2 * spare_x + x_left, BORDER_MM + 2 * spare_y + y_top
    return {"front": (x, y), "left": (x_left, y), "top": (x, y_top)}


def _draw_picture(page: DrawingPage, projection: DrawnView, free: Rect) -> None:
    """Draw the part seen from a corner in a free rectangle, not to scale."""
    (x0, y0), (x1, y1) = projection.box_mm
    width, height = free[2] - free[0], free[3] - free[1]
    if min(width, height) < MIN_PICTURE_MM:
        return
    scale = PICTURE_FILLS * min(width / (x1 - x0), height / (y1 - y0), 90 / (x1 - x0))
    x_corner, y_corner = (
        free[0] + (width - (x1 - x0) * scale) / 2,
        free[1] + (height - (y1 - y0) * scale) / 2,
    )
    for lines, style in ((projection.smooth, "thin"), (projection.visible, "picture")):
        page.path(on_paper(lines, projection, scale, (x_corner, y_corner)), style)
