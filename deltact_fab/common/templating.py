"""The one way from a template to a page, from findings to its verdict, from a frame to a table."""

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

MAX_COLUMNS = 14  # as many as a sheet of paper holds; a file has the others
SHORT_CELL_LETTERS = 32  # letters that stay on one line


def require_pages() -> None:
    """Require what a page needs; call it before the work. Raises MissingLibrary."""
    require_extra("report", "a page", "jinja2", "matplotlib")


def render_page(template: str, findings: Iterable[Check], **values: Any) -> str:
    """Fill a template of this package; a name that it does not find is an error.

    findings: sentences for and against what the page shows, which make its verdict. Raises
    MissingLibrary without the extra `report`.
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
    """Write a page whole, as `render_page` makes it; its folder is made where it is missing.

    Raises InputError when the folder cannot be, RunFailed when the disk refuses.
    """
    page = render_page(template, findings, **values)
    make_folder(out.parent)
    write_whole(out, page.encode())
    return out


class Verdict(NamedTuple):
    """What a page says first: its findings, each once, and the worst status of them."""

    checks: tuple[Check, ...]
    status: Status


def page_verdict(checks: Iterable[Check]) -> Verdict:
    """Sum of all that a page has to say for and against what it shows."""
    unique = tuple({(check.value, check.status): check for check in checks}.values())
    return Verdict(unique, max((c.status for c in unique), key=STATUS_ORDER.index, default="pass"))


# Of a key or a column: what its last part says of the unit.
_UNIT_LABELS = {
    "mm": "mm", "mm2": "mm²", "mm3": "mm³", "cm3": "cm³", "um": "µm", "px": "px", "n": "N",
    "s": "s", "nmm": "N mm", "mpa": "MPa", "kpa": "kPa", "ms": "ms", "mb": "MB",
    "percent": "%", "deg": "°",
}  # fmt: skip


def label(key: str) -> str:
    """A key or column as a page writes it: `normal_rmse_n` is "normal rmse, N"."""
    words, _, last = key.rpartition("_")
    if words and last in _UNIT_LABELS:
        return f"{words.replace('_', ' ')}, {_UNIT_LABELS[last]}"
    return key.replace("_", " ")


def format_number(value: Any, decimals: int | None = None) -> str:
    """Format a number with four digits at most; an empty text where there is none.

    decimals: as it is read off a balance or a rule instead: so many, without trailing zeros.
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
    return text.replace(",", "\u202f").replace("-", "−")  # a thin space that does not break


def cell(value: Any) -> str:
    """A value as a page shows it."""
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
    """Prepare a table for the macro `table`; columns without any value are left out.

    words: what stands above a column in place of its name. marks, links: the class of each row, and
    where its first cell leads. keys: a column of keys, shown by their labels.
    beyond: names of the columns that are not shown.
    """
    heads = words or {}
    cells = {
        name: [label(value) if name == keys else cell(value) for value in frame[name]]
        for name in frame
    }
    filled = [name for name, column in cells.items() if any(column) or not column]
    columns = filled[:MAX_COLUMNS]
    return {
        "head": [
            {"words": heads.get(str(name)) or label(str(name)), "kind": _kind(frame[name])}
            for name in columns
        ],
        "rows": list(zip(*(cells[name] for name in columns), strict=True)),
        "marks": list(marks) or [""] * len(frame),
        "links": links,
        "beyond": [label(str(name)) for name in filled[MAX_COLUMNS:]],
    }


def _kind(column: pd.Series[Any]) -> str:
    """number, or short or long words: the last are broken into lines."""
    values = column.dropna()
    if all(isinstance(value, int | float) or hasattr(value, "dtype") for value in values):
        return "number"
    return "short" if max(len(str(value)) for value in values) <= SHORT_CELL_LETTERS else "long"
