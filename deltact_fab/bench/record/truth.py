"""What a virtual rig knows exactly of a run: the gel's surface at every frame."""

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
    """Exact knowledge of a virtual rig: the surface's displacement at every frame.

    Displacements are interpolated linearly between two solved knots, as the drawing camera does.
    Pixels are those of the record's camera, which is the calibrated one; what they see they see
    through the true lens.
    """

    camera: CameraModel
    lattice: SurfaceLattice
    frames: dict[str, tuple[str, int, int, float]]
    """Of a frame by its id: the press, the knots before and after it, how far it is between."""
    folder: Path  # of the run
    lens: Fisheye | None = None
    """What the frames were drawn through; None: through the record's camera itself."""
    tractions: bool = False
    """Whether `traction_mpa` and `face_mm` are known: the protocol asked for them."""

    def displacement_mm(self, frame_id: str) -> NDArray[np.float64]:
        """Surface displacement on the lattice, (ny, nx, 3).

        Raises RunFailed for a frame of a press that was cut off: truth is stored press by press.
        """
        return self._interpolated(frame_id, "displacement_mm")

    def traction_mpa(self, frame_id: str) -> NDArray[np.float64]:
        """What presses and shears the face, (ny, nx, 3) MPa per resting area, on `face_mm`.

        z is minus the pressure. A node holds the mean around it, weighted with its hat (1 at the
        node, 0 at its neighbours), so that trapezoids over the face give the force on the sensor.
        Raises RunFailed as `displacement_mm` does, and where the protocol did not ask for it.
        """
        return self._interpolated(frame_id, "traction_mpa")

    def face_mm(self, frame_id: str) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Nodes (nx,) and (ny,) along x and y of the whole face, where tractions are given."""
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
                f"{self.folder}: no truth of frame {frame_id}: its press was cut off; finish the "
                "run with --resume"
            )
        return self.frames[frame_id]

    def flow_px(self, frame_id: str) -> NDArray[np.float64]:
        """Projected displacement of what every pixel sees at rest, (h, w, 2) px."""
        return self._seen_face.motion(self.displacement_mm(frame_id))[0]

    def flow_and_in_plane(self, frame_id: str) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """`flow_px`, and the displacement in the plane, (h, w, 2) mm: not projected."""
        return self._seen_face.motion(self.displacement_mm(frame_id))

    def points_px(self, frame_id: str, xy_mm: NDArray[np.float64]) -> NDArray[np.float64]:
        """Projected displacement (n, 2) px of points of the resting face (n, 2) mm."""
        return self._seen_face.points_px(self.displacement_mm(frame_id), xy_mm)

    @cached_property
    def _seen_face(self) -> SeenFace:
        return SeenFace(self.camera, self.lattice, self.lens)

    def _press_arrays(self, press: str, name: str) -> dict[str, NDArray[Any]]:
        """The arrays of a press, `name` among them."""
        cached: dict[str, dict[str, NDArray[Any]]] = self.__dict__.setdefault("held", {})
        path = TruthFiles(self.folder).press(press)
        if press not in cached:
            cached.clear()  # one press at a time: knots of a press fill some ten megabytes
            with _reading(path) as data:
                cached[press] = {key: data[key] for key in data if key in TRUTH_ARRAYS}
        if name not in cached[press]:
            raise RunFailed(
                f"{path}: no {name}: the protocol's channels did not ask for 'traction'"
            )
        return cached[press]


def load_truth(
    folder: Path, camera: CameraModel, presses: Iterable[str], tractions: bool = False
) -> RunTruth:
    """The truth of all complete ones of these presses. Raises RunFailed when it is damaged."""
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
        raise RunFailed(f"{lens_file}: model: not a lens that a virtual rig draws through")
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
    """An npz of the truth. Raises RunFailed naming it when it is missing or damaged."""
    try:
        with np.load(path) as data:
            yield data
    except (OSError, ValueError, KeyError, zipfile.BadZipFile) as error:
        raise RunFailed(f"{path}: the truth cannot be read: {error}") from error
