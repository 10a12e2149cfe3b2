"""What stands on a drawing, in millimetres with y downwards, and the same page as SVG or PDF.

Line widths are those of ISO 128 (0.5 wide, 0.25 narrow), texts 2.5 and 3.5 mm high (ISO 3098).
Where a narrow line meets a text it is broken, so that no text is struck through.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from html import escape
from typing import Any

from ...aliases import Point2
from ...pdf import Document, glyphs, width_em
from ...units import POINTS_PER_MM
from ...version import VERSION

Rect = tuple[float, float, float, float]  # left, top, right, bottom

SMALL_MM, LARGE_MM = 2.5, 3.5
CAP = 0.716  # height of a capital over the font's size: Helvetica and Arial
ARROW_MM = (2.5, 0.8)
FONT = "Arial, Helvetica, 'Liberation Sans', sans-serif"
GAP_MM = 0.4  # between a text and the ends of a line that it breaks
HATCH_MM, HATCH_WIDTH_MM = 2.0, 0.18


@dataclass(frozen=True)
class Stroke:
    """Width of a line in mm; its dashes, lines and gaps in turn."""

    width_mm: float
    dashes_mm: tuple[float, ...] = ()


STROKES = {
    "visible": Stroke(0.5),
    "hidden": Stroke(0.25, (2, 1)),
    "smooth": Stroke(0.18),
    "centre": Stroke(0.18, (5, 1, 0.6, 1)),
    "thin": Stroke(0.18),
    "cut": Stroke(0.35, (6, 1.2, 0.8, 1.2)),
    "frame": Stroke(0.5),
    "picture": Stroke(0.25),
}
BROKEN = ("thin", "centre", "cut")
"""Styles of lines that give way to a text."""


def _rules() -> Iterator[str]:
    """Every rule names the drawing: a page that holds several, or pictures, is left alone."""
    lines = "fill: none; stroke: #000; stroke-linecap: round; stroke-linejoin: round"
    yield f"path, .drawing circle {{ {lines} }}"
    for name, stroke in STROKES.items():
        dashes = " ".join(number(v) for v in stroke.dashes_mm)
        more = f"; stroke-dasharray: {dashes}; stroke-linecap: butt" if dashes else ""
        yield f".{name} {{ stroke-width: {number(stroke.width_mm)}{more} }}"
    yield ".hatch { stroke: none; fill: url(#hatch) }"
    yield ".arrow { fill: #000; stroke: none }"
    yield f"text {{ font-family: {FONT}; fill: #000 }}"


def text_width_mm(text: str, height_mm: float = SMALL_MM) -> float:
    """Width of a text whose capitals are height_mm high."""
    return width_em(text) * height_mm / CAP


def meet(a: Rect, b: Rect) -> bool:
    """Whether two rectangles overlap."""
    return a[0] < b[2] and b[0] < a[2] and a[1] < b[3] and b[1] < a[3]


def number(value: float) -> str:
    """A coordinate: thousandths of a millimetre, no trailing zeros, no minus zero."""
    return f"{round(value, 3) + 0.0:.3f}".rstrip("0").rstrip(".")


def path_data(lines: Iterable[Iterable[Sequence[float]]], closed: bool = False) -> str:
    """Polylines as the `d` of a path."""
    end = "Z" if closed else ""
    return "".join(
        "M" + "L".join(f"{number(x)} {number(y)}" for x, y in line) + end for line in lines
    )


@dataclass(frozen=True)
class Polylines:
    """Polylines of one style."""

    lines: tuple[tuple[Point2, ...], ...]
    style: str
    closed: bool = False

    @property
    def shape(self) -> Any:
        """What it draws."""
        import shapely

        ends = [(*line, line[0]) if self.closed else line for line in self.lines]
        return shapely.MultiLineString(ends)


@dataclass(frozen=True)
class Ring:
    """A circle."""

    at: Point2
    radius: float
    style: str

    @property
    def shape(self) -> Any:
        """What it draws."""
        import shapely

        return shapely.Point(self.at).buffer(self.radius).exterior


@dataclass(frozen=True)
class Text:
    """Words with their base line's start, middle or end at a point; upright reads upwards."""

    at: Point2
    words: str
    height_mm: float
    anchor: str
    upright: bool

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

    @property
    def shape(self) -> Any:
        """The same."""
        import shapely

        return shapely.box(*self.box)


