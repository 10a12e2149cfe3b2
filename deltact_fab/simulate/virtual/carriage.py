"""The motors of the simulated board: lines in a queue, the step count, and the carriage.

Two positions are kept apart: the count, which is all that a controller knows and reports, and the
carriage, which is where the tip really is. They agree after homing. A reset in motion stops the
count at once while the carriage coasts on (at most v^2/2a), which is how a position gets lost.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from operator import mul

from deltact_fab.common import Point

from .motion import Path, Segment, brake, trapezoid


def to_steps(mm: Point, per_mm: Point) -> tuple[int, int, int]:
    """Whole steps, halves away from zero as the firmware rounds."""
    x, y, z = (
        int(math.copysign(math.floor(abs(p * k) + 0.5), p)) for p, k in zip(mm, per_mm, strict=True)
    )
    return x, y, z


def steps_to_mm(steps: tuple[int, int, int], per_mm: Point) -> Point:
    """Position of a number of steps, mm."""
    return (steps[0] / per_mm[0], steps[1] / per_mm[1], steps[2] / per_mm[2])


def subtract(a: Point, b: Point) -> Point:
    """a - b."""
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])


def rate_along(delta_mm: Point, per_axis: Point) -> float:
    """Largest rate along a line that keeps every axis within its own limit."""
    length_mm = math.hypot(*delta_mm)
    return min(k * length_mm / abs(d) for d, k in zip(delta_mm, per_axis, strict=True) if d != 0)


PLANNER_BLOCKS = 15  # GRBL 1.1h, BLOCK_BUFFER_SIZE - 1
SCATTER_MM = 0.01  # by hand: repeatability of a cheap switch
MAX_BEND_MM = 0.01  # by hand: a motor step or two, a deviation that still counts as straight


@dataclass(frozen=True)
class _Block:
    """A line in the planner: its end in steps, its programmed feed."""

    number: int
    target_steps: tuple[int, int, int]
    feed_mm_min: float


class Carriage:
    """settings: of the board, as they are at any time. Times are ns, places machine mm."""

    def __init__(self, settings: Mapping[int, float], start_mm: Point, t_ns: int) -> None:
        self.path = Path(start_mm, t_ns)
        self.moving: Segment | None = None
        """The piece under way; a carriage that coasts from a reset has none."""
        self._settings = settings
        self._queue: deque[_Block] = deque()
        self._line_count = 0
        self.forget()

    def forget(self) -> None:
        """Power off and on: the count starts at 0 wherever the carriage is."""
        self._count = (0, 0, 0)
        self._slip_mm = self.path.end_mm

    # ---- where it is --------------------------------------------------------------------------

    def axes(self, first: int) -> Point:
        """A setting of three axes by the number of its first."""
        return (self._settings[first], self._settings[first + 1], self._settings[first + 2])

    def count_mm(self, t_ns: int | None = None) -> Point:
        """The controller's own idea of where it is, at rest or at a time."""
        if t_ns is None or self.moving is None:
            return steps_to_mm(self._count, self.axes(100))
        return steps_to_mm(self._count_at(t_ns), self.axes(100))

    def speed_mm_min(self, t_ns: int) -> float:
        return self.moving.speed_mm_s(t_ns) * 60 if self.moving is not None else 0.0

    def outside(self, target_mm: Point) -> bool:
        return any(not -m <= p <= 0 for p, m in zip(target_mm, self.axes(130), strict=True))

    # ---- the queue ----------------------------------------------------------------------------

    @property
    def free_blocks(self) -> int:
        return PLANNER_BLOCKS - len(self._queue)

    def plan(self, target_mm: Point, feed_mm_min: float) -> None:
        """Queue a line; one that is shorter than half a step is none."""
        self._line_count += 1
        target = to_steps(target_mm, self.axes(100))
        previous = self._queue[-1].target_steps if self._queue else self._count
        if target != previous:
            self._queue.append(_Block(self._line_count, target, feed_mm_min))

    def prolong(self, target_mm: Point, feed_mm_min: float, t_ns: int) -> bool:
        """Go on to a place straight ahead without coming to rest; False where that is not one.

        The line under way is the last of the queue.
        """
        line = self.moving
        if line is None or len(self._queue) != 1 or self._queue[0].feed_mm_min != feed_mm_min:
            return False
        position, speed = line.position_mm(t_ns), line.speed_mm_s(t_ns)
        target = to_steps(target_mm, self.axes(100))
        end = self._place_mm(target)
        remaining, ahead = subtract(end, position), subtract(end, line.end_mm)
        forward = sum(map(mul, ahead, line.unit))
        bent = forward <= 0 or forward < math.hypot(*ahead) - MAX_BEND_MM
        if bent or speed * speed > 2 * line.accel_mm_s2 * math.hypot(*remaining):
            return False
        block = self._queue[0]
        self._queue[0] = replace(block, target_steps=target)
        self.path.replace_last(t_ns)
        self.moving = self._line_to(end, feed_mm_min, block.number, t_ns, speed)
        return True

    def begin(self, t_ns: int) -> bool:
        """Start the next line of the queue; False when there is none."""
        while self._queue:
            block = self._queue[0]
            end = self._place_mm(block.target_steps)
            segment = self._line_to(end, block.feed_mm_min, block.number, t_ns)
            if segment.end_ns > t_ns:
                self.moving = segment
                return True
            self._arrive()
        return False

    def finish(self, arrived: bool) -> None:
        """The piece under way is over: at the end of its line, or where a brake left it."""
        assert self.moving is not None
        self._count = self._count_at(self.moving.end_ns)
        self.moving = None
        if arrived:
            self._arrive()

    def drop(self) -> None:
        self._queue.clear()

    # ---- stopping -----------------------------------------------------------------------------

    def brake(self, t_ns: int) -> bool:
        """Decelerate along the line from now on; False when it rests already."""
        assert self.moving is not None
        ramp = brake(self.moving, t_ns)
        self.path.replace_last(t_ns)
        self.moving = self.path.add(ramp)
        return ramp.end_ns > ramp.start_ns

    def stop_dead(self, t_ns: int) -> None:
        """Pulses end now: the count freezes, the carriage coasts to rest."""
        if self.moving is not None and self.path.moving(t_ns) is not None:
            self._count = self._count_at(t_ns)
            coast = brake(self.moving, t_ns)
            self.path.replace_last(t_ns)
            self.path.add(coast)
            self._slip_mm = subtract(self.path.end_mm, self.count_mm())
        self.moving = None
        self._queue.clear()

    def catch(self, t_ns: int) -> None:
        """Motors that are driven again hold a carriage that still coasts from a reset."""
        if self.moving is None and self.path.moving(t_ns) is not None:
            self.path.replace_last(t_ns)
            self._slip_mm = subtract(self.path.end_mm, self.count_mm())

    def trips_ns(self, scatter: Callable[[float, float], float]) -> int | None:
        """When the piece under way meets a switch that it moves towards; None: it meets none.

        Each trips within SCATTER_MM of its place.
        """
        line = self.moving
        assert line is not None
        at_min, trips = int(self._settings[23]), []
        for axis, travel in enumerate(self.axes(130)):
            sign = -1.0 if at_min >> axis & 1 else 1.0  # towards its switch
            place = (-travel if at_min >> axis & 1 else 0.0) + scatter(-SCATTER_MM, SCATTER_MM)
            start, end = line.start_mm[axis], line.end_mm[axis]
            if (end - start) * sign > 0 and (end - place) * sign >= 0:
                trips.append(self._crossing_ns(line, axis, place, sign))
        return min(trips, default=None)

    # ---- homing -------------------------------------------------------------------------------

    def homing_legs(self, passes: Iterable[int]) -> Iterator[tuple[dict[int, float], float]]:
        """Goals by axis and the rate to them (mm/min), each twice. passes: masks of axes."""
        s = self._settings
        at_min, pull, seek, feed = int(s[23]), s[27], s[25], s[24]
        for mask in passes:
            axes = [axis for axis in range(3) if mask >> axis & 1]
            switch = {a: -s[130 + a] if at_min >> a & 1 else 0.0 for a in axes}
            clear = {a: p + pull if at_min >> a & 1 else p - pull for a, p in switch.items()}
            yield from ((switch, seek), (clear, seek), (switch, feed), (clear, seek))

    def seek(self, goal: Mapping[int, float], rate_mm_min: float, t_ns: int) -> bool:
        """Towards a goal, all axes at one rate, until the first is there; False: all are."""
        position = self.path.end_mm
        distances = {a: g - position[a] for a, g in goal.items() if g != position[a]}
        if not distances:
            return False
        shortest = min(abs(d) for d in distances.values())
        end = list(position)
        for a, d in distances.items():
            end[a] = goal[a] if abs(d) == shortest else position[a] + math.copysign(shortest, d)
        self._line_count += 1
        rate = rate_mm_min * math.sqrt(len(distances))
        self.moving = self._line_to((end[0], end[1], end[2]), rate, self._line_count, t_ns)
        return True

    def set_home(self, mask: int) -> None:
        """Set the count of these axes from their switches; others keep theirs."""
        steps = to_steps(self.path.end_mm, self.axes(100))
        x, y, z = (steps[k] if mask >> k & 1 else self._count[k] for k in range(3))
        self._count = (x, y, z)
        u, v, w = (0.0 if mask >> k & 1 else self._slip_mm[k] for k in range(3))
        self._slip_mm = (u, v, w)

    @staticmethod
    def _crossing_ns(line: Segment, axis: int, place_mm: float, sign: float) -> int:
        times = range(line.start_ns, line.end_ns)
        k = bisect_left(times, place_mm * sign, key=lambda t: line.position_mm(t)[axis] * sign)
        return line.start_ns + k

    # ---- inside -------------------------------------------------------------------------------

    def _place_mm(self, count: tuple[int, int, int]) -> Point:
        """Place of the carriage that belongs to a count of steps."""
        (x, y, z), (dx, dy, dz) = steps_to_mm(count, self.axes(100)), self._slip_mm
        return (x + dx, y + dy, z + dz)

    def _count_at(self, t_ns: int) -> tuple[int, int, int]:
        return to_steps(subtract(self.path.position_mm(t_ns), self._slip_mm), self.axes(100))

    def _arrive(self) -> None:
        self._count = self._queue.popleft().target_steps

    def _line_to(
        self, end_mm: Point, feed_mm_min: float, number: int, t_ns: int, start_mm_s: float = 0.0
    ) -> Segment:
        start = self.path.end_mm
        delta = subtract(end_mm, start)
        if not any(delta):
            return trapezoid(start, end_mm, 1.0, 1.0, t_ns, number)
        rate = rate_along(delta, self.axes(110))
        feed = min(feed_mm_min, rate)
        accel = rate_along(delta, self.axes(120))
        line = trapezoid(start, end_mm, feed / 60, accel, t_ns, number, start_mm_s)
        return self.path.add(line)
