"""What recorded runs tell: tracking error, force calibration, shape and relaxation."""
