"""The sheet of a technical drawing as SVG in millimetres: frame, title block, lines and texts.

Line widths are those of ISO 128 (0.5 wide, 0.25 narrow), texts 2.5 and 3.5 mm high (ISO 3098).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from html import escape
from typing import Any

from ... import __version__

Point2 = tuple[float, float]
Rect = tuple[float, float, float, float]  # left, top, right, bottom

SHEETS = {"A4": (297.0, 210.0), "A3": (420.0, 297.0)}
BORDER_MM = 10.0
BLOCK_MM = (180.0, 36.0)
SMALL_MM, LARGE_MM = 2.5, 3.5
LINE_MM = 4.2  # from one line of small text to the next
CAP = 0.716  # height of a capital over the font's size: Helvetica, Arial and Liberation Sans
ARROW_MM = (2.5, 0.8)
FONT = "Arial, Helvetica, 'Liberation Sans', sans-serif"

# Every rule names the drawing: a page that holds several, or other pictures, is left alone.
_RULES = {
    "path, .drawing circle": "fill: none; stroke: #000; stroke-width: .25; "
    "stroke-linecap: round; stroke-linejoin: round",
    ".visible": "stroke-width: .5",
    ".hidden": "stroke-dasharray: 2 1; stroke-linecap: butt",
    ".smooth": "stroke-width: .18",
    ".centre": "stroke-width: .18; stroke-dasharray: 5 1 .6 1; stroke-linecap: butt",
    ".thin": "stroke-width: .18",
    ".cut": "stroke-width: .35; stroke-dasharray: 6 1.2 .8 1.2; stroke-linecap: butt",
    ".hatch": "stroke: none; fill: url(#hatch)",
    ".arrow": "fill: #000; stroke: none",
    ".frame": "stroke-width: .5",
    "text": f"font-family: {FONT}; fill: #000; paint-order: stroke; stroke: #fff; "
    "stroke-width: .8; stroke-linejoin: round",
}
STYLE = "\n".join(f".drawing {what} {{ {how} }}" for what, how in _RULES.items())

# Advance widths of Helvetica in thousandths of its size, by class of letter.
_WIDTHS = {
    **dict.fromkeys("ijl'|", 222),
    **dict.fromkeys("ftI .,:;/()[]!", 278),
    **dict.fromkeys("r-", 333),
    **dict.fromkeys("ckvxyzsJ", 500),
    **dict.fromkeys("abdeghnopqu0123456789L_", 556),
    **dict.fromkeys("FTZ+<>=±×~−", 611),
    **dict.fromkeys("ABEKPSVXY&", 667),
    **dict.fromkeys("CDHNRUw", 722),
    **dict.fromkeys("GOQØ⌀", 778),
    **dict.fromkeys("mM", 833),
    "W": 944,
}


def text_width_mm(text: str, height_mm: float = SMALL_MM) -> float:
    """Width of a text whose capitals are height_mm high."""
    return sum(_WIDTHS.get(letter, 722) for letter in text) / 1000 * height_mm / CAP


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


@dataclass
class Page:
    """Elements in the order they are drawn, y downwards, and the boxes that texts take."""

    items: list[str] = field(default_factory=list)
    texts: list[tuple[str, Rect]] = field(default_factory=list)

    def path(
        self, lines: Iterable[Iterable[Sequence[float]]], style: str, closed: bool = False
    ) -> None:
        """Polylines of one style; nothing when there are none."""
        if data := path_data(lines, closed):
            self.items.append(f'<path class="{style}" d="{data}"/>')

    def line(self, a: Point2, b: Point2, style: str = "thin") -> None:
        """A straight line."""
        self.path([[a, b]], style)

    def circle(self, at: Point2, radius: float, style: str = "thin") -> None:
        """A circle."""
        self.items.append(
            f'<circle class="{style}" cx="{number(at[0])}" cy="{number(at[1])}" '
            f'r="{number(radius)}"/>'
        )

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
        bold: bool = False,
    ) -> None:
        """Words with their base line's start, middle or end at a point; upright reads upwards."""
        x, y = at
        width = text_width_mm(words, height_mm) * (1.06 if bold else 1.0)
        left = {"start": 0.0, "middle": -width / 2, "end": -width}[anchor]
        if upright:
            box = (x - height_mm, y - left - width, x, y - left)
        else:
            box = (x + left, y - height_mm, x + left + width, y)
        self.texts.append((words, box))
        turn = f' transform="rotate(-90 {number(x)} {number(y)})"' if upright else ""
        weight = ' font-weight="bold"' if bold else ""
        self.items.append(
            f'<text x="{number(x)}" y="{number(y)}" font-size="{number(height_mm / CAP)}" '
            f'text-anchor="{anchor}"{weight}{turn}>{escape(words)}</text>'
        )

    def open(self, name: str, **data: Any) -> None:
        """Begin a group."""
        more = "".join(f' data-{key}="{escape(str(value))}"' for key, value in data.items())
        self.items.append(f'<g id="{escape(name)}"{more}>')

    def close(self) -> None:
        """End the group."""
        self.items.append("</g>")

    def svg(self, width_mm: float, height_mm: float, title: str) -> str:
        """The whole document, in real millimetres."""
        size = f'width="{number(width_mm)}mm" height="{number(height_mm)}mm"'
        head = (
            f'<svg xmlns="http://www.w3.org/2000/svg" class="drawing" {size} '
            f'viewBox="0 0 {number(width_mm)} {number(height_mm)}">'
        )
        hatch = (
            '<defs><pattern id="hatch" width="2" height="2" patternUnits="userSpaceOnUse" '
            'patternTransform="rotate(45)"><line x1="0" y1="0" x2="0" y2="2" '
            'style="stroke:#000;stroke-width:.36"/></pattern></defs>'
        )
        paper = '<rect width="100%" height="100%" style="fill:#fff;stroke:none"/>'
        lines = [
            head,
            f"<title>{escape(title)}</title>",
            f"<style>\n{STYLE}\n</style>",
            hatch,
            paper,
        ]
        return "\n".join([*lines, *self.items, "</svg>"]) + "\n"


