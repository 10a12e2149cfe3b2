"""A straight move under way, and how much of it the controller has been told yet.

A dead man: whatever stops the host, the controller goes on for what it was told and no further.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from operator import mul

from ...aliases import Vector
from ...protocols.motion import minus
from ..interface import StageState

AHEAD_S = 0.17  # in the gel; with a piece on its way, whose answer is lost, .22
AHEAD_CLEAR_S = 0.5  # where nothing is touched
PIECE_S = 0.05  # of motion in a line, at the feed
EXCUSED_S = 0.3  # after a host was late
SHORTEST_MM = 2e-4  # of a line: places have four decimals
FOLLOWED = 0.2  # of what it is behind, at each look


@dataclass(frozen=True)
class Move:
    """Machine places (mm), start (ns of the clock), planned time (s).

    ahead_s: no more motion than that is sent before it is due; infinite: all of it at once.
    sent_mm: of the way. late_ns: when a line was last sent so late that it braked.
    """

    start_mm: Vector
    target_mm: Vector
    feed_mm_min: float
    accel_mm_s2: float
    start_ns: int
    planned_s: float
    ahead_s: float
    sent_mm: float = 0.0
    late_ns: int = 0

    def since_s(self, now_ns: int) -> float:
        return (now_ns - self.start_ns) / 1e9

    @property
    def whole(self) -> bool:
        """Whether the controller knows all of it."""
        return self.sent_mm >= self._length_mm

    def due_mm(self, now_ns: int) -> float | None:
        """How far along its way the next line leads, None while none is due."""
        since_s = self.since_s(now_ns)
        due_mm = self._way_mm(since_s + self.ahead_s)
        if due_mm < self._length_mm:
            early_mm = self._way_mm(since_s + self.ahead_s - PIECE_S)
            if early_mm < self.sent_mm or due_mm < self.sent_mm + SHORTEST_MM:
                return None
        return None if self.whole else due_mm

    def first_mm(self) -> float:
        return max(self._way_mm(self.ahead_s), SHORTEST_MM)

    def place_mm(self, way_mm: float) -> Vector:
        """So far along it, as a line has it."""
        if way_mm >= self._length_mm:
            return self.target_mm
        share = way_mm / self._length_mm
        x, y, z = (
            round(a + share * (b - a), 4) + 0.0
            for a, b in zip(self.start_mm, self.target_mm, strict=True)
        )
        return (x, y, z)

    def runs_dry(self, now_ns: int, braking: bool = False) -> bool:
        """Whether the controller is at the end of what it was told; or brakes before it."""
        since_s, ahead_mm = self.since_s(now_ns), 0.0
        if braking:
            speed = min(self.feed_mm_min / 60, self.accel_mm_s2 * max(since_s, 0.0))
            ahead_mm = speed**2 / (2 * self.accel_mm_s2)
        return not self.whole and self._way_mm(since_s) + ahead_mm > self.sent_mm

    def seen(self, state: StageState) -> Move:
        """It, its plan moved towards where its controller was seen: their clocks may differ."""
        if self.whole:
            return self
        share = 1.0 if self._excused(state) else FOLLOWED
        return replace(self, start_ns=self.start_ns + round(share * 1e9 * self._behind_s(state)))

    def was_held(self, state: StageState, more_than_s: float) -> bool:
        """Whether somebody else ended a jog of it, and it goes on from rest with the next one."""
        if self.whole:
            return False
        dry = self.runs_dry(round(state.t_s * 1e9), braking=True)
        behind_s = self._behind_s(state) - state.within_s
        return behind_s > more_than_s and not dry and not self._excused(state)

    def again(self, from_mm: Vector, now_ns: int, planned_s: float) -> Move:
        """What is left of it, begun anew from rest."""
        return replace(
            self,
            start_mm=from_mm,
            start_ns=now_ns,
            planned_s=planned_s,
            sent_mm=0.0,
            late_ns=now_ns,
        )

    def _excused(self, state: StageState) -> bool:
        """Whether it is behind because the host was late."""
        return state.t_s - self.late_ns / 1e9 < EXCUSED_S + self.feed_mm_min / 60 / self.accel_mm_s2

    def _behind_s(self, state: StageState) -> float:
        gone = minus(state.machine_mm, self.start_mm)
        ahead = minus(self.target_mm, self.start_mm)
        gone_mm = sum(map(mul, gone, ahead)) / self._length_mm
        planned_mm = self._way_mm(state.t_s - self.start_ns / 1e9)
        return (planned_mm - gone_mm) / (self.feed_mm_min / 60)

    @property
    def _length_mm(self) -> float:
        return math.dist(self.start_mm, self.target_mm)

    def _way_mm(self, t_s: float) -> float:
        """Of its planned way after so long, braking left out."""
        if t_s <= 0:
            return 0.0
        if math.isinf(t_s):
            return self._length_mm
        speed = self.feed_mm_min / 60
        ramp_s = speed / self.accel_mm_s2
        way_mm = self.accel_mm_s2 * t_s**2 / 2 if t_s < ramp_s else speed * (t_s - ramp_s / 2)
        return min(way_mm, self._length_mm)
