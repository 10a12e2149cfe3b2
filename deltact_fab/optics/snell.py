"""Refraction at the plane faces between lens and gel."""

from __future__ import annotations

import math

from ..shapes.sensor import N_ACRYLIC, N_SILICONE


def reached_mm(half_angle_rad: float, air_gap_mm: float, acrylic_mm: float, gel_mm: float) -> float:
    """Radius on the gel's face that a ray leaving the lens at half_angle_rad reaches.

    Snell at plane faces: r = g tan t + sum of d sin t / sqrt(n^2 - sin^2 t) over acrylic and gel.
    """
    s = math.sin(half_angle_rad)
    layers = ((acrylic_mm, N_ACRYLIC), (gel_mm, N_SILICONE))
    behind = sum(d * s / math.sqrt(n**2 - s**2) for d, n in layers)
    return air_gap_mm * math.tan(half_angle_rad) + behind


def half_angle_rad(radius_mm: float, air_gap_mm: float, acrylic_mm: float, gel_mm: float) -> float:
    """Half angle at the lens under which a point of the face is seen; inf when none reaches it.

    Inverse of reached_mm by bisection, to 1e-12 rad; it grows with the angle. radius_mm >= 0.
    """
    low, high = 0.0, math.pi / 2 - 1e-9
    if reached_mm(high, air_gap_mm, acrylic_mm, gel_mm) < radius_mm:
        return math.inf
    while high - low > 1e-12:
        middle = (low + high) / 2
        if reached_mm(middle, air_gap_mm, acrylic_mm, gel_mm) < radius_mm:
            low = middle
        else:
            high = middle
    return high
