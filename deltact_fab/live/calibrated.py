"""The measurement of the sensor that a source shows, with its calibration files."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from ..measure.pipeline import Measurement, everything
from ..measure.sensor_id import SensorId, read_calibration, require_same
from .source import KnownSensor


def measurement_of(
    known: KnownSensor, files: Sequence[Path], show: Sequence[str] | None = None
) -> Measurement:
    """Of the outputs named, or of all that the calibrations allow.

    Raises InputError, one line, for a file that is none, for another sensor's, and as Measurement.
    """
    assert known.camera is not None, "open_source makes sure of it"
    present = SensorId.of(known.camera, known.recipe, known.design, known.serial)
    for file in files:  # more is known here than a camera, which Measurement looks at
        require_same(read_calibration(file)[0].sensor, present, str(file))
    return everything(known.camera, known.skin, files, show)
