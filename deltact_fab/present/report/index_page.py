"""One offline page over a folder of runs and studies: what each is and what came out of it."""

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
# Where neither runs nor studies lie, but thousands of files may.
SKIPPED_FOLDERS = frozenset({"images", "truth", "analysis", "node_modules", "__pycache__"})


@dataclass(frozen=True)
class Entry:
    """A row of the index. name: the folder's path below the index's.

    link: from the index to its page or, where there is none, its folder. date: UTC, to the minute,
    or empty. line: the verdict, or what there is. trouble: what is not in order, or empty.
    """

    name: str
    kind: str
    link: str
    date: str
    line: str
    trouble: str
    simulated: bool = False


def write_index(folder: Path, out: Path) -> Path:
    """Write the index of a folder, of all that lies below it, to one file.

    Raises InputError for a folder that is none, MissingLibrary without the extra `report`,
    RunFailed when the disk refuses.
    """
    import pandas as pd

    rows = list_entries(folder, out.parent)
    cells = [
        (row.name, f"{row.kind}{', simulated' * row.simulated}", row.date,
         f"{row.trouble} {row.line}".strip()) for row in rows
    ]  # fmt: skip
    marks = ["bad" if row.trouble else "" for row in rows]
    frame = pd.DataFrame(cells, columns=["name", "kind", "date, UTC", "what came out"])
    table = html_table(frame, marks=marks, links=[row.link for row in rows])
    n, worse = len(rows), sum(map(bool, marks))
    if not rows:
        text = "Nothing was found: a run's folder has a run.json, a study's a result.json."
    elif worse:
        are = "is" if worse == 1 else "are"
        text = f"{worse} of {n} {are} unfinished, old, damaged or made with warnings, and marked."
    else:
        text = f"{'It is' if n == 1 else f'All {n} are'} finished and can be read."
    check = Check("runs", value=text, status=graded(True, warns=not rows or worse > 0))
    return write_page(out, "index.html", [check], folder=folder.resolve().name, entries=table)


def is_index_above(folder: Path) -> bool:
    """True for a folder that is no run itself and has runs or studies below it."""
    return not (folder / RUN_FILE).exists() and any(True for _ in _places(folder))


def list_entries(folder: Path, link_base: Path) -> list[Entry]:
    """Every run and study below a folder, the newest first; links as from another folder.

    What cannot be read has a row that says so. Raises InputError for a folder that is none.
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
            # Without the folder, which the row names already.
            line = text.replace(f"{place}/", "").replace(f"{place}: ", "")
            rows.append(Entry(name, "study" if is_study else "run", link, "", line, "damaged:"))
    rows.sort(key=lambda entry: entry.name)
    return sorted(rows, key=lambda entry: entry.date, reverse=True)


def _places(folder: Path) -> Iterator[tuple[Path, bool]]:
    """Folders of runs and (True) of studies; a run holds no other one."""
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
        trouble = "made by other code than this:"
    elif not (place / PAGE_FILE).is_file():
        trouble = "its page is gone:"
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
        line = f"{description['frames']} frames in {presses}, not analysed yet"
    date = "" if begun is None else f"{datetime.fromtimestamp(begun, UTC):%Y-%m-%d %H:%M}"
    trouble = f"{description['state']}:"
    if description["state"] == "finished":
        n = len(warned)
        trouble = f"{n} warning{'s' * (n > 1)}:" if n else ""
    simulated = bool(description["simulated"])
    return Entry(name, f"run of {description['protocol']}", link, date, line, trouble, simulated)


# What reading a folder raises in which anything may be anything.
_READ_ERRORS = (
    DeltactFabError, OSError, ValueError, LookupError, TypeError, AttributeError, sqlite3.Error,
)  # fmt: skip
