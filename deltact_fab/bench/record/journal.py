"""Journal of a run: SQLite tables, the write lock, and the writer threads.

Files are written on two threads, rows in their order on a third. A row is committed only after its
file is on the disk, so a kill at any time leaves no row without its file. Rows are committed in the
order in which they were put, at most BATCH_N of them or BATCH_S after the first. A caller that
adds an image to a full queue waits or is refused.
"""

from __future__ import annotations

import hashlib
import itertools
import os
import re
import sqlite3
import threading
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import closing, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from deltact_fab.common import InputError, RunFailed, disk_errors, sync_folder, write_whole

from .files import UNHASHED_FORMAT
from .folder import UnsafeFile, has_file, open_file, read_file
from .images import encode
from .streams import MAX_CHUNK_BYTES, MONITOR_PREFIX

JOURNAL_SCHEMA = """
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
# Tables and columns of these words alone: nothing is computed when they are read or written.
_SCHEMA_TEXT = re.compile(
    rf"((?:{'|'.join(sorted(set(re.findall(r'[a-z]+[a-z0-9_]*|[A-Z]+', JOURNAL_SCHEMA))))})\b"
    r"|[\s(),])*"
)
# Format of SQLite, "The Rollback Journal": after the name of a file that a rollback deletes.
_SUPER_JOURNAL_MARK = bytes.fromhex("d9d505f920a163d7")
MIN_JOURNAL_STEPS, STEPS_PER_BYTE = 1_000_000, 4
"""Most steps of SQLite's machine; by hand: four times what reading a run takes."""
_CALLBACK_STEPS = 100_000  # by hand: some milliseconds
PRESS_TABLES = ("frames", "samples", "steps")  # rows are deleted with their press
WALL_COLUMNS = ("wall_s",)  # the only columns in which two equal runs may differ
# A resumed run may also differ in the rig's clock, which restarts with each session, and in its
# events.
CLOCK_COLUMNS = (*WALL_COLUMNS, "t_s", "t_start_s", "t_end_s", "origin_s")


def claim(folder: Path) -> BinaryIO:
    """Lock a run folder until the returned file is closed or the process ends.

    Raises InputError if another process holds the lock.
    """
    # On run.json: a lock on the journal would interfere with SQLite's own.
    file = open_file(folder, "run.json")
    if not lock_file(file, shared=False):
        file.close()
        raise InputError(f"{folder}: another process is writing this run")
    return file


def is_claimed(folder: Path) -> bool:
    """True if another process holds the lock of the run."""
    with open_file(folder, "run.json") as file:
        return not lock_file(file, shared=True)


def lock_file(file: BinaryIO, shared: bool) -> bool:
    """Lock a file until it is closed; False if another process holds it. True without locks."""
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
    """Open the journal for writing. Raises RunFailed if it is missing or not a journal."""
    with journal_errors(folder):
        # One thread at a time uses it: the pipeline's, between the start of a run and its end.
        db = open_journal(folder, "rwc" if new else "rw", check_same_thread=False)
        try:
            db.set_progress_handler(None, 0)
            db.execute("PRAGMA journal_mode=WAL")
            db.execute("PRAGMA synchronous=FULL")
        except BaseException:
            db.close()
            raise
        return db


def open_journal(folder: Path, mode: str, **options: Any) -> sqlite3.Connection:
    """Open the journal; mode: ro, rw or rwc. Raises UnsafeFile, sqlite3.Error.

    A schema that could run code is refused, and reading takes a number of steps in proportion to
    the file: pages that refer to one another may form a table without end.
    """
    path = folder / "journal.sqlite"
    has_file(folder, path.name)
    rollback = f"{path.name}-journal"
    if has_file(folder, rollback) and read_file(folder, rollback).endswith(_SUPER_JOURNAL_MARK):
        raise UnsafeFile(f"{path}-journal: names a file to be deleted; no run writes that")
    size = 0
    for file in folder.glob("journal.sqlite*"):
        with suppress(FileNotFoundError):  # a log that another process, a reader, just removed
            size += file.stat().st_size
    db = sqlite3.connect(f"{path.absolute().as_uri()}?mode={mode}", uri=True, **options)
    try:
        db.execute("PRAGMA trusted_schema=OFF")
        db.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, MAX_CHUNK_BYTES)
        callbacks = itertools.count()
        max_callbacks = (MIN_JOURNAL_STEPS + STEPS_PER_BYTE * size) // _CALLBACK_STEPS
        db.set_progress_handler(lambda: next(callbacks) > max_callbacks, _CALLBACK_STEPS)
        for kind, name, sql in db.execute("SELECT type, name, sql FROM sqlite_master"):
            if kind not in ("table", "index") or not _SCHEMA_TEXT.fullmatch(sql or ""):
                text = f"{kind} {name!r} is not of a run's journal; remove it"
                raise UnsafeFile(f"{path}: {text}")
    except BaseException:
        db.close()
        raise
    return db


def insert(db: sqlite3.Connection, table: str, row: Mapping[str, Any]) -> None:
    """Insert one row, by column names."""
    names = ",".join(row)
    db.execute(
        f"INSERT INTO {table} ({names}) VALUES ({','.join('?' * len(row))})", tuple(row.values())
    )


