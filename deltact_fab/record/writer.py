"""Writing a run, frame by frame, and taking an interrupted one up again."""

from __future__ import annotations

import hashlib
import os
import shutil
import sqlite3
import time
from collections.abc import Iterable, Sequence
from contextlib import closing, suppress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError, RunFailed
from ..optics import FlatField
from ..protocols.plan import Step
from .files import (
    FORMAT,
    encode_png,
    flat_file,
    image_file,
    json_bytes,
    refusing,
    sync_folder,
    truth_file,
    write_whole,
    written,
)
from .journal import PRESS_TABLES, SCHEMA, claim, connect, journal_errors
from .kept import Progress, frame_id_of, judged
from .run import Run
from .streams import Chunk, pack


class RunWriter:
    """Writes one run. Every frame and every step is committed before the next one starts; with a
    step come the samples that force sensor and stage gave in it.

    Rows are numbered by their place in the plan, so a press that is redone gets its old numbers.
    """

    def __init__(self, folder: Path, steps: Sequence[Step]) -> None:
        """For `create` and `resume` only."""
        self.folder = folder
        self.kept: frozenset[str] = frozenset()
        """Presses that are complete and are not carried out again."""
        self.redone: dict[str, str] = {}
        """Presses found begun or damaged, and why they are carried out again."""
        self.session = 1
        self._step_seq = {step.id: n for n, step in enumerate(steps, start=1)}
        self._frames_before = {}
        frames = 0
        for step in steps:
            self._frames_before[step.id] = frames
            frames += step.frames
        self._claim = claim(folder)
        try:
            self._db = connect(folder)
        except BaseException:
            self._claim.close()
            raise

    @classmethod
    def create(
        cls,
        folder: Path,
        meta: dict[str, Any],
        protocol: bytes,
        pattern: dict[str, Any],
        steps: Sequence[Step],
        flat: FlatField | None = None,
    ) -> RunWriter:
        """Start a run in a new folder, which appears whole or not at all.

        flat: of the camera that meta names; what is read is corrected by it.
        Raises InputError when it is there or cannot be made there, RunFailed on a bad disk.
        """
        if folder.exists():
            raise InputError(f"{folder}: already there; name a new --out folder")
        made = folder.with_name(f".{folder.name}.part")
        try:
            with refusing(folder):
                folder.parent.mkdir(parents=True, exist_ok=True)
                if made.exists():
                    shutil.rmtree(made)  # a start that was cut off
                (made / "images").mkdir(parents=True)
            write_whole(made / "protocol.toml", protocol)
            write_whole(made / "pattern.json", json_bytes(pattern))
            if flat is not None:
                write_whole(flat_file(made), flat.png())
            with journal_errors(made), closing(connect(made, new=True)) as db:
                db.executescript(f"BEGIN;{SCHEMA}COMMIT;")
                with db:
                    _event(db, "session", "begun")
            write_whole(made / "run.json", json_bytes({"format": FORMAT, **meta}))
            with refusing(folder):
                made.rename(folder)
                sync_folder(folder.parent)
        except BaseException as why:
            shutil.rmtree(made, ignore_errors=True)
            if isinstance(why, RunFailed):  # in words of the folder that was asked for
                raise RunFailed(str(why).replace(str(made), str(folder))) from why
            raise
        return cls(folder, steps)

    @classmethod
    def resume(
        cls, folder: Path, steps: Sequence[Step], progress: Progress | None = None
    ) -> RunWriter:
        """Continue an unfinished run: keep complete presses, clear away all else.

        Raises InputError for no run folder, one that is being written, one that cannot be written
        and one of an older format; RunFailed for a damaged journal.
        """
        run = Run(folder)
        if run.format != FORMAT:
            raise InputError(
                f"{folder}: format {run.format}: it can be read, but only the version that began "
                "it can go on with it"
            )
        if not os.access(folder, os.W_OK):
            raise InputError(f"{folder}: cannot be written; a run is continued where it stands")
        writer = cls(folder, steps)
        try:
            with journal_errors(folder):
                writer.kept, writer.redone = judged(writer._db, run, steps, progress)
                writer._clear()
        except BaseException:
            writer.abandon()
            raise
        return writer

    def frame(
        self,
        step: Step,
        k: int,
        image: NDArray[np.uint8] | None,
        t_s: float,
        t_step_s: float,
        t_press_s: float,
    ) -> str:
        """Store one frame (image may be left out by the scene) and return its id."""
        frame_id = frame_id_of(step, k)
        file = digest = None
        if image is not None:
            data = encode_png(image)
            file = image_file(frame_id)
            write_whole(self.folder / file, data)
            digest = hashlib.sha256(data).hexdigest()
        row = (
            frame_id, self._frames_before[step.id] + k, step.id, step.press, step.indenter,
            step.kind, k, step.settled and k == step.frames, file, digest, t_s, t_step_s,
            t_press_s, time.time(),
        )  # fmt: skip
        with journal_errors(self.folder), self._db:
            _insert(self._db, "frames", row)
        return frame_id

    def step(
        self,
        step: Step,
        planned_s: float,
        t_start_s: float,
        t_end_s: float,
        chunks: Iterable[Chunk] = (),
    ) -> None:
        """Journal a finished step and its samples. A press's last step completes the press."""
        row = (
            self._step_seq[step.id], step.id, step.press, step.indenter, step.kind,
            *step.target_mm, step.feed_mm_min, planned_s, t_start_s, t_end_s, time.time(),
        )  # fmt: skip
        with journal_errors(self.folder), self._db:
            self._insert_samples(step, chunks)
            _insert(self._db, "steps", row)

    def cut_off(self, step: Step, chunks: Iterable[Chunk]) -> None:
        """Keep the samples of a step that will not be finished, until its press is done again."""
        with journal_errors(self.folder), self._db:
            self._insert_samples(step, chunks)

    def event(
        self, kind: str, text: str, t_s: float | None = None, step: Step | None = None
    ) -> None:
        """Note what happened, at a time of the rig's clock."""
        with journal_errors(self.folder), self._db:
            _event(self._db, kind, text, t_s, step)

    def close(self, summary: dict[str, Any]) -> None:
        """Finish the run: fold the journal into one plain file, then write the summary.

        Raises RunFailed when the disk refuses; the run then stays unfinished.
        """
        try:
            with journal_errors(self.folder):
                self._db.execute("PRAGMA wal_checkpoint(TRUNCATE)")
                # A finished record is read from anywhere, write-protected folders included; a
                # reader that has it open just now keeps the log in being.
                with suppress(sqlite3.OperationalError):
                    self._db.execute("PRAGMA journal_mode=DELETE")
                self._db.close()
            write_whole(self.folder / "summary.json", json_bytes(summary))
        finally:
            self.abandon()

    def abandon(self) -> None:
        """Let go of the folder as it is; never raises, so that it masks no other error."""
        with suppress(sqlite3.Error):
            self._db.close()
        self._claim.close()

    def _insert_samples(self, step: Step, chunks: Iterable[Chunk]) -> None:
        for chunk in chunks:
            row = (
                self._step_seq[step.id], chunk.stream, step.press, step.id, len(chunk),
                chunk.origin_s, *pack(chunk),
            )  # fmt: skip
            _insert(self._db, "samples", row)

    def _clear(self) -> None:
        """Remove all but the kept presses: rows first, for a file without a row is cleared again.

        Raises RunFailed when a file cannot be removed.
        """
        with self._db:
            for table in PRESS_TABLES:
                rows = self._db.execute(f"SELECT DISTINCT press FROM {table}").fetchall()
                gone = [(press,) for (press,) in rows if press not in self.kept]
                self._db.executemany(f"DELETE FROM {table} WHERE press = ?", gone)
            kept_frames = self._db.execute("SELECT count(*) FROM frames").fetchone()[0]
            again = "; ".join(f"{press}: {text}" for press, text in self.redone.items())
            count = "SELECT count(*) FROM events WHERE kind = 'session'"
            self.session = 1 + self._db.execute(count).fetchone()[0]
            text = f"resumed: {kept_frames} frames kept"
            _event(self._db, "session", f"{text}; done again: {again}" if again else text)
        files = self._db.execute("SELECT file FROM frames WHERE file IS NOT NULL")
        keep = {self.folder / file for (file,) in files}
        keep |= {truth_file(self.folder, press) for press in self.kept}
        for path in written(self.folder):
            if path not in keep:
                try:
                    path.unlink()
                except OSError as why_not:
                    raise RunFailed(f"{path}: cannot be removed: {why_not.strerror}") from why_not


def _insert(db: sqlite3.Connection, table: str, row: Sequence[Any]) -> None:
    db.execute(f"INSERT INTO {table} VALUES ({','.join('?' * len(row))})", row)


def _event(
    db: sqlite3.Connection,
    kind: str,
    text: str,
    t_s: float | None = None,
    step: Step | None = None,
) -> None:
    where = (None, None) if step is None else (step.press, step.id)
    _insert(db, "events", (None, kind, *where, text, t_s, time.time()))
