"""TOML file of a recording made elsewhere: images, times, force and pose.

Missing keys stay unknown; nothing is guessed.
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
"""Factors to s, N, N mm and mm, by definition."""
_MAX_CSV_BYTES = 2**30
"""Largest CSV file, by hand: eight columns at 1 kHz for four hours; bounds the memory."""
_MAX_TIME_S = 1e11
"""Latest time, by hand: as seconds since 1970, the year 5138."""
_Name = Annotated[str, Field(min_length=1, max_length=1000)]
_Share = Annotated[float, Field(ge=-1, le=1)]
_Row = tuple[_Share, _Share, _Share]
Samples = tuple[Array, dict[str, Array]]
"""Times (n,) on the images' clock, s, and columns (n,) by name, in N, N mm and mm."""


class Times(Table):
    """CSV file with a header line, and its time column; all files share one clock."""

    file: _Name
    time: _Name
    """Column of times, non-decreasing."""
    time_unit: Literal["s", "ms", "us", "ns"] = "s"


class RecordedForce(Times):
    """Data of a force sensor, converted to the force on the sensor in the axes of its face."""

    columns: dict[Literal["fx", "fy", "fz", "tx", "ty", "tz"], _Name]
    """Column of each component; omitted ones were not measured."""
    force_unit: Literal["N", "mN"]
    torque_unit: Literal["N mm", "N m"] | None = None
    acts_on: Literal["sensor", "indenter"]
    """Body on which the force acts: in a press, fz < 0 on the sensor, > 0 on the indenter."""
    rotation: tuple[_Row, _Row, _Row] | None = None
    """Rows of the rotation matrix from the force sensor's axes to those of the face: x and y along
    its sides as the camera sees them, z outwards. Default: same axes."""
    lag_s: Annotated[float, Field(ge=-3600, le=3600)] = 0.0
    """Lag of the force timestamps behind the images; it is subtracted."""

    @model_validator(mode="after")
    def _check_components(self) -> Self:
        forces, torques = ([n for n in self.columns if n[0] == kind] for kind in "ft")
        if not forces:
            raise ValueError('columns: at least one of fx, fy, fz is needed, as in fz = "Fz"')
        if torques and self.torque_unit is None:
            raise ValueError('torque_unit: missing key; valid: "N mm", "N m"')
        if self.rotation is None:
            return self
        if part := next((part for part in (forces, torques) if len(part) in (1, 2)), None):
            raise ValueError(f"rotation: needs three components; columns has only {part}")
        matrix = np.array(self.rotation)
        if not np.allclose(matrix @ matrix.T, np.eye(3), atol=2e-3):
            raise ValueError("rotation: not a rotation matrix: rows must be orthonormal")
        if np.linalg.det(matrix) < 0:
            raise ValueError("rotation: a reflection: determinant -1, must be 1")
        return self


class RecordedPose(Times):
    """Position of the indenter's tip in the frame of the face; z = 0 is the resting face."""

    columns: Annotated[dict[Literal["x", "y", "z"], _Name], Field(min_length=3)]
    unit: Literal["mm", "m"]


class Recording(Table):
    """One recording. Paths are relative to its file."""

    images: _Name
    """A folder of images in order of their names, or a video."""
    rate_hz: Annotated[float, Field(ge=0.001, le=100_000)] | None = None
    """Frame rate of evenly spaced images without [times]; default for a video: its own rate."""
    times: Times | None = None
    """One row per image."""
    force: RecordedForce | None = None
    pose: RecordedPose | None = None
    description: str = ""
    camera: _Name | None = None
    """A camera file, as `calibrate lens` writes it; needs design."""
    design: _Name | None = None
    """Design of the sensor: a name of `cad list designs` or a path."""
    serial: Annotated[str, Field(min_length=1, max_length=64)] | None = None

    @model_validator(mode="after")
    def _check_keys(self) -> Self:
        if self.rate_hz and self.times:
            raise ValueError("rate_hz: [times] has the times of the images; remove one of them")
        if self.camera and not self.design:
            raise ValueError("camera: needs design too")
        return self

    def unknown(self) -> list[str]:
        """List the unknown values, one phrase each."""
        phrases = {
            "camera (flow is in pixels, no depth)": self.camera,
            "design": self.design,
            "serial number": self.serial,
            "pose of the indenter": self.pose,
            "force": self.force,
            "axes of the force sensor (taken as the face's)": not self.force or self.force.rotation,
            "reference point of the torque": not self.force or not self.force.torque_unit,
        }
        always = ("indenter", "pattern", "protocol", "presses", "images at rest", "rig")
        return [*(words for words, value in phrases.items() if not value), *always]


def read_force(force: RecordedForce, folder: Path) -> Samples:
    """Force and torque on the sensor, FORCE_COLUMNS, nan if not measured. Raises InputError."""
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
    """Positions of the tip, POSE_COLUMNS. Raises InputError."""
    t_s, values = read_csv(pose, folder, pose.columns)
    return t_s, {name: _UNIT_FACTORS[pose.unit] * values[name[0]] for name in POSE_COLUMNS}


def read_csv(times: Times, folder: Path, names: Mapping[Any, str], rising: bool = False) -> Samples:
    """Read times and columns of a CSV file by key, unconverted. rising: times strictly increase.

    Raises InputError naming file, line and value.
    """
    import pandas as pd

    path = folder / times.file
    try:
        table = pd.read_csv(io.StringIO(read_text(path, _MAX_CSV_BYTES)), skip_blank_lines=False)
    except ValueError as error:
        raise InputError(f"{path}: not a CSV file with a header line: {error}") from error
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
        order = f"{later} after {earlier}: times must increase"
        raise InputError(f"{path}: line {k + 3}: {times.time} = {order}")
    return t_s, arrays
