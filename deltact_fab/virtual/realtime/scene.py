"""The gel while time passes by itself: nothing is solved, for that would take longer than it may.

The ways of a protocol were solved ahead, and along them the scene is that of lockstep. A stop on
such a way is between two knots. Off it, as on the way out of the gel, force and surface are those
of the last knot, scaled as Hertz' law has it with the depth. Where no press has begun, as in a
touch-off, the force is that of `bench_face`, and the face is drawn at rest.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ...aliases import Point
from ...optics import StageFrame
from ..motion import Segment
from ..scene import GelScene, Knot, MotionSegment, Observation

HERTZ = 1.5  # force goes with this power of the depth
OFF_PLAN, BARE = -1, -2  # keys of knots that no one solved; of a bare face nothing is drawn
OFF_LINE_MM = 1e-3
Wrench = Callable[[Point], NDArray[np.float64]]


class LiveScene(GelScene):
    """A GelScene that guesses what was not solved; one thread at a time.

    felt: force (N) and torque (N mm), (6,), of a bare face with the carriage there, machine mm;
    None: nothing is felt off the plan. near_mm: how far a line's end may be from a planned one that
    stands for it, where a touch-off has found the face.
    """

    felt: Wrench | None = None
    near_mm = 0.0
    guessed = 0
    _bare = False
    _seen_ns = 0

    def set_frame(self, frame: StageFrame) -> None:
        """Where the face truly is for the tool that is mounted."""
        self._frame = frame

    def observe(self) -> Observation:
        """As in lockstep."""
        self._seen_ns = max(self._seen_ns, self._clock.now_ns())
        return super().observe()

    def wrenches(self, t_ns: NDArray[np.int64]) -> NDArray[np.float64]:
        """As in lockstep; a time that was passed already, by milliseconds, counts as the last."""
        at_ns = np.maximum(t_ns, self._seen_ns)
        self._seen_ns = int(at_ns[-1])
        return super().wrenches(at_ns)

    def _along(self, segment: Segment, t_ns: NDArray[np.int64]) -> NDArray[np.float64]:
        found = super()._along(segment, t_ns)
        if not self._bare:
            return found
        return self._bare_at([segment.position_mm(int(t)) for t in t_ns])

    def _still(self, t_ns: NDArray[np.int64]) -> NDArray[np.float64]:
        if self._here.key != BARE:
            return super()._still(t_ns)
        found = self._bare_at([self._controller.position_mm()])
        return np.repeat(found, len(t_ns), axis=0)

    def _bare_at(self, places: Sequence[Point]) -> NDArray[np.float64]:
        if self.felt is None:
            return np.zeros((len(places), 6))
        return np.stack([self.felt(place) for place in places])

    def _line_of(self, segment: Segment) -> MotionSegment:
        before = self._line
        line = super()._line_of(segment)
        if before is None:  # else it is the same, or what a stop left of it
            self._bare = self._is_bare(line)
        return line

    def _is_bare(self, line: MotionSegment) -> bool:
        """Whether it starts off the gel, or leads into it where no press was planned."""
        start = line.knots[0]
        deep = next((tip for tip in line.where if tip[2] < 0), None)
        if start.key == 0 and deep is not None:
            return not self._is_next(start, deep)
        return start.key == BARE

    def _is_next(self, before: Knot, tip: Point) -> bool:
        """Whether the knot at tip is the planned one after `before`, and is known."""
        planned = self._next_tip(before)
        return planned is not None and planned == tip

    def _next_tip(self, before: Knot) -> Point | None:
        if self._press is None or not 0 <= before.key < len(self._press.solver.knots):
            return None
        return self._press.solver.poses[before.key].tip_mm

    def _solve_up_to(self, line: MotionSegment, last: int) -> None:
        while len(line.knots) <= last:
            k = len(line.knots)
            before, tip = line.knots[-1], line.where[k]
            if tip[2] >= 0:
                line.knots.append(self._rest)
            elif self._bare:
                line.knots.append(replace(self._rest, key=BARE))
            elif self._is_next(before, tip):
                assert self._press is not None
                line.knots.append(self._knot(self._press.solver.next(before.key, tip, 0.0)))
            else:
                line.knots.append(self._off_plan(before, line.where[k - 1], tip))

    def _off_plan(self, before: Knot, at: Point, tip: Point) -> Knot:
        """On the way to the next planned knot what lies between; elsewhere what the depth says."""
        planned = self._next_tip(before)
        if planned is not None and (way_mm := math.dist(at, planned)) > 0:
            part = math.dist(at, tip) / way_mm
            between = [a + part * (b - a) for a, b in zip(at, planned, strict=True)]
            if part <= 1 and math.dist(between, tip) < OFF_LINE_MM:
                assert self._press is not None
                after = self._knot(self._press.solver.next(before.key, planned, 0.0))
                return self._guess(before, after, part)
        deeper = (tip[2] / at[2]) ** HERTZ if at[2] < 0 else 0.0
        return self._guess(self._rest, before, deeper)

    def _guess(self, a: Knot, b: Knot, part: float) -> Knot:
        """A knot that is `part` of the way from one to another."""
        wrench = [p + part * (q - p) for p, q in zip(a.wrench, b.wrench, strict=True)]
        fields = (
            None if p is None or q is None else p + np.float32(part) * (q - p)
            for p, q in ((a.displacement_mm, b.displacement_mm), (a.traction_mpa, b.traction_mpa))
        )
        field, traction = fields
        x, y, z, u, v, w = wrench
        knot = Knot(len(self.knots), OFF_PLAN, field, (x, y, z), (u, v, w), traction)
        self.knots.append(knot)
        self.guessed += 1
        return knot

    def _planned(self, machine_mm: Point) -> Point:
        """A planned point of the press where one is near enough."""
        point = self._frame.to_sensor_mm(machine_mm)
        if self._press is None or self.near_mm == 0.0:
            return super()._planned(machine_mm)
        near = min(self._press.waypoints, key=lambda p: math.dist(p, point), default=point)
        return near if math.dist(near, point) <= self.near_mm else point
