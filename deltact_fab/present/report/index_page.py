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

from .study_page import PAGE, RESULT, read_result

RUN = "run.json"
# Where neither runs nor studies lie, but thousands of files may.
SKIPPED = frozenset({"images", "truth", "analysis", "node_modules", "__pycache__"})


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

    rows = entries(folder, out.parent)
    told = [
        (row.name, f"{row.kind}{', simulated' * row.simulated}", row.date,
         f"{row.trouble} {row.line}".strip()) for row in rows
    ]  # fmt: skip
    marks = ["bad" if row.trouble else "" for row in rows]
    frame = pd.DataFrame(told, columns=["name", "kind", "date, UTC", "what came out"])
    made = html_table(frame, marks=marks, links=[row.link for row in rows])
    n, worse = len(rows), sum(map(bool, marks))
    if not rows:
        text = "Nothing was found: a run's folder has a run.json, a study's a result.json."
    elif worse:
        are = "is" if worse == 1 else "are"
        text = f"{worse} of {n} {are} unfinished, old, damaged or made with warnings, and marked."
    else:
        text = f"{'It is' if n == 1 else f'All {n} are'} finished and can be read."
    found = Check("runs", value=text, status=graded(True, warns=not rows or worse > 0))
    return write_page(out, "index.html", [found], folder=folder.resolve().name, entries=made)


def is_index_above(folder: Path) -> bool:
    """True for a folder that is no run itself and has runs or studies below it."""
    return not (folder / RUN).exists() and any(True for _ in _places(folder))


def entries(folder: Path, seen_from: Path) -> list[Entry]:
    """Every run and study below a folder, the newest first; links as from another folder.

    What cannot be read has a row that says so. Raises InputError for a folder that is none.
    """
    if not folder.is_dir():
        raise InputError(f"{folder}: no such folder")
    found = []
    for place, is_study in _places(folder):
        inside = place.relative_to(folder).as_posix()
        name = folder.resolve().name if inside == "." else inside
        page = place / PAGE
        target = os.path.relpath(page if page.is_file() else place, seen_from)
        link = quote(Path(target).as_posix())
        try:
            found.append((_study if is_study else _run)(place, name, link))
        except _DAMAGE as why:
            text = " ".join(str(why).split()) or type(why).__name__
            # Without the folder, which the row names already.
            line = text.replace(f"{place}/", "").replace(f"{place}: ", "")
            found.append(Entry(name, "study" if is_study else "run", link, "", line, "damaged:"))
    found.sort(key=lambda entry: entry.name)
    return sorted(found, key=lambda entry: entry.date, reverse=True)


def _places(folder: Path) -> Iterator[tuple[Path, bool]]:
    """Folders of runs and (True) of studies; a run holds no other one."""
    for place, inner, files in os.walk(folder):
        inner[:] = sorted(n for n in inner if n not in SKIPPED and not n.startswith("."))
        if RESULT in files:
            yield Path(place), True
        if RUN in files:
            inner[:] = []
            yield Path(place), False


def _study(place: Path, name: str, link: str) -> Entry:
    kept = read_result(place)
    trouble = ""
    if kept.missing:
        trouble = f"{len(kept.missing)} {'job' if len(kept.missing) == 1 else 'jobs'} missing:"
    elif kept.old:
        trouble = "made by other code than this:"
    elif not (place / PAGE).is_file():
        trouble = "its page is gone:"
    line = kept.verdict[0] if kept.verdict else ""
    made = kept.made.replace("T", " ").removesuffix("Z")
    return Entry(name, f"study {kept.study}", link, made, line, trouble, kept.simulated)


def _run(place: Path, name: str, link: str) -> Entry:
    run = open_run(place)
    told, (warned, _) = run.describe(), run.remarks()
    begun = told["begun_s"]
    tracking = place / "analysis" / "tracking.json"
    if tracking.is_file():
        line = str(read_json(tracking)["verdict"]["line"])
    else:
        presses = "1 press" if told["presses"] == 1 else f"{told['presses']} presses"
        line = f"{told['frames']} frames in {presses}, not analysed yet"
    date = "" if begun is None else f"{datetime.fromtimestamp(begun, UTC):%Y-%m-%d %H:%M}"
    trouble = f"{told['state']}:"
    if told["state"] == "finished":
        n = len(warned)
        trouble = f"{n} warning{'s' * (n > 1)}:" if n else ""
    simulated = bool(told["simulated"])
    return Entry(name, f"run of {told['protocol']}", link, date, line, trouble, simulated)


# What reading a folder raises in which anything may be anything.
_DAMAGE = (
    DeltactFabError, OSError, ValueError, LookupError, TypeError, AttributeError, sqlite3.Error,
)  # fmt: skip
