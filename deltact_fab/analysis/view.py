"""The sensor that a run was recorded on, as the run describes it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from .. import catalog
from ..errors import InputError
from ..measure.sensor_id import CalibrationSource, Head, Kind, SensorId, told
from ..measure.view import SensorView
from ..optics import CameraModel, Pinhole
from ..record import Run
from ..shapes import SkinDimensions
from ..version import VERSION


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


def view_of(run: Run) -> SensorView:
    """What the measurement may know of a run's sensor: no force, no truth.

    `in_pixels` there is no skin. Raises InputError without a camera, or where the record's skin is
    none.
    """
    if in_pixels(run):
        nothing: Any = None
        return SensorView(camera_of(run), nothing)
    source = f"{run.folder}/run.json: sensor.skin"
    skin = catalog.validate(SkinDimensions, run.meta["sensor"]["skin"], source)
    poisson = run.meta["protocol"]["specimen"].get("poisson", SensorView.poisson)
    return SensorView(run.camera, skin, float(poisson))


def sensor_of(run: Run) -> SensorId:
    """Which sensor a run was recorded on. Raises InputError without a camera."""
    specimen = run.meta["protocol"]["specimen"]
    recipe = None if run.imported else run.pattern["recipe"]
    return SensorId.of(camera_of(run), recipe, specimen.get("design"), specimen.get("serial"))


def head_of(runs: Sequence[Run], kind: Kind) -> Head:
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
        version=VERSION,
        seed=int(runs[0].meta["seed"]) if simulated else None,
    )
    return Head(kind, first, made)
