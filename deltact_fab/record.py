"""A run is a folder that survives: frozen inputs, an SQLite journal, images written whole.

RUN/run.json          name, seed, versions, protocol, rig, sensor, camera model
RUN/protocol.toml     the protocol as it was given, byte for byte
RUN/pattern.json      recipe and dot centres as data
RUN/journal.sqlite    steps, frames, sessions (WAL, synchronous=FULL)
RUN/images/*.png      temporary file, fsync, rename
RUN/truth/            written by a virtual rig only; read through `Run.truth()` in analysis only
RUN/summary.json      written last: its presence says that the run is finished

The folder appears whole, by one rename. A press is complete when its last step is journalled; what
else it leaves (images, truth) is on the disk before that. See docs/decisions/0005-resume.md.
"""

from __future__ import annotations

import errno
import hashlib
import json
import os
import shutil
import sqlite3
import time
import zipfile
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import closing, contextmanager, suppress
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from .errors import InputError, RunFailed
from .optics import LatticeSampler, Pinhole, SurfaceLattice
from .protocols.plan import Step

if TYPE_CHECKING:
    import pandas as pd

FORMAT = 2
_SCHEMA = """
CREATE TABLE steps (
  seq INTEGER PRIMARY KEY, step_id TEXT NOT NULL UNIQUE, press TEXT NOT NULL,
  indenter TEXT NOT NULL, kind TEXT NOT NULL,
  x_mm REAL NOT NULL, y_mm REAL NOT NULL, z_mm REAL NOT NULL, feed_mm_min REAL NOT NULL,
  planned_s REAL NOT NULL, t_start_s REAL NOT NULL, t_end_s REAL NOT NULL, wall_s REAL NOT NULL
);
CREATE TABLE frames (
  frame_id TEXT PRIMARY KEY, seq INTEGER NOT NULL UNIQUE, step_id TEXT NOT NULL,
  press TEXT NOT NULL, indenter TEXT NOT NULL, kind TEXT NOT NULL, k INTEGER NOT NULL,
  file TEXT, sha256 TEXT, t_s REAL NOT NULL, t_step_s REAL NOT NULL,
  x_mm REAL NOT NULL, y_mm REAL NOT NULL, z_mm REAL NOT NULL,
  fx_n REAL, fy_n REAL, fz_n REAL, tx_nmm REAL, ty_nmm REAL, tz_nmm REAL,
  wall_s REAL NOT NULL
);
CREATE TABLE sessions (
  seq INTEGER PRIMARY KEY, wall_s REAL NOT NULL, kept_frames INTEGER NOT NULL, redone TEXT NOT NULL
);
"""
WALL_COLUMNS = ("wall_s",)  # the only columns in which two equal runs may differ
# A resumed run may also differ in the rig's clock, which starts anew with each session.
CLOCK_COLUMNS = (*WALL_COLUMNS, "t_s", "t_start_s", "t_end_s")
# What a run may be continued with although it differs: it changes no number and no byte.
_MAY_DIFFER = ("format", "name", "rig_name", "versions.python", "versions.cadquery")

Progress = Callable[[int, int, str], None]


def write_whole(path: Path, data: bytes) -> None:
    """Write a file so that it is there whole or not at all: temporary, fsync, rename, fsync.

    Raises RunFailed naming the file when the disk refuses.
    """
    temporary = path.with_name(f".{path.name}.part")
    try:
        with temporary.open("wb") as out:
            out.write(data)
            out.flush()
            os.fsync(out.fileno())
        temporary.replace(path)
        _sync_folder(path.parent)
    except BaseException as why:
        # Where nothing may be written, nothing can be removed either, and nothing is there.
        with suppress(OSError):
            temporary.unlink()
        if isinstance(why, OSError):
            raise RunFailed(f"{path}: cannot be written: {why.strerror}") from why
        raise


