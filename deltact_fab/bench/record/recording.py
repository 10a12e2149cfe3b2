"""A recording made elsewhere, as its TOML file tells it: images, times, force and pose.

What the file does not say is not known; nothing is guessed.
"""

from __future__ import annotations

import io
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from deltact_fab.common import Array, InputError, Table, did_you_mean, read_text

from .streams import FORCE_COLUMNS, POSE_COLUMNS

_UNIT_FACTORS = {
    "s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "N": 1.0, "mN": 1e-3, "N mm": 1.0, "N m": 1e3,
    "mm": 1.0, "m": 1e3,
}  # fmt: skip
"""Of s, N, N mm and mm."""
_MAX_CSV_BYTES = 2**30
"""Of a CSV file: eight columns at 1 kHz for four hours."""
_MAX_TIME_S = 1e11
"""Of a time; in seconds since 1970 it is the year 5138."""
_Name = Annotated[str, Field(min_length=1, max_length=1000)]
_Share = Annotated[float, Field(ge=-1, le=1)]
_Row = tuple[_Share, _Share, _Share]
Samples = tuple[Array, dict[str, Array]]
"""Times (n,) on the images' clock, s, and columns by name, in N, N mm and mm."""


class Times(Table):
    """A CSV file with a line of names, and its column of times; all files have one clock."""

    file: _Name
    time: _Name
    """The column of times, which never go back."""
    time_unit: Literal["s", "ms", "us", "ns"] = "s"


class RecordedForce(Times):
    """What a force sensor said. It becomes the force on the sensor, in the axes of its face."""

    columns: dict[Literal["fx", "fy", "fz", "tx", "ty", "tz"], _Name]
    """The column of each component; one that is left out was not measured."""
    force_unit: Literal["N", "mN"]
    torque_unit: Literal["N mm", "N m"] | None = None
    acts_on: Literal["sensor", "indenter"]
    """What the numbers are the force on: a press has fz < 0 on the sensor, > 0 on the indenter."""
    rotation: tuple[_Row, _Row, _Row] | None = None
    """Rows of the matrix that turns the force sensor's axes into those of the face: x and y along
    its sides as the camera sees them, z out of it. Without it they are taken to be the same."""
    lag_s: Annotated[float, Field(ge=-3600, le=3600)] = 0.0
    """How much later than an image the force of the same moment is stamped; it is taken off."""

    @model_validator(mode="after")
    def _complete(self) -> Self:
        forces, torques = ([n for n in self.columns if n[0] == kind] for kind in "ft")
        if not forces:
            raise ValueError('columns: at least one of fx, fy, fz is needed, as in fz = "Fz"')
        if torques and self.torque_unit is None:
            raise ValueError('torque_unit: missing key; valid: "N mm", "N m"')
        if self.rotation is None:
            return self
        if part := next((part for part in (forces, torques) if len(part) in (1, 2)), None):
            raise ValueError(f"rotation: turns three components; columns has only {part}")
        matrix = np.array(self.rotation)
        if not np.allclose(matrix @ matrix.T, np.eye(3), atol=2e-3):
            raise ValueError("rotation: is none: rows of length 1 at right angles are needed")
        if np.linalg.det(matrix) < 0:
            raise ValueError("rotation: is a mirror: its determinant is -1, and 1 is needed")
        return self


class RecordedPose(Times):
    """Where the tip of what pressed was, in the frame of the face; z = 0 is the resting face."""

    columns: Annotated[dict[Literal["x", "y", "z"], _Name], Field(min_length=3)]
    unit: Literal["mm", "m"]


