"""Marks of a drawing in mm, y down, written as SVG or PDF; frame, title block, first-angle symbol.

Line widths follow ISO 128 (0.5 wide, 0.25 narrow), text heights ISO 3098 (2.5 and 3.5 mm). Narrow
lines are broken where they cross a text.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from html import escape
from itertools import groupby
from typing import Any

import numpy as np

from deltact_fab.common import Point2
from deltact_fab.version import PACKAGE_VERSION

from ...pdf import POINTS_PER_MM, Document, glyphs, width_em
from .dimensioning import TitleBlock

Rect = tuple[float, float, float, float]  # left, top, right, bottom

TEXT_MM, TITLE_MM = 2.5, 3.5  # capital heights, ISO 3098
CAPITAL_SHARE = 0.716  # height of a capital over the font's size, by definition of Arial
ARROW_HEAD_MM = (2.5, 0.8)  # length, width; by hand: as long as the text is high
SVG_FONT = "Arial, Helvetica, 'Liberation Sans', sans-serif"
TEXT_GAP_MM = 0.4  # between a text and a broken line, by hand: legible at 1:1
HATCH_PITCH_MM = 2.0  # by hand: grey from afar, still lines at 1:1
CIRCLE_CORNERS = 120  # of a circle's polygon, by hand: 0.03 % of the radius off at most
LINE_BLACK = "#000000"
# Line width in mm and dashes (line, gap, ...) of each style, after ISO 128.
LINE_STROKES: dict[str, tuple[float, tuple[float, ...]]] = {
    "visible": (0.5, ()),
    "hidden": (0.25, (2, 1)),
    "smooth": (0.18, ()),
    "centre": (0.18, (5, 1, 0.6, 1)),
    "thin": (0.18, ()),
    "leader": (0.18, ()),
    "hatch": (0.18, ()),
    "cut": (0.35, (6, 1.2, 0.8, 1.2)),
    "frame": (0.5, ()),
    "picture": (0.25, ()),
    "contour": (1.0, ()),
    "filled": (0.0, ()),
}
# Sheets of ISO 216, landscape; title block as wide as in ISO 7200; border and height by hand.
FORMATS_MM = {"A4": (297.0, 210.0), "A3": (420.0, 297.0)}
BORDER_MM, TITLE_BLOCK_MM = 10.0, (180.0, 45.0)
LARGE_CELLS = ("Title", "Scale", "Drawing number", "Revision")
TEXT_LINE_MM = 4.2  # baseline distance of small text, by hand: 1.7 times its height
# The title block (ISO 7200): each row's cells with their width in mm.
TITLE_CELLS: tuple[tuple[tuple[int, str], ...], ...] = (
    ((90, "Material"), (60, "Process"), (30, "Quantity")),
    ((66, "General tolerances"), (44, "Projection"), (22, "Dimensions"), (24, "Scale"),
     (24, "Paper")),
    ((66, "Owner"), (44, "Drawn by"), (46, "Approved by"), (24, "Document")),
    ((90, "Title"), (60, "Belongs to"), (30, "Made by")),
    ((90, "Drawing number"), (20, "Revision"), (40, "Date of issue"), (30, "Sheet")),
)  # fmt: skip
BROKEN_STYLES = ("thin", "leader", "hatch", "centre", "cut")
"""Line styles that are broken at a text."""


def text_width_mm(text: str, height_mm: float = TEXT_MM) -> float:
    """Width of a text with capitals height_mm high."""
    return width_em(text) * height_mm / CAPITAL_SHARE


def overlap(a: Rect, b: Rect) -> bool:
    """True if two rectangles overlap."""
    return a[0] < b[2] and b[0] < a[2] and a[1] < b[3] and b[1] < a[3]


def number(value: float) -> str:
    """Format a coordinate in thousandths, without trailing zeros or minus zero."""
    return f"{round(value, 3) + 0.0:.3f}".rstrip("0").rstrip(".")


@dataclass(frozen=True)
class Polylines:
    """Polylines of one style; fill: colour inside by the even-odd rule, or empty."""

    lines: tuple[tuple[Point2, ...], ...]
    style: str
    closed: bool = False
    fill: str = ""
    group: str = ""


@dataclass(frozen=True)
class Text:
    """Text anchored at its base line's start, middle or end; upright: reads upwards."""

    position: Point2
    text: str
    height_mm: float
    anchor: str
    upright: bool
    group: str = ""

    @property
    def start(self) -> Point2:
        """Base line point of the first letter."""
        width = text_width_mm(self.text, self.height_mm)
        back = {"start": 0.0, "middle": width / 2, "end": width}[self.anchor]
        x, y = self.position
        return (x, y + back) if self.upright else (x - back, y)

    @property
    def box(self) -> Rect:
        """Bounding rectangle of capitals and figures; descenders may touch a line."""
        x, y = self.start
        width = text_width_mm(self.text, self.height_mm)
        if self.upright:
            return x - self.height_mm, y - width, x, y
        return x, y - self.height_mm, x + width, y


