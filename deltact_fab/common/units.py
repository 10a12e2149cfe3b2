"""Unit factors fixed by definition, and conversion and formatting of times."""

from __future__ import annotations

MM_PER_INCH = 25.4  # definition
_NS_PER_SECOND = 1_000_000_000  # definition


def format_duration(seconds: float) -> str:
    """Format a duration as h min, min s or s."""
    total = round(seconds)
    hours, minutes = total // 3600, total // 60 % 60
    if hours:
        return f"{hours} h {minutes:02d} min"
    return f"{minutes} min {total % 60:02d} s" if minutes else f"{total} s"


def to_ns(seconds: float) -> int:
    """Convert seconds to the nearest nanosecond."""
    return round(seconds * _NS_PER_SECOND)
