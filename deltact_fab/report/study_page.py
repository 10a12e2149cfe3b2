"""One offline HTML page of a study, the verdict first, and the files that it stands on."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pandas as pd

from . import figures, study_folder
from .result import Headline, ReportTable, StudyResult
from .templating import number, render, require_pages, table, verdict

MAX_ROWS, FIRST_ROWS = 120, 20  # a longer table is shown by its first rows
MAX_MISSING = 20
HEADLINES = "headlines"


def prepared(one: ReportTable) -> dict[str, Any]:
    """What the template needs of a table.

    title, more: of the caption. hidden: how many rows are not shown.
    Raises KeyError for a shown column that the frame has not.
    """
    frame = one.frame if one.shown is None else one.frame[list(one.shown)]
    title, _, more = one.caption.partition(". ")
    shown = frame if len(frame) <= MAX_ROWS else frame.iloc[:FIRST_ROWS]
    return {
        **table(shown, one.words),
        "hidden": len(frame) - len(shown),
        "name": one.name,
        "title": title.removesuffix("."),
        "more": more,
    }


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


def write(result: StudyResult, out: Path) -> Path:
    """Write report.html, a CSV a table, further files and result.json into a folder; the page.

    All are made before the first is written: what fails leaves an earlier study as it is.
    Raises MissingLibrary without the extra `report`, InputError for a folder that cannot be or is
    another's, RunFailed when the disk refuses or a figure is no number.
    """
    study_folder.make(out)
    study_folder.refuse_strange(out, result.study)
    if result.headlines:
        frame = pd.DataFrame([one.as_dict() for one in result.headlines])
        own = ReportTable(HEADLINES, "Key figures", frame)
        result = replace(result, tables=(own, *result.tables))
    files = study_folder.contents(result)
    page = html(result, json.loads(files[study_folder.RESULT]))
    study_folder.place({study_folder.PAGE: page.encode(), **files}, out)
    return out / study_folder.PAGE


def html(result: StudyResult, kept: dict[str, Any]) -> str:
    """The page. kept: its result.json, of which versions and time are taken."""
    told = pd.DataFrame(map(_told, result.headlines))
    marks = ["bad" if one.state == "missed" else "" for one in result.headlines]
    settings = {**result.settings, "seed": str(result.seed), **kept["versions"]}
    left_out = [(one.what, one.why) for one in result.left_out]
    return render(
        "study.html",
        r=result,
        made=f"{kept['made'].replace('T', ' ').removesuffix('Z')} UTC",
        verdict=verdict(result.findings),
        figures=[
            {"svg": figures.to_svg(one.draw(), one.caption), "caption": one.caption}
            for one in result.figures
        ],
        what_counts=table(told, marks=marks),
        tables=[prepared(one) for one in result.tables if one.name != HEADLINES],
        left_out=table(pd.DataFrame(left_out, columns=["without", "why"])),
        settings=table(pd.DataFrame(settings.items(), columns=["setting", "value"])),
        most_missing=MAX_MISSING,
    )


def _told(one: Headline) -> dict[str, Any]:
    """A headline as a row of the page."""
    unit = f"\u00a0{one.unit}" if one.unit else ""  # on the line of its number
    apart = goal = ""
    if one.low is not None and one.high is not None:
        apart = f"{number(one.low)} to {number(one.high)}{unit}, "
    if one.goal is not None:
        least = "at least" if one.better == "high" else "at most"
        goal = f"{least} {number(one.goal)}{unit}: {one.state}"
    return {
        "figure": one.what,
        "value": f"{number(one.value)}{unit}",
        "95 % interval, over": f"{apart}{one.over}",
        "paper": "" if one.paper is None else f"{number(one.paper)}{unit}",
        "goal": goal,
        "remark": one.remark or ("the study gives no reason" if one.state == "missed" else ""),
    }
