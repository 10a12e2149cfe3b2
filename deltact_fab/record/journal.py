"""The journal of a run: SQLite tables, its connection, and the right to write it."""

from __future__ import annotations

import hashlib
import os
import sqlite3
from collections.abc import Iterator, Mapping
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any, BinaryIO

from ..errors import InputError, RunFailed
from .files import UNHASHED

SCHEMA = """
CREATE TABLE steps (
  seq INTEGER PRIMARY KEY, step_id TEXT NOT NULL UNIQUE, press TEXT NOT NULL,
  indenter TEXT NOT NULL, kind TEXT NOT NULL,
  x_mm REAL NOT NULL, y_mm REAL NOT NULL, z_mm REAL NOT NULL, feed_mm_min REAL NOT NULL,
  planned_s REAL NOT NULL, missed INTEGER NOT NULL, t_start_s REAL NOT NULL,
  t_end_s REAL NOT NULL, wall_s REAL NOT NULL
);
CREATE TABLE frames (
  frame_id TEXT PRIMARY KEY, seq INTEGER NOT NULL UNIQUE, step_id TEXT NOT NULL,
  press TEXT NOT NULL, indenter TEXT NOT NULL, kind TEXT NOT NULL, k INTEGER NOT NULL,
  settled INTEGER NOT NULL, file TEXT, sha256 TEXT, t_s REAL NOT NULL, t_step_s REAL NOT NULL,
  t_press_s REAL NOT NULL, late_s REAL NOT NULL, dropped INTEGER NOT NULL,
  repeated INTEGER NOT NULL, wall_s REAL NOT NULL
);
CREATE TABLE samples (
  seq INTEGER NOT NULL, stream TEXT NOT NULL, press TEXT NOT NULL, step_id TEXT NOT NULL,
  n INTEGER NOT NULL, origin_s REAL NOT NULL, columns TEXT NOT NULL, data BLOB NOT NULL,
  PRIMARY KEY (seq, stream)
);
CREATE TABLE events (
  seq INTEGER PRIMARY KEY, kind TEXT NOT NULL, press TEXT, step_id TEXT, text TEXT NOT NULL,
  t_s REAL, wall_s REAL NOT NULL
);
CREATE TABLE files (file TEXT PRIMARY KEY, sha256 TEXT NOT NULL);
"""
PRESS_TABLES = ("frames", "samples", "steps")  # whose rows belong to a press and go with it
WALL_COLUMNS = ("wall_s",)  # the only columns in which two equal runs may differ
# A resumed run may also differ in the rig's clock, which starts anew with each session; and in its
# events, which tell how it ended.
CLOCK_COLUMNS = (*WALL_COLUMNS, "t_s", "t_start_s", "t_end_s", "origin_s")


def claim(folder: Path) -> BinaryIO:
    """Claim a run folder until the file that this returns is closed, or the process dies.

    Raises InputError when another process has it.
    """
    # On run.json, for a lock on the journal would disturb the locks of SQLite itself.
    file = (folder / "run.json").open("rb")
    if not _lock(file, shared=False):
        file.close()
        raise InputError(f"{folder}: another process is writing this run")
    return file


def being_written(folder: Path) -> bool:
    """Whether another process has the run claimed just now."""
    with (folder / "run.json").open("rb") as file:
        return not _lock(file, shared=True)


def _lock(file: BinaryIO, shared: bool) -> bool:
    """Lock a file until it is closed; False when another process has it. True without locks."""
    if os.name == "posix":
        import fcntl

        try:
            fcntl.flock(file, (fcntl.LOCK_SH if shared else fcntl.LOCK_EX) | fcntl.LOCK_NB)
        except BlockingIOError:
            return False
        except OSError:  # a file system without locks
            pass
    return True


def connect(folder: Path, new: bool = False) -> sqlite3.Connection:
    """The journal for writing. Raises RunFailed when it is not there or is no journal."""
    path = (folder / "journal.sqlite").absolute()
    with journal_errors(folder):
        # One thread at a time uses it: the pipeline's, between the start of a run and its end.
        db = sqlite3.connect(
            f"{path.as_uri()}?mode={'rwc' if new else 'rw'}", uri=True, check_same_thread=False
        )
        try:
            db.execute("PRAGMA journal_mode=WAL")
            db.execute("PRAGMA synchronous=FULL")
        except BaseException:
            db.close()
            raise
        return db


def insert(db: sqlite3.Connection, table: str, row: Mapping[str, Any]) -> None:
    """One row, by the names of its columns."""
    names = ",".join(row)
    db.execute(
        f"INSERT INTO {table} ({names}) VALUES ({','.join('?' * len(row))})", tuple(row.values())
    )


def keep_hashes(db: sqlite3.Connection, files: Mapping[str, bytes]) -> None:
    """Of files of the run by their paths in it; those of before are replaced."""
    with db:
        rows = [(file, hashlib.sha256(data).hexdigest()) for file, data in files.items()]
        db.executemany("INSERT OR REPLACE INTO files (file, sha256) VALUES (?, ?)", rows)


def misfits(db: sqlite3.Connection, run_format: int) -> Iterator[str]:
    """What no run writes: values of another type than their column's, or out of all bounds.

    SQLite stores them all the same, and only what computes with them would fail. Nor may a column
    or the first event be missing.
    """
    have = _columns(db)
    with closing(sqlite3.connect(":memory:")) as empty:
        empty.executescript(SCHEMA)
        if run_format == UNHASHED:
            empty.execute("DROP TABLE files")
        lost = sorted(_columns(empty).keys() - have.keys())
    for table, column in lost:
        yield f"no such table or column: {table}.{column}"
    if not lost and not db.execute("SELECT count(*) FROM events").fetchone()[0]:
        yield "events: none; a run begins with one"
    for (table, column), (kind, needed) in have.items():
        if (fits := _FITS.get(kind)) is None:
            continue
        if not needed:
            fits = f"{{0}} IS NULL OR {fits}"
        wrong = f"NOT coalesce({fits.format(chr(34) + column + chr(34))}, FALSE)"
        count = db.execute(f'SELECT count(*) FROM "{table}" WHERE {wrong}').fetchone()[0]
        if count:
            yield f"{table}.{column}: {count} of its values are damaged"


def _columns(db: sqlite3.Connection) -> dict[tuple[str, str], tuple[str, bool]]:
    """Of every column, by its table and name, the type and whether it must have a value."""
    query = (
        'SELECT t.name, c.name, c.type, c."notnull" OR c.pk '
        "FROM sqlite_master t, pragma_table_info(t.name) c WHERE t.type = 'table'"
    )
    return {(table, column): (kind, needed) for table, column, kind, needed in db.execute(query)}


_FITS = {
    "REAL": "typeof({0}) IN ('real', 'integer') AND abs({0}) < 1e12",
    "INTEGER": "typeof({0}) = 'integer' AND {0} BETWEEN -1e12 AND 1e12",
    "TEXT": "typeof({0}) = 'text'",
    "BLOB": "typeof({0}) = 'blob'",
}


@contextmanager
def journal_errors(folder: Path) -> Iterator[None]:
    """An error of SQLite becomes a RunFailed that names the journal."""
    try:
        yield
    except sqlite3.Error as why:
        raise RunFailed(f"{folder / 'journal.sqlite'}: the journal failed: {why}") from why
