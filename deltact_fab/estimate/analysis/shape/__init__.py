"""Shape of the contact in a run: the depth calibrated on a ball, and the error against truth."""
