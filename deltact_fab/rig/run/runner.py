"""Runs the steps of a protocol on whatever rig it is given, and journals each of them.

An operator's interrupt (Ctrl-C, SIGTERM, SIGHUP) or any failure but the stage's own stops the
motion and lifts the tip; a second interrupt resets the controller and ends the process. An error
of the stage lifts it only where the controller kept its count. Presses that the record holds
complete are skipped. What was given to the record before a failure is kept.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress

from ...aliases import Progress
from ...errors import DeltactFabError, StageError, Stopped
from ...protocols.plan import Step
from ...record import RunWriter
from ..interface import Devices
from .interrupt import interruptible
from .live import Live, Remaining
from .lockstep import Lockstep
from .motion import StageMotion
from .schedule import DROPPED, LATE, MISSED, TAKEN, UNWRITTEN, Schedule
from .wallclock import ThreadedSchedule

GO_ON = "complete presses are kept: go on with --resume"


class Runner:
    """One run of one protocol: connect, home, then every step in order that is still to be done.

    progress: told of frames done, of how many, and of the step. live: told the same and more.
    """

    def __init__(
        self,
        devices: Devices,
        writer: RunWriter,
        progress: Progress | None = None,
        live: Callable[[Live], None] | None = None,
    ) -> None:
        self._d = devices
        self._writer = writer
        self._progress = progress or (lambda done, total, what: None)
        self._live = live
        kind = ThreadedSchedule if devices.wall_clock else Lockstep
        self._streams: Schedule = kind(devices, writer, self._tell)
        self._motion = StageMotion(devices.stage, self._streams)
        self._kept = self._total = 0  # frames
        self._remaining: Remaining | None = None

    def run(self, steps: Sequence[Step]) -> int:
        """Carry out the steps of all presses that the writer has not kept.

        Nothing moves when there are none. Returns the number of frames taken. Raises RunFailed
        and its kin.
        """
        self._total = sum(s.frames for s in steps)
        lift_to_mm = min(s.target_mm[2] for s in steps if s.kind == "travel")
        todo = [i for i, s in enumerate(steps) if s.press not in self._writer.kept]
        self._kept = self._total - sum(steps[i].frames for i in todo)
        self._remaining = Remaining(steps, todo, self._d.wall_clock, self._d.change_s)
        with interruptible(self._d.stage.abort):
            try:
                self._set_up(bool(todo))
                before = -1
                for i in todo:
                    last = i + 1 == len(steps) or steps[i + 1].press != steps[i].press
                    self._guarded(steps, i, i != before + 1, last, lift_to_mm)
                    before = i
                self._writer.flush()
            finally:
                for name in self._streams.close():
                    with suppress(DeltactFabError):
                        self._streams.event("fault", f"{name}: did not end; it is left behind")
        return self._streams.counts[TAKEN]

    def counts(self) -> dict[str, int]:
        """Frames that were late, missed, unwritten, dropped or repeated; what is not there is 0."""
        return {kind: n for kind, n in sorted(self._streams.counts.items()) if kind != TAKEN and n}

    def _set_up(self, moves: bool) -> None:
        """Connect, arm the guard, home. An error leaves the stage where it stopped."""
        stage, streams = self._d.stage, self._streams
        try:
            stage.connect()
            if moves:
                if self._d.begin is not None:
                    streams.event("begin", self._d.begin())
                streams.open()
                try:
                    stage.home()
                except StageError:
                    streams.check()  # what stopped it, rather than what that came to
                    raise
                streams.check()
                streams.event("homed", "positions are known")
        except KeyboardInterrupt as why:
            stage.stop()
            raise Stopped("stopped by the operator before the first step") from why
        assert self._remaining is not None
        self._remaining.start()

    def _guarded(
        self, steps: Sequence[Step], i: int, take_up: bool, last: bool, lift_to_mm: float
    ) -> None:
        """One step, and what is to be done when it fails."""
        step = steps[i]
        try:
            try:
                if take_up:
                    self._motion.take_up(steps, i)
                self._motion.step(step, last)
            except StageError:
                self._streams.check()  # a thread stopped it, and the stage says that it stopped
                raise
            assert self._remaining is not None
            self._remaining.finished(i)
        except StageError as why:
            lifted = self._motion.rescue(lift_to_mm)
            self._cut_off(step, "fault", f"{why}; {lifted}")
            raise type(why)(f"{why} ({lifted})") from why
        except BaseException as why:
            # The tip may be in the gel: whatever went wrong, it is not left there.
            lifted = self._motion.lift(lift_to_mm)
            stopped = isinstance(why, KeyboardInterrupt)
            text = "by the operator" if stopped else str(why)
            self._cut_off(step, "stop" if stopped else "fault", f"{text}; {lifted}")
            if isinstance(why, KeyboardInterrupt):
                raise Stopped(f"stopped by the operator in {step.id}; {lifted}; {GO_ON}") from why
            if isinstance(why, DeltactFabError):
                raise type(why)(f"{why} ({lifted})") from why
            raise

    def _tell(self, step: Step) -> None:
        counts = self._streams.counts
        done = self._kept + counts[TAKEN] + counts[MISSED] + counts[UNWRITTEN]
        self._progress(done, self._total, step.id)
        if self._live is not None and self._remaining is not None:
            lost = counts[MISSED] + counts[UNWRITTEN] + counts[DROPPED]
            force_n = self._streams.force.force_n if self._streams.force is not None else None
            left_s = self._remaining.left_s()
            self._live(Live(step.id, done, self._total, force_n, counts[LATE], lost, left_s))

    def _cut_off(self, step: Step, kind: str, text: str) -> None:
        """Keep what the streams held when the run broke off; no error here hides the first one."""
        for keep in (
            lambda: self._streams.cut_off(step),
            lambda: self._streams.event(kind, text, step),
            self._writer.flush,
        ):
            with suppress(DeltactFabError):
                keep()
