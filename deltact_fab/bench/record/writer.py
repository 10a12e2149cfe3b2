"""Writing a run, frame by frame, and taking an interrupted one up again. See `journal`."""

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
    TruthFiles,
    frame_id_of,
    image_file,
    json_bytes,
    metadata_files,
    written_files,
)
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
    """Writer of one run, off the caller's thread: every call returns when there is room for what it
    gave, and `flush` when all of it is committed. With a step come the samples that force sensor
    and stage gave in it.

    Rows are numbered by their place in the plan, so a press that is redone gets its old numbers.
    """

    def __init__(self, folder: Path, steps: Sequence[Step], image_format: str) -> None:
        """For `create` and `resume` only."""
        self.folder = folder
        self.kept_presses: frozenset[str] = frozenset()
        """Presses that are complete and are not carried out again."""
        self.redone: dict[str, str] = {}
        """Presses found begun or damaged, and why they are carried out again."""
        self.missed = 0
        """Frames of finished steps that did not come, over all sessions."""
        self.session = 1
        self.image_format = image_format
        self.failed: Callable[[RunFailed], None] = lambda error: None
        """Told at once, from another thread, when the disk refuses; the next call raises it too."""
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
    ) -> RunWriter:
        """Start a run in a new folder, which appears whole or not at all.

        flat: of the camera that meta names; what is read is corrected by it.
        Raises InputError when it is there or cannot be made there, RunFailed on a bad disk.
        """
        if folder.exists():
            raise InputError(f"{folder}: already there; name a new --out folder")
        ImageFormat.from_meta(meta).require()
        part = folder.with_name(f".{folder.name}.part")
        try:
            with disk_errors(folder, "made"):
                folder.parent.mkdir(parents=True, exist_ok=True)
                if part.exists():
                    shutil.rmtree(part)  # a start that was cut off
                (part / "images").mkdir(parents=True)
            files = {
                "run.json": json_bytes({"format": RUN_FORMAT, **meta}),
                "protocol.toml": protocol,
                "pattern.json": json_bytes(pattern),
            }
            if flat is not None:
                files[FLAT_FILE] = flat.to_png()
            for name, data in files.items():
                write_whole(part / name, data)
            with journal_errors(part), closing(connect(part, new=True)) as db:
                db.executescript(f"BEGIN;{JOURNAL_SCHEMA}COMMIT;")
                with db:
                    insert(db, "events", _event("session", "begun"))
                store_hashes(db, files)
            with disk_errors(folder, "made"):
                part.rename(folder)
                sync_folder(folder.parent)
        except BaseException as error:
            shutil.rmtree(part, ignore_errors=True)
            if isinstance(error, RunFailed):  # in words of the folder that was asked for
                raise RunFailed(str(error).replace(str(part), str(folder))) from error
            raise
        return cls(folder, steps, ImageFormat.from_meta(meta).suffix)

    @classmethod
    def resume(
        cls, folder: Path, steps: Sequence[Step], progress: Progress | None = None
    ) -> RunWriter:
        """Continue an unfinished run: keep complete presses, clear away all else.

        Raises InputError for no run folder, one that is being written and one that cannot be
        written; RunFailed for a damaged journal or other metadata.
        """
        run = Run(folder)
        if not os.access(folder, os.W_OK):
            raise InputError(f"{folder}: cannot be written; a run is continued where it stands")
        form = ImageFormat.from_meta(run.meta)
        form.require()
        writer = cls(folder, steps, form.suffix)
        try:
            with journal_errors(folder):
                for damage in hash_mismatches(run, writer._db):
                    raise RunFailed(f"{folder / damage.where}: {damage.text}; put it back")
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
        """Have one frame stored (image may be left out by the scene); return its id.

        None, and nothing stored, when too many wait to be written; wait: until there is room.
        late_s: after it was wanted. dropped, repeated: by the camera, since the one before.
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

        missed: of its frames, that will not come.
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

    def cut_off(self, step: Step, chunks: Iterable[Chunk]) -> None:
        """Keep the samples of a step that will not be finished, until its press is done again."""
        self._writing.put_rows(self._samples(step, chunks))

    def event(
        self, kind: str, text: str, t_s: float | None = None, step: Step | None = None
    ) -> None:
        """Note what happened, at a time of the rig's clock; from any thread."""
        self._writing.put_rows([("events", _event(kind, text, t_s, step))], history=True)

    def ready(self) -> None:
        """Load what writing images needs: doing so keeps all other threads waiting for a while."""
        encode(np.zeros((8, 8, 3), np.uint8), self.image_format)

    def flush(self) -> None:
        """Wait until all is committed. Raises RunFailed, as all that writes does after a failure.

        The failure names the file that the disk refused.
        """
        self._writing.flush()

    @property
    def failure(self) -> RunFailed | None:
        """Why nothing more can be written."""
        return self._writing.failure

    def close(self, summary: dict[str, Any]) -> None:
        """Finish the run: fold the journal into one plain file, then write the summary.

        Raises RunFailed when the disk refuses; the run then stays unfinished.
        """
        try:
            self._writing.flush()
            self._writing.close()
            data = json_bytes(summary)
            with journal_errors(self.folder), disk_errors(self.folder):
                names = metadata_files(self.folder, True)
                contents = {name: (self.folder / name).read_bytes() for name in names}
                store_hashes(self._db, {**contents, "summary.json": data})
                self._db.execute("PRAGMA wal_checkpoint(TRUNCATE)")
                # A finished record is read from anywhere, write-protected folders included; a
                # reader that has it open just now keeps the log in being.
                with suppress(sqlite3.OperationalError):
                    self._db.execute("PRAGMA journal_mode=DELETE")
                self._db.close()
            write_whole(self.folder / "summary.json", data)
        finally:
            self.abandon()

    def abandon(self) -> None:
        """Release the folder with all that was written; never raises, to mask no other error."""
        self._writing.close()
        with suppress(sqlite3.Error):
            self._db.close()
        self._claim.close()

    def _samples(self, step: Step, chunks: Iterable[Chunk]) -> list[tuple[str, TableRow]]:
        place = {"seq": self._step_seq[step.id], "press": step.press, "step_id": step.id}
        return [("samples", {**place, **pack(chunk)}) for chunk in chunks]

    def _clear(self) -> None:
        """Remove all but the kept presses: rows first, for a file without a row is cleared again.

        Raises RunFailed when a file cannot be removed.
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
            text += f"; done again: {repeated}" if repeated else ""
            insert(self._db, "events", _event("session", text))
        files = self._db.execute("SELECT file FROM frames WHERE file IS NOT NULL")
        keep = {self.folder / file for (file,) in files}
        keep |= {TruthFiles(self.folder).press(press) for press in self.kept_presses}
        for path in written_files(self.folder):
            if path not in keep:
                try:
                    path.unlink()
                except OSError as error:
                    raise RunFailed(f"{path}: cannot be removed: {error.strerror}") from error


def _step_columns(step: Step) -> TableRow:
    return {
        "step_id": step.id,
        "press": step.press,
        "indenter": step.indenter,
        "kind": step.kind,
    }


def _event(kind: str, text: str, t_s: float | None = None, step: Step | None = None) -> TableRow:
    press, step_id = (None, None) if step is None else (step.press, step.id)
    return {
        "kind": kind,
        "press": press,
        "step_id": step_id,
        "text": text,
        "t_s": t_s,
        "wall_s": time.time(),
    }
