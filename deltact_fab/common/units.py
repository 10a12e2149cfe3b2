"""Factors between units that are fixed by definition, and how numbers are written and made."""

from __future__ import annotations

MM_PER_INCH = 25.4
NS_PER_S = 1_000_000_000


def format_duration(seconds: float) -> str:
    """Format a time in hours, minutes and seconds, without the leading ones that are zero."""
    total = round(seconds)
    hours, minutes = total // 3600, total // 60 % 60
    if hours:
        return f"{hours} h {minutes:02d} min"
    return f"{minutes} min {total % 60:02d} s" if minutes else f"{total} s"


def to_ns(seconds: float) -> int:
    """Convert seconds to the nearest nanosecond."""
    return round(seconds * NS_PER_S)
