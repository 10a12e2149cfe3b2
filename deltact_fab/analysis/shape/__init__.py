"""Shape of the contact in a run: the depth calibrated on a ball, and the error against truth."""

from .ball import calibrate_depth
from .picture import ShapeMaps
from .press import PressShape, press_shape
from .run import GOALS, UNCALIBRATED, ShapeResult, analyse, deepest, with_traction
