"""Ground truth of a virtual rig: the gel's surface at every frame."""

from __future__ import annotations

import os
import zipfile
import zlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from tokenize import TokenError
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from deltact_fab.common import InputError, RunFailed, validate
from deltact_fab.sensor import (
    CameraModel,
    Fisheye,
    Pinhole,
    Rectified,
    SeenFace,
    SurfaceLattice,
    restore_camera,
)

from .files import LATTICE_FILE, LENS_FILE, SENSOR_FILE, read_record, truth_file
from .folder import MAX_RUN_FILE_BYTES, UnsafeFile, has_file, open_file

ARRAY_ERRORS = (
    OSError, ValueError, KeyError, EOFError, RuntimeError, SyntaxError, TokenError, MemoryError,
    zipfile.BadZipFile, zlib.error,
)  # fmt: skip
"""Errors of numpy and zipfile for a damaged archive of arrays."""
_MAX_DIRECTORY_BYTES = 1 << 16  # by hand: a directory of twenty arrays takes 1 kB
TRUTH_ARRAYS = ("displacement_mm", "traction_mpa", "x_mm", "y_mm")


@dataclass(frozen=True)
class RunTruth:
    """Ground truth of a virtual rig: surface displacement at every frame.

    Displacements are interpolated linearly between two solved knots, as in rendering. Pixels are
    those of the recorded, calibrated camera; rays follow the true one.
    """

    camera: CameraModel
    lattice: SurfaceLattice
    frames: dict[str, tuple[str, int, int, float]]
    """Press, knots before and after, and fraction between them, by frame id."""
    folder: Path  # run folder
    lens: Fisheye | Pinhole | None = None
    """Camera of the rendering; None: the recorded camera itself."""
    tractions: bool = False
    """True if `traction_mpa` and `face_mm` are stored (protocol channel 'traction')."""

    @property
    def sensor(self) -> int | None:
        """Number of the sensor of a population; None for the nominal one, or one equal to it."""
        if not has_file(self.folder, SENSOR_FILE):
            return None
        data = read_record(self.folder, SENSOR_FILE)
        unlike = [v for v in data.get("deviations", {}).values() if v not in (0.0, 1.0, [0.0, 0.0])]
        return data.get("number") if unlike else None

    file: ClassVar = staticmethod(truth_file)
    """Path of the truth of a press within its run."""

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
        file = truth_file(press)
        if press not in cached:
            cached.clear()  # one press at a time: some ten megabytes
            with _reading(self.folder, file) as data:
                cached[press] = {key: data[key] for key in data if key in TRUTH_ARRAYS}
        if name not in cached[press]:
            raise RunFailed(
                f"{self.folder / file}: no {name}: the protocol has no channel 'traction'"
            )
        return cached[press]


def load_truth(
    folder: Path, camera: CameraModel, presses: Mapping[str, int], tractions: bool = False
) -> RunTruth:
    """Load the truth of the complete presses among these. Raises RunFailed if damaged.

    presses: number of frames by name; a truth of more frames is of another press.
    """
    index, lens_file, lens = folder / LATTICE_FILE, folder / LENS_FILE, None
    try:
        lattice = validate(SurfaceLattice, read_record(folder, LATTICE_FILE), str(index))
        if isinstance(camera, Rectified) or has_file(folder, LENS_FILE):
            lens = restore_camera(read_record(folder, LENS_FILE), str(lens_file), true=True)
    except UnsafeFile:
        raise
    except InputError as error:
        raise RunFailed(str(error)) from error
    expected = Fisheye if isinstance(camera, Rectified) else Pinhole
    if lens is not None and not isinstance(lens, expected):
        raise RunFailed(f"{lens_file}: model: not a camera of this virtual rig")
    frames: dict[str, tuple[str, int, int, float]] = {}
    for press, count in presses.items():
        if not has_file(folder, truth_file(press)):
            continue
        with _reading(folder, truth_file(press)) as data:
            if len(data["frame_id"]) > count:
                raise ValueError(f"{len(data['frame_id'])} frames, {count} in the journal")
            rows = (data[name].tolist() for name in ("frame_id", "knots", "fraction"))
            for frame_id, (a, b), fraction in zip(*rows, strict=True):
                frames[frame_id] = (press, a, b, fraction)
    return RunTruth(camera, lattice, frames, folder, lens, tractions)


@contextmanager
def _reading(folder: Path, name: str) -> Iterator[Any]:
    """Open an npz of the truth. Raises RunFailed naming it if missing or damaged."""
    try:
        with open_arrays(folder, name) as data:
            yield data
    except ARRAY_ERRORS as error:
        raise RunFailed(f"{folder / name}: the truth cannot be read: {error}") from error


@contextmanager
def open_arrays(folder: Path, name: str) -> Iterator[Any]:
    """Open the arrays of an npz below a run folder, by their names; `zip`: the archive.

    Raises UnsafeFile for one that unpacks to more than an npz may have, ARRAY_ERRORS if damaged.
    """
    with open_file(folder, name) as file:
        # Before zipfile reads the directory: format .ZIP 4.3.16, without comment and not ZIP64.
        head = file.read(4)
        file.seek(-min(file.seek(0, os.SEEK_END), 42), os.SEEK_END)
        tail = file.read()
        size = int.from_bytes(tail[-10:-6], "little")
        marks = head, tail[-22:-18], tail[:4] == b"PK\6\7"
        if marks != (b"PK\3\4", b"PK\5\6", False) or size > _MAX_DIRECTORY_BYTES:
            raise zipfile.BadZipFile("not an archive of arrays")
        file.seek(0)
        with np.load(file, allow_pickle=False) as data:
            # zipfile unpacks no more than a member states, and knows methods that take more.
            members, limit = data.zip.infolist(), MAX_RUN_FILE_BYTES[".npz"]
            size = sum(member.file_size for member in members)
            methods = {member.compress_type for member in members}
            if size > limit or methods - {zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED}:
                text = f"unpacks to {size >> 20} MiB; must be at most {limit >> 20} MiB, deflated"
                raise UnsafeFile(f"{folder / name}: {text}")
            yield data