@dataclass(frozen=True)
class MarkGroup:
    """Marks up to the next end belong together; what is told of them stands in the SVG."""

    name: str
    data: tuple[tuple[str, str], ...] = ()


@dataclass(frozen=True)
class End:
    """The end of a group."""


Mark = Polylines | Ring | Text | MarkGroup | End


@dataclass
class DrawingPage:
    """Marks in the order they are drawn, on a sheet of size_mm."""

    size_mm: Point2
    title: str
    marks: list[Mark] = field(default_factory=list)

    def path(
        self, lines: Iterable[Iterable[Sequence[float]]], style: str, closed: bool = False
    ) -> None:
        """Polylines of one style; nothing when there are none."""
        drawn = tuple(tuple((float(x), float(y)) for x, y in line) for line in lines)
        if drawn:
            self.marks.append(Polylines(drawn, style, closed))

    def line(self, a: Point2, b: Point2, style: str = "thin") -> None:
        """A straight line."""
        self.path([[a, b]], style)

    def circle(self, at: Point2, radius: float, style: str = "thin") -> None:
        """A circle."""
        self.marks.append(Ring(at, radius, style))

    def arrow(self, tip: Point2, towards: Point2) -> None:
        """A filled arrow head whose tip lies at `tip` and that points along `towards`."""
        length = math.hypot(*towards)
        ux, uy = towards[0] / length, towards[1] / length
        along, half = ARROW_MM[0], ARROW_MM[1] / 2
        x, y = tip[0] - along * ux, tip[1] - along * uy
        corners = [tip, (x - half * uy, y + half * ux), (x + half * uy, y - half * ux)]
        self.path([corners], "arrow", closed=True)

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
        self.marks.append(Text(at, words, height_mm, anchor, upright))

    def open(self, name: str, **data: Any) -> None:
        """Begin a group."""
        self.marks.append(MarkGroup(name, tuple((key, str(value)) for key, value in data.items())))

    def close(self) -> None:
        """End the group."""
        self.marks.append(End())

    def crossings(self, rect: Rect) -> int:
        """How many lines, circles and texts drawn so far meet a rectangle."""
        import shapely

        area = shapely.box(*rect)
        return sum(
            int(shapely.intersects(area, shapely.get_parts(mark.shape)).sum())
            for mark in self.marks
            if isinstance(mark, Polylines | Ring | Text)
        )

    def broken(self) -> list[Mark]:
        """The marks as they are drawn: narrow lines end at the texts that they would strike."""
        import shapely

        texts = [m.shape for m in self.marks if isinstance(m, Text)]
        words = shapely.union_all(texts).buffer(GAP_MM, join_style="mitre")
        drawn: list[Mark] = []
        for mark in self.marks:
            if isinstance(mark, Polylines) and mark.style in BROKEN and not mark.closed:
                left = shapely.get_parts(mark.shape.difference(words))
                lines = tuple(tuple(p.coords) for p in left if p.length > GAP_MM / 2)
                if lines:
                    drawn.append(Polylines(lines, mark.style))
            else:
                drawn.append(mark)
        return drawn

    def svg(self) -> str:
        """The document as SVG, in real millimetres."""
        width, height = (number(side) for side in self.size_mm)
        style = "".join(f".drawing {rule}\n" for rule in _rules())
        lines = [
            f'<svg xmlns="http://www.w3.org/2000/svg" class="drawing" width="{width}mm" '
            f'height="{height}mm" viewBox="0 0 {width} {height}">',
            f"<title>{escape(self.title)}</title>",
            f"<style>\n{style}</style>",
            f'<defs><pattern id="hatch" width="{HATCH_MM:g}" height="{HATCH_MM:g}" '
            'patternUnits="userSpaceOnUse" patternTransform="rotate(45)"><line x1="1" y1="0" '
            f'x2="1" y2="{HATCH_MM:g}" style="stroke:#000;stroke-width:{HATCH_WIDTH_MM:g}"/>'
            "</pattern></defs>",
            '<rect width="100%" height="100%" style="fill:#fff;stroke:none"/>',
            *(_as_svg(mark) for mark in self.broken()),
            "</svg>",
        ]
        return "\n".join(lines) + "\n"

    def pdf(self) -> bytes:
        """The document as a PDF of one page; its only font is embedded."""
        file = Document()
        scale, height = POINTS_PER_MM, self.size_mm[1] * POINTS_PER_MM
        content = [f"{scale:.6f} 0 0 {-scale:.6f} 0 {height:.6f} cm 0 G 0 g 1 j"]
        content += [line for mark in self.broken() for line in _as_pdf(mark)]
        file.page([side * scale for side in self.size_mm], "\n".join(content))
        return file.finish(self.title, f"deltact-fab {VERSION}")


