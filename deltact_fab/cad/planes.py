"""Areas of plane figures that closed forms of parts need."""

from __future__ import annotations

import math


def band_mm2(half_width_mm: float, radius_mm: float) -> float:
    """Area of the disc within |x| <= half_width, at most its radius."""
    h, r = min(half_width_mm, radius_mm), radius_mm
    return 2 * (h * math.sqrt(r**2 - h**2) + r**2 * math.asin(h / r))


def segment_mm2(from_mm: float, radius_mm: float) -> float:
    """Area of the disc beyond x = from_mm, which lies within the disc."""
    c, r = from_mm, radius_mm
    return r**2 * math.acos(c / r) - c * math.sqrt(r**2 - c**2)


def cone_segment_mm3(
    from_mm: float, low_radius_mm: float, high_radius_mm: float, height_mm: float
) -> float:
    """Volume beyond the plane x = from_mm of a cone's frustum whose axis is z, at x = 0.

    The segment's area, which is also a function of the radius alone, integrated along the height.
    The plane meets both ends: 0 < from_mm < both radii, which differ.
    """

    def integral(r: float) -> float:
        q = math.sqrt(r**2 - c**2)
        return r**3 / 3 * math.acos(c / r) - 2 / 3 * c * r * q + c**3 / 3 * math.log(r + q)

    c = from_mm
    rise = height_mm / (low_radius_mm - high_radius_mm)
    return rise * (integral(low_radius_mm) - integral(high_radius_mm))


def common_circles_mm2(a_mm: float, b_mm: float, apart_mm: float) -> float:
    """Area that two discs of radii a and b share, their centres apart_mm apart."""
    if apart_mm >= a_mm + b_mm:
        return 0.0
    small, large = sorted((a_mm, b_mm))
    if apart_mm <= large - small:
        return math.pi * small**2
    # Each disc gives the segment beyond the common chord, which may lie beyond its centre.
    chord = (apart_mm**2 + a_mm**2 - b_mm**2) / (2 * apart_mm)
    return segment_mm2(chord, a_mm) + segment_mm2(apart_mm - chord, b_mm)
