"""Scheduler of a run's streams, called by the thread that moves the stage.

In lockstep one scheduler steps all streams and advances the time. From the tare of a press to its
end it polls pose and force ten times per second and at each frame. A retract that is not filmed
has no force either, since a simulated gel would have to be solved for it. A guard checks the force
from the connection on, every GUARD_PERIOD_NS, in every motion except homing.
"""

from __future__ import annotations

import logging
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from functools import partial

from deltact_fab.common import DeltactFabError, SensorError, to_ns

from ...protocols.motion import ARRIVAL_DELAY_S, STATUS_INTERVAL_S
from ...protocols.plan import Step
from ...record.streams import Chunk
from ...record.writer import RunWriter
from ..interface import CameraFrame, Devices
from .contact import FeltForce, streaming
from .loop import LOOP_ANSWER_S, LOOP_END_S, Loop
from .streams import ForceStream, FrameRequest, FrameStream, PoseStream

_LOG = logging.getLogger(__name__)
POSE_PERIOD_NS = to_ns(STATUS_INTERVAL_S)
# By hand: longer periods let a virtual guard trip later, shorter ones cost simulation time.
GUARD_PERIOD_NS = 8_000_000
SAMPLE_WAIT_NS = 1_000_000  # duration of a read, at 1 kHz
PAUSE_LOOK_S = 0.2  # by hand: between two looks at stage and monitors in a pause
N_TAKEN = "taken"
# Ids of the record's events for frames.
N_LATE, N_MISSED, N_UNWRITTEN = "frames late", "frames missed", "frames unwritten"
N_DROPPED, N_REPEATED = "frames dropped", "frames repeated"
FRAME_EVENTS = {
    N_MISSED: "not received in time",
    N_UNWRITTEN: "not written: the disk was too slow",
    N_LATE: "exposed more than half a period late",
    N_DROPPED: "lost by the camera",
    N_REPEATED: "identical to the previous image",
}


