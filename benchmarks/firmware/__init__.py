"""Firmware that shares no line with the simulated board, built from clones that the user names."""
