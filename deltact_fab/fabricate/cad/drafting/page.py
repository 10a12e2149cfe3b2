"""What stands on a drawing, in millimetres with y downwards, and the same page as SVG or PDF;
and a technical drawing's sheet: frame, title block, first-angle symbol.

Line widths are those of ISO 128 (0.5 wide, 0.25 narrow), texts 2.5 and 3.5 mm high (ISO 3098).
Where a narrow line meets a text it is broken, so that no text is struck through.
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

SMALL_MM, LARGE_MM = 2.5, 3.5
CAP = 0.716  # height of a capital over the font's size: Helvetica and Arial
ARROW_MM = (2.5, 0.8)
FONT = "Arial, Helvetica, 'Liberation Sans', sans-serif"
GAP_MM = 0.4  # between a text and the ends of a line that it breaks
HATCH_MM = 2.0
CORNERS = 120  # of the polygon that is drawn for a circle
BLACK = "#000000"
# Width of each style's lines in mm, and their dashes: lines and gaps in turn.
STROKES: dict[str, tuple[float, tuple[float, ...]]] = {
    "visible": (0.5, ()),
    "hidden": (0.25, (2, 1)),
    "smooth": (0.18, ()),
    "centre": (0.18, (5, 1, 0.6, 1)),
    "thin": (0.18, ()),
    "hatch": (0.18, ()),
    "cut": (0.35, (6, 1.2, 0.8, 1.2)),
    "frame": (0.5, ()),
    "picture": (0.25, ()),
    "contour": (1.0, ()),
    "filled": (0.0, ()),
}
SHEETS = {"A4": (297.0, 210.0), "A3": (420.0, 297.0)}
BORDER_MM = 10.0
BLOCK_MM = (180.0, 45.0)
LARGE = ("Title", "Scale", "Drawing number", "Revision")
LINE_MM = 4.2  # from one line of small text to the next
# The title block (ISO 7200): each row's cells with their width in mm.
CELLS: tuple[tuple[tuple[int, str], ...], ...] = (
    ((90, "Material"), (60, "Process"), (30, "Quantity")),
    ((66, "General tolerances"), (44, "Projection"), (22, "Dimensions"), (24, "Scale"),
     (24, "Paper")),
    ((66, "Owner"), (44, "Drawn by"), (46, "Approved by"), (24, "Document")),
    ((90, "Title"), (60, "Belongs to"), (30, "Made by")),
    ((90, "Drawing number"), (20, "Revision"), (40, "Date of issue"), (30, "Sheet")),
)  # fmt: skip
BROKEN = ("thin", "hatch", "centre", "cut")
"""Styles of lines that give way to a text."""


def text_width_mm(text: str, height_mm: float = SMALL_MM) -> float:
    """Width of a text whose capitals are height_mm high."""
    return width_em(text) * height_mm / CAP


def meet(a: Rect, b: Rect) -> bool:
    """Whether two rectangles overlap."""
    return a[0] < b[2] and b[0] < a[2] and a[1] < b[3] and b[1] < a[3]


def number(value: float) -> str:
    """A coordinate: thousandths of a millimetre, no trailing zeros, no minus zero."""
    return f"{round(value, 3) + 0.0:.3f}".rstrip("0").rstrip(".")


@dataclass(frozen=True)
class Polylines:
    """Polylines of one style; fill: the colour within them by the even-odd rule, else empty."""

    lines: tuple[tuple[Point2, ...], ...]
    style: str
    closed: bool = False
    fill: str = ""
    group: str = ""


@dataclass(frozen=True)
class Text:
    """Words with their base line's start, middle or end at a point; upright reads upwards."""

    at: Point2
    words: str
    height_mm: float
    anchor: str
    upright: bool
    group: str = ""

    @property
    def start(self) -> Point2:
        """Where the first letter stands."""
        width = text_width_mm(self.words, self.height_mm)
        back = {"start": 0.0, "middle": width / 2, "end": width}[self.anchor]
        x, y = self.at
        return (x, y + back) if self.upright else (x - back, y)

    @property
    def box(self) -> Rect:
        """What it takes: capitals and figures, for a line may run below."""
        x, y = self.start
        width = text_width_mm(self.words, self.height_mm)
        if self.upright:
            return x - self.height_mm, y - width, x, y
        return x, y - self.height_mm, x + width, y


Mark = Polylines | Text


