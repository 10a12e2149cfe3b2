"""Folder of a study: an offline HTML page, the verdict first, and its data files."""

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

PAGE_FILE, RESULT_FILE = "report.html", "result.json"
STUDY_FORMAT = "deltact-fab study 2"
MAX_ROWS, FIRST_ROWS = 120, 20  # by hand: the page shows only the first rows of longer tables
MAX_MISSING = 20  # by hand: names listed on the page
HEADLINES_TABLE = "headlines"
FIGURE_KINDS = ("svg", "pdf")


@dataclass(frozen=True)
class StoredResult:
    """Fields read from `result.json`, which has the output of `--json`.

    made: time of writing (UTC, ISO 8601). module, code: the study's module and its digest. files:
    names.
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
        """True if made by other code than the present."""
        return bool(self.module) and _code_of(self.module) != self.code


def _code_of(module: str) -> str:
    """Digest of a module; empty for an unknown one."""
    try:
        return code_digest(module) if module else ""
    except ValueError:
        return ""


def read_result(folder: str | Path) -> StoredResult:
    """Read the result of a study's folder. Raises InputError naming file and key."""
    path = Path(folder) / RESULT_FILE
    if not isfile(path):
        raise InputError(
            f"{folder}: no study ({RESULT_FILE} is missing); give a folder written by `study run`"
        )
    content = read_json(path)
    if (found_format := content.get("format")) != STUDY_FORMAT:
        raise InputError(f"{path}: format: {found_format!r}; this version reads {STUDY_FORMAT!r}")
    return validate(StoredResult, content, str(path))


def contents(result: StudyResult) -> dict[str, bytes]:
    """Files of a study without its page, by name; result.json last.

    Raises RunFailed for a non-finite number.
    """
    files = {
        f"{table.name}.csv": table.frame.to_csv(index=False).encode() for table in result.tables
    }
    files |= {name: text.encode() for name, text in result.files.items()}
    result_data = {
        "format": STUDY_FORMAT,
        "title": result.title,
        "made": f"{datetime.now(UTC):%Y-%m-%dT%H:%MZ}",
        "module": result.module,
        "code": _code_of(result.module),
        "versions": library_versions(),
        **result.data,
        "figures": [figure.name for figure in result.figures],
        "files": [PAGE_FILE, *files],
    }
    try:
        files[RESULT_FILE] = (json.dumps(result_data, indent=1, allow_nan=False) + "\n").encode()
    except ValueError as error:
        raise RunFailed(f"{result.study}: a figure is not finite: {error}") from error
    return files


def refuse_foreign_folder(out: Path, study: str) -> None:
    """Raise InputError for a folder that is neither empty nor an earlier one of this study.

    Empty subfolders are ignored: that of its figures may be one.
    """
    try:
        earlier = read_result(out).study
    except InputError:
        earlier = None
    files = (p for p in out.rglob("*") if not p.is_dir() and not p.name.startswith(".new-"))
    if earlier != study and any(files):
        state = f"contains study {earlier}" if earlier else f"not empty, and no study {study}"
        raise InputError(f"{out}: {state}; give another folder")


def place_files(files: Mapping[str, bytes], out: Path) -> None:
    """Write files into a study's folder and remove those of an earlier result, no others.

    Earlier files stay until all are on the disk. Raises RunFailed if the disk refuses.
    """
    # Its list changes last, so the next call completes an interrupted one.
    names = sorted(files, key=lambda name: name == RESULT_FILE)
    try:
        earlier = read_result(out).files
    except InputError:
        earlier = ()
    # Only names in this folder, also if the list was edited.
    gone = [out / name for name in earlier if name not in files and Path(name).name == name]
    write_files({out / name: files[name] for name in names}, gone, RunFailed)


def table_context(table: ReportTable) -> dict[str, Any]:
    """Template context of a table.

    title, details: of the caption. hidden: number of rows not shown.
    """
    frame = table.frame
    title, _, details = table.caption.partition(". ")
    page_rows = frame if len(frame) <= MAX_ROWS else frame.iloc[:FIRST_ROWS]
    return {
        **html_table(page_rows),
        "hidden": len(frame) - len(page_rows),
        "name": table.name,
        "title": title.removesuffix("."),
        "details": details,
    }


