"""Reading a run: its tables, images and, on a virtual rig, its truth."""

from __future__ import annotations

import hashlib
import json
import sqlite3
import zipfile
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError, RunFailed
from ..optics import CameraModel, LatticeSampler, SurfaceLattice, camera_from_dict
from .files import FORMAT, lattice_file, truth_file

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True)
class Truth:
    """What a virtual rig knows exactly: the surface's displacement at every frame.

    Displacements are interpolated linearly between two solved knots, as the drawing camera does.
    """

    camera: CameraModel
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
        xs, ys = self.camera.axes_mm()
        return self._project(
            self._grid(xs, ys)(self.displacement_mm(frame_id)), *np.meshgrid(xs, ys)
        )

    def in_plane_mm(self, frame_id: str) -> NDArray[np.float64]:
        """In-plane displacement of every rest pixel, (h, w, 2) mm: not what is projected."""
        xs, ys = self.camera.axes_mm()
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
    def camera(self) -> CameraModel:
        """The projection the images were taken with. Raises InputError when none took any."""
        stored = self.meta["camera"]
        if stored is None:
            raise InputError(f"{self.folder}: recorded without a camera")
        return camera_from_dict(stored, f"{self.folder}/run.json: camera")

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
