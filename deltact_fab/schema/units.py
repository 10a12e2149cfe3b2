"""The unit of a key, which is the end of its name."""

from __future__ import annotations

# Longest first: mm_min before min, nmm before mm.
_UNITS = (
    ("mm_per_px", "mm/px"),
    ("per_m", "1/m"),
    ("mm_min", "mm/min"),
    ("mm_s2", "mm/s2"),
    ("electrons", "electrons"),
    ("nmm", "N mm"),
    ("mpa", "MPa"),
    ("ohm", "ohm"),
    ("deg", "degrees"),
    ("mm2", "mm2"),
    ("mm", "mm"),
    ("um", "um"),
    ("px", "px"),
    ("hz", "Hz"),
    ("ms", "ms"),
    ("s", "s"),
    ("n", "N"),
    ("k", "K"),
    ("v", "V"),
    ("baud", "baud"),
    ("dpi", "dots per inch"),
)


def unit_of(key: str) -> str:
    """As a person writes it; empty for a key without one."""
    for end, unit in _UNITS:
        if key.endswith(f"_{end}") or (key == end and len(end) > 2):
            return unit
    return ""
