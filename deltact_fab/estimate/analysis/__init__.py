"""Analyses of recorded runs: tracking error, force calibration, shape and relaxation."""
