"""The sheet of a technical drawing: frame, title block, first-angle symbol."""

from __future__ import annotations

from dataclasses import dataclass

from ...version import VERSION
from .page import LARGE_MM, SMALL_MM, DrawingPage, Rect, text_width_mm
from .title import TitleBlock

SHEETS = {"A4": (297.0, 210.0), "A3": (420.0, 297.0)}
BORDER_MM = 10.0
BLOCK_MM = (180.0, 45.0)
LARGE = ("Title", "Scale", "Drawing number", "Revision")
LINE_MM = 4.2  # from one line of small text to the next


@dataclass(frozen=True)
class Title:
    """What the title block says (ISO 7200), beside what the lab says of all its drawings."""

    name: str
    group: str
    material: str
    process: str
    quantity: int
    scale: str
    sheet: str
    general_tolerance: str
    lab: TitleBlock
    document: str = "part drawing"


def block_rect(sheet: str) -> Rect:
    """Where the title block stands on a sheet."""
    width, height = SHEETS[sheet]
    right, bottom = width - BORDER_MM, height - BORDER_MM
    return right - BLOCK_MM[0], bottom - BLOCK_MM[1], right, bottom


def draw_frame(page: DrawingPage, title: Title) -> None:
    """Border, title block with the first-angle symbol, and the notes beside or above it."""
    width, height = SHEETS[title.sheet]
    b = BORDER_MM
    page.group = "sheet"
    corners = [(b, b), (width - b, b), (width - b, height - b), (b, height - b)]
    page.path([corners], "frame", closed=True)
    left, top, right, bottom = block_rect(title.sheet)
    page.path([[(left, bottom), (left, top), (right, top)]], "frame")
    lab = title.lab
    cells: list[list[tuple[float, str, str]]] = [
        [(90, "Material", title.material), (60, "Process", title.process),
         (30, "Quantity", str(title.quantity))],
        [(66, "General tolerances", title.general_tolerance), (44, "Projection", "first angle"),
         (22, "Dimensions", "mm"), (24, "Scale", title.scale), (24, "Paper", title.sheet)],
        [(66, "Owner", lab.owner), (44, "Drawn by", lab.drawn_by),
         (46, "Approved by", lab.approved_by), (24, "Document", title.document)],
        [(90, "Title", title.name), (60, "Belongs to", title.group),
         (30, "Made by", f"deltact-fab {VERSION}")],
        [(90, "Drawing number", lab.number_of(title.name)), (20, "Revision", lab.revision),
         (40, "Date of issue", lab.date), (30, "Sheet", "1 of 1")],
    ]  # fmt: skip
    row_mm = BLOCK_MM[1] / len(cells)
    for i, row in enumerate(cells):
        y, x = top + i * row_mm, left
        if i:
            page.line((left, y), (right, y), "thin")
        for j, (cell, label, words) in enumerate(row):
            if j:
                page.line((x, y), (x, y + row_mm), "thin")
            page.text((x + 1.5, y + 3.0), label, 1.8)
            words = words or "–"
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
