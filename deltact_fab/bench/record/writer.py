"""Writing of a run, frame by frame, and resuming of an interrupted one. See `journal`."""

from __future__ import annotations

import os
import shutil
import sqlite3
import time
from collections.abc import Callable, Iterable, Sequence
from contextlib import closing, suppress
from itertools import accumulate
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deltact_fab.common import (
    InputError,
    Progress,
    RunFailed,
    disk_errors,
    sync_folder,
    write_whole,
)
from deltact_fab.sensor import FlatField

from ..protocols.plan import Step
from .check import RunVerdict, find_damage, hash_mismatches
from .files import (
    FLAT_FILE,
    RUN_FORMAT,
    SENSOR_FILE,
    frame_id_of,
    image_file,
    json_bytes,
    metadata_files,
    truth_file,
    written_files,
)
from .folder import read_file
from .images import ImageFormat, encode
from .journal import (
    JOURNAL_SCHEMA,
    PRESS_TABLES,
    TableRow,
    WriterThreads,
    claim,
    connect,
    insert,
    journal_errors,
    store_hashes,
)
from .run import Run
from .streams import Chunk, pack


class RunWriter:
    """Writer of one run in the background: calls return once their data are queued, `flush` once
    they are committed. A step is stored with the samples of force sensor and stage.

    Rows are numbered by their position in the plan, so a repeated press gets its old numbers.
    """

    def __init__(self, folder: Path, steps: Sequence[Step], image_format: str) -> None:
        """For `create` and `resume` only."""
        self.folder = folder
        self.kept_presses: frozenset[str] = frozenset()
        """Complete presses, which are not repeated."""
        self.redone: dict[str, str] = {}
        """Incomplete or damaged presses, with the reason for repeating them."""
        self.missed = 0
        """Frames missing from finished steps, over all sessions."""
        self.skipped: tuple[str, ...] = ()
        """Presses and changes of indenter that were not made, as the run ended before them."""
        self.session = 1
        self.image_format = image_format
        self.failed: Callable[[RunFailed], None] = lambda error: None
        """Called from another thread on a disk error; the next call raises it too."""
        self._step_seq = {step.id: n for n, step in enumerate(steps, start=1)}
        frames_before = accumulate((step.frames for step in steps), initial=0)
        self._frames_before = {step.id: n for step, n in zip(steps, frames_before, strict=False)}
        self._claim = claim(folder)
        try:
            self._db = connect(folder)
        except BaseException:
            self._claim.close()
            raise
        self._writing = WriterThreads(folder, self._db, lambda error: self.failed(error))

    @classmethod
    def create(
        cls,
        folder: Path,
        meta: dict[str, Any],
        protocol: bytes,
        pattern: dict[str, Any],
        steps: Sequence[Step],
        flat: FlatField | None = None,
        truth: dict[str, Any] | None = None,
    ) -> RunWriter:
        """Start a run in a new folder, created atomically.

        flat: flat field of the camera in meta, applied on reading. truth: see `RigKind.truth`.
        Raises InputError if the folder exists or cannot be created, RunFailed for a disk error.
        """
        if folder.exists():
            raise InputError(f"{folder}: already exists; name a new --out folder")
        ImageFormat.from_meta(meta).require()
        part = folder.with_name(f".{folder.name}.part")
        try:
            with disk_errors(folder, "made"):
                folder.parent.mkdir(parents=True, exist_ok=True)
                if part.exists():
                    shutil.rmtree(part)  # left by an interrupted start
                (part / "images").mkdir(parents=True)
            files = {
                "run.json": json_bytes({"format": RUN_FORMAT, **meta}),
                "protocol.toml": protocol,
                "pattern.json": json_bytes(pattern),
            }
            if flat is not None:
                files[FLAT_FILE] = flat.to_png()
            if truth is not None:
                files[SENSOR_FILE] = json_bytes(truth)
                (part / SENSOR_FILE).parent.mkdir()
            for name, data in files.items():
                write_whole(part / name, data)
            with journal_errors(part), closing(connect(part, new=True)) as db:
                db.executescript(f"BEGIN;{JOURNAL_SCHEMA}COMMIT;")
                with db:
                    insert(db, "events", _log_row("session", "begun"))
                store_hashes(db, files)
            with disk_errors(folder, "made"):
                part.rename(folder)
                sync_folder(folder.parent)
        except BaseException as error:
            shutil.rmtree(part, ignore_errors=True)
            if isinstance(error, RunFailed):  # name the requested folder
                raise RunFailed(str(error).replace(str(part), str(folder))) from error
            raise
        return cls(folder, steps, ImageFormat.from_meta(meta).suffix)

    @classmethod
    def resume(
        cls, folder: Path, steps: Sequence[Step], progress: Progress | None = None
    ) -> RunWriter:
        """Continue an unfinished run: keep complete presses, remove the rest.

        Raises InputError for a folder that is not a run, is being written or is read-only;
        RunFailed for a damaged journal or other metadata.
        """
        run = Run(folder)
        if not os.access(folder, os.W_OK):
            raise InputError(f"{folder}: read-only; a run can only be continued in its own folder")
        form = ImageFormat.from_meta(run.meta)
        form.require()
        writer = cls(folder, steps, form.suffix)
        try:
            with run.reader():
                pass  # a sound schema, and tables that end
            with journal_errors(folder):
                for damage in hash_mismatches(run, writer._db):
                    raise RunFailed(f"{folder / damage.where}: {damage.text}; restore it")
                verdict = RunVerdict(folder)
                for damage in find_damage(run, writer._db, steps, verdict, progress):
                    if damage.where == "journal.sqlite":
                        raise sqlite3.DatabaseError(damage.text)
                    if damage.kind == "damaged":
                        writer.redone.setdefault(damage.where, damage.text)
                writer.redone |= verdict.open
                writer.kept_presses = frozenset(verdict.sound)
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
        *,
        late_s: float = 0.0,
        dropped: int = 0,
        repeated: int = 0,
        wait: bool = True,
    ) -> str | None:
        """Store one frame (image: None if the protocol has no images); return its id.

        Returns None, with nothing stored, if the queue is full; wait: for space instead.
        late_s: delay of the exposure. dropped, repeated: by the camera, since the previous one.
        """
        frame_id = frame_id_of(step, k)
        row: TableRow = {
            "frame_id": frame_id,
            "seq": self._frames_before[step.id] + k,
            **_step_columns(step),
            "k": k,
            "settled": step.settled and k == step.frames,
            "file": None,
            "sha256": None,
            "t_s": t_s,
            "t_step_s": t_step_s,
            "t_press_s": t_press_s,
            "late_s": late_s,
            "dropped": dropped,
            "repeated": repeated,
            "wall_s": time.time(),
        }
        if image is None:
            self._writing.put_rows([("frames", row)])
            return frame_id
        row["file"] = image_file(frame_id, self.image_format)
        path = self.folder / row["file"]
        return frame_id if self._writing.put_image([("frames", row)], path, image, wait) else None

    def step(
        self,
        step: Step,
        planned_s: float,
        t_start_s: float,
        t_end_s: float,
        chunks: Iterable[Chunk] = (),
        missed: int = 0,
    ) -> None:
        """Journal a finished step and its samples. A press's last step completes the press.

        missed: number of its frames that the camera did not deliver.
        """
        self.missed += missed
        x_mm, y_mm, z_mm = step.target_mm
        row: TableRow = {
            "seq": self._step_seq[step.id],
            **_step_columns(step),
            "x_mm": x_mm,
            "y_mm": y_mm,
            "z_mm": z_mm,
            "feed_mm_min": step.feed_mm_min,
            "planned_s": planned_s,
            "missed": missed,
            "t_start_s": t_start_s,
            "t_end_s": t_end_s,
            "wall_s": time.time(),
        }
        self._writing.put_rows([*self._samples(step, chunks), ("steps", row)])

    def interrupted_step(self, step: Step, chunks: Iterable[Chunk]) -> None:
        """Store the samples of an interrupted step, until its press is repeated."""
        self._writing.put_rows(self._samples(step, chunks))

    def event(
        self, kind: str, text: str, t_s: float | None = None, step: Step | None = None
    ) -> None:
        """Log an event; thread-safe. t_s: on the rig's clock."""
        self._writing.put_rows([("events", _log_row(kind, text, t_s, step))], history=True)

    def load_encoder(self) -> None:
        """Load the image encoder in advance: its import blocks all threads for a while."""
        encode(np.zeros((8, 8, 3), np.uint8), self.image_format)

    def flush(self) -> None:
        """Wait until all is committed. Raises RunFailed naming the file that could not be written.

        Every writing method raises it after a failure.
        """
        self._writing.flush()

    @property
    def failure(self) -> RunFailed | None:
        """Error after which nothing can be written; None: no error."""
        return self._writing.failure

    def close(self, summary: dict[str, Any]) -> None:
        """Finish the run: checkpoint the journal into one file, then write the summary.

        Raises RunFailed for a disk error; the run then stays unfinished.
        """
        try:
            self._writing.flush()
            self._writing.close()
            data = json_bytes(summary)
            with journal_errors(self.folder), disk_errors(self.folder):
                names = metadata_files(self.folder, True)
                contents = {name: read_file(self.folder, name) for name in names}
                store_hashes(self._db, {**contents, "summary.json": data})
                self._db.execute("PRAGMA wal_checkpoint(TRUNCATE)")
                # A finished record must be readable in write-protected folders; an open reader
                # keeps the write-ahead log alive.
                with suppress(sqlite3.OperationalError):
                    self._db.execute("PRAGMA journal_mode=DELETE")
                self._db.close()
            write_whole(self.folder / "summary.json", data)
        finally:
            self.abandon()

    def abandon(self) -> None:
        """Release the folder; never raises, so as not to mask another error."""
        self._writing.close()
        with suppress(sqlite3.Error):
            self._db.close()
        self._claim.close()

    def _samples(self, step: Step, chunks: Iterable[Chunk]) -> list[tuple[str, TableRow]]:
        place = {"seq": self._step_seq[step.id], "press": step.press, "step_id": step.id}
        return [("samples", {**place, **pack(chunk)}) for chunk in chunks]

    def _clear(self) -> None:
        """Remove all but the kept presses: rows first, so files without rows can be found again.

        Raises RunFailed if a file cannot be removed.
        """
        with self._db:
            for table in PRESS_TABLES:
                rows = self._db.execute(f"SELECT DISTINCT press FROM {table}").fetchall()
                gone = [(press,) for (press,) in rows if press not in self.kept_presses]
                self._db.executemany(f"DELETE FROM {table} WHERE press = ?", gone)
            query = "SELECT coalesce(sum(missed), 0) FROM steps"
            self.missed = self._db.execute(query).fetchone()[0]
            kept_frames = self._db.execute("SELECT count(*) FROM frames").fetchone()[0]
            count = "SELECT count(*) FROM events WHERE kind = 'session'"
            self.session = 1 + self._db.execute(count).fetchone()[0]
            text = f"resumed: {kept_frames} frames kept"
            repeated = "; ".join(f"{press}: {reason}" for press, reason in self.redone.items())
            text += f"; repeated: {repeated}" if repeated else ""
            insert(self._db, "events", _log_row("session", text))
        files = self._db.execute("SELECT file FROM frames WHERE file IS NOT NULL")
        keep = {self.folder / file for (file,) in files}
        keep |= {self.folder / truth_file(press) for press in self.kept_presses}
        for path in written_files(self.folder):
            if path not in keep:
                try:
                    path.unlink()
                except OSError as error:
                    raise RunFailed(f"{path}: cannot be removed: {error.strerror}") from error


def _step_columns(step: Step) -> TableRow:
    return {"step_id": step.id, "press": step.press, "indenter": step.indenter, "kind": step.kind}


def _log_row(kind: str, text: str, t_s: float | None = None, step: Step | None = None) -> TableRow:
    press, step_id = (None, None) if step is None else (step.press, step.id)
    return {
        "kind": kind,
        "press": press,
        "step_id": step_id,
        "text": text,
        "t_s": t_s,
        "wall_s": time.time(),
    }
