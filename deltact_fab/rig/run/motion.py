"""The motion of a run: one step, the way to a press that is taken up, the way out of the gel."""

from __future__ import annotations

from collections.abc import Sequence

from ...errors import DeltactFabError
from ...protocols.plan import Step
from ...units import to_ns
from ..interface import LIFT_FEED_MM_MIN, Stage, rise
from .schedule import Schedule
from .streams import FrameRequest


class StageMotion:
    """Moves the stage by the steps of a protocol, and has the streams take what goes with them."""

    def __init__(self, stage: Stage, streams: Schedule) -> None:
        self._stage = stage
        self._streams = streams
        self._mounted = ""

    def take_up(self, steps: Sequence[Step], i: int) -> None:
        """Before the first step of a press: its indenter, and where the step before it ended.

        So that it is reached by the same move as in an undisturbed run, and takes the same time.
        What is driven again for that is not journalled again.
        """
        step, before = steps[i], steps[i - 1]
        if step.kind != "change" and step.indenter != self._mounted:
            change = next(s for s in steps if s.kind == "change" and s.indenter == step.indenter)
            self._go(change)
            self._change(change)
            if change == before:
                return
        # Both ends of this move are at or above the clearance plane.
        self._go(before)

    def step(self, step: Step, last: bool) -> None:
        """Carry out one step; last: of its press, which it completes."""
        streams = self._streams
        streams.enter(step)
        start_ns = streams.now_ns()
        planned_s = self._stage.start_move(step.target_mm, step.feed_mm_min)
        streams.set_out(step)
        filmed_s = planned_s + step.hold_s
        filmed_ns = to_ns(filmed_s)
        for k in range(1, step.frames):
            # Whole nanoseconds from the start of the move, so that a frame is taken at the same
            # pose at any time of day.
            at_ns = start_ns + to_ns(filmed_s * k / step.frames)
            streams.film(FrameRequest(step, k, at_ns, start_ns, filmed_ns // step.frames))
        streams.arrive(step, start_ns + filmed_ns)
        if step.kind == "change":
            self._change(step)
        if step.id.endswith("/rest"):
            streams.begin(step)
        if step.frames:
            at_ns = streams.now_ns() + to_ns(step.settle_s)
            streams.film(FrameRequest(step, step.frames, at_ns, start_ns))
        streams.complete(step)
        streams.finish(step, planned_s, start_ns, last)

    def lift(self, height_mm: float) -> str:
        """Stop, then straight up to the clearance plane; says what came of it.

        Nothing moves where the stage has lost its position, for it refuses to.
        """
        stage = self._stage
        try:
            stage.stop()
            with self._streams.lifting():
                rise(stage, height_mm, LIFT_FEED_MM_MIN)
        except KeyboardInterrupt:
            stage.stop()
            return "the lift was stopped by the operator"
        except DeltactFabError as why:
            return f"the tip could NOT be lifted: {why}"
        return "the tip was lifted"

    def rescue(self, height_mm: float) -> str:
        """After a fault of the stage: up to the clearance plane, where its count is kept."""
        try:
            with self._streams.lifting():
                if self._stage.rescue(height_mm, LIFT_FEED_MM_MIN):
                    return "the controller kept its count: the tip was lifted"
        except KeyboardInterrupt:
            self._stage.abort()
            return "the lift was stopped by the operator"
        except DeltactFabError as why:
            return f"the tip could NOT be lifted: {why}"
        return (
            "the tip was NOT lifted and may be in the gel: switch the motors off and turn z up by "
            "hand"
        )

    def _go(self, step: Step) -> None:
        self._streams.enter(step)
        planned_s = self._stage.start_move(step.target_mm, step.feed_mm_min)
        self._streams.reach(self._streams.now_ns() + to_ns(planned_s))

    def _change(self, step: Step) -> None:
        found = self._streams.change(step.indenter)
        self._mounted = step.indenter
        self._streams.event("indenter", found or f"{step.indenter} mounted")
