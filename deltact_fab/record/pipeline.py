"""What is written while a run goes on: files on two threads, rows in their order on a third.

A row is committed only after its file is on the disk, so a kill at any time leaves no row without
its file. Rows are committed in the order in which they were put, at most BATCH of them or BATCH_S
after the first of them. A caller that adds an image finds room for it or waits, or
learns that there is none.
"""

from __future__ import annotations

import hashlib
import sqlite3
import threading
from collections import deque
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import RunFailed
from ..files import disk_errors, sync_folder, write_whole
from .images import encode
from .journal import insert, journal_errors

ENCODERS = 2
BATCH, BATCH_S = 32, 0.5
MAX_IMAGES, MAX_BYTES = 128, 256 << 20  # that wait to be written
FLUSH_S = 120.0  # what waits is written within seconds; a disk that takes longer hangs
SHA256 = "sha256"  # the column that is known when the file is written

TableRow = dict[str, Any]


@dataclass
class _Entry:
    """Rows of tables that belong together, and the hash of the file of the first of them."""

    rows: Sequence[tuple[str, TableRow]]
    digest: Future[str] | None = None
    history: bool = False
    """Written even after a failure: how the run ended."""


class WriterThreads:
    """The threads of one `RunWriter`. failed: called once, from one of them, with the reason."""

    def __init__(
        self, folder: Path, db: sqlite3.Connection, failed: Callable[[RunFailed], None]
    ) -> None:
        self._folder = folder
        self._db = db
        self._failed = failed
        self._changed = threading.Condition()
        self._queue: deque[_Entry] = deque()
        self._open = 0  # entries that are not committed yet
        self._images = self._bytes = 0  # that wait to be written
        self._hurry = self._ending = False
        self._cut = False  # from here on rows would stand without what comes before them
        self.failure: RunFailed | None = None
        self._pool = ThreadPoolExecutor(ENCODERS, "encoder")
        self._committer = threading.Thread(target=self._run, name="journal", daemon=True)
        self._committer.start()

    def put(self, rows: Sequence[tuple[str, TableRow]], history: bool = False) -> None:
        """Have these rows committed together. Raises RunFailed after a failure.

        history: told all the same then.
        """
        with self._changed:
            if self.failure is not None and not history:
                raise self.failure
            self._append(_Entry(rows, history=history))

    def put_image(
        self, rows: Sequence[tuple[str, TableRow]], file: Path, image: NDArray[np.uint8], wait: bool
    ) -> bool:
        """Have the image written, then these rows; False, and nothing kept, when there is no room.

        wait: until there is. The first row gets the SHA-256 of the file. Raises RunFailed.
        """
        with self._changed:
            while not self._has_room(image.nbytes) and self.failure is None:
                if not wait:
                    return False
                if not self._changed.wait(FLUSH_S):
                    raise self._hanging()
            if self.failure is not None:
                raise self.failure
            self._images += 1
            self._bytes += image.nbytes
            self._append(_Entry(rows, self._pool.submit(self._write, file, image)))
        return True

    def flush(self) -> None:
        """Wait until all that was put is committed. Raises RunFailed when it cannot be."""
        with self._changed:
            self._hurry = True
            self._changed.notify_all()
            if not self._changed.wait_for(lambda: not self._open, FLUSH_S):
                raise self._hanging()
            if self.failure is not None:
                raise self.failure

    def close(self) -> None:
        """Write what was put, and end the threads; never raises."""
        with self._changed:
            self._hurry = self._ending = True
            self._changed.notify_all()
        self._committer.join(FLUSH_S)
        self._pool.shutdown(wait=not self._committer.is_alive(), cancel_futures=True)

    def _has_room(self, nbytes: int) -> bool:
        if not self._images:
            return True
        return self._images < MAX_IMAGES and self._bytes + nbytes <= MAX_BYTES

    def _append(self, entry: _Entry) -> None:
        self._queue.append(entry)
        self._open += 1
        self._changed.notify_all()

    def _hanging(self) -> RunFailed:
        return RunFailed(f"{self._folder}: the disk took nothing for {FLUSH_S:.0f} s")

    def _write(self, file: Path, image: NDArray[np.uint8]) -> str:
        """In an encoder's thread; a failure is known at once, not when its row is due."""
        try:
            data = encode(image, file.suffix[1:])
            digest = hashlib.sha256(data).hexdigest()
            write_whole(file, data, sync_name=False)
        except BaseException as why:
            self._fail(why)
            raise
        finally:
            with self._changed:
                self._images -= 1
                self._bytes -= image.nbytes
                self._changed.notify_all()
        return digest

    def _fail(self, why: BaseException) -> None:
        with self._changed:
            if self.failure is not None:
                return
            self.failure = (
                why if isinstance(why, RunFailed) else RunFailed(f"{self._folder}: {why!r}")
            )
            self._changed.notify_all()
        self._failed(self.failure)

    def _run(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._queue or self._ending)
                self._changed.wait_for(lambda: self._hurry or len(self._queue) >= BATCH, BATCH_S)
                batch = [self._queue.popleft() for _ in range(min(BATCH, len(self._queue)))]
                if not batch:
                    return
            self._commit(batch)
            with self._changed:
                self._open -= len(batch)
                if not self._queue:
                    self._hurry = self._ending
                self._changed.notify_all()

    def _commit(self, batch: Sequence[_Entry]) -> None:
        """Commit what comes before the first entry that failed; of the rest only the history."""
        whole: list[_Entry] = []
        try:
            for entry in batch if not self._cut else ():
                if entry.digest is not None:
                    entry.rows[0][1][SHA256] = entry.digest.result()
                whole.append(entry)
        except BaseException as why:
            self._cut = True
            self._fail(why)
        rest = batch[len(whole) :]
        try:
            if any(entry.digest is not None for entry in whole):
                with disk_errors(self._folder / "images"):
                    sync_folder(self._folder / "images")  # their renames, of all of them at once
            self._insert(whole)
        except BaseException as why:
            self._cut = True
            self._fail(why)
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