def _sync_folder(folder: Path) -> None:
    """Make a rename survive a power cut; file systems that cannot say so are let pass."""
    if os.name != "posix":
        return
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    except OSError as why:
        if why.errno not in (errno.EINVAL, errno.ENOTSUP):
            raise
    finally:
        os.close(handle)


def image_file(frame_id: str) -> str:
    """Path of a frame's image inside the run folder."""
    return f"images/{frame_id.replace('/', '_').replace('#', '_')}.png"


def truth_file(folder: Path, press: str) -> Path:
    """Where a virtual rig keeps the truth of one press of the run in `folder`.

    An npz of displacement_mm (n, ny, nx, 3), one a solved knot, and for each frame of the press,
    in order of capture: frame_id, knots (m, 2) it lies between, fraction (m,) of the way.
    """
    return folder / "truth" / f"{press.replace('/', '_')}.npz"


def lattice_file(folder: Path) -> Path:
    """Where a virtual rig keeps the lattice that its truth stands on."""
    return folder / "truth" / "lattice.json"


def encode_png(image: NDArray[np.uint8]) -> bytes:
    """(h, w, 3) BGR to PNG bytes, tuned for noisy frames (fast filter, Huffman only)."""
    import cv2

    done, data = cv2.imencode(
        ".png",
        image,
        [
            cv2.IMWRITE_PNG_COMPRESSION,
            1,
            cv2.IMWRITE_PNG_STRATEGY,
            cv2.IMWRITE_PNG_STRATEGY_HUFFMAN_ONLY,
            cv2.IMWRITE_PNG_FILTER,
            cv2.IMWRITE_PNG_FILTER_AVG,
        ],
    )
    if not done:
        raise RunFailed("an image could not be encoded as PNG")
    return bytes(data)