class Recording(Table):
    """One recording. Paths count from its file."""

    images: _Name
    """A folder of images in order of their names, or a video."""
    rate_hz: Annotated[float, Field(ge=0.001, le=100_000)] | None = None
    """Of images without [times], evenly; a video has a rate of its own."""
    times: Times | None = None
    """A row an image."""
    force: RecordedForce | None = None
    pose: RecordedPose | None = None
    description: str = ""
    camera: _Name | None = None
    """A camera file, as `calibrate lens` writes it; needs design."""
    design: _Name | None = None
    """The sensor's design: a name of `cad list designs` or a path."""
    serial: Annotated[str, Field(min_length=1, max_length=64)] | None = None

    @model_validator(mode="after")
    def _together(self) -> Self:
        if self.rate_hz and self.times:
            raise ValueError("rate_hz: [times] says when images were taken; remove one of them")
        if self.camera and not self.design:
            raise ValueError("camera: needs design too, whose face it looks at")
        return self

    def unknown(self) -> list[str]:
        """What nobody said, a phrase each."""
        phrases = {
            "camera (flow is in pixels, no depth)": self.camera,
            "design": self.design,
            "serial number": self.serial,
            "pose of what pressed": self.pose,
            "force": self.force,
            "axes of the force sensor (taken as the face's)": not self.force or self.force.rotation,
            "the point that torque is about": not self.force or not self.force.torque_unit,
        }
        always = ("indenter", "pattern", "protocol", "presses", "which images are at rest", "rig")
        return [*(words for words, value in phrases.items() if not value), *always]


def read_force(force: RecordedForce, folder: Path) -> Samples:
    """Force and torque on the sensor, FORCE_COLUMNS, nan where not measured. Raises InputError."""
    t_s, values = read_csv(force, folder, force.columns)
    nothing = np.full(len(t_s), np.nan)
    three, torque = ([values.get(part + axis, nothing) for axis in "xyz"] for part in "ft")
    six = np.array([*three, *torque])
    if force.rotation is not None:
        six = np.concatenate([np.array(force.rotation) @ part for part in (six[:3], six[3:])])
    six[:3] *= _UNIT_FACTORS[force.force_unit]
    six[3:] *= _UNIT_FACTORS[force.torque_unit or "N mm"]
    six *= 1 if force.acts_on == "sensor" else -1
    return t_s - force.lag_s, dict(zip(FORCE_COLUMNS, six, strict=True))


def read_pose(pose: RecordedPose, folder: Path) -> Samples:
    """Places of the tip, POSE_COLUMNS. Raises InputError."""
    t_s, values = read_csv(pose, folder, pose.columns)
    return t_s, {name: _UNIT_FACTORS[pose.unit] * values[name[0]] for name in POSE_COLUMNS}


def read_csv(times: Times, folder: Path, names: Mapping[Any, str], rising: bool = False) -> Samples:
    """Times and columns of a CSV file, by key, as they stand there. rising: no time stands twice.

    Raises InputError naming file, line and value.
    """
    import pandas as pd

    path = folder / times.file
    try:
        table = pd.read_csv(io.StringIO(read_text(path, _MAX_CSV_BYTES)), skip_blank_lines=False)
    except ValueError as error:
        raise InputError(f"{path}: not a CSV file with a line of names: {error}") from error
    table.columns = table.columns.str.strip()
    arrays = {}
    for key, name in {"time": times.time, **names}.items():
        if name not in table:
            near = did_you_mean(name, table.columns)
            raise InputError(f"{path}: {key} = {name!r}: no such column; {near}")
        values = pd.to_numeric(table[name], errors="coerce").to_numpy(float)
        for k in np.flatnonzero(~np.isfinite(values)):
            text = table[name].iloc[k]
            raise InputError(f"{path}: line {k + 2}: {name} = {text!r}: not a finite number")
        arrays[key] = values
    t_s = arrays.pop("time") * _UNIT_FACTORS[times.time_unit]
    if not len(t_s) or np.abs(t_s).max() > _MAX_TIME_S:
        size = f"up to {np.abs(t_s).max():.1e} s; is it time_unit = 'ns'?" if len(t_s) else "no row"
        raise InputError(f"{path}: {times.time}: {size}")
    for k in np.flatnonzero(np.diff(t_s) <= 0 if rising else np.diff(t_s) < 0):
        earlier, later = table[times.time].iloc[k : k + 2]
        raise InputError(
            f"{path}: line {k + 3}: {times.time} = {later} after {earlier}: times must go on"
        )
    return t_s, arrays
