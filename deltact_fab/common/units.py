"""Factors between units that are fixed by definition, and how numbers are written and made."""

from __future__ import annotations

import zlib

MM_PER_INCH = 25.4
POINTS_PER_MM = 72 / MM_PER_INCH  # of PDF and type
NS_PER_S = 1_000_000_000

DIGITS = 4
"""Significant ones of a number that a person reads, where nothing better is known of it."""


def format_digits(value: float) -> str:
    """A number with DIGITS significant digits; between 0.0001 and a million without exponent."""
    if 10**DIGITS <= abs(value) < 1e6:
        return f"{value:.0f}"
    return f"{value:.{DIGITS}g}"


def format_duration(seconds: float) -> str:
    """Hours, minutes and seconds, without the leading ones that are zero."""
    whole = round(seconds)
    hours, minutes = whole // 3600, whole // 60 % 60
    if hours:
        return f"{hours} h {minutes:02d} min"
    return f"{minutes} min {whole % 60:02d} s" if minutes else f"{whole} s"


def to_ns(seconds: float) -> int:
    """Seconds to the nearest nanosecond."""
    return round(seconds * NS_PER_S)


def stream_number(name: str) -> int:
    """A number for a stream's name that is the same in every process, for seeds."""
    return zlib.crc32(name.encode())
