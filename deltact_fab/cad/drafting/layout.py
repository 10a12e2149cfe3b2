"""Views, details and picture on a sheet: the largest scale that fits the smallest sheet."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import combinations

from ...aliases import Point2
from ...errors import InputError
from .arrangement import ArrangedView
from .dimensioning import Callouts, Detail, Item
from .page import Rect, meet
from .sheet import BORDER_MM, LINE_MM, SHEETS, block_rect, wrapped
from .views import DrawnView, enlarged

# ISO 5455, the largest first.
DETAIL_SCALES = {"20:1": 20.0, "10:1": 10.0, "5:1": 5.0, "2:1": 2.0}
DETAIL_MM = 60.0  # a circle on paper is larger only where it must be
SCALES = {"5:1": 5.0, "2:1": 2.0, "1:1": 1.0, "1:2": 0.5, "1:5": 0.2}
WIDE_MM = 150.0  # nothing is enlarged beyond this
GAP_MM = 6.0


@dataclass(frozen=True)
class Layout:
    """Views on a sheet: where the upper left corner of each stands, in paper mm."""

    sheet: str
    scale: str
    arranged: dict[str, ArrangedView]
    at: dict[str, Point2]
    notes: list[str] = field(default_factory=list)

    def taken(self, but: str = "") -> list[Rect]:
        """What the views take with all that is written around them, without one of them."""
        views = (name for name in self.arranged if name != but)
        return [rect for name in views for rect in self.arranged[name].taken(self.at[name])]

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
            for x0, y0, x1, y1 in self.taken()
        )
        # What stands around one view keeps apart from itself already.
        views = [view.taken(self.at[name]) for name, view in self.arranged.items()]
        pairs = combinations([*views, [self.reserved]], 2)
        return inside and not any(meet(a, b) for one, other in pairs for a in one for b in other)


def laid_out(
    part: str,
    drawn: dict[str, DrawnView],
    said: Callouts,
    items: Sequence[Item],
    notes: list[str],
) -> Layout:
    """The largest scale that fits a sheet, on the smallest sheet that takes it."""
    left, _, right, _ = block_rect("A4")
    lines = [line for note in notes for line in wrapped(note, right - left - 6)]
    for scale in SCALES:
        for sheet in SHEETS:
            layout = _placed(sheet, scale, drawn, said, items, lines)
            if layout.fits:
                return layout
    (x0, y0), (x1, y1) = drawn["top"].box_mm
    raise InputError(
        f"{part}: its drawing fits no A3 sheet at 1:5 ({x1 - x0:.0f} x {y1 - y0:.0f} mm)"
    )


def _placed(
    sheet: str,
    scale: str,
    drawn: dict[str, DrawnView],
    said: Callouts,
    items: Sequence[Item],
    notes: list[str],
) -> Layout:
    arranged = {
        name: ArrangedView(
            name,
            drawn[name].view,
            SCALES[scale],
            drawn[name].box_mm,
            [item for item in items if item.view == name],
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
    # Whether the left view stands over what is beside the top view.
    over = x_left - x - left.margins[0] < top.size_mm[0] + top.margins[2] + GAP_MM
    below = max(front.margins[3], left.margins[3] if over else 0.0)
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
    layout = Layout(sheet, scale, arranged, at, notes)
    for detail in said.details:
        mine = [item for item in items if item.view == detail.letter]
        _place_detail(layout, detail, drawn[detail.view], mine)
    return layout


def _place_detail(layout: Layout, detail: Detail, parent: DrawnView, items: Sequence[Item]) -> None:
    """Put a detail where the sheet is free, as large as goes; where nothing goes, off the sheet."""
    drawn = enlarged(parent, detail)
    layout.at[detail.letter] = SHEETS[layout.sheet]
    larger = {n: scale for n, scale in DETAIL_SCALES.items() if scale > SCALES[layout.scale]}
    for name, scale in larger.items():
        if 2 * detail.radius_mm * scale > DETAIL_MM and scale > min(larger.values()):
            continue
        arranged = ArrangedView(
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


def _free_place(layout: Layout, room: Point2, but: str) -> Point2 | None:
    """The upper left corner of a free rectangle of a size, towards the upper right of the sheet."""
    width, height = SHEETS[layout.sheet]
    edge, gap = BORDER_MM + 4, 3.0
    taken = [*layout.taken(but), layout.reserved]
    taken = [(a - gap, b - gap, c + gap, d + gap) for a, b, c, d in taken]
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


def free_square(layout: Layout) -> Rect:
    """The free rectangle in which a square fits best."""
    width, height = SHEETS[layout.sheet]
    b = BORDER_MM + 2
    taken = [*layout.taken(), layout.reserved]
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
