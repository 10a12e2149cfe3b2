"""Runs the steps of a protocol on whatever rig it is given, and journals each of them.

An operator's interrupt (Ctrl-C, SIGTERM, SIGHUP) or any failure but the stage's own stops the
motion and lifts the tip; a second interrupt resets the controller and ends the process. An error
of the stage leaves it where it stopped, for its position may be lost.
Presses that the record holds complete are skipped; the first step of any other is reached by the
same move as in an undisturbed run, from where the step before it ended, so that it takes the same
time. What is driven again for that is not journalled again.

From the tare of a press to its end stage and force sensor are streams of their own: while it waits
for a frame or for the end of a move, the runner asks the stage ten times a second where it is and
takes what the force sensor has sent. A saturated sample, or one over the rig's limit, stops the run
then: up to 0.1 s and the reading of a position after it was measured, so this is no force guard.
The way out of the gel is not felt: no frame is taken on it, and a simulated gel would have to be
solved for it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress

from ...errors import DeltactFabError, RunFailed, SensorError, StageError
from ...protocols.plan import Step
from ...record import RunWriter
from ..interface import Devices, ForceSensor
from .interrupt import interruptible
from .streams import PressStreams

Progress = Callable[[int, int, str], None]
LIFT_FEED_MM_MIN = 120.0
# A frame at the end of a move is taken this long after the planned end, not when the host happens
# to hear of it: status reports differ in length with what was asked before, by milliseconds.
ARRIVAL_S = 0.1
# The firmware's documents ask for at most 10 status reports a second. A step goes on for as long
# after its last frame, so that the next one does not start when the host happens to be ready.
LOOK_NS = 100_000_000


class Runner:
    """One run of one protocol: connect, home, then every step in order that is still to be done."""

    def __init__(self, devices: Devices, writer: RunWriter, progress: Progress | None = None):
        self._d = devices
        self._writer = writer
        self._progress = progress or (lambda done, total, what: None)
        self._mounted = ""
        self._frame_ids: list[str] = []
        self._streams: PressStreams | None = None  # of the press under way, from its tare on
        self._felt: ForceSensor | None = None  # while it streams
        self._looked_ns = 0

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
                    self._event("homed", "positions are known")
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
                except StageError as why:
                    self._cut_off(step, "fault", str(why))
                    raise
                except BaseException as why:
                    # The tip may be in the gel: whatever went wrong, it is not left there.
                    lifted = self._lift(lift_to_mm)
                    stopped = isinstance(why, KeyboardInterrupt)
                    text = "by the operator" if stopped else str(why)
                    self._cut_off(step, "stop" if stopped else "fault", f"{text}; {lifted}")
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
        self._event("indenter", f"{step.indenter} mounted")

    def _step(self, step: Step, done: int, total: int, last: bool) -> int:
        """One step; last: of its press, which it completes."""
        d = self._d
        self._feel_or_not(step)
        start_ns = self._looked_ns = self._now_ns()
        planned_s = d.stage.start_move(step.target_mm, step.feed_mm_min)
        for k in range(1, step.frames):
            # Whole nanoseconds from the start of the move, so that a frame is taken at the same
            # pose at any time of day.
            self._until(step, start_ns + _ns(planned_s * k / step.frames))
            self._frame(step, k, start_ns)
            self._progress(done + k, total, step.id)
        self._arrive(step, start_ns, planned_s)
        if step.kind == "change":
            self._change(step)
        if step.id.endswith("/rest"):
            self._begin(step)
        if step.frames:
            self._until(step, self._now_ns() + _ns(step.settle_s))
            self._frame(step, step.frames, start_ns)
            self._progress(done + step.frames, total, step.id)
        if self._streams is not None and step.frames:
            self._until(step, self._looked_ns + LOOK_NS)
        self._feel(step)
        end_ns = self._now_ns()
        if last and d.camera is not None and step.kind != "change":
            d.camera.end(self._frame_ids)
        chunks = self._streams.take() if self._streams is not None else []
        self._writer.step(step, planned_s, start_ns / 1e9, end_ns / 1e9, chunks)
        if last and self._streams is not None:
            self._end(step)
        return step.frames

    def _arrive(self, step: Step, start_ns: int, planned_s: float) -> None:
        """Wait for the end of the move, then for the moment that its plan gives."""
        end_ns = start_ns + _ns(planned_s)
        self._until(step, end_ns)
        self._d.stage.wait()
        self._sleep_until(end_ns + _ns(ARRIVAL_S))

    def _until(self, step: Step, t_ns: int) -> None:
        """Let time pass; in a press look at the stage and the force sensor every LOOK_NS.

        Never within LOOK_NS of the end, where a frame may have the stage's position read.
        """
        while self._streams is not None:
            look_ns = max(self._looked_ns + LOOK_NS, self._now_ns())
            if look_ns + LOOK_NS > t_ns:
                break
            self._sleep_until(look_ns)
            self._locate()
            self._feel(step)
        self._sleep_until(t_ns)

    def _sleep_until(self, t_ns: int) -> None:
        left_ns = t_ns - self._now_ns()
        if left_ns > 0:
            self._d.clock.sleep_s(left_ns / 1e9)

    def _begin(self, step: Step) -> None:
        """Nothing touches: tare, flush, and start the streams of this press."""
        self._frame_ids = []
        if self._d.camera is not None:
            self._d.camera.begin(step.press)
        self._looked_ns = self._now_ns()
        self._streams = PressStreams(self._looked_ns)
        self._felt = self._d.force
        if self._felt is not None:
            self._felt.begin(step.press)
        self._event("begun", "tared" if self._felt is not None else "no force sensor", step)

    def _end(self, step: Step) -> None:
        """The press is complete: its streams end."""
        self._streams = None
        self._feel_no_more()
        self._event("complete", "", step)

    def _feel_or_not(self, step: Step) -> None:
        """The force sensor rests while the tip leaves the gel."""
        if step.kind == "retract":
            self._feel_no_more()
        elif self._streams is not None and self._felt is None and self._d.force is not None:
            self._felt = self._d.force
            self._felt.start()

    def _feel_no_more(self) -> None:
        felt, self._felt = self._felt, None
        if felt is not None:
            felt.stop()

    def _frame(self, step: Step, k: int, start_ns: int) -> None:
        assert self._streams is not None, "a press begins before its first frame"
        d = self._d
        t_ns = self._now_ns()
        frame = d.camera.capture() if d.camera is not None else None
        self._locate()
        if frame is not None:
            t_ns = _ns(frame.t_s)
        frame_id = self._writer.frame(
            step,
            k,
            frame.image if frame is not None else None,
            t_ns / 1e9,
            (t_ns - start_ns) / 1e9,
            self._streams.t_press_s(t_ns),
        )
        self._frame_ids.append(frame_id)
        self._feel(step)

    def _locate(self) -> None:
        """Where the stage says it is goes into the stream, with the time at which it was asked."""
        if self._streams is not None:
            self._looked_ns = self._now_ns()
            self._streams.pose(self._looked_ns, self._d.stage.position_mm())

    def _feel(self, step: Step) -> None:
        """What the force sensor has sent goes into the stream. Raises SensorError beyond limits."""
        if self._felt is None or self._streams is None:
            return
        samples = self._felt.read()
        if self._d.guard is not None:
            self._d.guard.watch(samples)
        self._streams.force(samples)
        if samples.lost:
            self._event("gap", f"{samples.lost} force samples are missing", step)
        force_n = samples.force_n
        if samples.saturated.any():
            found = tuple(force_n[samples.saturated.argmax()].tolist())
            raise SensorError(f"{step.id}: the force sensor is saturated at {found} N")
        if self._d.guard is not None and self._d.guard.tripped:
            raise SensorError(f"{step.id}: {self._d.guard.tripped}")

    def _event(self, kind: str, text: str, step: Step | None = None) -> None:
        self._writer.event(kind, text, self._d.clock.now_s(), step)

    def _cut_off(self, step: Step, kind: str, text: str) -> None:
        """Keep what the streams held when the run broke off; no error here hides the first one."""
        with suppress(DeltactFabError):
            if self._streams is not None:
                self._writer.cut_off(step, self._streams.take())
            self._event(kind, text, step)

    def _now_ns(self) -> int:
        return _ns(self._d.clock.now_s())

    def _lift(self, height_mm: float) -> str:
        """Stop, then straight up to the clearance plane; says what came of it."""
        stage = self._d.stage
        try:
            stage.stop()
            with suppress(DeltactFabError):  # a dead sensor does not leave the tip in the gel
                self._feel_no_more()
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
