"""The measurement as a robot calls it: images in; flow, shape, force and contact out."""

from .measurement import MarkerMeasurement, Measurement
from .outputs import OUTPUTS, Result
from .pipeline import Pipeline

__all__ = ["OUTPUTS", "MarkerMeasurement", "Measurement", "Pipeline", "Result"]
