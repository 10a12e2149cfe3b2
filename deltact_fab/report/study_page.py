"""One offline HTML page of a study, the verdict first, and the files that it stands on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from . import figures, study_folder, tables
from .result import LeftOut, ReportFigure, ReportTable, StudyResult
from .templating import environment, render, require_pages

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
        own = ReportTable(HEADLINES, "What counts", tables.headline_frame(result.headlines))
        result = replace(result, tables=(own, *result.tables))
    files = study_folder.contents(result)
    page = html(result, study_folder.made_of(files), layer_costs)
    study_folder.place({study_folder.PAGE: page.encode(), **files}, out)
    return out / study_folder.PAGE


def html(
    result: StudyResult, kept: study_folder.KeptResult, layer_costs: Sequence[dict[str, Any]] = ()
) -> str:
    """The page. kept: what its result.json says, of versions and time."""
    pages = environment(num=tables.number, unit=_unit)
    prepared = {table.name: tables.prepared(table) for table in result.tables}
    left_out = [_with_cost(one, layer_costs) for one in result.left_out]
    headlines = result.headlines
    return render(
        pages,
        "study.html",
        r=result,
        made=f"{kept.made.replace('T', ' ').removesuffix('Z')} UTC",
        doubt=bool(result.missing) or any(one.met is False for one in headlines),
        headlines=headlines,
        headline_table=prepared.pop(HEADLINES, None),
        figures=[_drawn(one) for one in result.figures],
        tables=list(prepared.values()),
        left_out=left_out,
        measured_here=any(a.cost != b.cost for a, b in zip(left_out, result.left_out, strict=True)),
        settings={**result.settings, "seed": str(result.seed), **kept.versions},
        most_missing=MAX_MISSING,
    )


def _drawn(one: ReportFigure) -> dict[str, Any]:
    return {"svg": figures.to_svg(one.draw(), one.caption), "caption": one.caption}


def _with_cost(one: LeftOut, layer_costs: Sequence[dict[str, Any]]) -> LeftOut:
    """With what its layer costs on this machine, where that was measured."""
    found = next((cost for cost in layer_costs if cost["layer"] == one.layer), None)
    if one.cost or found is None or found["seconds"] is None:
        return one
    return replace(one, cost=f"{found['seconds']:.2f} CPU s, {found['megabytes']:.0f} MB")


def _unit(unit: str) -> str:
    """A unit behind its number, on the same line."""
    return f"\u00a0{unit}" if unit else ""
