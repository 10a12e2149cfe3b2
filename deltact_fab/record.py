"""A run is a folder that survives: frozen inputs, an SQLite journal, images written whole.

RUN/run.json          name, seed, versions, rig, sensor, camera model, scene summary
RUN/protocol.toml     the protocol as it was given, byte for byte
RUN/pattern.json      recipe and dot centres as data
RUN/journal.sqlite    steps and frames (WAL, synchronous=FULL)
RUN/images/*.png      temporary file, fsync, rename
RUN/truth/            written by a virtual rig only; read through `Run.truth()` in analysis only
"""

from __future__ import annotations

import hashlib
import json
import os
import sqlite3
import time
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

FORMAT = 1
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
"""
WALL_COLUMNS = ("wall_s",)  # the only columns in which two equal runs may differ


def write_whole(path: Path, data: bytes) -> None:
    """Write a file so that it is there whole or not at all: temporary, fsync, rename.

    Raises RunFailed naming the file when the disk refuses.
    """
    temporary = path.with_name(f".{path.name}.part")
    try:
        with temporary.open("wb") as out:
            out.write(data)
            out.flush()
            os.fsync(out.fileno())
        temporary.replace(path)
    except OSError as why:
        temporary.unlink(missing_ok=True)
        raise RunFailed(f"{path}: cannot be written: {why.strerror}") from why


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
    """Writes one run. Every frame and every step is committed before the next one starts."""

    def __init__(
        self, folder: Path, meta: dict[str, Any], protocol: bytes, pattern: dict[str, Any]
    ):
        """Create the folder. Raises InputError when it is there, RunFailed on a bad disk."""
        if folder.exists():
            raise InputError(f"{folder}: already there; name a new --out folder")
        try:
            (folder / "images").mkdir(parents=True)
        except OSError as why:
            raise InputError(f"{folder}: cannot be made: {why.strerror}") from why
        self.folder = folder
        write_whole(folder / "protocol.toml", protocol)
        write_whole(folder / "pattern.json", _json(pattern))
        write_whole(folder / "run.json", _json({"format": FORMAT, **meta}))
        self._db = sqlite3.connect(folder / "journal.sqlite")
        self._db.execute("PRAGMA journal_mode=WAL")
        self._db.execute("PRAGMA synchronous=FULL")
        with self._db:
            self._db.executescript(_SCHEMA)
        self._frames = 0
        self._steps = 0

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
        frame_id = f"{step.id}#{k:03d}"
        file = digest = None
        if image is not None:
            data = encode_png(image)
            file = f"images/{frame_id.replace('/', '_').replace('#', '_')}.png"
            write_whole(self.folder / file, data)
            digest = hashlib.sha256(data).hexdigest()
        self._frames += 1
        row = (
            frame_id, self._frames, step.id, step.press, step.indenter, step.kind, k, file, digest,
            t_s, t_step_s, *position_mm, *(force_n or (None,) * 3), *(torque_nmm or (None,) * 3),
            time.time(),
        )  # fmt: skip
        self._insert("frames", row)
        return frame_id

    def step(self, step: Step, planned_s: float, t_start_s: float, t_end_s: float) -> None:
        """Journal a finished step."""
        self._steps += 1
        self._insert(
            "steps",
            (
                self._steps, step.id, step.press, step.indenter, step.kind, *step.target_mm,
                step.feed_mm_min, planned_s, t_start_s, t_end_s, time.time(),
            ),
        )  # fmt: skip

    def close(self, summary: dict[str, Any] | None = None) -> None:
        """Write the summary and fold the journal's log back into one file."""
        if summary is not None:
            write_whole(self.folder / "summary.json", _json(summary))
        self._db.execute("PRAGMA wal_checkpoint(TRUNCATE)")
        self._db.close()

    def _insert(self, table: str, row: tuple[Any, ...]) -> None:
        marks = ",".join("?" * len(row))
        try:
            with self._db:
                self._db.execute(f"INSERT INTO {table} VALUES ({marks})", row)
        except sqlite3.Error as why:
            raise RunFailed(f"{self.folder / 'journal.sqlite'}: {why}") from why


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
    folder: Path

    def displacement_mm(self, frame_id: str) -> NDArray[np.float64]:
        """Surface displacement on the lattice, (ny, nx, 3)."""
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
            with np.load(self.folder / f"{press.replace('/', '_')}.npz") as data:
                held[press] = data["displacement_mm"]
        knots: NDArray[np.float32] = held[press]
        return knots


class Run:
    """A recorded run, read only."""

    def __init__(self, folder: Path):
        if not (folder / "run.json").is_file():
            raise InputError(f"{folder}: not a run folder (no run.json)")
        self.folder = folder
        try:
            self.meta: dict[str, Any] = json.loads((folder / "run.json").read_text())
            self.pattern: dict[str, Any] = json.loads((folder / "pattern.json").read_text())
        except (OSError, ValueError) as why:
            raise InputError(f"{folder}: run.json or pattern.json cannot be read: {why}") from why
        if self.meta.get("format") != FORMAT:
            raise InputError(
                f"{folder}/run.json: format: {self.meta.get('format')}, this version reads {FORMAT}"
            )

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

    def image(self, file: str) -> NDArray[np.uint8]:
        """(h, w, 3) BGR of one frame. Raises RunFailed when it is missing or does not decode."""
        import cv2

        path = self.folder / file
        try:
            data = np.frombuffer(path.read_bytes(), np.uint8)
        except OSError as why:
            raise RunFailed(f"{path}: cannot be read: {why.strerror}") from why
        image = cv2.imdecode(data, cv2.IMREAD_COLOR) if data.size else None
        if image is None:
            raise RunFailed(f"{path}: does not decode as an image")
        return np.asarray(image, np.uint8)

    def summary(self) -> dict[str, Any]:
        """What the run said of itself at its end; empty when it was cut off."""
        path = self.folder / "summary.json"
        data: dict[str, Any] = json.loads(path.read_text()) if path.is_file() else {}
        return data

    def truth(self) -> Truth | None:
        """The virtual rig's truth, None on a real run."""
        index = self.folder / "truth" / "index.json"
        if not index.is_file():
            return None
        data = json.loads(index.read_text())
        frames = {key: (knots, float(w)) for key, (knots, w) in data["frames"].items()}
        return Truth(self.camera, SurfaceLattice(**data["lattice"]), frames, index.parent)

    def _table(self, name: str) -> pd.DataFrame:
        import pandas as pd

        path = self.folder / "journal.sqlite"
        try:
            with sqlite3.connect(f"file:{path}?mode=ro", uri=True) as db:
                return pd.read_sql_query(f"SELECT * FROM {name} ORDER BY seq", db)
        except (sqlite3.Error, pd.errors.DatabaseError) as why:
            raise RunFailed(f"{path}: the journal cannot be read: {why}") from why


def open(folder: str | Path) -> Run:
    """Open a run folder. Raises InputError when it is none."""
    return Run(Path(folder))