Mark = Polylines | Text


@dataclass
class DrawingPage:
    """Marks in drawing order on a sheet of size_mm; group: SVG group of the next marks."""

    size_mm: Point2
    title: str
    marks: list[Mark] = field(default_factory=list)
    group: str = ""

    def path(
        self,
        lines: Iterable[Iterable[Sequence[float]]],
        style: str,
        closed: bool = False,
        fill: str = "",
    ) -> None:
        """Add polylines of one style, if there are any."""
        paths = tuple(tuple((float(x), float(y)) for x, y in line) for line in lines)
        if paths:
            self.marks.append(Polylines(paths, style, closed, fill, self.group))

    def line(self, a: Point2, b: Point2, style: str = "thin") -> None:
        """Add a straight line."""
        self.path([[a, b]], style)

    def circle(self, centre: Point2, radius: float, style: str = "thin", fill: str = "") -> None:
        """Add a circle."""
        turn = 2 * np.pi * np.arange(CIRCLE_CORNERS) / CIRCLE_CORNERS
        rim = np.array(centre) + radius * np.stack([np.cos(turn), np.sin(turn)], axis=1)
        self.path([rim], style, closed=True, fill=fill)

    def arrow(self, tip: Point2, towards: Point2) -> None:
        """Add a filled arrow head with its tip at `tip`, pointing along `towards`."""
        length = math.hypot(*towards)
        ux, uy = towards[0] / length, towards[1] / length
        along, half = ARROW_HEAD_MM[0], ARROW_HEAD_MM[1] / 2
        x, y = tip[0] - along * ux, tip[1] - along * uy
        corners = [tip, (x - half * uy, y + half * ux), (x + half * uy, y - half * ux)]
        self.path([corners], "filled", closed=True, fill=LINE_BLACK)

    def hatch(self, loops: Sequence[Any]) -> None:
        """Hatch a face at 45 degrees; loops: its outline, then its holes."""
        import shapely

        face = shapely.Polygon(loops[0], loops[1:])
        x0, y0, x1, y1 = face.bounds
        step = HATCH_PITCH_MM * math.sqrt(2)
        offsets = step * np.arange(math.ceil((x0 + y0) / step), (x1 + y1) / step)
        lines = shapely.MultiLineString([((s - y0, y0), (s - y1, y1)) for s in offsets])
        cut = shapely.get_parts(lines.intersection(face))
        self.path([line.coords for line in cut if line.length > 0], "hatch")

    def text(
        self,
        position: Point2,
        text: str,
        height_mm: float = TEXT_MM,
        anchor: str = "start",
        *,
        upright: bool = False,
    ) -> None:
        """Text anchored at its base line's start, middle or end; upright: reads upwards."""
        self.marks.append(Text(position, text, height_mm, anchor, upright, self.group))

    def broken(self) -> list[Mark]:
        """Return the marks with narrow lines broken at texts."""
        import shapely

        texts = [shapely.box(*m.box) for m in self.marks if isinstance(m, Text)]
        words = shapely.union_all(texts).buffer(TEXT_GAP_MM, join_style="mitre")
        marks: list[Mark] = []
        for mark in self.marks:
            if isinstance(mark, Polylines) and mark.style in BROKEN_STYLES and not mark.closed:
                pieces = shapely.get_parts(shapely.MultiLineString(mark.lines).difference(words))
                lines = tuple(tuple(p.coords) for p in pieces if p.length > TEXT_GAP_MM / 2)
                mark = replace(mark, lines=lines)
            marks.append(mark)
        return marks

    def svg(self) -> str:
        """Return the page as SVG, in real millimetres."""
        width, height = (number(side) for side in self.size_mm)
        lines = [
            f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}mm" height="{height}mm" '
            f'viewBox="0 0 {width} {height}" stroke-linejoin="round" stroke-linecap="round">',
            f"<title>{escape(self.title)}</title>",
            '<rect width="100%" height="100%" fill="#ffffff"/>',
        ]
        for name, marks in groupby(self.broken(), lambda mark: mark.group):
            elements = map(_as_svg, marks)
            lines += [f'<g data-name="{escape(name)}">', *elements, "</g>"] if name else elements
        return "\n".join([*lines, "</svg>"]) + "\n"

    def pdf(self) -> bytes:
        """Return the page as PDF with its font embedded."""
        file = Document()
        scale, height = POINTS_PER_MM, self.size_mm[1] * POINTS_PER_MM
        content = [f"{scale:.6f} 0 0 {-scale:.6f} 0 {height:.6f} cm 0 G 0 g 1 j"]
        content += [line for mark in self.broken() for line in _as_pdf(mark)]
        file.page([side * scale for side in self.size_mm], "\n".join(content))
        return file.finish(self.title, f"deltact-fab {PACKAGE_VERSION}")