def _as_svg(mark: Mark) -> str:
    if isinstance(mark, Polylines):
        return f'<path class="{mark.style}" d="{path_data(mark.lines, mark.closed)}"/>'
    if isinstance(mark, Ring):
        x, y = (number(v) for v in mark.at)
        return f'<circle class="{mark.style}" cx="{x}" cy="{y}" r="{number(mark.radius)}"/>'
    if isinstance(mark, Text):
        x, y = (number(v) for v in mark.at)
        turn = f' transform="rotate(-90 {x} {y})"' if mark.upright else ""
        return (
            f'<text x="{x}" y="{y}" font-size="{number(mark.height_mm / CAP)}" '
            f'text-anchor="{mark.anchor}"{turn}>{escape(mark.words)}</text>'
        )
    if isinstance(mark, MarkGroup):
        more = "".join(f' data-{key}="{escape(value)}"' for key, value in mark.data)
        return f'<g id="{escape(mark.name)}"{more}>'
    return "</g>"


def _as_pdf(mark: Mark) -> Iterator[str]:
    """Operators of PDF, on a page whose unit is the millimetre and whose y runs down."""
    if isinstance(mark, Text):
        x, y = (number(v) for v in mark.start)
        size = number(mark.height_mm / CAP)
        turn = "0 -1 -1 0" if mark.upright else "1 0 0 -1"
        yield f"BT /F {size} Tf {turn} {x} {y} Tm <{glyphs(mark.words)}> Tj ET"
    elif isinstance(mark, Ring):
        yield f"{_pen(mark.style)} {_round(mark.at, mark.radius)} S"
    elif isinstance(mark, Polylines):
        end = " h" if mark.closed else ""
        path = " ".join(
            " ".join(
                f"{number(x)} {number(y)} {'l' if i else 'm'}" for i, (x, y) in enumerate(line)
            )
            + end
            for line in mark.lines
        )
        if mark.style == "arrow":
            yield f"{path} f"
        elif mark.style == "hatch":
            yield f"q {path} W* n {number(HATCH_WIDTH_MM)} w [] 0 d {_hatch(mark)} S Q"
        else:
            yield f"{_pen(mark.style)} {path} S"


def _pen(style: str) -> str:
    stroke = STROKES[style]
    dashes = " ".join(number(v) for v in stroke.dashes_mm)
    return f"{number(stroke.width_mm)} w {0 if dashes else 1} J [{dashes}] 0 d"


def _round(at: Point2, radius: float) -> str:
    """A circle as four Bezier curves, true to 0.03 % of its radius."""
    x, y = at
    k = 4 / 3 * (math.sqrt(2) - 1)
    ways = ((1, 0), (0, 1), (-1, 0), (0, -1), (1, 0))
    path = [f"{number(x + radius)} {number(y)} m"]
    for (a, b), (c, d) in itertools.pairwise(ways):
        points = ((a + k * c, b + k * d), (c + k * a, d + k * b), (c, d))
        path.append(
            " ".join(f"{number(x + radius * u)} {number(y + radius * v)}" for u, v in points)
        )
        path[-1] += " c"
    return " ".join(path)


def _hatch(mark: Polylines) -> str:
    """Lines at 45 degrees over everything that the mark holds, where the SVG's pattern has them."""
    points = [point for line in mark.lines for point in line]
    low, high = min(y for _, y in points), max(y for _, y in points)
    step = HATCH_MM * math.sqrt(2)
    first = min(x + y for x, y in points)
    last = max(x + y for x, y in points)
    at = (math.floor(first / step) + 0.5) * step
    path = []
    while at < last:
        path.append(f"{number(at - low)} {number(low)} m {number(at - high)} {number(high)} l")
        at += step
    return " ".join(path)
