"""Shape of the contact in a run: the depth calibrated on a ball, and the error against truth."""

from .ball import calibrate_depth
from .press import PressShape, ShapeMaps, press_shape
from .run import GOALS, UNCALIBRATED, ShapeResult, analyse, deepest, with_traction