def _as_svg(mark: Mark) -> str:
    if isinstance(mark, Text):
        x, y = (number(v) for v in mark.position)
        turn = f' transform="rotate(-90 {x} {y})"' if mark.upright else ""
        return (
            f'<text x="{x}" y="{y}" font-family="{SVG_FONT}" '
            f'font-size="{number(mark.height_mm / CAPITAL_SHARE)}" '
            f'text-anchor="{mark.anchor}"{turn}>{escape(mark.text)}</text>'
        )
    end = "Z" if mark.closed else ""
    data = "".join(
        "M" + "L".join(f"{number(x)} {number(y)}" for x, y in line) + end for line in mark.lines
    )
    width, dashes = LINE_STROKES[mark.style]
    pen = f' stroke="{LINE_BLACK}" stroke-width="{number(width)}"' if width else ""
    if dashes:
        dash_text = " ".join(map(number, dashes))
        pen += f' stroke-dasharray="{dash_text}" stroke-linecap="butt"'
    fill = mark.fill or "none"
    return f'<path class="{mark.style}" d="{data}" fill="{fill}" fill-rule="evenodd"{pen}/>'


def _as_pdf(mark: Mark) -> Iterator[str]:
    """Yield PDF operators for a page in mm with y down."""
    if isinstance(mark, Text):
        x, y = (number(v) for v in mark.start)
        size = number(mark.height_mm / CAPITAL_SHARE)
        turn = "0 -1 -1 0" if mark.upright else "1 0 0 -1"
        yield f"BT 0 g /F {size} Tf {turn} {x} {y} Tm <{glyphs(mark.text)}> Tj ET"
        return
    path = " ".join(
        f"{number(x)} {number(y)} {'l' if i else 'm'}" + " h" * (mark.closed and i + 1 == len(line))
        for line in mark.lines
        for i, (x, y) in enumerate(line)
    )
    if mark.fill:
        colour = " ".join(number(int(mark.fill[i : i + 2], 16) / 255) for i in (1, 3, 5))
        yield f"{colour} rg {path} f*"
    width, dashes = LINE_STROKES[mark.style]
    if width:
        dash_text = " ".join(map(number, dashes))
        yield f"{number(width)} w {0 if dashes else 1} J [{dash_text}] 0 d {path} S"