class RunWriter:
    """Writes one run. Every frame and every step is committed before the next one starts.

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
        self._claim = _claim(folder)
        try:
            self._db = _connect(folder)
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
    ) -> RunWriter:
        """Start a run in a new folder, which appears whole or not at all.

        Raises InputError when it is there or cannot be made there, RunFailed on a bad disk.
        """
        if folder.exists():
            raise InputError(f"{folder}: already there; name a new --out folder")
        made = folder.with_name(f".{folder.name}.part")
        try:
            with _refusing(folder):
                folder.parent.mkdir(parents=True, exist_ok=True)
                if made.exists():
                    shutil.rmtree(made)  # a start that was cut off
                (made / "images").mkdir(parents=True)
            write_whole(made / "protocol.toml", protocol)
            write_whole(made / "pattern.json", _json(pattern))
            with _journal(made), closing(_connect(made, new=True)) as db:
                db.executescript(_SCHEMA)
                with db:
                    db.execute("INSERT INTO sessions VALUES (1, ?, 0, '')", (time.time(),))
            write_whole(made / "run.json", _json({"format": FORMAT, **meta}))
            with _refusing(folder):
                made.rename(folder)
                _sync_folder(folder.parent)
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

        A press is kept when all its steps and frames are journalled, every image has its hash and
        its truth is whole. Raises InputError for no run folder, one that is being written or one
        that cannot be written; RunFailed for a damaged journal.
        """
        run = Run(folder)
        if not os.access(folder, os.W_OK):
            raise InputError(f"{folder}: cannot be written; a run is continued where it stands")
        writer = cls(folder, steps)
        try:
            with _journal(folder):
                writer._find_kept(run, steps, progress)
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
        position_mm: tuple[float, float, float],
        force_n: tuple[float, float, float] | None,
        torque_nmm: tuple[float, float, float] | None,
    ) -> str:
        """Store one frame (image may be left out by the scene) and return its id."""
        frame_id = _frame_id(step, k)
        file = digest = None
        if image is not None:
            data = encode_png(image)
            file = image_file(frame_id)
            write_whole(self.folder / file, data)
            digest = hashlib.sha256(data).hexdigest()
        row = (
            frame_id, self._frames_before[step.id] + k, step.id, step.press, step.indenter,
            step.kind, k, file, digest, t_s, t_step_s, *position_mm, *(force_n or (None,) * 3),
            *(torque_nmm or (None,) * 3), time.time(),
        )  # fmt: skip
        self._insert("frames", row)
        return frame_id

    def step(self, step: Step, planned_s: float, t_start_s: float, t_end_s: float) -> None:
        """Journal a finished step. The last step of a press completes the press."""
        self._insert(
            "steps",
            (
                self._step_seq[step.id], step.id, step.press, step.indenter, step.kind,
                *step.target_mm, step.feed_mm_min, planned_s, t_start_s, t_end_s, time.time(),
            ),
        )  # fmt: skip

    def close(self, summary: dict[str, Any]) -> None:
        """Finish the run: fold the journal into one plain file, then write the summary.

        Raises RunFailed when the disk refuses; the run then stays unfinished.
        """
        try:
            with _journal(self.folder):
                self._db.execute("PRAGMA wal_checkpoint(TRUNCATE)")
                # A finished record is read from anywhere, write-protected folders included; a
                # reader that has it open just now keeps the log in being.
                with suppress(sqlite3.OperationalError):
                    self._db.execute("PRAGMA journal_mode=DELETE")
                self._db.close()
            write_whole(self.folder / "summary.json", _json(summary))
        finally:
            self.abandon()

    def abandon(self) -> None:
        """Let go of the folder as it is; never raises, so that it masks no other error."""
        with suppress(sqlite3.Error):
            self._db.close()
        self._claim.close()

    def _insert(self, table: str, row: tuple[Any, ...]) -> None:
        marks = ",".join("?" * len(row))
        with _journal(self.folder), self._db:
            self._db.execute(f"INSERT INTO {table} VALUES ({marks})", row)

    def _find_kept(self, run: Run, steps: Sequence[Step], progress: Progress | None) -> None:
        """Judge every press by what the journal and the disk hold of it."""
        verdict = self._db.execute("PRAGMA quick_check(1)").fetchone()[0]
        if verdict != "ok":
            raise sqlite3.DatabaseError(verdict)
        done = {row[0] for row in self._db.execute("SELECT step_id FROM steps")}
        found = {
            frame_id: (file, digest)
            for frame_id, file, digest in self._db.execute(
                "SELECT frame_id, file, sha256 FROM frames"
            )
        }
        plan: dict[str, list[Step]] = {}
        for step in steps:
            plan.setdefault(step.press, []).append(step)
        checked = 0
        kept = set()
        for press, part in plan.items():
            ids = [_frame_id(step, k) for step in part for k in range(1, step.frames + 1)]
            have = [i for i in ids if i in found]
            if not have and not any(step.id in done for step in part):
                continue
            if len(have) < len(ids) or any(step.id not in done for step in part):
                self.redone[press] = f"cut off after {len(have)} of {len(ids)} frames"
                continue
            why = self._damage(run, press, {i: found[i] for i in ids})
            checked += len(ids)
            if progress is not None and ids:
                progress(checked, len(found), f"checking {press}")
            if why:
                self.redone[press] = why
            else:
                kept.add(press)
        self.kept = frozenset(kept)

    def _damage(
        self, run: Run, press: str, frames: dict[str, tuple[str | None, str | None]]
    ) -> str:
        """What is wrong with the files of a press whose rows are all there; empty when nothing."""
        drawn = False
        for file, digest in frames.values():
            if file is None:
                continue
            drawn = True
            try:
                data = (self.folder / file).read_bytes()
            except OSError as why:
                return f"{file}: {why.strerror}"
            if hashlib.sha256(data).hexdigest() != digest:
                return f"{file}: differs from its hash in the journal"
        if drawn and run.simulated:
            if not lattice_file(self.folder).is_file():
                return "its truth is missing"
            path = truth_file(self.folder, press)
            try:
                with zipfile.ZipFile(path) as packed:
                    bad = packed.testzip()
                with np.load(path) as data:
                    ids = data["frame_id"].tolist()
            except (OSError, ValueError, KeyError, zipfile.BadZipFile):
                return "its truth is missing or damaged"
            if bad is not None or ids != list(frames):
                return "its truth is damaged"
        return ""

    def _clear(self) -> None:
        """Remove all but the kept presses: rows first, for a file without a row is cleared again.

        Raises RunFailed when a file cannot be removed.
        """
        with self._db:
            rows = self._db.execute(
                "SELECT DISTINCT press FROM frames UNION SELECT press FROM steps"
            )
            gone = [(press,) for (press,) in rows.fetchall() if press not in self.kept]
            self._db.executemany("DELETE FROM frames WHERE press = ?", gone)
            self._db.executemany("DELETE FROM steps WHERE press = ?", gone)
            kept_frames = self._db.execute("SELECT count(*) FROM frames").fetchone()[0]
            why = "; ".join(f"{press}: {text}" for press, text in self.redone.items())
            self.session = 1 + self._db.execute("SELECT max(seq) FROM sessions").fetchone()[0]
            self._db.execute(
                "INSERT INTO sessions VALUES (?, ?, ?, ?)",
                (self.session, time.time(), kept_frames, why),
            )
        files = self._db.execute("SELECT file FROM frames WHERE file IS NOT NULL")
        keep = {self.folder / file for (file,) in files}
        keep |= {truth_file(self.folder, press) for press in self.kept}
        for path in _written(self.folder):
            if path not in keep:
                try:
                    path.unlink()
                except OSError as why_not:
                    raise RunFailed(f"{path}: cannot be removed: {why_not.strerror}") from why_not


