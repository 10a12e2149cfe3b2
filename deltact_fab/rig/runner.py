"""Runs the steps of a protocol on whatever rig it is given, and journals each of them.

An operator's interrupt (Ctrl-C, SIGTERM, SIGHUP) or any failure but the stage's own stops the
motion and lifts the tip; a second interrupt resets the controller and ends the process. An error
of the stage leaves it where it stopped, for its position may be lost.
Presses that the record holds complete are skipped; the first step of any other is reached by the
same move as in an undisturbed run, from where the step before it ended, so that it takes the same
time. What is driven again for that is not journalled again.
Forces are read with the frames, so this is no force guard: between two frames nobody looks.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

from ..errors import DeltactFabError, RunFailed, SensorError, StageError
from ..protocols.plan import Step
from ..record import RunWriter
from .interface import Devices
from .interrupt import interruptible

Progress = Callable[[int, int, str], None]
LIFT_FEED_MM_MIN = 120.0
# A frame at the end of a move is taken this long after the planned end, not when the host happens
# to hear of it: status reports differ in length with what was asked before, by milliseconds.
ARRIVAL_S = 0.1


class Runner:
    """One run of one protocol: connect, home, then every step in order that is still to be done."""

    def __init__(self, devices: Devices, writer: RunWriter, progress: Progress | None = None):
        self._d = devices
        self._writer = writer
        self._progress = progress or (lambda done, total, what: None)
        self._mounted = ""
        self._frame_ids: list[str] = []

    def run(self, steps: Sequence[Step]) -> int:
        """Carry out the steps of all presses that the writer has not kept.

        Nothing moves when there are none. Returns the number of frames taken. Raises RunFailed
        and its kin.
        """
        total = sum(s.frames for s in steps)
        lift_to_mm = min(s.target_mm[2] for s in steps if s.kind == "travel")
        todo = [i for i, s in enumerate(steps) if s.press not in self._writer.kept]
        kept = done = total - sum(steps[i].frames for i in todo)
        before = -1
        stage = self._d.stage
        with interruptible(stage.abort):
            try:
                stage.connect()
                if todo:
                    stage.home()
            except KeyboardInterrupt as why:
                stage.stop()
                raise RunFailed("stopped by the operator before the first step") from why
            for i in todo:
                step = steps[i]
                try:
                    if before != i - 1:
                        self._take_up(steps, i)
                    last = i + 1 == len(steps) or steps[i + 1].press != step.press
                    done += self._step(step, done, total, last)
                    before = i
                except StageError:
                    raise
                except BaseException as why:
                    # The tip may be in the gel: whatever went wrong, it is not left there.
                    lifted = self._lift(lift_to_mm)
                    if isinstance(why, KeyboardInterrupt):
                        raise RunFailed(
                            f"stopped by the operator in {step.id}; {lifted}; complete presses "
                            "are kept: go on with --resume"
                        ) from why
                    if isinstance(why, DeltactFabError):
                        raise type(why)(f"{why} ({lifted})") from why
                    raise
        return done - kept

    def _take_up(self, steps: Sequence[Step], i: int) -> None:
        """Before the first step of a press: its indenter, and where the step before it ended."""
        step, before = steps[i], steps[i - 1]
        if step.kind != "change" and step.indenter != self._mounted:
            change = next(s for s in steps if s.kind == "change" and s.indenter == step.indenter)
            self._go(change)
            self._change(change)
            if change == before:
                return
        # Both ends of this move are at or above the clearance plane.
        self._go(before)

    def _go(self, step: Step) -> None:
        self._d.stage.start_move(step.target_mm, step.feed_mm_min)
        self._d.stage.wait()

    def _change(self, step: Step) -> None:
        self._d.change_indenter(step.indenter)
        self._mounted = step.indenter

    def _step(self, step: Step, done: int, total: int, last: bool) -> int:
        """One step; last: of its press, which it completes."""
        d = self._d
        start_s = d.clock.now_s()
        start_ns = _ns(start_s)
        planned_s = d.stage.start_move(step.target_mm, step.feed_mm_min)
        if step.kind in ("press", "shear") and step.frames and not step.settle_s:
            for k in range(1, step.frames + 1):
                # Whole nanoseconds from the start of the move, so that a frame is taken at the
                # same pose at any time of day.
                wait_ns = start_ns + _ns(planned_s * k / step.frames) - _ns(d.clock.now_s())
                if k == step.frames:
                    self._arrive(start_ns, planned_s)
                elif wait_ns > 0:
                    d.clock.sleep_s(wait_ns / 1e9)
                self._frame(step, k, start_s)
                self._progress(done + k, total, step.id)
        else:
            self._arrive(start_ns, planned_s)
            if step.kind == "change":
                self._change(step)
            if step.id.endswith("/rest"):
                self._begin(step.press)
            if step.frames:
                d.clock.sleep_s(step.settle_s)
                self._frame(step, 1, start_s)
                self._progress(done + 1, total, step.id)
        end_s = d.clock.now_s()
        if last and d.camera is not None and step.kind != "change":
            d.camera.end(self._frame_ids)
        self._writer.step(step, planned_s, start_s, end_s)
        return step.frames

    def _arrive(self, start_ns: int, planned_s: float) -> None:
        """Wait for the end of the move, then for the moment that its plan gives."""
        self._d.stage.wait()
        left_ns = start_ns + _ns(planned_s) + _ns(ARRIVAL_S) - _ns(self._d.clock.now_s())
        if left_ns > 0:
            self._d.clock.sleep_s(left_ns / 1e9)

    def _begin(self, press: str) -> None:
        """Nothing touches: tare, flush, and start the streams of this press."""
        self._frame_ids = []
        if self._d.camera is not None:
            self._d.camera.begin(press)
        if self._d.force is not None:
            self._d.force.begin(press)

    def _frame(self, step: Step, k: int, start_s: float) -> None:
        d = self._d
        t_s = d.clock.now_s()
        frame = d.camera.capture() if d.camera is not None else None
        reading = d.force.read() if d.force is not None else None
        position_mm = d.stage.position_mm()
        t_s = frame.t_s if frame is not None else t_s
        frame_id = self._writer.frame(
            step,
            k,
            frame.image if frame is not None else None,
            t_s,
            (_ns(t_s) - _ns(start_s)) / 1e9,
            position_mm,
            reading.force_n if reading is not None else None,
            reading.torque_nmm if reading is not None else None,
        )
        self._frame_ids.append(frame_id)
        if reading is None:
            return
        if reading.saturated:
            raise SensorError(f"{step.id}: the force sensor is saturated at {reading.force_n} N")
        limit_n = d.force_limit_n
        peak_n = max(abs(f) for f in reading.force_n)
        if limit_n is not None and peak_n > limit_n:
            raise SensorError(f"{step.id}: force {peak_n:.2f} N over the rig's limit {limit_n} N")

    def _lift(self, height_mm: float) -> str:
        """Stop, then straight up to the clearance plane; says what came of it."""
        stage = self._d.stage
        try:
            stage.stop()
            x, y, z = stage.position_mm()
            stage.start_move((x, y, max(z, height_mm)), LIFT_FEED_MM_MIN)
            stage.wait()
        except KeyboardInterrupt:
            stage.stop()
            return "the lift was stopped by the operator"
        except DeltactFabError as why:
            return f"the tip could NOT be lifted: {why}"
        return "the tip was lifted"


def _ns(seconds: float) -> int:
    return round(seconds * 1e9)