def block_rect(sheet: str) -> Rect:
    """Rectangle of the title block on a sheet."""
    width, height = FORMATS_MM[sheet]
    right, bottom = width - BORDER_MM, height - BORDER_MM
    return right - TITLE_BLOCK_MM[0], bottom - TITLE_BLOCK_MM[1], right, bottom


def draw_frame(
    page: DrawingPage, sheet: str, name: str, lab: TitleBlock, cells: Mapping[str, str]
) -> None:
    """Draw border and title block with the first-angle symbol; cells: other cells by label."""
    width, height = FORMATS_MM[sheet]
    b = BORDER_MM
    page.group = "sheet"
    corners = [(b, b), (width - b, b), (width - b, height - b), (b, height - b)]
    page.path([corners], "frame", closed=True)
    x0, y0, x1, y1 = block_rect(sheet)
    page.path([[(x0, y1), (x0, y0), (x1, y0)]], "frame")
    texts = {
        "Projection": "first angle", "Dimensions": "mm", "Paper": sheet, "Owner": lab.owner,
        "Drawn by": lab.drawn_by, "Approved by": lab.approved_by, "Title": name, "Sheet": "1 of 1",
        "Made by": f"deltact-fab {PACKAGE_VERSION}", "Revision": lab.revision,
        "Date of issue": lab.date, "Drawing number": lab.number and f"{lab.number}-{name}", **cells,
    }  # fmt: skip
    row_mm = TITLE_BLOCK_MM[1] / len(TITLE_CELLS)
    for i, row in enumerate(TITLE_CELLS):
        y, x = y0 + i * row_mm, x0
        if i:
            page.line((x0, y), (x1, y), "thin")
        for j, (cell, label) in enumerate(row):
            if j:
                page.line((x, y), (x, y + row_mm), "thin")
            page.text((x + 1.5, y + 3.0), label, 1.8)
            words = texts.get(label) or "–"
            size = TITLE_MM if label in LARGE_CELLS else TEXT_MM
            # A long material is set smaller rather than over the line.
            size = min(size, size * (cell - 3) / text_width_mm(words, size))
            page.text((x + 1.5, y + 7.8), words, size)
            if label == "Projection":
                _first_angle(page, x + 31, y + row_mm / 2)
            x += cell


def _first_angle(page: DrawingPage, x: float, y: float) -> None:
    """Draw the first-angle symbol (ISO 5456-2): cone, then its end seen from the left."""
    h, r, length = 5.0, 1.25, 5.0
    cone = [(x - length, y - r), (x, y - h / 2), (x, y + h / 2), (x - length, y + r)]
    page.path([cone], "thin", closed=True)
    cx = x + 2.5 + h / 2
    for radius in (r, h / 2):
        page.circle((cx, y), radius)
    page.line((x - length - 1, y), (x + 1, y), "centre")
    page.line((cx - h / 2 - 1, y), (cx + h / 2 + 1, y), "centre")
    page.line((cx, y - h / 2 - 1), (cx, y + h / 2 + 1), "centre")


def wrapped(words: str, width_mm: float) -> list[str]:
    """Wrap words to lines of small text no wider than width_mm."""
    lines: list[str] = []
    for word in words.split():
        longer = f"{lines[-1]} {word}" if lines else word
        if lines and text_width_mm(longer) <= width_mm:
            lines[-1] = longer
        else:
            lines.append(word)
    return lines