def require_ready_study(study: str, out: Path) -> None:
    """Check before a study begins that its page can be written into a folder.

    Raises MissingLibrary without the extra `report`, InputError for a folder with other content
    than an earlier result of this study.
    """
    require_pages()
    refuse_foreign_folder(out, study)


def write_study_page(result: StudyResult, out: Path) -> Path:
    """Write report.html, a CSV per table, further files and result.json into a folder.

    Returns the page. An earlier result is unchanged on failure.
    Raises MissingLibrary without the extra `report`, InputError for a folder with other content,
    RunFailed if the disk refuses or a figure is not finite.
    """
    make_folder(out)
    refuse_foreign_folder(out, result.study)
    if result.headlines:
        frame = pd.DataFrame([head.as_dict() for head in result.headlines])
        head_table = ReportTable(HEADLINES_TABLE, "Key figures", frame)
        result = replace(result, tables=(head_table, *result.tables))
    files = contents(result)
    page = render_study(result, json.loads(files[RESULT_FILE]))
    place_files({PAGE_FILE: page.encode(), **files}, out)
    return out / PAGE_FILE


def write_study_figures(result: StudyResult, folder: Path) -> list[Path]:
    """Write NAME.svg and NAME.pdf of every figure into a folder; return the files.

    Text is 6 to 8 pt with its font beside (SVG) or embedded (PDF). Output is reproducible. All are
    drawn before the first is written. Raises MissingLibrary without the extra `report`, InputError
    for an impossible folder, RunFailed if the disk refuses.
    """
    files = {
        f"{report_figure.name}.{kind}": figures.figure_bytes(figure, kind)
        for report_figure in result.figures
        for figure in (figures.draw_for_paper(report_figure),)
        for kind in FIGURE_KINDS
    }
    make_folder(folder)
    for name, data in files.items():
        write_whole(folder / name, data)
    return [folder / name for name in files]


def render_study(result: StudyResult, result_data: dict[str, Any]) -> str:
    """Render the page. result_data: its result.json, for versions and time."""
    head_rows = pd.DataFrame(map(_headline_row, result.headlines))
    marks = ["bad" if head.state == "missed" else "" for head in result.headlines]
    settings = {**result.settings, "seed": str(result.seed), **result_data["versions"]}
    left_out = [(note.id, note.text) for note in result.left_out]
    return render_page(
        "study.html",
        result.findings,
        r=result,
        made=f"{result_data['made'].replace('T', ' ').removesuffix('Z')} UTC",
        figures=[
            {"svg": figures.to_svg(f.draw(), f.caption), "caption": f.caption}
            for f in result.figures
        ],
        what_counts=html_table(head_rows, marks=marks),
        tables=[table_context(table) for table in result.tables if table.name != HEADLINES_TABLE],
        left_out=html_table(pd.DataFrame(left_out, columns=["not built or used", "reason"])),
        settings=html_table(pd.DataFrame(settings.items(), columns=["setting", "value"])),
        most_missing=MAX_MISSING,
    )


def _headline_row(head: Headline) -> dict[str, Any]:
    """Row of a headline on the page."""
    unit = f"\u00a0{head.unit}" if head.unit else ""  # no line break before the unit
    interval = goal = ""
    if head.low is not None and head.high is not None:
        interval = f"{format_number(head.low)} to {format_number(head.high)}{unit}, "
    if head.goal is not None:
        bound = "at least" if head.better == "high" else "at most"
        goal = f"{bound} {format_number(head.goal)}{unit}: {head.state}"
        goal += head.price and f", {head.price}"
    return {
        "figure": head.what,
        "value": f"{format_number(head.value)}{unit}",
        "95 % interval, over": f"{interval}{head.over}",
        "paper": "" if head.paper is None else f"{format_number(head.paper)}{unit}",
        "goal": goal,
        "remark": head.remark or ("no reason given" if head.state == "missed" else ""),
    }
