"""Firmware that shares no line with the simulated board, in a program that the user built."""
