"""Ground truth of a virtual rig: the gel's surface at every frame."""

from __future__ import annotations

import zipfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deltact_fab.common import InputError, RunFailed, read_json, validate
from deltact_fab.sensor import (
    CameraModel,
    Fisheye,
    Rectified,
    SeenFace,
    SurfaceLattice,
    restore_camera,
)

from .files import TruthFiles

TRUTH_ARRAYS = ("displacement_mm", "traction_mpa", "x_mm", "y_mm")


@dataclass(frozen=True)
class RunTruth:
    """Ground truth of a virtual rig: surface displacement at every frame.

    Displacements are interpolated linearly between two solved knots, as in rendering. Pixels are
    those of the recorded, calibrated camera; rays follow the true lens.
    """

    camera: CameraModel
    lattice: SurfaceLattice
    frames: dict[str, tuple[str, int, int, float]]
    """Press, knots before and after, and fraction between them, by frame id."""
    folder: Path  # run folder
    lens: Fisheye | None = None
    """Lens of the rendering; None: the recorded camera itself."""
    tractions: bool = False
    """True if `traction_mpa` and `face_mm` are stored (protocol channel 'traction')."""

    def displacement_mm(self, frame_id: str) -> NDArray[np.float64]:
        """Surface displacement on the lattice, (ny, nx, 3).

        Raises RunFailed for a frame of an interrupted press: truth is stored press by press.
        """
        return self._interpolated(frame_id, "displacement_mm")

    def traction_mpa(self, frame_id: str) -> NDArray[np.float64]:
        """Traction on the face (ny, nx, 3) MPa per resting area, on the nodes `face_mm`.

        z is minus the pressure. A node holds the mean weighted with its hat function, so the
        trapezoidal rule over the face gives the force on the sensor. Raises RunFailed as
        `displacement_mm` does, and if the protocol has no channel 'traction'.
        """
        return self._interpolated(frame_id, "traction_mpa")

    def face_mm(self, frame_id: str) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Nodes (nx,) and (ny,) along x and y of the face, for tractions."""
        arrays = self._press_arrays(self._place(frame_id)[0], "traction_mpa")
        return arrays["x_mm"], arrays["y_mm"]

    def _interpolated(self, frame_id: str, name: str) -> NDArray[np.float64]:
        press, a, b, fraction = self._place(frame_id)
        knots = self._press_arrays(press, name)[name]
        first = knots[a].astype(float)
        return np.asarray(first + fraction * (knots[b].astype(float) - first))

    def _place(self, frame_id: str) -> tuple[str, int, int, float]:
        if frame_id not in self.frames:
            raise RunFailed(
                f"{self.folder}: no truth for frame {frame_id}: its press is incomplete; finish "
                "the run with --resume"
            )
        return self.frames[frame_id]

    def flow_px(self, frame_id: str) -> NDArray[np.float64]:
        """Projected displacement (h, w, 2) px of the face point that each pixel sees at rest."""
        return self._seen_face.motion(self.displacement_mm(frame_id))[0]

    def flow_and_in_plane(self, frame_id: str) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """`flow_px`, and the in-plane displacement (h, w, 2) mm, not projected."""
        return self._seen_face.motion(self.displacement_mm(frame_id))

    def points_px(self, frame_id: str, xy_mm: NDArray[np.float64]) -> NDArray[np.float64]:
        """Projected displacement (n, 2) px of points of the resting face (n, 2) mm."""
        return self._seen_face.points_px(self.displacement_mm(frame_id), xy_mm)

    @cached_property
    def _seen_face(self) -> SeenFace:
        return SeenFace(self.camera, self.lattice, self.lens)

    def _press_arrays(self, press: str, name: str) -> dict[str, NDArray[Any]]:
        """Arrays of a press; requires `name`."""
        cached: dict[str, dict[str, NDArray[Any]]] = self.__dict__.setdefault("held", {})
        path = TruthFiles(self.folder).press(press)
        if press not in cached:
            cached.clear()  # one press at a time: some ten megabytes
            with _reading(path) as data:
                cached[press] = {key: data[key] for key in data if key in TRUTH_ARRAYS}
        if name not in cached[press]:
            raise RunFailed(f"{path}: no {name}: the protocol has no channel 'traction'")
        return cached[press]


def load_truth(
    folder: Path, camera: CameraModel, presses: Iterable[str], tractions: bool = False
) -> RunTruth:
    """Load the truth of the complete presses among these. Raises RunFailed if damaged."""
    files = TruthFiles(folder)
    index, lens_file = files.lattice, files.lens
    lens = None
    try:
        lattice = validate(SurfaceLattice, read_json(index), str(index))
        if isinstance(camera, Rectified):
            lens = restore_camera(read_json(lens_file), str(lens_file))
    except InputError as error:
        raise RunFailed(str(error)) from error
    if not isinstance(lens, Fisheye | None):
        raise RunFailed(f"{lens_file}: model: not a lens of a virtual rig")
    frames: dict[str, tuple[str, int, int, float]] = {}
    for press in presses:
        path = files.press(press)
        if not path.is_file():
            continue
        with _reading(path) as data:
            rows = (data[name].tolist() for name in ("frame_id", "knots", "fraction"))
            for frame_id, (a, b), fraction in zip(*rows, strict=True):
                frames[frame_id] = (press, a, b, fraction)
    return RunTruth(camera, lattice, frames, folder, lens, tractions)


@contextmanager
def _reading(path: Path) -> Iterator[Any]:
    """Open an npz of the truth. Raises RunFailed naming it if missing or damaged."""
    try:
        with np.load(path) as data:
            yield data
    except (OSError, ValueError, KeyError, zipfile.BadZipFile) as error:
        raise RunFailed(f"{path}: the truth cannot be read: {error}") from error