@dataclass(frozen=True)
class Title:
    """What the title block says."""

    name: str
    group: str
    material: str
    process: str
    quantity: int
    scale: str
    sheet: str
    general_tolerance: str


def block_rect(sheet: str) -> Rect:
    """Where the title block stands on a sheet."""
    width, height = SHEETS[sheet]
    right, bottom = width - BORDER_MM, height - BORDER_MM
    return right - BLOCK_MM[0], bottom - BLOCK_MM[1], right, bottom


def draw_frame(page: Page, title: Title) -> None:
    """Border, title block with the first-angle symbol, and the notes beside or above it."""
    width, height = SHEETS[title.sheet]
    b = BORDER_MM
    page.open("sheet")
    corners = [(b, b), (width - b, b), (width - b, height - b), (b, height - b)]
    page.path([corners], "frame", closed=True)
    left, top, right, bottom = block_rect(title.sheet)
    page.path([[(left, bottom), (left, top), (right, top)]], "frame")
    cells: list[list[tuple[float, str, str]]] = [
        [(86, "Material", title.material), (64, "Process", title.process),
         (30, "Quantity", str(title.quantity))],
        [(46, "General tolerances", title.general_tolerance), (40, "Projection", "first angle"),
         (32, "Dimensions", "mm"), (32, "Scale", title.scale), (30, "Sheet", title.sheet)],
        [(86, "Part", title.name), (64, "Belongs to", title.group),
         (30, "Made by", f"deltact-fab {__version__}")],
    ]  # fmt: skip
    row_mm = BLOCK_MM[1] / len(cells)
    for i, row in enumerate(cells):
        y, x = top + i * row_mm, left
        if i:
            page.line((left, y), (right, y), "thin")
        for j, (cell, label, words) in enumerate(row):
            if j:
                page.line((x, y), (x, y + row_mm), "thin")
            page.text((x + 1.5, y + 3.6), label, 1.8)
            if words:
                size = LARGE_MM if label in ("Part", "Scale") else SMALL_MM
                # A long material is set smaller rather than over the line.
                wide = text_width_mm(words, size) * 1.06
                size = min(size, size * (cell - 3) / wide)
                page.text((x + 1.5, y + 9.4), words, size, bold=label == "Part")
            if label == "Projection":
                _first_angle(page, x + 28.5, y + row_mm / 2)
            x += cell
    page.close()


def _first_angle(page: Page, x: float, y: float) -> None:
    """The symbol of first-angle projection (ISO 5456-2): the cone, then its end seen from left."""
    h, r, length = 6.0, 1.5, 6.0
    cone = [(x - length, y - r), (x, y - h / 2), (x, y + h / 2), (x - length, y + r)]
    page.path([cone], "thin", closed=True)
    cx = x + 2.5 + h / 2
    for radius in (r, h / 2):
        page.circle((cx, y), radius)
    page.line((x - length - 1, y), (x + 1, y), "centre")
    page.line((cx - h / 2 - 1, y), (cx + h / 2 + 1, y), "centre")
    page.line((cx, y - h / 2 - 1), (cx, y + h / 2 + 1), "centre")


def wrapped(words: str, width_mm: float, height_mm: float = SMALL_MM) -> list[str]:
    """Words in lines no wider than width_mm."""
    lines: list[str] = []
    for word in words.split():
        longer = f"{lines[-1]} {word}" if lines else word
        if lines and text_width_mm(longer, height_mm) <= width_mm:
            lines[-1] = longer
        else:
            lines.append(word)
    return lines
