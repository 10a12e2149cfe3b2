"""The paper's calibration of force: presses as pure jobs, and what follows from their points."""
