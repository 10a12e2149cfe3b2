"""Factors between units that are fixed by definition."""

MM_PER_INCH = 25.4
POINTS_PER_MM = 72 / MM_PER_INCH  # of PDF and type