def _frame_id(step: Step, k: int) -> str:
    return f"{step.id}#{k:03d}"


def _written(folder: Path) -> Iterable[Path]:
    """Images, truths of presses and cut-off writes of a run: what a resume may remove."""
    for pattern in (".*.part", "images/*.png", "images/.*.part", "truth/*.npz", "truth/.*.part"):
        yield from folder.glob(pattern)


class _Claim:
    """The right to write into a run folder; it ends with the process, however that dies."""

    def __init__(self, handle: int | None) -> None:
        self._handle = handle

    def close(self) -> None:
        """Give it back."""
        handle, self._handle = self._handle, None
        if handle is not None:
            os.close(handle)


def _claim(folder: Path) -> _Claim:
    """Claim a run folder. Raises InputError when another process has it."""
    if os.name != "posix":
        return _Claim(None)
    import fcntl

    # On run.json, for a lock on the journal would disturb the locks of SQLite itself.
    handle = os.open(folder / "run.json", os.O_RDONLY)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError as why:
        os.close(handle)
        raise InputError(f"{folder}: another process is writing this run") from why
    except OSError:  # a file system without locks
        os.close(handle)
        return _Claim(None)
    return _Claim(handle)


def _connect(folder: Path, new: bool = False) -> sqlite3.Connection:
    """The journal for writing. Raises RunFailed when it is not there or is no journal."""
    path = (folder / "journal.sqlite").absolute()
    with _journal(folder):
        db = sqlite3.connect(f"{path.as_uri()}?mode={'rwc' if new else 'rw'}", uri=True)
        try:
            db.execute("PRAGMA journal_mode=WAL")
            db.execute("PRAGMA synchronous=FULL")
        except BaseException:
            db.close()
            raise
        return db


@contextmanager
def _journal(folder: Path) -> Iterator[None]:
    """An error of SQLite becomes a RunFailed that names the journal."""
    try:
        yield
    except sqlite3.Error as why:
        raise RunFailed(f"{folder / 'journal.sqlite'}: the journal failed: {why}") from why


@contextmanager
def _refusing(folder: Path) -> Iterator[None]:
    """An OSError while the folder is made: a full or broken disk failed, all else is bad input."""
    try:
        yield
    except OSError as why:
        kind = RunFailed if why.errno in (errno.ENOSPC, errno.EDQUOT, errno.EIO) else InputError
        raise kind(f"{folder}: cannot be made: {why.strerror}") from why


