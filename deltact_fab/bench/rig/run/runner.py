"""Runs the steps of a protocol on a rig, and journals each of them.

An operator's interrupt (Ctrl-C, SIGTERM, SIGHUP) or any failure stops the motion and lifts the tip
until nothing is felt; a second interrupt resets the controller and ends the process. After a fault
that loses the position the tip is lifted only if the controller kept its count. Complete presses of
the record are skipped. Data recorded before a failure are kept. Between two presses a run can be
paused, by an operator (Ctrl-Z, SIGUSR1) or a monitor: the tip stays where it is, above the face,
and the rig homed.
"""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Sequence
from concurrent.futures import Future, wait
from contextlib import suppress
from dataclasses import dataclass

from deltact_fab.common import (
    DeltactFabError,
    Progress,
    StageError,
    Stopped,
    format_duration,
    to_ns,
)

from ...protocols.plan import Step
from ...record.writer import RunWriter
from ..interface import Devices, OpenBench
from .contact import end_contact
from .loop import interruptible, write_from_handler
from .schedule import N_DROPPED, N_LATE, N_MISSED, N_TAKEN, N_UNWRITTEN, Schedule
from .streams import FrameRequest
from .wallclock import ThreadedSchedule

PAUSED_BY_HAND = "by the operator; Ctrl-Z or SIGUSR1 continues"
_PAUSE_WORDS = b"deltact-fab: pauses before the next press; Ctrl-Z or SIGUSR1 takes it back\n"
_CLEAR_LINE = b"\r\x1b[2K"  # of a progress bar
RESUME_HINT = "complete presses are kept: continue with --resume"
PRIOR_PLAN_S = 10.0  # by hand: weight of the plan before any step was timed
GEL_STEP_MM = 0.5  # overhead of a simulated step, as path; measured (commit 34b20c4b)
QUICK_ANSWER_S = 0.05  # by hand: of a decision that needs no pause

EndDecision = Callable[[Sequence[str]], tuple[bool, str]]
"""Decision if a run ends before its plan does, by the names of its complete presses.

Returns True to end it, and a text for the journal, empty for none. Called between two presses and
after the last, in a thread of its own if the rig is open."""


