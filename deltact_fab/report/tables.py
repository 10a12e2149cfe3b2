"""A table as a page has it: cells for the eye, and the text that its button copies."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from .result import Headline, ReportTable
from .templating import named

if TYPE_CHECKING:
    import pandas as pd

MAX_ROWS, FIRST_ROWS = 120, 20  # a longer table is shown by its first rows
SHORT = 32  # letters that stay on one line


def prepared(table: ReportTable) -> dict[str, Any]:
    """What the template needs of a table.

    title, more: of the caption. head, rows: without columns in which there is no value. hidden: how
    many rows are not shown. tsv: the same head and all rows, numbers to their last digit.
    Raises ValueError for a shown column that the frame has not.
    """
    frame = table.frame if table.shown is None else table.frame[list(_known(table))]
    frame = frame[[name for name in frame if frame[name].notna().any() or frame.empty]]
    title, _, more = table.caption.partition(". ")
    shown = frame if len(frame) <= MAX_ROWS else frame.iloc[:FIRST_ROWS]
    head = [
        {"words": table.words.get(str(name)) or named(str(name)), "kind": _kind(frame[name])}
        for name in frame
    ]
    return {
        "name": table.name,
        "title": title.removesuffix("."),
        "more": more,
        "head": head,
        "rows": [[cell(value) for value in row] for row in shown.itertuples(index=False)],
        "hidden": len(frame) - len(shown),
        "tsv": tsv(frame),
    }


def headline_frame(headlines: tuple[Headline, ...]) -> pd.DataFrame:
    """The figures that count as a table, for its file."""
    import pandas as pd

    return pd.DataFrame([one.as_dict() for one in headlines])


def tsv(frame: pd.DataFrame) -> str:
    """Head and rows with tabs between; no quotes, for a spreadsheet takes the cells as they are."""
    lines = [list(map(str, frame.columns)), *frame.itertuples(index=False)]
    return "\n".join("\t".join(_plain(value) for value in line) for line in lines) + "\n"


def number(value: Any) -> str:
    """Four digits at most; nothing where there is none."""
    if _is_none(value):
        return ""
    if isinstance(value, int) or (float(value).is_integer() and abs(value) < 1e9):
        text = f"{int(value):,}".replace(",", "\u202f")  # a thin space that does not break
        return text.replace("-", "−")
    size = abs(float(value))
    text = (
        f"{value:,.0f}" if 1e4 <= size < 1e9 else f"{value:.4g}" if size >= 1e-4 else f"{value:.2e}"
    )
    return text.replace(",", "\u202f").replace("-", "−")


def cell(value: Any) -> str:
    """A value as a page shows it."""
    import numpy as np

    if isinstance(value, bool | np.bool_):
        return "yes" if value else "no"
    if isinstance(value, np.integer):
        value = int(value)
    if _is_none(value) or isinstance(value, int | float | np.floating):
        return number(value)
    return str(value)


def _known(table: ReportTable) -> tuple[str, ...]:
    assert table.shown is not None
    if strange := [name for name in table.shown if name not in table.frame]:
        raise ValueError(f"table {table.name}: no column {strange[0]!r}")
    return table.shown


def _is_none(value: Any) -> bool:
    return value is None or (isinstance(value, float) and not math.isfinite(value))


def _kind(column: pd.Series[Any]) -> str:
    """number, or short or long words: the last are broken into lines."""
    known = column.dropna()
    if all(isinstance(value, int | float) or hasattr(value, "dtype") for value in known):
        return "number"
    return "short" if max(len(str(value)) for value in known) <= SHORT else "long"


def _plain(value: Any) -> str:
    """As pandas writes it into the CSV, on one line."""
    return "" if _is_none(value) else " ".join(str(value).split())
