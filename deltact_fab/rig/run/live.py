"""What an operator sees of a run while it goes on."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass

from ...protocols.plan import Step
from ...units import duration

PRIOR_S = 10.0  # so much of the plan is believed before anything was measured
START_MM = 0.5  # a simulated step in the gel takes as long as so much more way: measured


@dataclass(frozen=True)
class Live:
    """One look: where the run is, what the sensor feels, what was lost, what is left."""

    step: str
    done: int  # frames, of total
    total: int
    force_n: tuple[float, float, float] | None
    late: int
    lost: int  # frames that will not come, and those that the camera dropped
    left_s: float | None  # wall time; None before it can be told

    def line(self) -> str:
        """All of it in a line; force as z of the sensor has it, a press below zero."""
        parts = [self.step]
        if self.force_n is not None:
            parts.append(f"Fz {self.force_n[2]:+.2f} N")
        if self.late or self.lost:
            parts.append(f"{self.late} late, {self.lost} lost")
        if self.left_s is not None:
            parts.append(f"{duration(self.left_s)} left")
        return "  ".join(parts)


class Remaining:
    """Wall time that is left: the plan's, times how much longer than planned it took so far.

    In lockstep the plan is the way through the gel, which is solved; one through the air is free.
    """

    def __init__(
        self, steps: Sequence[Step], todo: Sequence[int], wall_clock: bool, change_s: float = 0.0
    ) -> None:
        """todo: places of the steps that are carried out. wall_clock: the plan's time is real.

        change_s: what another indenter takes beside the way there.
        """
        self._planned_s = {
            i: _planned_s(steps, i) + change_s * (steps[i].kind == "change")
            if wall_clock else _in_gel_mm(steps, i)
            for i in todo
        }  # fmt: skip
        self._left_s = sum(self._planned_s.values())
        self._done_s = PRIOR_S if wall_clock else 0.0
        self._took_s = self._done_s
        self._since_s = time.monotonic()

    def start(self) -> None:
        """The first step starts now: what came before it says nothing of the steps."""
        self._since_s = time.monotonic()

    def finished(self, i: int) -> None:
        """A step is over."""
        planned_s, now_s = self._planned_s[i], time.monotonic()
        if planned_s:
            self._left_s -= planned_s
            self._done_s += planned_s
            self._took_s += now_s - self._since_s
        self._since_s = now_s

    def left_s(self) -> float | None:
        """As it is now; what the step under way took is not yet of the measure."""
        if not self._done_s:
            return None
        left_s = self._left_s * self._took_s / self._done_s
        return max(left_s - (time.monotonic() - self._since_s), 0.0)


def _planned_s(steps: Sequence[Step], i: int) -> float:
    step, before = steps[i], steps[i - 1] if i else steps[i]
    way_mm = math.dist(before.target_mm, step.target_mm)
    return way_mm / step.feed_mm_min * 60 + step.hold_s + step.settle_s + 0.1


def _in_gel_mm(steps: Sequence[Step], i: int) -> float:
    """Of a step that ends in the gel, what of its way lies below the face, and START_MM."""
    here, there = (steps[j].target_mm for j in (max(i - 1, 0), i))
    if there[2] >= 0:
        return 0.0
    share = 1.0 if here[2] <= 0 else -there[2] / (here[2] - there[2])
    return START_MM + share * math.dist(here, there)
