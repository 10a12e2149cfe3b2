"""A measurement of all that a sensor's calibrations allow."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from ...optics import CameraModel
from ...shapes import SkinDimensions
from ..force import LocalFeatures, features_of
from ..view import SensorView
from .calibrated import Calibrated, Calibration
from .measurement import Measurement


def everything(
    camera: CameraModel,
    skin: SkinDimensions | None = None,
    calibrations: Sequence[Calibration] = (),
    show: Sequence[str] | None = None,
    **options: Any,
) -> Measurement:
    """Of the outputs named in `show`, else of all. A calibration of force brings its own view.

    skin: of the sensor, where it is known. options: as of Measurement, which says what is raised.
    """
    known = Calibrated.of(camera, calibrations)
    view: SensorView | CameraModel = SensorView(camera, skin or SkinDimensions())
    include = ["flow", "shape"]
    include += ["contacts"] if known.depth is not None else []
    if known.force is not None:
        view = camera
        include.append("force")
        if isinstance(features_of(known.force, known.view, "force model"), LocalFeatures):
            include.append("traction")
    return Measurement(view, show or include, calibrations, **options)
