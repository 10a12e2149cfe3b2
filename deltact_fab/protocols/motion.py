"""Straight moves of a stage and how long they take; planning and driving use the same."""

from __future__ import annotations

import math

from ..aliases import Vector


def plus(a: Vector, b: Vector) -> Vector:
    """a + b."""
    return (a[0] + b[0], a[1] + b[1], a[2] + b[2])


def minus(a: Vector, b: Vector) -> Vector:
    """a - b."""
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])


def move_duration_s(
    delta_mm: Vector, feed_mm_min: float, max_feed_mm_min: Vector, acceleration_mm_s2: Vector
) -> float:
    """Time of a straight move from rest to rest, with every axis within its own limits.

    A ramp, a cruise and a ramp; a triangle when the line is too short to reach the feed.
    """
    length = math.hypot(*delta_mm)
    if length == 0:
        return 0.0
    share = [abs(d) / length for d in delta_mm]
    accel = min(a / s for a, s in zip(acceleration_mm_s2, share, strict=True) if s > 0)
    top = min(f / s for f, s in zip(max_feed_mm_min, share, strict=True) if s > 0)
    speed = min(feed_mm_min, top) / 60
    if speed * speed >= length * accel:
        return 2 * math.sqrt(length / accel)
    return length / speed + speed / accel