def require_same(
    run: Run,
    meta: dict[str, Any],
    protocol: bytes,
    pattern: dict[str, Any],
    with_versions: bool = True,
) -> None:
    """Refuse to go on with a run under other conditions than it was begun with.

    meta, protocol, pattern: as for `RunWriter.create`. Raises InputError naming the first thing
    that differs, its value in the folder and its value now.
    """
    given = json.loads(_json({**meta, "pattern": pattern}))
    stored = {**run.meta, "pattern": run.pattern}
    # What a user gave comes before what follows from it.
    for part in dict.fromkeys(("protocol", "seed", "rig", "sensor", "pattern", *given, *stored)):
        if part == "versions" and not with_versions:
            continue
        found = _difference(stored.get(part, _ABSENT), given.get(part, _ABSENT), part)
        if found is not None:
            key, was, now = found
            raise InputError(
                f"{run.folder}: cannot be resumed: {key}: {_short(was)} in the folder, "
                f"{_short(now)} now; a run ends under the conditions it was begun with"
            )
    kept = run.folder / "protocol.toml"
    try:
        before = kept.read_bytes()
    except OSError as why:
        raise InputError(f"{kept}: cannot be read: {why.strerror}") from why
    if before != protocol:
        was, now = (hashlib.sha256(text).hexdigest()[:12] for text in (before, protocol))
        raise InputError(
            f"{run.folder}: cannot be resumed: protocol.toml: SHA-256 {was} in the folder, {now} "
            f"now: the same values in another text; resume with {kept}"
        )


_ABSENT = object()


def _difference(a: Any, b: Any, at: str) -> tuple[str, Any, Any] | None:
    """The first place where two trees of plain data differ: its key and both values."""
    if at in _MAY_DIFFER:
        return None
    if isinstance(a, dict) and isinstance(b, dict):
        for key in sorted(a.keys() | b.keys()):
            found = _difference(a.get(key, _ABSENT), b.get(key, _ABSENT), f"{at}.{key}")
            if found is not None:
                return found
        return None
    return None if a == b else (at, a, b)


def _short(value: Any) -> str:
    if value is _ABSENT:
        return "nothing"
    text = json.dumps(value)
    return text if len(text) <= 60 else f"{text[:57]}..."


def _json(data: dict[str, Any]) -> bytes:
    return (json.dumps(data, indent=1, sort_keys=True) + "\n").encode()


