"""The lens from images of boards: corners, fit, own uncertainty; and the flat field."""

from .board import Board
from .calibration import PHOTOGRAPHS, Calibration, calibrate, flat_field, of_corners

__all__ = ["PHOTOGRAPHS", "Board", "Calibration", "calibrate", "flat_field", "of_corners"]