class Runner:
    """One run of one protocol: connect, home, then the remaining steps in order.

    progress: called with frames done, total and step. live: called with a RunProgress. decide: see
    `EndDecision`.
    """

    def __init__(
        self,
        devices: Devices,
        writer: RunWriter,
        progress: Progress | None = None,
        live: Callable[[RunProgress], None] | None = None,
        decide: EndDecision | None = None,
    ) -> None:
        self._d = devices
        self._writer = writer
        self._progress = progress or (lambda n_done, total, step: None)
        self._live = live
        self._decide = decide
        kind = ThreadedSchedule if devices.wall_clock else Schedule
        self._streams: Schedule = kind(devices, writer, self._report)
        self._stage = devices.stage
        self._mounted = ""
        self._pausing = False  # wanted by the operator
        self._paused = ""  # reasons of the present pause
        self._n_resumed = self._total = 0  # frames
        self._remaining: RemainingTime | None = None

    def run(self, steps: Sequence[Step]) -> int:
        """Carry out the steps of all presses that the writer lacks, and count the frames taken.

        Without any nothing moves. Raises RunFailed and its subclasses.
        """
        self._total = sum(s.frames for s in steps)
        lift_to_mm = min(s.target_mm[2] for s in steps if s.kind == "travel")
        todo = [i for i, s in enumerate(steps) if s.press not in self._writer.kept_presses]
        self._n_resumed = self._total - sum(steps[i].frames for i in todo)
        self._remaining = RemainingTime(steps, todo, self._d.wall_clock, self._d.change_s)
        with interruptible(self._stage.abort, self._toggle_pause):
            try:
                # Of an earlier session: its end may be decided, and then nothing moves.
                if self._ends(steps, todo[0] if todo else len(steps), waiting=False):
                    todo = []
                self._set_up([steps[i] for i in todo])
                previous = -1
                for i in todo:
                    last = i + 1 == len(steps) or steps[i + 1].press != steps[i].press
                    if self._run_step(steps, i, i != previous + 1, last, lift_to_mm):
                        break
                    previous = i
                self._writer.flush()
            finally:
                for name in self._streams.close():
                    with suppress(DeltactFabError):
                        self._streams.event("fault", f"{name}: thread did not end")
        return self._streams.counts[N_TAKEN]

    def counts(self) -> dict[str, int]:
        """Number of frames late, missed, unwritten, dropped or repeated, without zeros."""
        counts = sorted(self._streams.counts.items())
        return {kind: n for kind, n in counts if kind != N_TAKEN and n}

    def _set_up(self, steps: Sequence[Step]) -> None:
        """Connect, judge all moves, arm the guard, home. An error leaves the stage as it is."""
        stage, streams = self._stage, self._streams
        try:
            stage.connect()
            stage.check_moves((step.target_mm, step.feed_mm_min) for step in steps)
            if steps:
                if self._d.begin is not None:
                    streams.event("begin", self._d.begin())
                streams.open()
                try:
                    stage.home()
                except StageError:
                    streams.check()  # the cause, rather than its consequence
                    raise
                streams.check()
                streams.event("homed", "positions are known")
        except KeyboardInterrupt as error:
            stage.stop()
            raise Stopped("stopped by the operator before the first step") from error
        assert self._remaining is not None
        self._remaining.start()

    def _run_step(
        self, steps: Sequence[Step], i: int, take_up: bool, last: bool, lift_to_mm: float
    ) -> bool:
        """Run one step; True if the run ends before it, or after the last one.

        On a failure lift the tip and journal the reason.
        """
        step = steps[i]
        try:
            try:
                if steps[i - 1].press != step.press or not i:
                    if self._ends(steps, i):
                        return True
                    self._pause(step.press)
                if take_up:
                    self._resume_at(steps, i)
                self._carry_out(step, last)
            except StageError:
                self._streams.check()  # the cause, if another thread stopped the stage
                raise
            assert self._remaining is not None
            self._remaining.finished(i)
            return i + 1 == len(steps) and self._ends(steps, i + 1)
        except BaseException as error:
            # The tip may be in the gel: lift it after any error.
            lifted = self._lift(lift_to_mm)
            stopped = isinstance(error, KeyboardInterrupt)
            text = "by the operator" if stopped else str(error)
            self._cut_off(step, "stop" if stopped else "fault", f"{text}; {lifted}")
            if isinstance(error, KeyboardInterrupt):
                text = f"stopped by the operator in {step.id}; {lifted}; {RESUME_HINT}"
                raise Stopped(text) from error
            if isinstance(error, DeltactFabError):
                raise type(error)(f"{error} ({lifted})") from error
            raise

    def _toggle_pause(self) -> None:
        """Begin or end a pause by the operator; called in a signal handler."""
        self._pausing = not self._pausing
        if self._pausing:
            write_from_handler(_CLEAR_LINE, _PAUSE_WORDS)

    def _ends(self, steps: Sequence[Step], i: int, waiting: bool = True) -> bool:
        """Decide if the run ends before a step; journal the decision. Nothing moves meanwhile.

        waiting: with the rig open; stage and guard are watched as in a pause.
        """
        if self._decide is None:
            return False
        decide, answer = self._decide, Future[tuple[bool, str]]()
        presses = list(dict.fromkeys(s.press for s in steps[:i] if s.kind != "change"))

        def work() -> None:
            try:
                answer.set_result(decide(presses))
            except BaseException as error:
                answer.set_exception(error)

        if waiting:
            since_s = time.monotonic()
            self._paused = f"estimate after {len(presses)} presses"
            # A daemon, as a stop must not wait for it.
            threading.Thread(target=work, name="decision", daemon=True).start()
            while wait([answer], QUICK_ANSWER_S).not_done:
                self._streams.wait_paused()
            self._paused = ""
            assert self._remaining is not None
            self._remaining.leave_out(time.monotonic() - since_s)
        else:
            work()
        ends, text = answer.result()
        if text:
            self._streams.event("decision", text)
            self._writer.flush()  # a kill from here on repeats no decision
        if ends:
            self._writer.skipped = tuple(dict.fromkeys(step.press for step in steps[i:]))
        return ends

    def _pause(self, press: str) -> None:
        """Wait before a press while the operator or a monitor asks for it; nothing moves."""
        noted: set[str] = set()
        since_s = time.monotonic()
        assert self._remaining is not None
        while True:
            by_monitor = self._streams.pause_reasons()
            reasons = ({"": PAUSED_BY_HAND} if self._pausing else {}) | (by_monitor or {})
            for key in reasons.keys() - noted:
                self._streams.notify("paused", f"before {press}: {reasons[key]}")
            noted |= reasons.keys()
            self._paused = "; ".join(reasons.values())
            if not reasons and by_monitor is not None:
                break
            self._streams.wait_paused()
        paused_s = time.monotonic() - since_s
        self._remaining.leave_out(paused_s)
        if noted:
            self._streams.notify("continued", f"{press}, after {format_duration(paused_s)}")

    def _resume_at(self, steps: Sequence[Step], i: int) -> None:
        """Mount the indenter of a press and go to the end of the step before it.

        Then its first move is the same as in an uninterrupted run. These moves are not journalled.
        """
        step, previous = steps[i], steps[i - 1]
        if step.kind != "change" and step.indenter != self._mounted:
            change = next(s for s in reversed(steps[:i]) if s.kind == "change")
            self._go(change)
            self._change(change)
            if change == previous:
                return
        # Both ends of this move are at or above the clearance plane.
        self._go(previous)

    def _carry_out(self, step: Step, last: bool) -> None:
        """Carry out one step; last: it completes its press."""
        streams = self._streams
        streams.enter(step)
        start_ns = streams.now_ns()
        planned_s = self._stage.start_move(step.target_mm, step.feed_mm_min)
        streams.move_sent(step)
        filmed_s = planned_s + step.hold_s
        filmed_ns = to_ns(filmed_s)
        for k in range(1, step.frames):
            # Whole nanoseconds from the start of the move, so that the pose of a frame does not
            # depend on the time of day.
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

    def _lift(self, height_mm: float) -> str:
        """End a contact, at least at the clearance plane; return the outcome."""
        with self._streams.lifting() as felt_n:
            return end_contact(self._stage, felt_n, self._d.contact_n, height_mm)

    def _go(self, step: Step) -> None:
        self._streams.enter(step)
        planned_s = self._stage.start_move(step.target_mm, step.feed_mm_min)
        self._streams.reach(self._streams.now_ns() + to_ns(planned_s))

    def _change(self, step: Step) -> None:
        report = self._streams.change(step.indenter)
        self._mounted = step.indenter
        self._streams.event("indenter", report or f"{step.indenter} mounted")

    def _report(self, step: Step) -> None:
        counts = self._streams.counts
        n_done = self._n_resumed + counts[N_TAKEN] + counts[N_MISSED] + counts[N_UNWRITTEN]
        name = f"paused: {self._paused}" if self._paused else step.id
        self._progress(n_done, self._total, name)
        if self._live is not None and self._remaining is not None:
            n_lost = counts[N_MISSED] + counts[N_UNWRITTEN] + counts[N_DROPPED]
            force, now_ns = self._streams.force, self._streams.now_ns()
            force_n = force.newest_n(now_ns) if force is not None else None
            left_s = None if self._paused else self._remaining.left_s()
            n = n_done, self._total
            self._live(RunProgress(name, *n, force_n, counts[N_LATE], n_lost, left_s))

    def _cut_off(self, step: Step, kind: str, text: str) -> None:
        """Record pending data of an interrupted run; errors here are suppressed."""
        for keep in (
            lambda: self._streams.cut_off(step),
            lambda: self._streams.event(kind, text, step),
            self._writer.flush,
        ):
            with suppress(DeltactFabError):
                keep()