@dataclass(frozen=True)
class Truth:
    """What a virtual rig knows exactly: the surface's displacement at every frame.

    Displacements are interpolated linearly between two solved knots, as the drawing camera does.
    """

    camera: Pinhole
    lattice: SurfaceLattice
    frames: dict[str, tuple[str, float]]  # frame id -> (knot key "press:a:b", fraction)
    folder: Path  # of the run

    def displacement_mm(self, frame_id: str) -> NDArray[np.float64]:
        """Surface displacement on the lattice, (ny, nx, 3).

        Raises RunFailed for a frame of a press that was cut off: truth is stored press by press.
        """
        if frame_id not in self.frames:
            raise RunFailed(
                f"{self.folder}: no truth of frame {frame_id}: its press was cut off; finish the "
                "run with --resume"
            )
        key, fraction = self.frames[frame_id]
        press, a, b = key.rsplit(":", 2)
        knots = self._knots(press)
        first = knots[int(a)].astype(float)
        return first + fraction * (knots[int(b)].astype(float) - first)

    def flow_px(self, frame_id: str) -> NDArray[np.float64]:
        """Projected displacement of every rest pixel, (h, w, 2) px."""
        camera = self.camera
        xs = camera.rest_mm(np.stack([np.arange(camera.width_px)] * 2, -1))[:, 0]
        ys = camera.rest_mm(np.stack([np.arange(camera.height_px)] * 2, -1))[:, 1]
        return self._project(
            self._grid(xs, ys)(self.displacement_mm(frame_id)), *np.meshgrid(xs, ys)
        )

    def in_plane_mm(self, frame_id: str) -> NDArray[np.float64]:
        """In-plane displacement of every rest pixel, (h, w, 2) mm: not what is projected."""
        camera = self.camera
        xs = camera.rest_mm(np.stack([np.arange(camera.width_px)] * 2, -1))[:, 0]
        ys = camera.rest_mm(np.stack([np.arange(camera.height_px)] * 2, -1))[:, 1]
        return self._grid(xs, ys)(self.displacement_mm(frame_id)[..., :2])

    def points_px(self, frame_id: str, xy_mm: NDArray[np.float64]) -> NDArray[np.float64]:
        """Projected displacement (n, 2) px of rest points (n, 2) mm."""
        sampler = LatticeSampler.make(self.lattice, xy_mm[:, 0], xy_mm[:, 1])
        moved = sampler.at_points(self.displacement_mm(frame_id))
        return self._project(moved, xy_mm[:, 0], xy_mm[:, 1])

    def _project(self, u_mm: NDArray[Any], x_mm: NDArray[Any], y_mm: NDArray[Any]) -> NDArray[Any]:
        rest = np.stack((x_mm, y_mm, np.zeros_like(x_mm)), axis=-1)
        return self.camera.project_px(rest + u_mm) - self.camera.project_px(rest)

    def _grid(self, xs: NDArray[Any], ys: NDArray[Any]) -> LatticeSampler:
        if "grid" not in self.__dict__:
            self.__dict__["grid"] = LatticeSampler.make(self.lattice, xs, ys)
        sampler: LatticeSampler = self.__dict__["grid"]
        return sampler

    def _knots(self, press: str) -> NDArray[np.float32]:
        held = self.__dict__.setdefault("held", {})
        if press not in held:
            held.clear()  # one press at a time: knots of a press fill some ten megabytes
            with _reading(truth_file(self.folder, press)) as data:
                held[press] = data["displacement_mm"]
        knots: NDArray[np.float32] = held[press]
        return knots


