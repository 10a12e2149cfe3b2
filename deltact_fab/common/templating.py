"""Rendering of pages from templates, of a verdict from checks, of HTML tables from frames."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from numbers import Real
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from deltact_fab.paths import asset

from .checks import STATUS_ORDER, Check, Status
from .errors import require_extra
from .files import make_folder, write_whole

if TYPE_CHECKING:
    import pandas as pd

MAX_COLUMNS = 14  # by hand: fits a sheet of paper; the data file has all
SHORT_CELL_LETTERS = 32  # by hand: longer cells wrap


def require_pages() -> None:
    """Check that page rendering is installed, before the work. Raises MissingLibrary."""
    require_extra("report", "a page", "jinja2", "matplotlib")


def render_page(template: str, findings: Iterable[Check], **values: Any) -> str:
    """Fill a template of this package; an undefined name is an error.

    findings: checks that make up the page's verdict. Raises MissingLibrary without the extra
    `report`.
    """
    require_pages()
    import jinja2

    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(asset("templates")),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters.update(
        num=format_number, fig=lambda value, decimals=1: format_number(value, decimals)
    )
    return environment.get_template(template).render(verdict=page_verdict(findings), **values)


def write_page(out: Path, template: str, findings: Iterable[Check], **values: Any) -> Path:
    """Render a page as `render_page` does and write it atomically; creates its folder.

    Raises InputError if the folder cannot be created, RunFailed for a disk error.
    """
    page = render_page(template, findings, **values)
    make_folder(out.parent)
    write_whole(out, page.encode())
    return out


class Verdict(NamedTuple):
    """Verdict of a page: its distinct checks and their worst status."""

    checks: tuple[Check, ...]
    status: Status


def page_verdict(checks: Iterable[Check]) -> Verdict:
    """Combine the checks of a page into a verdict."""
    unique = tuple({(check.value, check.status): check for check in checks}.values())
    return Verdict(unique, max((c.status for c in unique), key=STATUS_ORDER.index, default="pass"))


# Unit by the last part of a key or column.
_UNIT_LABELS = {
    "mm": "mm", "mm2": "mm²", "mm3": "mm³", "cm3": "cm³", "um": "µm", "px": "px", "n": "N",
    "s": "s", "nmm": "N mm", "mpa": "MPa", "kpa": "kPa", "ms": "ms", "mb": "MB",
    "percent": "%", "deg": "°",
}  # fmt: skip


def format_label(key: str) -> str:
    """Format a key or column as a label: `normal_rmse_n` is "normal rmse, N"."""
    words, _, last = key.rpartition("_")
    if words and last in _UNIT_LABELS:
        return f"{words.replace('_', ' ')}, {_UNIT_LABELS[last]}"
    return key.replace("_", " ")


def format_number(value: Any, decimals: int | None = None) -> str:
    """Format a number with at most four significant digits; empty for None or nan.

    decimals: fixed number of decimals instead, without trailing zeros.
    """
    if decimals is not None:
        fixed = f"{value:.{decimals}f}"
        return fixed.rstrip("0").rstrip(".") if decimals else fixed
    if value is None or not math.isfinite(value):
        return ""
    size = abs(value)
    if float(value).is_integer() and size < 1e9:
        text = f"{int(value):,}"
    elif 1e4 <= size < 1e9:
        text = f"{value:,.0f}"
    else:
        text = f"{value:.4g}" if size >= 1e-4 else f"{value:.2e}"
    return text.replace(",", "\u202f").replace("-", "−")  # narrow no-break space


def format_cell(value: Any) -> str:
    """Format a table cell."""
    import numpy as np

    if isinstance(value, bool | np.bool_):
        return "yes" if value else "no"
    return format_number(value) if value is None or isinstance(value, Real) else str(value)


def html_table(
    frame: pd.DataFrame,
    words: Mapping[str, str] | None = None,
    marks: Sequence[str] = (),
    links: Sequence[str] = (),
    keys: str = "",
) -> dict[str, Any]:
    """Prepare a table for the macro `table`; empty columns are dropped.

    words: column headings instead of names. marks, links: CSS class of each row and link of its
    first cell. keys: a column of keys, shown as labels. Result key `beyond`: labels of the columns
    over MAX_COLUMNS.
    """
    heads = words or {}
    cells = {
        name: [format_label(value) if name == keys else format_cell(value) for value in frame[name]]
        for name in frame
    }
    filled = [name for name, column in cells.items() if any(column) or not column]
    columns = filled[:MAX_COLUMNS]
    return {
        "head": [
            {"words": heads.get(str(name)) or format_label(str(name)), "kind": _kind(frame[name])}
            for name in columns
        ],
        "rows": list(zip(*(cells[name] for name in columns), strict=True)),
        "marks": list(marks) or [""] * len(frame),
        "links": links,
        "beyond": [format_label(str(name)) for name in filled[MAX_COLUMNS:]],
    }


def _kind(column: pd.Series[Any]) -> str:
    """Column kind: number, short or long text (wrapped)."""
    values = column.dropna()
    if all(isinstance(value, int | float) or hasattr(value, "dtype") for value in values):
        return "number"
    return "short" if max(len(str(value)) for value in values) <= SHORT_CELL_LETTERS else "long"