@dataclass
class DrawingPage:
    """Marks in the order they are drawn, on a sheet of size_mm.

    group: the name under which the marks that are drawn next stand together in the SVG.
    """

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
        """Polylines of one style; nothing when there are none."""
        drawn = tuple(tuple((float(x), float(y)) for x, y in line) for line in lines)
        if drawn:
            self.marks.append(Polylines(drawn, style, closed, fill, self.group))

    def line(self, a: Point2, b: Point2, style: str = "thin") -> None:
        """A straight line."""
        self.path([[a, b]], style)

    def circle(self, at: Point2, radius: float, style: str = "thin", fill: str = "") -> None:
        """A circle."""
        turn = 2 * np.pi * np.arange(CORNERS) / CORNERS
        rim = np.stack([at[0] + radius * np.cos(turn), at[1] + radius * np.sin(turn)], axis=1)
        self.path([rim], style, closed=True, fill=fill)

    def arrow(self, tip: Point2, towards: Point2) -> None:
        """A filled arrow head whose tip lies at `tip` and that points along `towards`."""
        length = math.hypot(*towards)
        ux, uy = towards[0] / length, towards[1] / length
        along, half = ARROW_MM[0], ARROW_MM[1] / 2
        x, y = tip[0] - along * ux, tip[1] - along * uy
        corners = [tip, (x - half * uy, y + half * ux), (x + half * uy, y - half * ux)]
        self.path([corners], "filled", closed=True, fill=BLACK)

    def hatch(self, loops: Sequence[Any]) -> None:
        """Lines at 45 degrees over a face: its outline, then its holes."""
        import shapely

        face = shapely.Polygon(loops[0], loops[1:])
        left, top, right, bottom = face.bounds
        step = HATCH_MM * math.sqrt(2)
        at = step * np.arange(math.ceil((left + top) / step), (right + bottom) / step)
        lines = shapely.MultiLineString([((s - top, top), (s - bottom, bottom)) for s in at])
        cut = shapely.get_parts(lines.intersection(face))
        self.path([line.coords for line in cut if line.length > 0], "hatch")

    def text(
        self,
        at: Point2,
        words: str,
        height_mm: float = SMALL_MM,
        anchor: str = "start",
        *,
        upright: bool = False,
    ) -> None:
        """Words with their base line's start, middle or end at a point; upright reads upwards."""
        self.marks.append(Text(at, words, height_mm, anchor, upright, self.group))

    def broken(self) -> list[Mark]:
        """The marks as they are drawn: narrow lines end at the texts that they would strike."""
        import shapely

        texts = [shapely.box(*m.box) for m in self.marks if isinstance(m, Text)]
        words = shapely.union_all(texts).buffer(GAP_MM, join_style="mitre")
        drawn: list[Mark] = []
        for mark in self.marks:
            if isinstance(mark, Polylines) and mark.style in BROKEN and not mark.closed:
                left = shapely.get_parts(shapely.MultiLineString(mark.lines).difference(words))
                lines = tuple(tuple(p.coords) for p in left if p.length > GAP_MM / 2)
                mark = replace(mark, lines=lines)
            drawn.append(mark)
        return drawn

    def svg(self) -> str:
        """The document as SVG, in real millimetres."""
        width, height = (number(side) for side in self.size_mm)
        lines = [
            f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}mm" height="{height}mm" '
            f'viewBox="0 0 {width} {height}" stroke-linejoin="round" stroke-linecap="round">',
            f"<title>{escape(self.title)}</title>",
            '<rect width="100%" height="100%" fill="#ffffff"/>',
        ]
        for name, marks in groupby(self.broken(), lambda mark: mark.group):
            drawn = map(_as_svg, marks)
            lines += [f'<g data-name="{escape(name)}">', *drawn, "</g>"] if name else drawn
        return "\n".join([*lines, "</svg>"]) + "\n"

    def pdf(self) -> bytes:
        """The document as a PDF of one page; its only font is embedded."""
        file = Document()
        scale, height = POINTS_PER_MM, self.size_mm[1] * POINTS_PER_MM
        content = [f"{scale:.6f} 0 0 {-scale:.6f} 0 {height:.6f} cm 0 G 0 g 1 j"]
        content += [line for mark in self.broken() for line in _as_pdf(mark)]
        file.page([side * scale for side in self.size_mm], "\n".join(content))
        return file.finish(self.title, f"deltact-fab {PACKAGE_VERSION}")


