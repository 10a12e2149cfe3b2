"""Shape of the contact in a run: the depth calibrated on a ball, and the error against truth."""

from .ball import DepthCalibration, calibrate_depth
from .picture import ShapeMaps
from .press import PressShape, press_shape
from .run import FIGURES, GOALS, UNCALIBRATED, ShapeResult, analyse

__all__ = [
    "FIGURES",
    "GOALS",
    "UNCALIBRATED",
    "DepthCalibration",
    "PressShape",
    "ShapeMaps",
    "ShapeResult",
    "analyse",
    "calibrate_depth",
    "press_shape",
]