class Run:
    """A recorded run, read only."""

    def __init__(self, folder: Path):
        if not (folder / "run.json").is_file():
            what = "not a run folder (no run.json)" if folder.exists() else "no such folder"
            raise InputError(f"{folder}: {what}")
        self.folder = folder
        try:
            self.meta: dict[str, Any] = json.loads((folder / "run.json").read_text())
            self.pattern: dict[str, Any] = json.loads((folder / "pattern.json").read_text())
        except (OSError, ValueError) as why:
            raise InputError(f"{folder}: run.json or pattern.json cannot be read: {why}") from why
        found = self.meta.get("format") if isinstance(self.meta, dict) else None
        if found != FORMAT:
            raise InputError(f"{folder}/run.json: format: {found}, this version reads {FORMAT}")

    def frames(self) -> pd.DataFrame:
        """One row a frame, in order of capture; columns as in the journal."""
        return self._table("frames")

    def steps(self) -> pd.DataFrame:
        """One row a finished step."""
        return self._table("steps")

    @cached_property
    def camera(self) -> Pinhole:
        """The projection the images were taken with."""
        return Pinhole(**self.meta["camera"])

    @property
    def simulated(self) -> bool:
        """True when no hardware was involved."""
        return bool(self.meta["simulated"])

    def dots_mm(self) -> NDArray[np.float64]:
        """Centres of the pattern's dots at rest, (n, 2) mm; n = 0 without dots."""
        return np.asarray(self.pattern.get("dots_mm", []), dtype=float).reshape(-1, 2)

    def dot_diameter_mm(self) -> float:
        """Diameter of the pattern's dots."""
        return float(self.pattern["dot_diameter_mm"])

    def sessions(self) -> pd.DataFrame:
        """One row a session of writing: the first, then each resume and what it kept and redid."""
        return self._table("sessions")

    def image(self, file: str) -> NDArray[np.uint8]:
        """(h, w, 3) BGR of one frame.

        Raises RunFailed when it is missing, differs from its hash or does not decode.
        """
        import cv2

        path = self.folder / file
        try:
            data = path.read_bytes()
        except OSError as why:
            raise RunFailed(f"{path}: cannot be read: {why.strerror}") from why
        if hashlib.sha256(data).hexdigest() != self._hash_of(file):
            raise RunFailed(
                f"{path}: damaged: {len(data)} bytes that differ from the hash in the journal"
            )
        image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
        if image is None:
            raise RunFailed(f"{path}: does not decode as an image")
        return np.asarray(image, np.uint8)

    @property
    def finished(self) -> bool:
        """True when the run came to its end; False while it goes on or when it was cut off."""
        return (self.folder / "summary.json").is_file()

    def summary(self) -> dict[str, Any]:
        """What the run said of itself at its end; empty when it was cut off."""
        path = self.folder / "summary.json"
        try:
            data: dict[str, Any] = json.loads(path.read_text()) if self.finished else {}
        except (OSError, ValueError) as why:
            raise RunFailed(f"{path}: cannot be read: {why}") from why
        return data

    def truth(self) -> Truth | None:
        """The virtual rig's truth of all complete presses, None on a real run.

        Raises RunFailed when it is damaged.
        """
        index = lattice_file(self.folder)
        if not index.is_file():
            return None
        try:
            lattice = SurfaceLattice(**json.loads(index.read_text()))
        except (OSError, ValueError, TypeError) as why:
            raise RunFailed(f"{index}: cannot be read: {why}") from why
        frames: dict[str, tuple[str, float]] = {}
        for press in dict.fromkeys(self.frames()["press"]):
            path = truth_file(self.folder, press)
            if not path.is_file():
                continue
            with _reading(path) as data:
                rows = (data[name].tolist() for name in ("frame_id", "knots", "fraction"))
                for frame_id, (a, b), fraction in zip(*rows, strict=True):
                    frames[frame_id] = (f"{press}:{a}:{b}", fraction)
        return Truth(self.camera, lattice, frames, self.folder)

    def _hash_of(self, file: str) -> str | None:
        held: dict[str, str] = self.__dict__.setdefault("hashes", {})
        if file not in held:  # also a frame that came since, in a run that goes on
            with self._reader() as db:
                held.update(db.execute("SELECT file, sha256 FROM frames WHERE file IS NOT NULL"))
        return held.get(file)

    def _table(self, name: str) -> pd.DataFrame:
        import pandas as pd

        with self._reader() as db:
            try:
                return pd.read_sql_query(f"SELECT * FROM {name} ORDER BY seq", db)
            except pd.errors.DatabaseError as why:
                raise sqlite3.DatabaseError(str(why.__cause__ or why)) from why

    @contextmanager
    def _reader(self) -> Iterator[sqlite3.Connection]:
        """The journal, read only. Raises RunFailed when it cannot be read."""
        path = self.folder / "journal.sqlite"
        try:
            uri = f"{path.absolute().as_uri()}?mode=ro"
            with closing(sqlite3.connect(uri, uri=True)) as db:
                yield db
        except sqlite3.Error as why:
            raise RunFailed(f"{path}: the journal cannot be read: {why}") from why


@contextmanager
def _reading(path: Path) -> Iterator[Any]:
    """An npz of the truth. Raises RunFailed naming it when it is missing or damaged."""
    try:
        with np.load(path) as data:
            yield data
    except (OSError, ValueError, KeyError, zipfile.BadZipFile) as why:
        raise RunFailed(f"{path}: the truth cannot be read: {why}") from why


def open(folder: str | Path) -> Run:
    """Open a run folder. Raises InputError when it is none."""
    return Run(Path(folder))
