"""Measurement of a recorded run: shape and contacts at the deepest presses, and force.

Each press is tracked from its own first image, as by `measure`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pandas as pd

from deltact_fab.bench import Run
from deltact_fab.common import Array, InputError, Progress

from ..measure.force.calibration import ForceCalibration, load_force
from ..measure.pipeline.measurement import Measurement
from ..measure.pipeline.outputs import MeasurementResult
from ..measure.sensor_id import CalibrationKind, read_calibration, require_same_sensor
from .flows import MAP_EVERY_PX
from .runs import sensor_of, view_of_run

MAX_FORCE_FRAMES = 1000
"""Longest run whose force is measured in all frames; of a longer one, or without a calibration of
force, only each indenter's deepest press is measured. By hand: more take minutes."""


@dataclass(frozen=True)
class DeepestPress:
    """The end of an indenter's deepest press. depth_mm: of its tip, by the stage."""

    indenter: str
    frame_id: str
    depth_mm: float
    result: MeasurementResult


@dataclass(frozen=True)
class ForceComparison:
    """Estimated force at frames of a run, compared with the force sensor.

    frames: their rows of the run's table, with fx_n_est to fz_n_est, extrapolated, trusted.
    features: of the model. fitted_to_run: the model was fitted to this run. rms_n: errors in x, y
    and z over the frames with a sensor reading; None without one.
    """

    frames: pd.DataFrame
    features: str
    fitted_to_run: bool
    rms_n: tuple[float, float, float] | None

    @property
    def doubtful(self) -> bool:
        """True if it is no independent test, or frames are extrapolated."""
        return self.fitted_to_run or self.rms_n is None or bool(self.frames["extrapolated"].any())

    @property
    def line(self) -> str:
        n, n_extrapolated = len(self.frames), int(self.frames["extrapolated"].sum())
        text = f"Force from the flow by {self.features!r}, {n} frames: "
        if self.rms_n is None:
            return text + "no force sensor data to compare with"
        x, y, z = self.rms_n
        text += f"RMS error {z:.2f} N normal, {x:.2f} and {y:.2f} N shear"
        if self.fitted_to_run:
            text += "; not a test: the calibration was fitted to this run"
        if n_extrapolated:
            text += f"; {n_extrapolated} frames extrapolated"
        return text


@dataclass(frozen=True)
class RunMeasurement:
    """Shape and force measured in a run; left_out: one line per thing not measured, and why."""

    FORCE_COLUMNS: ClassVar = ("fx_n", "fy_n", "fz_n")

    deepest: list[DeepestPress]
    force: ForceComparison | None
    left_out: list[str]


def find_calibrations(run: Run, files: Sequence[Path] = ()) -> list[Path]:
    """Find calibrations of force and depth: these files, else those in RUN/analysis.

    Raises InputError, one line, for a file that is no calibration or another sensor's.
    """
    defaults = (run.folder / "analysis" / name for name in ("calibration.toml", "depth.toml"))
    chosen = list(files) or [file for file in defaults if file.is_file()]
    for file in chosen:
        require_same_sensor(read_calibration(file)[0], sensor_of(run), str(file))
    return chosen


def measure_run(
    run: Run, calibrations: Sequence[Path] = (), progress: Progress | None = None
) -> RunMeasurement:
    """Measure a run that has images. Raises as `Measurement` and `Run.image` do."""
    import cv2

    cv2.setNumThreads(1)  # the flow depends on their number
    frames = run.frames().dropna(subset=["file"])
    if frames.empty:
        raise InputError(f"{run.folder}: a run without images")
    view = view_of_run(run)
    measurement = Measurement(view, None, calibrations, spacing_px=MAP_EVERY_PX)
    heads = {read_calibration(file)[0].kind: file for file in calibrations}
    last = frames[frames["kind"] == "press"].groupby("step_id", sort=False).tail(1)
    last = last.dropna(subset="z_mm")  # no depth is known under a weight
    ends = last.loc[last.groupby("indenter", sort=False)["z_mm"].idxmin()]
    all_frames = "force" in heads and len(frames) <= MAX_FORCE_FRAMES
    followed = frames if all_frames else frames[frames["press"].isin(ends["press"])]
    deepest, forces, count = [], [], 0
    for press, part in followed.groupby("press", sort=False):
        measurement.reset()
        for row in part.itertuples():
            result = measurement.update(run.image(str(row.file)))
            if result.force is not None:
                forces.append((*result.force.force_n, result.extrapolated, result.trusted))
            count += 1
            if row.frame_id in set(ends["frame_id"]):
                z_mm: Any = row.z_mm
                deepest.append(
                    DeepestPress(str(row.indenter), str(row.frame_id), -float(z_mm), result)
                )
            if progress is not None:
                progress(count, len(followed), str(press))
    force = None
    if "force" in heads:
        force = compare_with_sensor(run, load_force(heads["force"]), followed, np.array(forces))
    left_out = _notes(set(heads), bool(deepest), len(frames) - len(followed))
    return RunMeasurement(deepest, force, left_out)


def compare_with_sensor(
    run: Run, force: ForceCalibration, followed: pd.DataFrame, estimated: Array
) -> ForceComparison:
    """Compare estimated forces with the force sensor's readings, where there are any."""
    columns = [f"{name}_est" for name in RunMeasurement.FORCE_COLUMNS]
    table = followed.assign(
        **dict(zip(columns, estimated.T[:3], strict=True)),
        extrapolated=estimated[:, 3] > 0,
        trusted=estimated[:, 4] > 0,
    )
    residual = estimated[:, :3] - table[list(RunMeasurement.FORCE_COLUMNS)].to_numpy(float)
    residual = residual[np.isfinite(residual).all(axis=1)]
    x, y, z = np.sqrt(np.mean(residual**2, axis=0)) if len(residual) else (np.nan,) * 3
    fitted = not {run.folder.resolve().name, run.meta["name"]}.isdisjoint(force.head.made.runs)
    rms = (float(x), float(y), float(z)) if len(residual) else None
    return ForceComparison(table, force.model.features, fitted, rms)


def _notes(kinds: set[CalibrationKind], pressed: bool, frames: int) -> list[str]:
    lines = []
    if not pressed:
        lines.append("shape and contacts: no press in this run")
    elif "depth" not in kinds:
        lines.append("contacts, and depth in mm: no calibration (`deltact-fab calibrate depth`)")
    if "force" not in kinds:
        lines.append("force from the flow: no calibration (`deltact-fab calibrate force`)")
    elif frames:
        lines.append(f"force at {frames} frames: long run, only the deepest presses are measured")
    return lines
