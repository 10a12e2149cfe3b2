"""The one way from a template to a page, from findings to its verdict, from a frame to a table."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from numbers import Real
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from deltact_fab.paths import asset

from .checks import Check, Status, worst
from .extras import require_extra
from .files import make_folder, write_whole

if TYPE_CHECKING:
    import pandas as pd

MAX_COLUMNS = 14  # as many as a sheet of paper holds; a file has the others
SHORT = 32  # letters that stay on one line


def require_pages() -> None:
    """Raises MissingLibrary without the extra `report`; call it before the work for a page."""
    require_extra("report", "a page", "jinja2", "matplotlib")


def render_page(template: str, **values: Any) -> str:
    """The page of a template of this package; a name that it does not find is an error.

    Raises MissingLibrary without the extra `report`.
    """
    require_pages()
    import jinja2

    made = jinja2.Environment(
        loader=jinja2.FileSystemLoader(asset("templates")),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    made.filters.update(num=format_number, fig=format_fixed)
    return made.get_template(template).render(**values)


class Verdict(NamedTuple):
    """What a page says first: its findings, each once, and the worst status of them."""

    checks: tuple[Check, ...]
    status: Status


def finding(id: str, text: str, status: Status = "pass") -> Check:
    """A sentence of a page's verdict."""
    return Check(id, value=text, status=status)


def page_verdict(checks: Iterable[Check]) -> Verdict:
    """Sum of all that a page has to say for and against what it shows."""
    once = tuple({(check.value, check.status): check for check in checks}.values())
    return Verdict(once, worst(once))


def warning_findings(id: str, lines: Iterable[str]) -> list[Check]:
    """A finding for each line that is a warning."""
    return [finding(f"{id}.{k}", line, "warn") for k, line in enumerate(lines)]


# Of a key or a column: what its last part says of the unit.
_UNITS = {
    "mm": "mm", "mm2": "mm²", "mm3": "mm³", "cm3": "cm³", "um": "µm", "px": "px", "n": "N",
    "s": "s", "nmm": "N mm", "mpa": "MPa", "kpa": "kPa", "ms": "ms", "mb": "MB",
    "percent": "%", "deg": "°",
}  # fmt: skip


def label(key: str) -> str:
    """A key or column as a page writes it: `normal_rmse_n` is "normal rmse, N"."""
    words, _, last = key.rpartition("_")
    if words and last in _UNITS:
        return f"{words.replace('_', ' ')}, {_UNITS[last]}"
    return key.replace("_", " ")


def format_number(value: Any) -> str:
    """Four digits at most; nothing where there is none."""
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


def format_fixed(value: float, digits: int = 1) -> str:
    """A number as it is read off a balance or a rule: fixed digits, no trailing zeros."""
    text = f"{value:.{digits}f}"
    return text.rstrip("0").rstrip(".") if "." in text else text


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
) -> dict[str, Any]:
    """What the macro `table` needs; columns in which there is no value are left out.

    words: what stands above a column in place of its name. marks, links: the class of each row, and
    where its first cell leads. beyond: names of the columns that are not shown.
    """
    heads = words or {}
    cells = {name: [cell(value) for value in frame[name]] for name in frame}
    known = [name for name, column in cells.items() if any(column) or not column]
    shown = known[:MAX_COLUMNS]
    return {
        "head": [
            {"words": heads.get(str(name)) or label(str(name)), "kind": _kind(frame[name])}
            for name in shown
        ],
        "rows": list(zip(*(cells[name] for name in shown), strict=True)),
        "marks": list(marks) or [""] * len(frame),
        "links": links,
        "beyond": [label(str(name)) for name in known[MAX_COLUMNS:]],
    }


def _kind(column: pd.Series[Any]) -> str:
    """number, or short or long words: the last are broken into lines."""
    known = column.dropna()
    if all(isinstance(value, int | float) or hasattr(value, "dtype") for value in known):
        return "number"
    return "short" if max(len(str(value)) for value in known) <= SHORT else "long"


def save_page(page: str, out: Path) -> Path:
    """Write a page whole, into a folder that is made where it is missing.

    Raises InputError when the folder cannot be, RunFailed when the disk refuses.
    """
    make_folder(out.parent)
    write_whole(out, page.encode())
    return out