class Schedule:
    """Pose, force and frames of one run in lockstep: the plan gives the time of each step of a
    stream. Same seed, same bytes. In `wallclock.ThreadedSchedule` threads step the streams.

    report: called when the progress changed.
    """

    def __init__(self, devices: Devices, writer: RunWriter, report: Callable[[Step], None]) -> None:
        self._d = devices
        self._writer = writer
        self._report = report
        self._step: Step | None = None  # present step
        self._force_streams = False  # the force sensor streams
        self._origin_ns: int | None = None  # tare of the present press
        self._press_frames: dict[str, float] = {}  # of the present press: id to time (s)
        self._step_counts: Counter[str] = Counter()  # events of the present step
        self.counts: Counter[str] = Counter()
        """Counts of the run, with N_TAKEN: frames recorded."""
        self.force: ForceStream | None = None
        if devices.force is not None:
            self.force = ForceStream(devices.force, devices.guard, self._note)
        depth = self.force.depth if self.force is not None else None
        self.pose = PoseStream(devices.stage, devices.clock, depth)
        self.frames = FrameStream(devices.camera, devices.clock, self._record_frame)
        self._loops: list[Loop] = []

    # ---- called by the thread that moves the stage ----------------------------------------------

    def open(self) -> None:
        """Start monitors, and the force stream for the guard; nothing else streams outside of a
        press."""
        self._open_monitors()
        if self._guarded and self.force is not None:
            self.force.keeping = False
            self._start_force()

    def enter(self, step: Step) -> None:
        """Begin a step; a retract that is not filmed pauses the force sensor."""
        self._step = step
        if step.kind == "retract" and not step.frames and not self._guarded:
            self._stop_force()
        elif self.in_press and not self._force_streams:
            self._start_force()
        self.pose.asked_ns = self.now_ns()

    def move_sent(self, step: Step) -> None:
        """Called after the move of a step was sent."""

    def film(self, request: FrameRequest) -> None:
        self._until(request.t_ns)
        self.frames.add_request(request)
        self.frames.step()
        self.pose.step()
        self._poll_force()
        self._report(request.step)

    def arrive(self, step: Step, end_ns: int) -> None:
        """Wait for the end of the move, then for its planned time."""
        self._until(end_ns)
        self._d.stage.wait()
        self._sleep_until(end_ns + to_ns(ARRIVAL_DELAY_S))

    def reach(self, end_ns: int) -> None:
        if self._guarded:
            self._sleep_until(end_ns)
        self._d.stage.wait()

    def complete(self, step: Step) -> None:
        """Wait a fixed time after the last frame, so that the next step does not start at a time
        that depends on the host."""
        if self.in_press and step.frames:
            self._until(self.pose.asked_ns + POSE_PERIOD_NS)
        self._poll_force()

    def change(self, name: str) -> str | None:
        """Change the indenter, the force stream paused."""
        self._stop_force()
        report = self._d.change_indenter(name)
        if self._guarded:
            self._start_force()
        return report

    @contextmanager
    def lifting(self) -> Iterator[FeltForce]:
        """Lift with the force sensor read at rest only; yields its force."""
        with suppress(DeltactFabError):
            self._stop_force()
        force = self._d.force

        def felt_n() -> float | None:
            with streaming(self._d.clock, force) as force_reading:
                return force_reading()

        yield felt_n

    def close(self) -> list[str]:
        """End the threads, each after its present step; return the names of those that did not end
        in time."""
        names = [loop.name for loop in self._loops if not loop.end(LOOP_END_S)]
        for monitor in self._d.monitors:
            monitor.close()
        return names

    def check(self) -> None:
        """Raise the error of another thread that stopped the stage, if any."""

    # ---- between two presses ---------------------------------------------------------------------

    def pause_reasons(self) -> dict[str, str] | None:
        """Reasons of monitors against a press, by name; None while a first reading is awaited."""
        monitors = self._d.monitors
        problems = {m.table.name: text for m in monitors if (text := m.pause_reason())}
        return None if not problems and any(m.awaited for m in monitors) else problems

    def wait_paused(self) -> None:
        """Wait a moment in a pause; the rig's time does not pass in lockstep."""
        time.sleep(PAUSE_LOOK_S)

    def notify(self, kind: str, text: str) -> None:
        """Journal an event and show it on the terminal; from any thread."""
        self.event(kind, text)
        _LOG.warning("%s: %s", kind, text)

    # ---- one press -------------------------------------------------------------------------------

    @property
    def in_press(self) -> bool:
        """True from the tare of a press to its last step."""
        return self._origin_ns is not None

    def begin(self, step: Step) -> None:
        """Flush, tare without contact, and start the streams of a press."""
        self._press_frames = {}
        self.frames.clear()
        self._begin_devices(step)
        self.event("begun", "tared" if self.force is not None else "no force sensor", step)

    def finish(self, step: Step, planned_s: float, start_ns: int, last: bool) -> None:
        """Journal a complete step; last: it completes its press."""
        end_ns = self.now_ns()
        if last and self._d.camera is not None and step.kind != "change":
            self._end_camera(self._press_frames)
        missed = self._account(step)
        self._writer.step(
            step, planned_s, start_ns / 1e9, end_ns / 1e9, self._take(), missed=missed
        )
        if last and self.in_press:
            self._origin_ns = None
            self._end_devices()
            self.event("complete", "", step)
        if last:
            self._writer.flush()

    def cut_off(self, step: Step) -> None:
        """Record pending data of an interrupted step. Raises RunFailed."""
        self._account(step)
        self._writer.interrupted_step(step, self._take())

    def event(self, kind: str, text: str, step: Step | None = None) -> None:
        self._writer.event(kind, text, self._d.clock.now_s(), step)

    def now_ns(self) -> int:
        return self._d.clock.now_ns()

    # ---- inside ----------------------------------------------------------------------------------

    def _begin_devices(self, step: Step) -> None:
        if self._d.camera is not None:
            self._d.camera.begin(step.press)
        self._stop_force()  # samples before have another tare
        self._origin_ns = self.pose.asked_ns = self.now_ns()
        if self.force is not None:
            self._force_streams = self.force.keeping = True
            self.force.force.begin(step.press)
        for monitor in self._d.monitors:
            monitor.mark(self._origin_ns)

    def _end_camera(self, frames: Mapping[str, float]) -> None:
        assert self._d.camera is not None
        self._d.camera.end(frames)

    def _end_devices(self) -> None:
        if self._guarded and self.force is not None:
            self.force.keeping = False
        else:
            self._stop_force()

    @property
    def _guarded(self) -> bool:
        return self._d.guard is not None

    def _open_monitors(self) -> None:
        for monitor in self._d.monitors:
            monitor.start(self._d.wall_clock, partial(self.notify, "monitor"))
            loop = Loop(f"monitor {monitor.table.name}", monitor.step, self._fail)
            self._loops.append(loop)
            loop.ask(lambda: None, LOOP_ANSWER_S, going=True)

    def _fail(self, error: BaseException) -> None:
        """Handle an error that ended a thread."""
        self.event("fault", f"{type(error).__name__}: {error}")

    def _waits_for_room(self, request: FrameRequest) -> bool:
        return True

    def _until(self, t_ns: int) -> None:
        """Wait; in a press poll stage and force sensor every POSE_PERIOD_NS.

        Not within POSE_PERIOD_NS of the end, where a frame may poll the position.
        """
        while self.in_press:
            look_ns = max(self.pose.asked_ns + POSE_PERIOD_NS, self.now_ns())
            if look_ns + POSE_PERIOD_NS > t_ns:
                break
            self._sleep_until(look_ns)
            self.pose.step()
            self._poll_force()
        self._sleep_until(t_ns)

    def _sleep_until(self, t_ns: int) -> None:
        """Wait while reading the stage, and the force for the guard every GUARD_PERIOD_NS."""
        while (left_ns := t_ns - self.now_ns()) > 0:
            if not (self._guarded and self._force_streams) or left_ns <= GUARD_PERIOD_NS:
                self._d.stage.listen(left_ns / 1e9)
                return
            self._d.stage.listen((GUARD_PERIOD_NS - SAMPLE_WAIT_NS) / 1e9)
            self._poll_force()

    def _poll_force(self) -> None:
        """Poll the force stream. Raises SensorError beyond limits."""
        if self.force is None or not self._force_streams or not (self.in_press or self._guarded):
            return
        try:
            self.force.step()
        except SensorError as error:
            assert self._step is not None
            raise type(error)(f"{self._step.id}: {error}") from error

    def _start_force(self) -> None:
        if self._d.force is not None:
            self._force_streams = True
            self._d.force.start()

    def _stop_force(self) -> None:
        if self._force_streams and self._d.force is not None:
            self._force_streams = False
            self._d.force.stop()

    def _note(self, kind: str, text: str) -> None:
        self.event(kind, text, self._step)

    def _take(self) -> list[Chunk]:
        if self._origin_ns is None:
            return []
        chunks = self.pose.take(self._origin_ns)
        chunks += self.force.take(self._origin_ns) if self.force is not None else []
        return chunks + [c for m in self._d.monitors for c in m.take(self._origin_ns)]

    def _record_frame(
        self,
        request: FrameRequest,
        frame: CameraFrame | None,
        t_ns: int,
        dropped: int,
        repeated: int,
    ) -> None:
        """Record one requested frame."""
        assert self._origin_ns is not None, "a press begins before its first frame"
        frame_id = self._writer.frame(
            request.step,
            request.k,
            frame.image if frame is not None else None,
            t_ns / 1e9,
            (t_ns - request.start_ns) / 1e9,
            (t_ns - self._origin_ns) / 1e9,
            late_s=(t_ns - request.t_ns) / 1e9,
            dropped=dropped,
            repeated=repeated,
            wait=self._waits_for_room(request),
        )
        self._step_counts += Counter({N_DROPPED: dropped, N_REPEATED: repeated})
        if frame_id is None:
            self._step_counts[N_UNWRITTEN] += 1
            return
        self._press_frames[frame_id] = t_ns / 1e9
        self.counts[N_TAKEN] += 1
        self._step_counts[N_LATE] += request.late(t_ns)

    def _account(self, step: Step) -> int:
        """Journal the losses of a step, one event per kind; return the number of frames lost."""
        counts, self._step_counts = self._step_counts, Counter()
        counts[N_MISSED], self.frames.missed = self.frames.missed, 0
        for kind, text in FRAME_EVENTS.items():
            if counts[kind]:
                self.event(kind, f"{counts[kind]} {text}", step)
        self.counts += counts
        return counts[N_MISSED] + counts[N_UNWRITTEN]