def store_hashes(db: sqlite3.Connection, files: Mapping[str, bytes]) -> None:
    """Store the SHA-256 of files, by their paths in the run; earlier ones are replaced."""
    with db:
        rows = [(file, hashlib.sha256(data).hexdigest()) for file, data in files.items()]
        db.executemany("INSERT OR REPLACE INTO files (file, sha256) VALUES (?, ?)", rows)


def schema_faults(db: sqlite3.Connection, run_format: int) -> Iterator[str]:
    """Yield faults of the tables: missing columns or events, values of wrong type or out of range.

    SQLite stores any value in any column, so damage would surface only in computations.
    """
    have = _columns(db)
    with closing(sqlite3.connect(":memory:")) as empty:
        empty.executescript(JOURNAL_SCHEMA)
        if run_format == UNHASHED_FORMAT:
            empty.execute("DROP TABLE files")
        missing = sorted(_columns(empty).keys() - have.keys())
    for table, column in missing:
        yield f"no such table or column: {table}.{column}"
    if not missing and not db.execute("SELECT 1 FROM events LIMIT 1").fetchone():
        yield "events: none, at least one expected"
    for (table, column), (kind, needed) in have.items():
        if (fits := _TYPE_CONDITIONS.get(kind)) is None:
            continue
        if not needed:
            fits = f"{{0}} IS NULL OR {fits}"
        wrong = f"NOT coalesce({fits.format(chr(34) + column + chr(34))}, FALSE)"
        count = db.execute(f'SELECT count(*) FROM "{table}" WHERE {wrong}').fetchone()[0]
        if count:
            yield f"{table}.{column}: {count} damaged values"


def _columns(db: sqlite3.Connection) -> dict[tuple[str, str], tuple[str, bool]]:
    """Type and NOT NULL of every column, by table and column name."""
    query = (
        'SELECT t.name, c.name, c.type, c."notnull" OR c.pk '
        "FROM sqlite_master t, pragma_table_info(t.name) c WHERE t.type = 'table'"
    )
    return {(table, column): (kind, needed) for table, column, kind, needed in db.execute(query)}


_TYPE_CONDITIONS = {
    "REAL": "typeof({0}) IN ('real', 'integer') AND abs({0}) < 1e12",
    "INTEGER": "typeof({0}) = 'integer' AND {0} BETWEEN -1e12 AND 1e12",
    "TEXT": "typeof({0}) = 'text'",
    "BLOB": "typeof({0}) = 'blob'",
}


@contextmanager
def journal_errors(folder: Path, text: str = "journal error") -> Iterator[None]:
    """Turn an SQLite error into a RunFailed that names the journal, or UnsafeFile without end."""
    path = folder / "journal.sqlite"
    try:
        yield
    except sqlite3.Error as error:
        if getattr(error, "sqlite_errorcode", None) == sqlite3.SQLITE_INTERRUPT:
            raise UnsafeFile(f"{path}: its tables take more steps than its size allows") from error
        raise RunFailed(f"{path}: {text}: {error}") from error


ENCODER_THREADS = 2  # measured with two: docs/evidence/bench-timing.md
BATCH_N, BATCH_S = 32, 0.5  # by hand: larger batches sync less often, a kill loses more
MAX_QUEUED_IMAGES, MAX_QUEUED_BYTES = 128, 256 << 20  # by hand: memory for slow disks
FLUSH_S = 120.0  # by hand: the queue takes seconds; a disk that takes longer hangs
HASH_COLUMN = "sha256"  # the column that is known when the file is written

TableRow = dict[str, Any]


@dataclass
class _Entry:
    """Rows to be committed together, and the pending hash of the first row's file."""

    rows: Sequence[tuple[str, TableRow]]
    digest: Future[str] | None = None
    history: bool = False
    """True for events, which are written even after a failure."""