@dataclass(frozen=True)
class RunProgress:
    """State of a run: step, frames, force, remaining time."""

    step: str  # or "paused: " with the reason
    frames_done: int  # of frames_total
    frames_total: int
    force_n: tuple[float, float, float] | None
    frames_late: int
    frames_lost: int  # missed, unwritten or dropped by the camera
    left_s: float | None  # wall time; None until it can be estimated, and in a pause

    def line(self) -> str:
        """Return a status line; Fz in the sensor's z, negative in a press."""
        parts = [self.step]
        if self.force_n is not None:
            parts.append(f"Fz {self.force_n[2]:+.2f} N")
        if self.frames_late or self.frames_lost:
            parts.append(f"{self.frames_late} late, {self.frames_lost} lost")
        if self.left_s is not None:
            parts.append(f"{format_duration(self.left_s)} left")
        return "  ".join(parts)


class RemainingTime:
    """Remaining wall time: planned time times the ratio of elapsed to planned time so far.

    In lockstep the path inside the gel stands for time, because only that is solved.
    """

    def __init__(
        self, steps: Sequence[Step], todo: Sequence[int], wall_clock: bool, change_s: float = 0.0
    ) -> None:
        """todo: indices of the steps to carry out. wall_clock: real time, no lockstep.

        change_s: duration of a change of indenter without its travel.
        """
        self._planned_s = {
            i: _planned_s(steps, i) + change_s * (steps[i].kind == "change")
            if wall_clock else _in_gel_mm(steps, i)
            for i in todo
        }  # fmt: skip
        self._left_s = sum(self._planned_s.values())
        self._done_s = PRIOR_PLAN_S if wall_clock else 0.0
        self._took_s = self._done_s
        self._since_s = time.monotonic()

    def start(self) -> None:
        """Start timing at the first step."""
        self._since_s = time.monotonic()

    def finished(self, i: int) -> None:
        """Account for a finished step."""
        planned_s, now_s = self._planned_s[i], time.monotonic()
        if planned_s:
            self._left_s -= planned_s
            self._done_s += planned_s
            self._took_s += now_s - self._since_s
        self._since_s = now_s

    def left_s(self) -> float | None:
        """Estimate the remaining time (s); the present step counts once it is finished."""
        if not self._done_s:
            return None
        left_s = self._left_s * self._took_s / self._done_s
        return max(left_s - (time.monotonic() - self._since_s), 0.0)

    def leave_out(self, pause_s: float) -> None:
        """Take a pause that has just ended out of the times."""
        self._since_s += pause_s


