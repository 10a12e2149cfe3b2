"""Offline index page of a folder of runs and studies, with their results."""

from __future__ import annotations

import os
import sqlite3
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from urllib.parse import quote

from deltact_fab.bench import open_run
from deltact_fab.common import (
    Check,
    DeltactFabError,
    InputError,
    graded,
    html_table,
    read_json,
    write_page,
)

from .study_page import PAGE_FILE, RESULT_FILE, read_result

RUN_FILE = "run.json"
# Folders without runs or studies, with possibly thousands of files.
SKIPPED_FOLDERS = frozenset({"images", "truth", "analysis", "node_modules", "__pycache__"})


@dataclass(frozen=True)
class Entry:
    """Row of the index. name: path of the folder below the index's.

    link: from the index to its page, or to its folder without a page. date: UTC, to the minute, or
    empty. line: the verdict, or a summary. trouble: its problem, or empty.
    """

    name: str
    kind: str
    link: str
    date: str
    line: str
    trouble: str
    simulated: bool = False


def write_index(folder: Path, out: Path) -> Path:
    """Write the index of all runs and studies below a folder to one file.

    Raises InputError for a missing folder, MissingLibrary without the extra `report`, RunFailed
    if the disk refuses.
    """
    import pandas as pd

    rows = list_entries(folder, out.parent)
    cells = [
        (row.name, f"{row.kind}{', simulated' * row.simulated}", row.date,
         f"{row.trouble} {row.line}".strip()) for row in rows
    ]  # fmt: skip
    marks = ["bad" if row.trouble else "" for row in rows]
    frame = pd.DataFrame(cells, columns=["name", "kind", "date, UTC", "result"])
    table = html_table(frame, marks=marks, links=[row.link for row in rows])
    n, worse = len(rows), sum(map(bool, marks))
    if not rows:
        text = "No runs or studies found (no run.json or result.json)."
    elif worse:
        are = "is" if worse == 1 else "are"
        text = f"{worse} of {n} {are} unfinished, outdated, damaged or with warnings (marked)."
    else:
        text = f"{n} of {n} finished and readable."
    check = Check("runs", value=text, status=graded(True, warns=not rows or worse > 0))
    return write_page(out, "index.html", [check], folder=folder.resolve().name, entries=table)


def is_index_above(folder: Path) -> bool:
    """True for a folder with runs or studies below it that is not a run itself."""
    return not (folder / RUN_FILE).exists() and any(True for _ in _places(folder))


def list_entries(folder: Path, link_base: Path) -> list[Entry]:
    """List every run and study below a folder, newest first; links relative to `link_base`.

    An unreadable one has a row with the error. Raises InputError for a missing folder.
    """
    if not folder.is_dir():
        raise InputError(f"{folder}: no such folder")
    rows = []
    for place, is_study in _places(folder):
        inside = place.relative_to(folder).as_posix()
        name = folder.resolve().name if inside == "." else inside
        page = place / PAGE_FILE
        target = os.path.relpath(page if page.is_file() else place, link_base)
        link = quote(Path(target).as_posix())
        try:
            rows.append((_study_entry if is_study else _run_entry)(place, name, link))
        except _READ_ERRORS as error:
            text = " ".join(str(error).split()) or type(error).__name__
            # Without the folder, which is the row's name.
            line = text.replace(f"{place}/", "").replace(f"{place}: ", "")
            rows.append(Entry(name, "study" if is_study else "run", link, "", line, "damaged:"))
    rows.sort(key=lambda entry: entry.name)
    return sorted(rows, key=lambda entry: entry.date, reverse=True)


def _places(folder: Path) -> Iterator[tuple[Path, bool]]:
    """Iterate over folders of runs (False) and studies (True); not below runs."""
    for place, inner, files in os.walk(folder):
        inner[:] = sorted(n for n in inner if n not in SKIPPED_FOLDERS and not n.startswith("."))
        if RESULT_FILE in files:
            yield Path(place), True
        if RUN_FILE in files:
            inner[:] = []
            yield Path(place), False


def _study_entry(place: Path, name: str, link: str) -> Entry:
    result = read_result(place)
    trouble = ""
    if result.missing:
        trouble = f"{len(result.missing)} {'job' if len(result.missing) == 1 else 'jobs'} missing:"
    elif result.old:
        trouble = "made by other code:"
    elif not (place / PAGE_FILE).is_file():
        trouble = "page missing:"
    line = result.verdict[0] if result.verdict else ""
    date = result.made.replace("T", " ").removesuffix("Z")
    return Entry(name, f"study {result.study}", link, date, line, trouble, result.simulated)


def _run_entry(place: Path, name: str, link: str) -> Entry:
    run = open_run(place)
    description, (warned, _) = run.describe(), run.remarks()
    begun = description["begun_s"]
    tracking = place / "analysis" / "tracking.json"
    if tracking.is_file():
        line = str(read_json(tracking)["verdict"]["line"])
    else:
        presses = "1 press" if description["presses"] == 1 else f"{description['presses']} presses"
        line = f"{description['frames']} frames in {presses}, not analysed"
    date = "" if begun is None else f"{datetime.fromtimestamp(begun, UTC):%Y-%m-%d %H:%M}"
    trouble = f"{description['state']}:"
    if description["state"] == "finished":
        n = len(warned)
        trouble = f"{n} warning{'s' * (n > 1)}:" if n else ""
    simulated = bool(description["simulated"])
    return Entry(name, f"run of {description['protocol']}", link, date, line, trouble, simulated)


# Errors of reading a folder of any content.
_READ_ERRORS = (
    DeltactFabError, OSError, ValueError, LookupError, TypeError, AttributeError, sqlite3.Error,
)  # fmt: skip
