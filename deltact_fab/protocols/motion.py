"""How long a run takes: its straight moves, and what its scheduler and a host add to them.

Planning and driving use the same, so that an estimate and a run have the same waits.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from ..aliases import Vector

LOOK_S = 0.1
"""The firmware's documents ask for at most 10 status reports a second. In lockstep a step goes on
for as long after its last frame, so that the next one does not start when the host is ready."""
ARRIVAL_S = 0.1
"""In lockstep a frame at the end of a move is taken this long after the planned end, not when the
host happens to hear of it: status reports differ in length, by milliseconds."""


@dataclass(frozen=True)
class RigPace:
    """Seconds beyond motion and settling: to connect, for a move, for a step with frames."""

    connect_s: float
    move_s: float
    frames_s: float


LOCKSTEP = RigPace(connect_s=1.3, move_s=ARRIVAL_S, frames_s=LOOK_S)
# A move: median on GRBL 1.1h at 115200 baud. Frames: one period of a camera, a sample, a position.
WALL_CLOCK = RigPace(connect_s=2.0, move_s=0.023, frames_s=0.03)

SEEK_MM_S = 10.0
SWITCHES_S = 2.0


def plus(a: Vector, b: Vector) -> Vector:
    """a + b."""
    return (a[0] + b[0], a[1] + b[1], a[2] + b[2])


def minus(a: Vector, b: Vector) -> Vector:
    """a - b."""
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])


def along_line(delta_mm: Vector, per_axis: Vector) -> float:
    """Largest value along a line that keeps every axis within its own limit."""
    length = math.hypot(*delta_mm)
    return min(
        limit * length / abs(d) for d, limit in zip(delta_mm, per_axis, strict=True) if d != 0
    )


def move_duration_s(
    delta_mm: Vector, feed_mm_min: float, max_feed_mm_min: Vector, acceleration_mm_s2: Vector
) -> float:
    """Time of a straight move from rest to rest, with every axis within its own limits.

    A ramp, a cruise and a ramp; a triangle when the line is too short to reach the feed.
    """
    length = math.hypot(*delta_mm)
    if length == 0:
        return 0.0
    accel = along_line(delta_mm, acceleration_mm_s2)
    speed = min(feed_mm_min, along_line(delta_mm, max_feed_mm_min)) / 60
    if speed * speed >= length * accel:
        return 2 * math.sqrt(length / accel)
    return length / speed + speed / accel


def homing_s(travel_mm: tuple[float, float, float]) -> float:
    """From half the travel away: z first, then x and y together, every switch twice."""
    x, y, z = travel_mm
    return (z + max(x, y)) / 2 / SEEK_MM_S + 2 * SWITCHES_S