def _as_svg(mark: Mark) -> str:
    if isinstance(mark, Text):
        x, y = (number(v) for v in mark.at)
        turn = f' transform="rotate(-90 {x} {y})"' if mark.upright else ""
        return (
            f'<text x="{x}" y="{y}" font-family="{FONT}" '
            f'font-size="{number(mark.height_mm / CAP)}" '
            f'text-anchor="{mark.anchor}"{turn}>{escape(mark.words)}</text>'
        )
    end = "Z" if mark.closed else ""
    data = "".join(
        "M" + "L".join(f"{number(x)} {number(y)}" for x, y in line) + end for line in mark.lines
    )
    width, dashes = STROKES[mark.style]
    pen = f' stroke="{BLACK}" stroke-width="{number(width)}"' if width else ""
    if dashes:
        told = " ".join(map(number, dashes))
        pen += f' stroke-dasharray="{told}" stroke-linecap="butt"'
    fill = mark.fill or "none"
    return f'<path class="{mark.style}" d="{data}" fill="{fill}" fill-rule="evenodd"{pen}/>'


def _as_pdf(mark: Mark) -> Iterator[str]:
    """Operators of PDF, on a page whose unit is the millimetre and whose y runs down."""
    if isinstance(mark, Text):
        x, y = (number(v) for v in mark.start)
        size = number(mark.height_mm / CAP)
        turn = "0 -1 -1 0" if mark.upright else "1 0 0 -1"
        yield f"BT 0 g /F {size} Tf {turn} {x} {y} Tm <{glyphs(mark.words)}> Tj ET"
        return
    path = " ".join(
        f"{number(x)} {number(y)} {'l' if i else 'm'}" + " h" * (mark.closed and i + 1 == len(line))
        for line in mark.lines
        for i, (x, y) in enumerate(line)
    )
    if mark.fill:
        colour = " ".join(number(int(mark.fill[i : i + 2], 16) / 255) for i in (1, 3, 5))
        yield f"{colour} rg {path} f*"
    width, dashes = STROKES[mark.style]
    if width:
        told = " ".join(map(number, dashes))
        yield f"{number(width)} w {0 if dashes else 1} J [{told}] 0 d {path} S"


def block_rect(sheet: str) -> Rect:
    """Where the title block stands on a sheet."""
    width, height = SHEETS[sheet]
    right, bottom = width - BORDER_MM, height - BORDER_MM
    return right - BLOCK_MM[0], bottom - BLOCK_MM[1], right, bottom


def draw_frame(
    page: DrawingPage, sheet: str, name: str, lab: TitleBlock, told: Mapping[str, str]
) -> None:
    """Border and title block with the first-angle symbol.

    lab: what the lab says of all its drawings. told: the other cells by their labels.
    """
    width, height = SHEETS[sheet]
    b = BORDER_MM
    page.group = "sheet"
    corners = [(b, b), (width - b, b), (width - b, height - b), (b, height - b)]
    page.path([corners], "frame", closed=True)
    left, top, right, bottom = block_rect(sheet)
    page.path([[(left, bottom), (left, top), (right, top)]], "frame")
    said = {
        "Projection": "first angle", "Dimensions": "mm", "Paper": sheet, "Owner": lab.owner,
        "Drawn by": lab.drawn_by, "Approved by": lab.approved_by, "Title": name, "Sheet": "1 of 1",
        "Made by": f"deltact-fab {PACKAGE_VERSION}", "Revision": lab.revision,
        "Date of issue": lab.date, "Drawing number": lab.number and f"{lab.number}-{name}", **told,
    }  # fmt: skip
    row_mm = BLOCK_MM[1] / len(CELLS)
    for i, row in enumerate(CELLS):
        y, x = top + i * row_mm, left
        if i:
            page.line((left, y), (right, y), "thin")
        for j, (cell, label) in enumerate(row):
            if j:
                page.line((x, y), (x, y + row_mm), "thin")
            page.text((x + 1.5, y + 3.0), label, 1.8)
            words = said.get(label) or "–"
            size = LARGE_MM if label in LARGE else SMALL_MM
            # A long material is set smaller rather than over the line.
            size = min(size, size * (cell - 3) / text_width_mm(words, size))
            page.text((x + 1.5, y + 7.8), words, size)
            if label == "Projection":
                _first_angle(page, x + 31, y + row_mm / 2)
            x += cell


def _first_angle(page: DrawingPage, x: float, y: float) -> None:
    """The symbol of first-angle projection (ISO 5456-2): the cone, then its end seen from left."""
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
    """Words in lines of small text no wider than width_mm."""
    lines: list[str] = []
    for word in words.split():
        longer = f"{lines[-1]} {word}" if lines else word
        if lines and text_width_mm(longer) <= width_mm:
            lines[-1] = longer
        else:
            lines.append(word)
    return lines
