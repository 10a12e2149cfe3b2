"""The paper's calibration of force: presses as pure jobs, and what their points say."""
