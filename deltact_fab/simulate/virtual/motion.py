"""Straight moves in time: trapezoids, and the braking ramps that cut them short.

A segment is a straight line travelled with piecewise constant acceleration. Its position depends
only on the integer nanoseconds since it started, so a move is the same at any time of day.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from deltact_fab.common import Point

from .clock import NS_PER_S

Phase = tuple[float, float, float, float]  # from t (s), travelled (mm), speed (mm/s), a (mm/s2)


@dataclass(frozen=True, slots=True)
class Segment:
    """A straight line from start_ns to end_ns; `end_mm` is where it is at end_ns exactly.

    block: segments of one commanded line share it (a hold cuts a line in two and bends nothing).
    """

    start_mm: Point
    end_mm: Point
    start_ns: int
    end_ns: int
    unit: Point
    phases: tuple[Phase, ...]
    accel_mm_s2: float
    block: int

    def position_mm(self, t_ns: int) -> Point:
        """Position at a time; the ends of the line outside of its duration."""
        if t_ns >= self.end_ns:
            return self.end_mm
        s, _ = self._travelled(t_ns)
        (x, y, z), (u, v, w) = self.start_mm, self.unit
        return (x + u * s, y + v * s, z + w * s)

    def speed_mm_s(self, t_ns: int) -> float:
        """Speed along the line, 0 outside of its duration."""
        return self._travelled(t_ns)[1] if self.start_ns <= t_ns < self.end_ns else 0.0

    def cut(self, t_ns: int) -> Segment:
        """The same motion, ended at t_ns (not at rest there: a braking ramp has to follow)."""
        return replace(self, end_mm=self.position_mm(t_ns), end_ns=t_ns)

    def travelled_mm(self, t_ns: NDArray[np.int64]) -> NDArray[np.float64]:
        """Way along the line at times (n,) of its duration."""
        t = np.maximum(t_ns - self.start_ns, 0) / NS_PER_S
        phases = np.array(self.phases)
        t0, s0, v0, a = phases[np.searchsorted(phases[:, 0], t, "right") - 1].T
        return np.asarray(s0 + (v0 + 0.5 * a * (t - t0)) * (t - t0), float)

    def _travelled(self, t_ns: int) -> tuple[float, float]:
        t = max(t_ns - self.start_ns, 0) / NS_PER_S
        for t0, s0, v0, a in reversed(self.phases):
            if t >= t0:
                dt = t - t0
                return s0 + (v0 + 0.5 * a * dt) * dt, max(v0 + a * dt, 0.0)
        raise AssertionError("phases start at 0")


def trapezoid(
    start_mm: Point,
    end_mm: Point,
    speed_mm_s: float,
    accel_mm_s2: float,
    start_ns: int,
    block: int = 0,
    begun_mm_s: float = 0.0,
) -> Segment:
    """To rest: ramp, cruise, ramp; a triangle when the line is too short to cruise.

    begun_mm_s: the speed that it starts with, from which it can brake within the line. Raises
    ValueError for a speed or acceleration that is not positive.
    """
    if not (speed_mm_s > 0 and accel_mm_s2 > 0):
        raise ValueError(f"speed {speed_mm_s} and acceleration {accel_mm_s2} must be positive")
    delta = (end_mm[0] - start_mm[0], end_mm[1] - start_mm[1], end_mm[2] - start_mm[2])
    length = math.hypot(*delta)
    if length == 0:
        return Segment(
            start_mm, end_mm, start_ns, start_ns, (0.0, 0.0, 0.0), (), accel_mm_s2, block
        )
    a, v0 = accel_mm_s2, begun_mm_s
    peak = max(min(speed_mm_s, math.sqrt(length * a + v0 * v0 / 2)), v0)
    ramp_s, ramp_mm = (peak - v0) / a, (peak - v0) * (peak + v0) / (2 * a)
    slow_s, slow_mm = peak / a, peak * peak / (2 * a)
    brake_s = ramp_s + max(length - ramp_mm - slow_mm, 0.0) / peak
    phases = (
        (0.0, 0.0, v0, a),
        (ramp_s, ramp_mm, peak, 0.0),
        (brake_s, length - slow_mm, peak, -a),
    )
    unit = (delta[0] / length, delta[1] / length, delta[2] / length)
    end_ns = start_ns + math.ceil((brake_s + slow_s) * NS_PER_S)
    return Segment(start_mm, end_mm, start_ns, end_ns, unit, phases, accel_mm_s2, block)


def brake(moving: Segment, t_ns: int) -> Segment:
    """The ramp to rest from where `moving` is at t_ns, at its own acceleration, along its line."""
    speed, a = moving.speed_mm_s(t_ns), moving.accel_mm_s2
    at_mm = moving.position_mm(t_ns)
    braking_mm = speed * speed / (2 * a)
    u, v, w = moving.unit
    end = (at_mm[0] + u * braking_mm, at_mm[1] + v * braking_mm, at_mm[2] + w * braking_mm)
    end_ns = t_ns + math.ceil(speed / a * NS_PER_S)
    phases = ((0.0, 0.0, speed, -a),)
    return Segment(at_mm, end, t_ns, end_ns, moving.unit, phases, a, moving.block)


class Path:
    """Past and planned motion of the carriage: segments with rests between them."""

    def __init__(self, at_mm: Point, t_ns: int) -> None:
        self._origin_mm = at_mm
        self._origin_ns = t_ns
        self._segments: list[Segment] = []
        self._starts: list[int] = []

    @property
    def segments(self) -> list[Segment]:
        return list(self._segments)

    @property
    def end_mm(self) -> Point:
        return self._segments[-1].end_mm if self._segments else self._origin_mm

    def add(self, segment: Segment) -> Segment:
        """Append a segment; it starts where and not before the last one ends."""
        if segment.end_ns > segment.start_ns:
            self._segments.append(segment)
            self._starts.append(segment.start_ns)
        return segment

    def replace_last(self, t_ns: int) -> None:
        """Cut the last segment at t_ns; it vanishes when it had not begun to move."""
        last = self._segments.pop()
        self._starts.pop()
        self.add(last.cut(t_ns))

    def moving(self, t_ns: int) -> Segment | None:
        """The segment under way at a time, None at rest."""
        k = bisect_right(self._starts, t_ns) - 1
        if k < 0 or t_ns >= self._segments[k].end_ns:
            return None
        return self._segments[k]

    def position_mm(self, t_ns: int) -> Point:
        """Position at a time; where it started, before its origin."""
        k = bisect_right(self._starts, t_ns) - 1
        return self._segments[k].position_mm(t_ns) if k >= 0 else self._origin_mm
