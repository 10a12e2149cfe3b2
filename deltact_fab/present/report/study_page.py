"""A study's folder: one offline HTML page, the verdict first, and the files that it stands on.

It is written whole, and its result is read again.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from os.path import isfile
from pathlib import Path
from typing import Any

import pandas as pd

from deltact_fab.common import (
    InputError,
    RunFailed,
    code_digest,
    format_number,
    html_table,
    make_folder,
    read_json,
    render_page,
    require_pages,
    validate,
    write_files,
    write_whole,
)
from deltact_fab.version import library_versions

from . import figures
from .result import Headline, ReportTable, StudyResult

PAGE, RESULT = "report.html", "result.json"
FORMAT = "deltact-fab study 2"
MAX_ROWS, FIRST_ROWS = 120, 20  # a longer table is shown by its first rows
MAX_MISSING = 20
HEADLINES = "headlines"
FIGURES = ("svg", "pdf")


@dataclass(frozen=True)
class KeptResult:
    """What is read of `result.json`, in which all stands that `--json` prints.

    made: day and time (UTC, ISO 8601) at which it was written. module, code: what made it, and its
    digest. files: names.
    """

    study: str
    verdict: tuple[str, ...]
    simulated: bool
    made: str
    missing: tuple[str, ...]
    module: str
    code: str
    files: tuple[str, ...]

    @property
    def old(self) -> bool:
        """Whether other code than the present one made it."""
        return bool(self.module) and _code_of(self.module) != self.code


def _code_of(module: str) -> str:
    """The digest of a module; empty where the package has none of that name."""
    try:
        return code_digest(module) if module else ""
    except ValueError:
        return ""


def read_result(folder: str | Path) -> KeptResult:
    """What a study left in a folder. Raises InputError naming file and key."""
    path = Path(folder) / RESULT
    if not isfile(path):
        raise InputError(
            f"{folder}: no study ({RESULT} is missing); name a folder that `study run` wrote"
        )
    found = read_json(path)
    if (kept := found.get("format")) != FORMAT:
        raise InputError(f"{path}: format: {kept!r}; this version reads {FORMAT!r}")
    return validate(KeptResult, found, str(path))


def contents(result: StudyResult) -> dict[str, bytes]:
    """The files of a study but its page, by name; result.json last.

    Raises RunFailed for a number that JSON does not have.
    """
    made = {
        f"{table.name}.csv": table.frame.to_csv(index=False).encode() for table in result.tables
    }
    made |= {name: text.encode() for name, text in result.files.items()}
    kept = {
        "format": FORMAT,
        "title": result.title,
        "made": f"{datetime.now(UTC):%Y-%m-%dT%H:%MZ}",
        "module": result.module,
        "code": _code_of(result.module),
        "versions": library_versions(),
        **result.data,
        "figures": [figure.name for figure in result.figures],
        "files": [PAGE, *made],
    }
    try:
        made[RESULT] = (json.dumps(kept, indent=1, allow_nan=False) + "\n").encode()
    except ValueError as why:
        raise RunFailed(f"{result.study}: its data hold a figure that is no number: {why}") from why
    return made


def refuse_strange(out: Path, study: str) -> None:
    """Raises InputError for a folder that is neither empty nor an earlier one of this study.

    Empty folders in it count for nothing: that of its figures may be one.
    """
    try:
        other = read_result(out).study
    except InputError:
        other = None
    files = (one for one in out.rglob("*") if not one.is_dir() and not one.name.startswith(".new-"))
    if other != study and any(files):
        held = f"holds the study {other}" if other else f"is not empty, and no earlier {study}"
        raise InputError(f"{out}: {held}; name another folder")


def place(files: Mapping[str, bytes], out: Path) -> None:
    """Put files into a study's folder; those that an earlier study left there go, others stay.

    Until all are on the disk the earlier ones stay as they are. Raises RunFailed when the disk
    refuses.
    """
    # Its list is the last to change: what is cut short here is found by the next.
    names = sorted(files, key=lambda name: name == RESULT)
    try:
        earlier = read_result(out).files
    except InputError:
        earlier = ()
    # A list that was changed by hand reaches into no other folder.
    gone = [out / name for name in earlier if name not in files and Path(name).name == name]
    write_files({out / name: files[name] for name in names}, gone, RunFailed)


def prepared(one: ReportTable) -> dict[str, Any]:
    """What the template needs of a table.

    title, more: of the caption. hidden: how many rows are not shown.
    Raises KeyError for a shown column that the frame has not.
    """
    frame = one.frame if one.shown is None else one.frame[list(one.shown)]
    title, _, more = one.caption.partition(". ")
    shown = frame if len(frame) <= MAX_ROWS else frame.iloc[:FIRST_ROWS]
    return {
        **html_table(shown, one.words),
        "hidden": len(frame) - len(shown),
        "name": one.name,
        "title": title.removesuffix("."),
        "more": more,
    }


def require_ready_study(study: str, out: Path) -> None:
    """Check before a study begins that its page can be written into a folder.

    Raises MissingLibrary without the extra `report`, InputError for a folder that holds anything
    but an earlier one of this study.
    """
    require_pages()
    refuse_strange(out, study)


def write_study_page(result: StudyResult, out: Path) -> Path:
    """Write report.html, a CSV a table, further files and result.json into a folder; the page.

    All are made before the first is written: what fails leaves an earlier study as it is.
    Raises MissingLibrary without the extra `report`, InputError for a folder that cannot be or is
    another's, RunFailed when the disk refuses or a figure is no number.
    """
    make_folder(out)
    refuse_strange(out, result.study)
    if result.headlines:
        frame = pd.DataFrame([one.as_dict() for one in result.headlines])
        own = ReportTable(HEADLINES, "Key figures", frame)
        result = replace(result, tables=(own, *result.tables))
    files = contents(result)
    page = html(result, json.loads(files[RESULT]))
    place({PAGE: page.encode(), **files}, out)
    return out / PAGE


def write_study_figures(result: StudyResult, folder: Path) -> list[Path]:
    """Write NAME.svg and NAME.pdf of every figure into a folder; the files, in their order.

    Letters are text with their font beside (SVG) or in the file (PDF), of 6 to 8 points. The same
    figure gives the same bytes each time. All are drawn before the first is written. Raises
    MissingLibrary without the extra `report`, InputError for a folder that cannot be, RunFailed
    when the disk refuses.
    """
    drawn = {
        f"{one.name}.{kind}": figures.figure_bytes(figure, kind)
        for one in result.figures
        for figure in (figures.draw(one),)
        for kind in FIGURES
    }
    make_folder(folder)
    for name, data in drawn.items():
        write_whole(folder / name, data)
    return [folder / name for name in drawn]


def html(result: StudyResult, kept: dict[str, Any]) -> str:
    """The page. kept: its result.json, of which versions and time are taken."""
    told = pd.DataFrame(map(_told, result.headlines))
    marks = ["bad" if one.state == "missed" else "" for one in result.headlines]
    settings = {**result.settings, "seed": str(result.seed), **kept["versions"]}
    left_out = [(one.id, one.text) for one in result.left_out]
    return render_page(
        "study.html",
        result.findings,
        r=result,
        made=f"{kept['made'].replace('T', ' ').removesuffix('Z')} UTC",
        figures=[
            {"svg": figures.to_svg(one.draw(), one.caption), "caption": one.caption}
            for one in result.figures
        ],
        what_counts=html_table(told, marks=marks),
        tables=[prepared(one) for one in result.tables if one.name != HEADLINES],
        left_out=html_table(pd.DataFrame(left_out, columns=["without", "why"])),
        settings=html_table(pd.DataFrame(settings.items(), columns=["setting", "value"])),
        most_missing=MAX_MISSING,
    )


def _told(one: Headline) -> dict[str, Any]:
    """A headline as a row of the page."""
    unit = f"\u00a0{one.unit}" if one.unit else ""  # on the line of its number
    apart = goal = ""
    if one.low is not None and one.high is not None:
        apart = f"{format_number(one.low)} to {format_number(one.high)}{unit}, "
    if one.goal is not None:
        least = "at least" if one.better == "high" else "at most"
        goal = f"{least} {format_number(one.goal)}{unit}: {one.state}"
    return {
        "figure": one.what,
        "value": f"{format_number(one.value)}{unit}",
        "95 % interval, over": f"{apart}{one.over}",
        "paper": "" if one.paper is None else f"{format_number(one.paper)}{unit}",
        "goal": goal,
        "remark": one.remark or ("the study gives no reason" if one.state == "missed" else ""),
    }
