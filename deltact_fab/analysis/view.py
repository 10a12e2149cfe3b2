"""The sensor that a run was recorded on, as the run describes it."""

from __future__ import annotations

from collections.abc import Sequence

from .. import __version__, catalog
from ..errors import InputError
from ..measure.sensor_id import CalibrationSource, Head, Kind, SensorId
from ..measure.view import SensorView
from ..record import Run
from ..shapes import SkinDimensions


def view_of(run: Run) -> SensorView:
    """What the measurement may know of a run's sensor: no force, no truth.

    Raises InputError without a camera, or where the record's skin is none.
    """
    source = f"{run.folder}/run.json: sensor.skin"
    skin = catalog.validate(SkinDimensions, run.meta["sensor"]["skin"], source)
    return SensorView(run.camera, skin, float(run.meta["protocol"]["specimen"]["poisson"]))


def sensor_of(run: Run) -> SensorId:
    """Which sensor a run was recorded on. Raises InputError without a camera."""
    specimen = run.meta["protocol"]["specimen"]
    return SensorId.of(
        run.camera, run.pattern["recipe"], specimen["design"], specimen.get("serial")
    )


def head_of(runs: Sequence[Run], kind: Kind) -> Head:
    """The head of a calibration made from runs, which must be of one sensor.

    Raises InputError, one line that names the run that differs and in what.
    """
    first = sensor_of(runs[0])
    for run in runs[1:]:
        if unlike := sensor_of(run).unlike(first):
            raise InputError(
                f"{run.folder}: another sensor than {runs[0].folder}: {'; '.join(unlike)}"
            )
    simulated = any(run.simulated for run in runs)
    made = CalibrationSource(
        runs=tuple(run.folder.resolve().name for run in runs),
        simulated=simulated,
        version=__version__,
        seed=int(runs[0].meta["seed"]) if simulated else None,
    )
    return Head(kind, first, made)
