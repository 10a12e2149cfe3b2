"""The measurement as a robot calls it: images in; flow, shape, force and contact out."""

from .calibrated import Calibration
from .measurement import Measurement, everything
from .pipeline import Pipeline, Policy
from .plan import OUTPUTS
from .result import Output, Result, Shape

__all__ = [
    "OUTPUTS",
    "Calibration",
    "Measurement",
    "Output",
    "Pipeline",
    "Policy",
    "Result",
    "Shape",
    "everything",
]
