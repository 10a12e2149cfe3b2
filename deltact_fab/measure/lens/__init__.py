"""The lens from images of boards: corners, fit, own uncertainty; and the flat field."""

from .calibration import PHOTOGRAPHS, Calibration, calibrate, flat_field, of_corners
from .corners import Checkerboard

__all__ = ["PHOTOGRAPHS", "Calibration", "Checkerboard", "calibrate", "flat_field", "of_corners"]