class WriterThreads:
    """Threads of a `RunWriter`. failed: called once, from one of them, with the error."""

    def __init__(
        self, folder: Path, db: sqlite3.Connection, failed: Callable[[RunFailed], None]
    ) -> None:
        self._folder = folder
        self._db = db
        self._failed = failed
        self._changed = threading.Condition()
        self._queue: deque[_Entry] = deque()
        self._open = 0  # entries not committed yet
        self._images = self._bytes = 0  # in the queue
        self._hurry = self._ending = False
        self._cut = False  # later rows would lack earlier ones
        self.failure: RunFailed | None = None
        self._pool = ThreadPoolExecutor(ENCODER_THREADS, "encoder")
        self._committer = threading.Thread(target=self._run, name="journal", daemon=True)
        self._committer.start()

    def put_rows(self, rows: Sequence[tuple[str, TableRow]], history: bool = False) -> None:
        """Queue rows to be committed together. Raises RunFailed after a failure.

        history: written even after a failure.
        """
        with self._changed:
            if self.failure is not None and not history:
                raise self.failure
            self._append(_Entry(rows, history=history))

    def put_image(
        self, rows: Sequence[tuple[str, TableRow]], file: Path, image: NDArray[np.uint8], wait: bool
    ) -> bool:
        """Queue an image, then its rows; False, with nothing queued, if the queue is full.

        wait: for space instead. The first row gets the SHA-256 of the file. Raises RunFailed.
        """
        with self._changed:
            while not self._has_room(image.nbytes) and self.failure is None:
                if not wait:
                    return False
                if not self._changed.wait(FLUSH_S):
                    raise self._timeout_error()
            if self.failure is not None:
                raise self.failure
            self._images += 1
            self._bytes += image.nbytes
            self._append(_Entry(rows, self._pool.submit(self._write, file, image)))
        return True

    def flush(self) -> None:
        """Wait until the queue is committed. Raises RunFailed if that fails."""
        with self._changed:
            self._hurry = True
            self._changed.notify_all()
            if not self._changed.wait_for(lambda: not self._open, FLUSH_S):
                raise self._timeout_error()
            if self.failure is not None:
                raise self.failure

    def close(self) -> None:
        """Write the queue and end the threads; never raises."""
        with self._changed:
            self._hurry = self._ending = True
            self._changed.notify_all()
        self._committer.join(FLUSH_S)
        self._pool.shutdown(wait=not self._committer.is_alive(), cancel_futures=True)

    def _has_room(self, nbytes: int) -> bool:
        if not self._images:
            return True
        return self._images < MAX_QUEUED_IMAGES and self._bytes + nbytes <= MAX_QUEUED_BYTES

    def _append(self, entry: _Entry) -> None:
        self._queue.append(entry)
        self._open += 1
        self._changed.notify_all()

    def _timeout_error(self) -> RunFailed:
        return RunFailed(f"{self._folder}: no write completed within {FLUSH_S:.0f} s")

    def _write(self, file: Path, image: NDArray[np.uint8]) -> str:
        """Encode and write in an encoder thread; a failure is reported at once."""
        try:
            data = encode(image, file.suffix[1:])
            digest = hashlib.sha256(data).hexdigest()
            write_whole(file, data, sync_name=False)
        except BaseException as error:
            self._fail(error)
            raise
        finally:
            with self._changed:
                self._images -= 1
                self._bytes -= image.nbytes
                self._changed.notify_all()
        return digest

    def _fail(self, error: BaseException) -> None:
        with self._changed:
            if self.failure is not None:
                return
            self.failure = (
                error if isinstance(error, RunFailed) else RunFailed(f"{self._folder}: {error!r}")
            )
            self._changed.notify_all()
        self._failed(self.failure)

    def _run(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._queue or self._ending)
                self._changed.wait_for(lambda: self._hurry or len(self._queue) >= BATCH_N, BATCH_S)
                batch = [self._queue.popleft() for _ in range(min(BATCH_N, len(self._queue)))]
                if not batch:
                    return
            self._commit(batch)
            with self._changed:
                self._open -= len(batch)
                if not self._queue:
                    self._hurry = self._ending
                self._changed.notify_all()

    def _commit(self, batch: Sequence[_Entry]) -> None:
        """Commit the entries before the first failed one; of the rest only the history."""
        complete: list[_Entry] = []
        try:
            for entry in batch if not self._cut else ():
                if entry.digest is not None:
                    entry.rows[0][1][HASH_COLUMN] = entry.digest.result()
                complete.append(entry)
        except BaseException as error:
            self._cut = True
            self._fail(error)
        rest = batch[len(complete) :]
        try:
            if any(entry.digest is not None for entry in complete):
                with disk_errors(self._folder / "images"):
                    sync_folder(self._folder / "images")  # all renames at once
            self._insert(complete)
        except BaseException as error:
            self._cut = True
            self._fail(error)
            rest = batch
        with suppress(RunFailed):
            self._insert([entry for entry in rest if entry.history])

    def _insert(self, entries: Sequence[_Entry]) -> None:
        if not entries:
            return
        with journal_errors(self._folder), self._db:
            for entry in entries:
                for table, row in entry.rows:
                    insert(self._db, table, row)


def read_press_rows(folder: Path) -> dict[str, list[tuple[Any, ...]]]:
    """Read rows that belong to presses, by table, to compare two runs.

    All columns but the clocks, the id first; of pose samples only their presence: poses are
    sampled while a move is streamed, so their values depend on timing. Monitors are left out.
    """
    rows: dict[str, list[tuple[Any, ...]]] = {}
    with closing(open_journal(folder, "ro")) as db:
        for table in PRESS_TABLES:
            columns = [c[1] for c in db.execute(f"PRAGMA table_info({table})")]
            names = [c for c in columns if c not in CLOCK_COLUMNS]
            names.sort(key=lambda c: c not in ("frame_id", "step_id"))
            condition = f"WHERE stream NOT GLOB '{MONITOR_PREFIX}*'" if table == "samples" else ""
            query = f"SELECT {','.join(names)} FROM {table} {condition} ORDER BY 1, 2"
            stored = db.execute(query).fetchall()
            rows[table] = [row[:3] if "pose" in row else row for row in stored]
    return rows
