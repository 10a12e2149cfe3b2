"""One offline HTML page of a study, the verdict first, and the files that it stands on."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from . import figures, study_folder
from .result import LeftOut, ReportTable, StudyResult
from .templating import environment, named, render, require_pages

MAX_ROWS, FIRST_ROWS = 120, 20  # a longer table is shown by its first rows
SHORT = 32  # letters that stay on one line


def prepared(table: ReportTable) -> dict[str, Any]:
    """What the template needs of a table.

    title, more: of the caption. head, rows: without columns in which there is no value. hidden: how
    many rows are not shown. tsv: the same head and all rows, numbers to their last digit.
    Raises ValueError for a shown column that the frame has not.
    """
    frame = table.frame
    if table.shown is not None:
        if strange := [name for name in table.shown if name not in frame]:
            raise ValueError(f"table {table.name}: no column {strange[0]!r}")
        frame = frame[list(table.shown)]
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


def tsv(frame: pd.DataFrame) -> str:
    """Head and rows with tabs between; no quotes, for a spreadsheet takes the cells as they are."""
    lines = [list(map(str, frame.columns)), *frame.itertuples(index=False)]
    cells = (
        "\t".join("" if _is_none(value) else " ".join(str(value).split()) for value in line)
        for line in lines
    )
    return "\n".join(cells) + "\n"


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
    if isinstance(value, bool | np.bool_):
        return "yes" if value else "no"
    if isinstance(value, np.integer):
        value = int(value)
    if _is_none(value) or isinstance(value, int | float | np.floating):
        return number(value)
    return str(value)


def _is_none(value: Any) -> bool:
    return value is None or (isinstance(value, float) and not math.isfinite(value))


def _kind(column: pd.Series[Any]) -> str:
    """number, or short or long words: the last are broken into lines."""
    known = column.dropna()
    if all(isinstance(value, int | float) or hasattr(value, "dtype") for value in known):
        return "number"
    return "short" if max(len(str(value)) for value in known) <= SHORT else "long"


MAX_MISSING = 20
HEADLINES = "headlines"


def ready(study: str, out: Path, figures_in: Path | None = None) -> None:
    """Say before a study begins, and not after hours, what keeps it from being written.

    out: its folder; figures_in: that of `paper_figures.save`. Raises MissingLibrary without the
    extra `report`, InputError for a folder that cannot be, or that holds anything but an earlier
    one of this study.
    """
    require_pages()
    study_folder.make(out)
    study_folder.refuse_strange(out, study)
    if figures_in is not None:
        study_folder.make(figures_in)


def write(result: StudyResult, out: Path, layer_costs: Sequence[dict[str, Any]] = ()) -> Path:
    """Write report.html, a CSV a table, further files and result.json into a folder; the page.

    All are made before the first is written: what fails leaves an earlier study as it is.
    layer_costs: what each layer costs that a scene may leave out, as `numerics` measured it.
    Raises MissingLibrary without the extra `report`, InputError for a folder that cannot be or is
    another's, RunFailed when the disk refuses or a figure is no number.
    """
    study_folder.make(out)
    study_folder.refuse_strange(out, result.study)
    if result.headlines:
        frame = pd.DataFrame([one.as_dict() for one in result.headlines])
        own = ReportTable(HEADLINES, "What counts", frame)
        result = replace(result, tables=(own, *result.tables))
    files = study_folder.contents(result)
    page = html(result, study_folder.made_of(files), layer_costs)
    study_folder.place({study_folder.PAGE: page.encode(), **files}, out)
    return out / study_folder.PAGE


def html(
    result: StudyResult, kept: study_folder.KeptResult, layer_costs: Sequence[dict[str, Any]] = ()
) -> str:
    """The page. kept: what its result.json says, of versions and time."""
    # A unit stands behind its number, on the same line.
    pages = environment(num=number, unit=lambda unit: f"\u00a0{unit}" if unit else "")
    tables = {table.name: prepared(table) for table in result.tables}
    left_out = [_with_cost(one, layer_costs) for one in result.left_out]
    headlines = result.headlines
    return render(
        pages,
        "study.html",
        r=result,
        made=f"{kept.made.replace('T', ' ').removesuffix('Z')} UTC",
        doubt=bool(result.missing) or result.state not in (None, "met"),
        headlines=headlines,
        headline_table=tables.pop(HEADLINES, None),
        figures=[
            {"svg": figures.to_svg(one.draw(), one.caption), "caption": one.caption}
            for one in result.figures
        ],
        tables=list(tables.values()),
        left_out=left_out,
        measured_here=any(a.cost != b.cost for a, b in zip(left_out, result.left_out, strict=True)),
        settings={**result.settings, "seed": str(result.seed), **kept.versions},
        most_missing=MAX_MISSING,
    )


def _with_cost(one: LeftOut, layer_costs: Sequence[dict[str, Any]]) -> LeftOut:
    """With what its layer costs on this machine, where that was measured."""
    found = next((cost for cost in layer_costs if cost["layer"] == one.layer), None)
    if one.cost or found is None or found["seconds"] is None:
        return one
    return replace(one, cost=f"{found['seconds']:.2f} CPU s, {found['megabytes']:.0f} MB")
