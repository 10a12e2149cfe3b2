"""The dimensioned drawing of a part: ISO first angle, hidden lines removed.

    front    left (or section A-A)
    top      picture, notes, title block

Seen from the front (along +y), the view from above stands below it and the view from the left to
its right (ISO 5456-2), at the largest scale that fits the smallest sheet. What is dimensioned is in
the part's own file, as data.
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
    LINE_MM,
    SHEETS,
    SMALL_MM,
    DrawingPage,
    Rect,
    block_rect,
    draw_frame,
    meet,
    wrapped,
)
from .placing import Placing
from .projection import DrawnView, views
from .scheme import scheme

PICTURE_MM = 22.0  # a smaller picture of the part is left out
PICTURE_FILLS = 0.8
# ISO 5455, the largest first.
SCALES = {"5:1": 5.0, "2:1": 2.0, "1:1": 1.0, "1:2": 0.5, "1:5": 0.2}
WIDE_MM = 150.0  # nothing is enlarged beyond this
GAP_MM = 6.0
# Of what is left over, this much goes between the border and the views, or little if need be.
SPARE_MM = (25.0, 2.0)


@dataclass(frozen=True)
class Layout:
    """Views on a sheet: where the upper left corner of each stands, in paper mm."""

    sheet: str
    scale: str
    arranged: dict[str, ArrangedView]
    at: dict[str, Point2]
    notes: Sequence[str]

    @property
    def taken(self) -> dict[str, Rect]:
        """What each view takes with all that is written around it."""
        return {name: view.taken(self.at[name]) for name, view in self.arranged.items()}

    @property
    def reserved(self) -> Rect:
        """Title block and notes."""
        left, top, right, bottom = block_rect(self.sheet)
        return left - 2, top - 4 - LINE_MM * len(self.notes), right, bottom

    @property
    def fits(self) -> bool:
        """Whether everything lies on the sheet and nothing on the title block."""
        (width, height), edge, taken = SHEETS[self.sheet], BORDER_MM + 1, self.taken.values()
        widest = max(view.size_mm[0] for view in self.arranged.values())
        if SCALES[self.scale] > 1 and widest > WIDE_MM:
            return False
        return all(
            x0 >= edge and y0 >= edge and x1 <= width - edge and y1 <= height - edge
            for x0, y0, x1, y1 in taken
        ) and not any(meet(a, b) for a, b in combinations([*taken, self.reserved], 2))

    @property
    def picture(self) -> Rect:
        """The larger of the free rectangles below and beside the left view."""
        (width, _), (_, above, _, _) = SHEETS[self.sheet], self.reserved
        _, _, beside, _ = self.taken["top"]
        _, _, right, below = self.taken["left"]
        edge, above = width - BORDER_MM - 2, above - 2
        free = ((beside + 2, below + 2, edge, above), (right + 2, BORDER_MM + 2, edge, above))
        return max(free, key=lambda r: min(r[2] - r[0], r[3] - r[1]))


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
    general, off_mm = _tolerances(part, design)
    items = list(Placing(found, said, drawn, off_mm).items(scheme(found, said)))
    layout = _laid_out(part.name, drawn, said, items, notes)
    page = DrawingPage(SHEETS[layout.sheet], f"{part.name}, {layout.scale}")
    told = {
        "Material": part.material, "Process": part.process, "Quantity": str(part.quantity),
        "General tolerances": general, "Scale": layout.scale, "Document": "part drawing",
        "Belongs to": _belongs(part),
    }  # fmt: skip
    draw_frame(page, layout.sheet, part.name, design.drawing, told)
    left, top, _, _ = layout.reserved
    for i, line in enumerate(layout.notes):
        page.text((left + 2, top + 2 + LINE_MM * i + SMALL_MM), line)
    for name, arranged in layout.arranged.items():
        arranged.draw(page, name, layout.at[name])
    page.group = "picture"
    _draw_picture(page, drawn["picture"], layout.picture)
    return page


def _tolerances(part: Part, design: Design) -> tuple[str, tuple[float, float, float]]:
    """What the part's machine does to every length, and to a fitted one along x, y and z, in mm."""
    if part.process == PRINT_PROCESS:
        plane, height = design.resin_printer.plane_mm, design.resin_printer.height_mm
        return f"±{plane:.2g} in the layers, ±{height:.2g} across", (plane, plane, height)
    if part.process == LASER_CUT:
        cut, share = design.laser.tolerance_mm, design.laser.sheet_tolerance
        general = f"±{cut:.2g}; sheet ±{100 * share:.2g} %"
        return general, (cut, cut, share * design.optics.acrylic_mm)
    return GENERAL_TOLERANCE, (0.0, 0.0, 0.0)


def _belongs(part: Part) -> str:
    if part.group == "sensor":
        return f"DelTact sensor, part {part.number}" if part.number else "DelTact sensor"
    return {"tools": "casting tools", "bench": "test bench"}.get(part.group, part.group)


def _laid_out(
    part: str,
    drawn: Mapping[str, DrawnView],
    said: Callouts,
    items: Sequence[Item],
    notes: Sequence[str],
) -> Layout:
    """The largest scale that fits a sheet, on the smallest sheet that takes it."""
    left, _, right, _ = block_rect("A4")
    lines = [line for note in notes for line in wrapped(note, right - left - 6)]
    for scale in SCALES:
        arranged = {
            name: ArrangedView(
                drawn[name],
                SCALES[scale],
                [item for item in items if item.view == name],
                said.cut_x_mm if name == "top" else None,
                "A–A" if said.cut_x_mm is not None and name == "left" else "",
            )
            for name in ("front", "top", "left")
        }
        for sheet in SHEETS:
            for most_mm in SPARE_MM:
                at = _places(sheet, arranged, most_mm)
                layout = Layout(sheet, scale, arranged, at, lines)
                if layout.fits:
                    return layout
    (x0, y0), (x1, y1) = drawn["top"].box_mm
    raise InputError(
        f"{part}: its drawing fits no A3 sheet at 1:5 ({x1 - x0:.0f} x {y1 - y0:.0f} mm)"
    )


def _places(sheet: str, arranged: Mapping[str, ArrangedView], most_mm: float) -> dict[str, Point2]:
    """Where the views stand: front and top share their x, front and left their height."""
    front, top, left = (arranged[name] for name in ("front", "top", "left"))
    x = max(front.margins[0], top.margins[0])
    y = max(front.margins[1], left.margins[1])
    x_left = x + front.size_mm[0] + front.margins[2] + GAP_MM + left.margins[0]
    below = max(front.margins[3], left.margins[3])
    y_top = y + front.size_mm[1] + below + GAP_MM + top.margins[1]
    width = max(x_left + left.size_mm[0] + left.margins[2], x + top.size_mm[0] + top.margins[2])
    height = y_top + top.size_mm[1] + top.margins[3]
    spare_x = min((SHEETS[sheet][0] - 2 * BORDER_MM - width) / 3, most_mm)
    spare_y = min((SHEETS[sheet][1] - 2 * BORDER_MM - height) / 3, most_mm)
    x, y = BORDER_MM + spare_x + x, BORDER_MM + spare_y + y
    x_left, y_top = BORDER_MM + 2 * spare_x + x_left, BORDER_MM + 2 * spare_y + y_top
    return {"front": (x, y), "left": (x_left, y), "top": (x, y_top)}


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
    for lines, style in ((drawn.smooth, "thin"), (drawn.visible, "picture")):
        page.path(on_paper(lines, drawn, scale, (left, top)), style)
