"""What an operator sees of a run while it goes on."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass

from ...protocols.plan import Step
from ...units import duration

PRIOR_S = 10.0  # so much of the plan is believed before anything was measured
FRAME_MM = 0.05  # a simulated frame takes about as long as so much way through the gel


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
    """Wall time that is left, by what the steps before took.

    On the wall clock that is the plan's time, times how much longer than planned it took so far.
    In lockstep a way through the air takes none, and one through the gel is solved: steps of a kind
    take as long for a mm as those before; kinds that have not come yet, as the others.
    """

    def __init__(
        self, steps: Sequence[Step], todo: Sequence[int], wall_clock: bool, change_s: float = 0.0
    ) -> None:
        """todo: places of the steps that are carried out. wall_clock: the plan's time is real.

        change_s: what another indenter takes beside the way there.
        """
        self._kind = {i: "" if wall_clock else steps[i].kind for i in todo}
        self._amount = {
            i: _planned_s(steps, i) + change_s * (steps[i].kind == "change")
            if wall_clock else _in_gel_mm(steps, i) + FRAME_MM * steps[i].frames
            for i in todo
        }  # fmt: skip
        kinds = set(self._kind.values())
        self._left = {k: sum(self._amount[i] for i in todo if self._kind[i] == k) for k in kinds}
        self._done = dict.fromkeys(kinds, PRIOR_S if wall_clock else 0.0)
        self._took_s = self._done.copy()
        self._since_s = time.monotonic()

    def start(self) -> None:
        """The first step starts now: what came before it says nothing of the steps."""
        self._since_s = time.monotonic()

    def finished(self, i: int) -> None:
        """A step is over."""
        kind, amount, now_s = self._kind[i], self._amount[i], time.monotonic()
        if amount:
            self._left[kind] -= amount
            self._done[kind] += amount
            self._took_s[kind] += now_s - self._since_s
        self._since_s = now_s

    def left_s(self) -> float | None:
        """As it is now; what the step under way took is not yet of the measure."""
        done = sum(self._done.values())
        if not done:
            return None
        pace = sum(self._took_s.values()) / done
        left_s = sum(
            left * (self._took_s[kind] / self._done[kind] if self._done[kind] else pace)
            for kind, left in self._left.items()
        )
        return max(left_s - (time.monotonic() - self._since_s), 0.0)


def _planned_s(steps: Sequence[Step], i: int) -> float:
    step, before = steps[i], steps[i - 1] if i else steps[i]
    way_mm = math.dist(before.target_mm, step.target_mm)
    return way_mm / step.feed_mm_min * 60 + step.hold_s + step.settle_s + 0.1


def _in_gel_mm(steps: Sequence[Step], i: int) -> float:
    """Of the way of a step, what lies below the resting face."""
    here, there = steps[i - 1].target_mm if i else steps[i].target_mm, steps[i].target_mm
    top_mm, bottom_mm = max(here[2], there[2]), min(here[2], there[2])
    if bottom_mm >= 0:
        return 0.0
    share = 1.0 if top_mm <= 0 else -bottom_mm / (top_mm - bottom_mm)
    return share * math.dist(here, there)