def _planned_s(steps: Sequence[Step], i: int) -> float:
    step, previous = steps[i], steps[i - 1] if i else steps[i]
    path_mm = math.dist(previous.target_mm, step.target_mm)
    return path_mm / step.feed_mm_min * 60 + step.hold_s + step.settle_s + 0.1


def _in_gel_mm(steps: Sequence[Step], i: int) -> float:
    """Path below the face of a step that ends in the gel, plus GEL_STEP_MM."""
    start_mm, end_mm = (steps[j].target_mm for j in (max(i - 1, 0), i))
    if end_mm[2] >= 0:
        return 0.0
    share = 1.0 if start_mm[2] <= 0 else -end_mm[2] / (start_mm[2] - end_mm[2])
    return GEL_STEP_MM + share * math.dist(start_mm, end_mm)


def carry_out_steps(
    bench: OpenBench | Devices,
    steps: Sequence[Step],
    writer: RunWriter,
    progress: Progress | None = None,
    live: Callable[[RunProgress], None] | None = None,
    decide: EndDecision | None = None,
) -> tuple[dict[str, int], float]:
    """Carry out steps with the stage, or with weights placed by hand, and record them.

    live: called with the progress. decide: see `EndDecision`; not with weights.
    Returns counts of frames late or lost, and the rig's seconds. Raises RunFailed and its
    subclasses.
    """
    start_s, counts = bench.clock.now_s(), dict[str, int]()
    if isinstance(bench, Devices):
        runner = Runner(bench, writer, progress, live, decide)
        runner.run(steps)
        counts = runner.counts()
    else:
        from ..weights import WeightsBench

        assert isinstance(bench, WeightsBench), "a bench without a stage uses weights"
        bench.run(steps, writer, progress)
    return counts, bench.clock.now_s() - start_s
