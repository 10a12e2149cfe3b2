"""Refraction at the plane faces between lens and gel."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any

from ..shapes.sensor import N_ACRYLIC, N_SILICONE


def across(tan_squared: Any, index: float) -> Any:
    """Tangent of a ray in a layer over its tangent in air, both against the common normal.

    Snell at plane faces: n sin t' = sin t, so tan t' / tan t = 1 / sqrt(n^2 + (n^2 - 1) tan^2 t),
    which stays finite up to grazing rays. tan_squared: tan^2 t in air, a number or an array.
    """
    return (index**2 + (index**2 - 1) * tan_squared) ** -0.5


def reached_mm(half_angle_rad: float, air_gap_mm: float, acrylic_mm: float, gel_mm: float) -> float:
    """Radius on the gel's face that a ray leaving the lens at half_angle_rad reaches."""
    t = math.tan(half_angle_rad)
    return t * _per_tangent_mm(t, _layers(air_gap_mm, acrylic_mm, gel_mm))


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


def _layers(air_gap_mm: float, acrylic_mm: float, gel_mm: float) -> tuple[tuple[float, float], ...]:
    return ((air_gap_mm, 1.0), (acrylic_mm, N_ACRYLIC), (gel_mm, N_SILICONE))


def _per_tangent_mm(tangent: float, layers: Iterable[tuple[float, float]]) -> float:
    return float(sum(d * across(tangent**2, n) for d, n in layers))
