"""What a virtual rig knows exactly of a run: the gel's surface at every frame."""

from __future__ import annotations

import json
import zipfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import RunFailed
from ..optics import LatticeSampler, Pinhole, SurfaceLattice
from .files import lattice_file, truth_file


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
        xs, ys = self._pixels_mm()
        return self._project(
            self._grid(xs, ys)(self.displacement_mm(frame_id)), *np.meshgrid(xs, ys)
        )

    def in_plane_mm(self, frame_id: str) -> NDArray[np.float64]:
        """In-plane displacement of every rest pixel, (h, w, 2) mm: not what is projected."""
        xs, ys = self._pixels_mm()
        return self._grid(xs, ys)(self.displacement_mm(frame_id)[..., :2])

    def points_px(self, frame_id: str, xy_mm: NDArray[np.float64]) -> NDArray[np.float64]:
        """Projected displacement (n, 2) px of rest points (n, 2) mm."""
        sampler = LatticeSampler.make(self.lattice, xy_mm[:, 0], xy_mm[:, 1])
        moved = sampler.at_points(self.displacement_mm(frame_id))
        return self._project(moved, xy_mm[:, 0], xy_mm[:, 1])

    def _pixels_mm(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Columns and rows of the image on the resting face: x (w,) and y (h,) mm."""
        camera = self.camera
        xs = camera.rest_mm(np.stack([np.arange(camera.width_px)] * 2, -1))[:, 0]
        ys = camera.rest_mm(np.stack([np.arange(camera.height_px)] * 2, -1))[:, 1]
        return xs, ys

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


def load(folder: Path, camera: Pinhole, presses: Iterable[str]) -> Truth:
    """The truth of all complete ones of these presses. Raises RunFailed when it is damaged."""
    index = lattice_file(folder)
    try:
        lattice = SurfaceLattice(**json.loads(index.read_text()))
    except (OSError, ValueError, TypeError) as why:
        raise RunFailed(f"{index}: cannot be read: {why}") from why
    frames: dict[str, tuple[str, float]] = {}
    for press in presses:
        path = truth_file(folder, press)
        if not path.is_file():
            continue
        with _reading(path) as data:
            rows = (data[name].tolist() for name in ("frame_id", "knots", "fraction"))
            for frame_id, (a, b), fraction in zip(*rows, strict=True):
                frames[frame_id] = (f"{press}:{a}:{b}", fraction)
    return Truth(camera, lattice, frames, folder)


@contextmanager
def _reading(path: Path) -> Iterator[Any]:
    """An npz of the truth. Raises RunFailed naming it when it is missing or damaged."""
    try:
        with np.load(path) as data:
            yield data
    except (OSError, ValueError, KeyError, zipfile.BadZipFile) as why:
        raise RunFailed(f"{path}: the truth cannot be read: {why}") from why
