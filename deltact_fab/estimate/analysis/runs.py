"""Inputs of an analysis from a run: usable frames, settled ones, and the sensor."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from deltact_fab.bench import Run
from deltact_fab.common import InputError, make_folder, validate, write_whole
from deltact_fab.sensor import CameraModel, Pinhole, SkinDimensions
from deltact_fab.version import PACKAGE_VERSION

from ..measure.sensor_id import (
    CalibrationHead,
    CalibrationKind,
    CalibrationSource,
    SensorId,
    SensorModel,
    format_differences,
)

PRESS_KINDS = ("press", "shear")
"""Kinds of the steps that press the face."""


def read_frames(run: Run, analysis: str) -> pd.DataFrame:
    """Read the frames of a run that is finished and has images. analysis: name for the message.

    Raises InputError, one line, for any other run, RunFailed for a damaged journal.
    """
    frames = run.frames()  # first: a damaged journal is worse than an unfinished run
    if not run.finished:
        raise InputError(f"{run.folder}: the run is not finished; continue with `run --resume`")
    if frames.empty or frames["file"].isna().any():
        raise InputError(f"{run.folder}: no images recorded; {analysis} needs the channel 'image'")
    return frames


def fitted_rows(run: Run, frames: pd.DataFrame) -> pd.DataFrame:
    """Return the rows of a table of frames that belong to presses of role "fit"."""
    roles = run.press_roles()
    return frames[[roles.get(press, "fit") == "fit" for press in frames["press"]]]


def has_rests(frames: pd.DataFrame) -> bool:
    """True if a run's table of frames has settled ones that press the face."""
    return bool((frames["settled"] & frames["kind"].isin(PRESS_KINDS)).any())


def settled_rows(frames: pd.DataFrame) -> pd.DataFrame:
    """Return the settled rows of the table of a press's frames.

    Where the protocol does not settle: the last frame of each step that presses or shears. For an
    imported run all rows, as nothing is known of its motion.
    """
    if (frames["kind"] == Run.UNKNOWN).all():
        return frames
    if has_rests(frames):
        return frames[frames["settled"]]
    last = frames.groupby("step_id", sort=False).tail(1)
    return last[last["kind"].isin(PRESS_KINDS)]


def settle_s(run: Run, kind: str) -> float:
    """Settling time of stops of a kind, by the run's protocol; 0: none.

    kind: of the step; `travel` stands for the rest before the press.
    """
    settle = (run.meta["protocol"].get("capture") or {}).get("settle_s")
    stop = "rest" if kind == "travel" else kind
    return (settle.get(stop) if isinstance(settle, dict) else settle) or 0.0


def write_results(folder: Path, results: dict[str, dict[str, Any] | pd.DataFrame]) -> list[Path]:
    """Write plain data as JSON and tables as CSV, by file name.

    Raises InputError for an impossible folder, RunFailed when writing fails.
    """
    make_folder(folder)
    for name, content in results.items():
        if isinstance(content, pd.DataFrame):
            text = content.to_csv(index=False)
        else:
            text = json.dumps(content, indent=1, allow_nan=False) + "\n"
        write_whole(folder / name, text.encode())
    return [folder / name for name in results]


def in_pixels(run: Run) -> bool:
    """True for an imported run of an unknown camera, whose flow is in pixels."""
    return run.imported and run.meta["camera"] is None


def camera_of(run: Run) -> CameraModel:
    """Return a run's camera; if `in_pixels`, an orthographic one of 1 mm per pixel.

    Raises InputError for a run recorded without a camera.
    """
    if not in_pixels(run):
        return run.camera
    w, h = run.meta["imported"]["image_px"]
    return Pinhole(1.0, w, h, math.inf)


def view_of_run(run: Run) -> SensorModel:
    """Return the sensor model of a run for the measurement, without force and truth.

    If `in_pixels`, without a skin. Raises InputError without a camera, or for an invalid skin.
    """
    if in_pixels(run):
        nothing: Any = None
        return SensorModel(camera_of(run), nothing)
    source = f"{run.folder}/run.json: sensor.skin"
    skin = validate(SkinDimensions, run.meta["sensor"]["skin"], source)
    poisson = run.meta["protocol"]["specimen"].get("poisson", SensorModel.poisson)
    return SensorModel(run.camera, skin, float(poisson))


def sensor_of(run: Run) -> SensorId:
    """Return the identity of a run's sensor. Raises InputError without a camera."""
    specimen = run.meta["protocol"]["specimen"]
    recipe = None if run.imported else run.pattern["recipe"]
    design, serial = specimen.get("design"), specimen.get("serial")
    return SensorModel(camera_of(run), recipe=recipe, design=design, serial=serial).id


def head_of(runs: Sequence[Run], kind: CalibrationKind) -> CalibrationHead:
    """Return the head of a calibration made from runs, which must be of one sensor.

    Raises InputError, one line that names the run that differs, and how.
    """
    first = sensor_of(runs[0])
    for run in runs[1:]:
        if unlike := sensor_of(run).differences_from(first):
            text = format_differences(unlike, "there")
            raise InputError(f"{run.folder}: another sensor than {runs[0].folder}: {text}")
    simulated = any(run.simulated for run in runs)
    source = CalibrationSource(
        runs=tuple(run.folder.resolve().name for run in runs),
        simulated=simulated,
        version=PACKAGE_VERSION,
        seed=int(runs[0].meta["seed"]) if simulated else None,
    )
    return CalibrationHead(kind, first, source)
