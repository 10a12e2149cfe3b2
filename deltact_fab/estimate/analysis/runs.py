"""What a run is to an analysis: frames that it can use, those at rest, and the sensor."""

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
    CalibrationSource,
    Kind,
    SensorId,
    SensorModel,
    told,
)

PRESSING = ("press", "shear")
"""Kinds of the steps in which the face is pressed."""


def read_frames(run: Run, what: str) -> pd.DataFrame:
    """Read the frames of a run that is finished and has images; `what` is analysed.

    Raises InputError, one line, for any other run, RunFailed for a damaged journal.
    """
    frames = run.frames()  # a damaged journal is worse news than an unfinished run
    if not run.finished:
        raise InputError(f"{run.folder}: the run is not finished; go on with `run --resume`")
    if frames.empty or frames["file"].isna().any():
        raise InputError(f"{run.folder}: no images were recorded; {what} needs the channel 'image'")
    return frames


def settles(frames: pd.DataFrame) -> bool:
    """Whether a run's protocol has frames at rest that press the face, of the table of frames."""
    return bool((frames["settled"] & frames["kind"].isin(PRESSING)).any())


def settled(frames: pd.DataFrame) -> pd.DataFrame:
    """The frames of a press at which nothing moves, of the table of all its frames.

    Where the protocol does not settle: the last frame of each step that presses or shears. Of an
    imported run nobody knows, and all are taken.
    """
    if (frames["kind"] == Run.UNKNOWN).all():
        return frames
    if settles(frames):
        return frames[frames["settled"]]
    last = frames.groupby("step_id", sort=False).tail(1)
    return last[last["kind"].isin(PRESSING)]


def settle_s(run: Run, kind: str) -> float:
    """How long stops of a kind rested before their frame, by the run's protocol; 0: not at all.

    kind: of the step; before and after the press it is `travel`, and the former is meant.
    """
    settle = (run.meta["protocol"].get("capture") or {}).get("settle_s")
    stop = "rest" if kind == "travel" else kind
    return (settle.get(stop) if isinstance(settle, dict) else settle) or 0.0


def write_results(folder: Path, results: dict[str, dict[str, Any] | pd.DataFrame]) -> list[Path]:
    """Write plain data as JSON and tables as CSV, by their files' names.

    Raises InputError for a folder that cannot be, RunFailed when the disk refuses.
    """
    make_folder(folder)
    for name, of in results.items():
        if isinstance(of, pd.DataFrame):
            text = of.to_csv(index=False)
        else:
            text = json.dumps(of, indent=1, allow_nan=False) + "\n"
        write_whole(folder / name, text.encode())
    return [folder / name for name in results]


def in_pixels(run: Run) -> bool:
    """Whether nobody knows the camera of a run that was imported: its flow is in pixels."""
    return run.imported and run.meta["camera"] is None


def camera_of(run: Run) -> CameraModel:
    """A run's camera; where it is `in_pixels` a view from afar in which a pixel is a mm.

    Raises InputError for a run that was recorded without a camera.
    """
    if not in_pixels(run):
        return run.camera
    w, h = run.meta["imported"]["image_px"]
    return Pinhole(1.0, w, h, math.inf)


def view_of_run(run: Run) -> SensorModel:
    """What the measurement may know of a run's sensor: no force, no truth.

    `in_pixels` there is no skin. Raises InputError without a camera, or where the record's skin is
    none.
    """
    if in_pixels(run):
        nothing: Any = None
        return SensorModel(camera_of(run), nothing)
    source = f"{run.folder}/run.json: sensor.skin"
    skin = validate(SkinDimensions, run.meta["sensor"]["skin"], source)
    poisson = run.meta["protocol"]["specimen"].get("poisson", SensorModel.poisson)
    return SensorModel(run.camera, skin, float(poisson))


def sensor_of(run: Run) -> SensorId:
    """Which sensor a run was recorded on. Raises InputError without a camera."""
    specimen = run.meta["protocol"]["specimen"]
    recipe = None if run.imported else run.pattern["recipe"]
    design, serial = specimen.get("design"), specimen.get("serial")
    return SensorModel(camera_of(run), recipe=recipe, design=design, serial=serial).id


def head_of(runs: Sequence[Run], kind: Kind) -> CalibrationHead:
    """The head of a calibration made from runs, which must be of one sensor.

    Raises InputError, one line that names the run that differs and in what.
    """
    first = sensor_of(runs[0])
    for run in runs[1:]:
        if unlike := sensor_of(run).unlike(first):
            raise InputError(
                f"{run.folder}: another sensor than {runs[0].folder}: {told(unlike, 'there')}"
            )
    simulated = any(run.simulated for run in runs)
    made = CalibrationSource(
        runs=tuple(run.folder.resolve().name for run in runs),
        simulated=simulated,
        version=PACKAGE_VERSION,
        seed=int(runs[0].meta["seed"]) if simulated else None,
    )
    return CalibrationHead(kind, first, made)
