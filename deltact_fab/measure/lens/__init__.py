"""The lens from images of boards: corners, fit, own uncertainty, and the flat field."""

from .board import Board
from .calibration import PHOTOGRAPHS, Calibration, calibrate, of_corners
from .flat import FlatField

__all__ = ["PHOTOGRAPHS", "Board", "Calibration", "FlatField", "calibrate", "of_corners"]
