"""Factors between units that are fixed by definition, and seconds in whole nanoseconds."""

MM_PER_INCH = 25.4
POINTS_PER_MM = 72 / MM_PER_INCH  # of PDF and type
NS_PER_S = 1_000_000_000


def to_ns(seconds: float) -> int:
    """Seconds to the nearest nanosecond."""
    return round(seconds * NS_PER_S)
