"""The one way from a template to a page.

One pass over a finished page serves all of them, whatever made their cells.
"""

from __future__ import annotations

import html
import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..extras import require
from ..files import making, write_whole

_TABLE = re.compile(r"<table\b(?P<attributes>[^>]*)>(?P<body>.*?)</table>", re.DOTALL)
_ROW = re.compile(r"<tr\b([^>]*)>(.*?)</tr>", re.DOTALL)
_CELL = re.compile(r"<(t[hd])\b([^>]*)>(.*?)</\1>", re.DOTALL)
_SPAN = re.compile(r'\s*(col|row)span="(\d+)"')
_TAG = re.compile(r"<(?!img|svg)[^>]*>")
_NONE = re.compile(r'\s*data-none="([^"]*)"')
_STACK = re.compile(r'class="[^"]*\bstack\b')
_NOTHING = frozenset({"", "–", "—", "-", "n.a."})


@dataclass
class _Cell:
    """across, down: how many columns and rows it takes; first: its leftmost column."""

    kind: str
    attributes: str
    text: str
    first: int
    across: int
    down: int

    @property
    def empty(self) -> bool:
        return html.unescape(_TAG.sub("", self.text)).strip() in _NOTHING

    def columns(self) -> range:
        return range(self.first, self.first + self.across)


Row = tuple[str, list[_Cell]]


def tidied(page: str) -> str:
    """The page with its tables tidied.

    A column goes when all its cells but the heads are empty, a row when all are but its first, the
    row's name. Where none is left, the table's `data-none` stands in its place. Heads come into a
    `<thead>`, which every printed sheet repeats. A cell of a table of class `stack` learns its head
    (`data-head`), which stands before it where a narrow window breaks the rows.
    """
    return _TABLE.sub(_table, page)


def _table(found: re.Match[str]) -> str:
    head, body = _split(_rows(found["body"]))
    named = any(len(cells) > 1 for _, cells in body)
    body = [row for row in body if not (named and _says_nothing(row[1]))]
    told = _NONE.search(found["attributes"])
    if not body:
        return f'<p class="soft">{told[1] if told else "There is nothing to show."}</p>'
    columns = {k for _, cells in [*head, *body] for cell in cells for k in cell.columns()}
    full = [c for _, cells in body for c in cells if c.kind == "td" and not c.empty]
    filled = {cell.first for cell in full if cell.across == 1}
    for cell in full:  # words across several columns keep one of them, if nothing else does
        if filled.isdisjoint(cell.columns()):
            filled.add(cell.first)
    gone = columns - filled
    heads = {}
    if _STACK.search(found["attributes"]) and len(head) == 1:
        heads = {cell.first: _plain(cell.text) for cell in head[0][1]}
    lines = [f"<table{_NONE.sub('', found['attributes'])}>"]
    if head:
        lines += ["<thead>", *(_line(row, gone, {}) for row in head), "</thead>"]
    return "\n".join(
        [*lines, "<tbody>", *(_line(r, gone, heads) for r in body), "</tbody></table>"]
    )


def _rows(text: str) -> list[Row]:
    """Rows of a table's inside, each cell with the columns that it takes."""
    rows: list[Row] = []
    taken: dict[int, int] = {}  # column: rows for which a cell above still reaches down into it
    for attributes, inside in _ROW.findall(text):
        cells, at = [], 0
        below = {k: left - 1 for k, left in taken.items() if left > 1}
        for kind, own, words in _CELL.findall(inside):
            spans = {which: int(number) for which, number in _SPAN.findall(own)}
            while taken.get(at, 0):
                at += 1
            cell = _Cell(kind, _SPAN.sub("", own), words, at, spans.get("col", 1),
                         spans.get("row", 1))  # fmt: skip
            below.update(dict.fromkeys(cell.columns(), cell.down - 1) if cell.down > 1 else {})
            cells.append(cell)
            at += cell.across
        taken = below
        rows.append((attributes, cells))
    return rows


def _split(rows: list[Row]) -> tuple[list[Row], list[Row]]:
    """Heads and the rest; one cell across a whole row is the title of a group and no head."""
    count = 0
    for _, cells in rows:
        if (len(cells) == 1 and cells[0].across > 1) or any(c.kind != "th" for c in cells):
            break
        count += 1
    return rows[:count], rows[count:]


def _says_nothing(cells: list[_Cell]) -> bool:
    """Whether a row has a name and nothing else."""
    return all(cell.kind == "td" for cell in cells) and all(c.empty for c in cells[1:]) and (
        len(cells) > 1 or all(c.empty for c in cells)
    )  # fmt: skip


def _line(row: Row, gone: set[int], heads: dict[int, str]) -> str:
    attributes, cells = row
    return f"<tr{attributes}>{''.join(_written(cell, gone, heads) for cell in cells)}</tr>"


def _written(cell: _Cell, gone: set[int], heads: dict[int, str]) -> str:
    left = len(set(cell.columns()) - gone)
    if not left:
        return ""
    attributes = cell.attributes
    if left > 1:
        attributes += f' colspan="{left}"'
    if cell.down > 1:
        attributes += f' rowspan="{cell.down}"'
    if cell.kind == "td" and cell.first in heads:
        attributes += f' data-head="{heads[cell.first]}"'
    return f"<{cell.kind}{attributes}>{cell.text}</{cell.kind}>"


def _plain(text: str) -> str:
    """Words of a head for an attribute."""
    return html.escape(html.unescape(re.sub(r"<[^>]*>", "", text)).strip(), quote=True)


def require_pages() -> None:
    """Raises MissingLibrary without the extra `report`; call it before the work for a page."""
    require("report", "a page", "jinja2", "matplotlib")


def environment(**filters: Callable[..., str]) -> Any:
    """A jinja2 environment over this package's templates, with the filters given.

    A name that a template does not find is an error. Raises MissingLibrary without the extra
    `report`.
    """
    require_pages()
    import jinja2

    made = jinja2.Environment(
        loader=jinja2.FileSystemLoader(Path(__file__).parent / "templates"),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    made.filters.update(filters, named=named)
    return made


# Of a key or a column: what its last part says of the unit.
_UNITS = {
    "mm": "mm", "mm2": "mm²", "mm3": "mm³", "cm3": "cm³", "um": "µm", "px": "px", "n": "N",
    "s": "s", "nmm": "N mm", "mpa": "MPa", "kpa": "kPa", "ms": "ms", "mb": "MB",
    "percent": "%", "deg": "°",
}  # fmt: skip


def named(key: str) -> str:
    """A key or column as a page writes it: `normal_rmse_n` is "normal rmse, N"."""
    words, _, last = key.rpartition("_")
    if words and last in _UNITS:
        return f"{words.replace('_', ' ')}, {_UNITS[last]}"
    return key.replace("_", " ")


def render(pages: Any, template: str, **values: Any) -> str:
    """The page of a template of `environment`, its tables tidied."""
    return tidied(pages.get_template(template).render(**values))


def save(page: str, out: Path) -> Path:
    """Write a page whole, into a folder that is made where it is missing.

    Raises InputError when the folder cannot be, RunFailed when the disk refuses.
    """
    with making(out.parent):
        out.parent.mkdir(parents=True, exist_ok=True)
    write_whole(out, page.encode())
    return out
