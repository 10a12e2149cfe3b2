"""Shape of the contact in a run: the depth calibrated on a ball, and the error against truth."""

from .ball import DepthCalibration, calibrate_depth
from .result import GOALS, ShapeResult
from .run import analyse

__all__ = ["GOALS", "DepthCalibration", "ShapeResult", "analyse", "calibrate_depth"]
