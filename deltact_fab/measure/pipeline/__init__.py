"""The measurement as a robot calls it: images in; flow, shape, force and contact out."""

from .measurement import MarkerMeasurement, Measurement, everything
from .pipeline import Pipeline
from .plan import OUTPUTS, Calibration
from .result import Result

__all__ = [
    "OUTPUTS",
    "Calibration",
    "MarkerMeasurement",
    "Measurement",
    "Pipeline",
    "Result",
    "everything",
]
