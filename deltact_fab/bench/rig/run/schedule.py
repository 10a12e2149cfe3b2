"""What keeps the streams of a run going, as the thread that moves the stage sees it.

In lockstep one scheduler steps all of them, and time passes only when it lets it. From the tare of
a press to its end it asks the stage ten times a second where it is and takes what the force sensor
has sent, and both at each frame. A way out of the gel that is not filmed is not felt either: a
simulated gel would have to be solved for it. Where there is a guard, it sees the force from the
connection on, every GUARD_NS, in every motion but homing.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress

from deltact_fab.common import DeltactFabError, SensorError, to_ns

from ...protocols.motion import ARRIVAL_S, LOOK_S
from ...protocols.plan import Step
from ...record.streams import Chunk
from ...record.writer import RunWriter
from ..interface import CameraFrame, Devices
from .streams import ForceStream, FrameRequest, FrameStream, PoseStream

POSE_PERIOD_NS = to_ns(LOOK_S)
GUARD_PERIOD_NS = 8_000_000  # between two looks of the guard
SAMPLE_WAIT_NS = 1_000_000  # a reading waits for the next sample
N_TAKEN = "taken"
# What became of frames, as the record's events name it.
N_LATE, N_MISSED, N_UNWRITTEN = "frames late", "frames missed", "frames unwritten"
N_DROPPED, N_REPEATED = "frames dropped", "frames repeated"
FRAME_EVENTS = {
    N_MISSED: "did not come in time",
    N_UNWRITTEN: "were not kept: the disk was too slow",
    N_LATE: "exposed more than half a period after they were wanted",
    N_DROPPED: "lost by the camera",
    N_REPEATED: "the same image once more",
}


class Schedule:
    """Pose, force and frames of one run in lockstep: each stream is stepped at a time that the plan
    gives. Same seed, same bytes. In `wallclock.ThreadedSchedule` streams step themselves.

    tell: called when something came that an operator may want to see.
    """

    def __init__(self, devices: Devices, writer: RunWriter, report: Callable[[Step], None]) -> None:
        self._d = devices
        self._writer = writer
        self._report = report
        self._step: Step | None = None  # under way
        self._force_streams = False  # the force sensor streams
        self._origin_ns: int | None = None  # of the press under way, from its tare on
        self._press_frames: dict[str, float] = {}  # of the press under way: id to time (s)
        self._step_counts: Counter[str] = Counter()  # what became of frames
        self.counts: Counter[str] = Counter()
        """The same over the run, and TAKEN: frames that were kept."""
        self.pose = PoseStream(devices.stage, devices.clock)
        self.frames = FrameStream(devices.camera, devices.clock, self._record_frame)
        self.force: ForceStream | None = None
        if devices.force is not None:
            self.force = ForceStream(devices.force, devices.guard, self._note)

    # ---- what the thread that moves the stage asks for ------------------------------------------

    def open(self) -> None:
        """Nothing streams outside of a press but for the guard."""
        if self._guarded and self.force is not None:
            self.force.keeping = False
            self._start_force()

    def enter(self, step: Step) -> None:
        """The force sensor rests while the tip leaves the gel, unless that is filmed."""
        self._step = step
        if step.kind == "retract" and not step.frames and not self._guarded:
            self._stop_force()
        elif self.in_press and not self._force_streams:
            self._start_force()
        self.pose.asked_ns = self.now_ns()

    def move_sent(self, step: Step) -> None:
        """Its move has just been sent."""

    def film(self, request: FrameRequest) -> None:
        self._until(request.t_ns)
        self.frames.want(request)
        self.frames.step()
        self.pose.step()
        self._poll_force()
        self._report(request.step)

    def arrive(self, step: Step, end_ns: int) -> None:
        """Wait for the end of the move, then for the moment that its plan gives."""
        self._until(end_ns)
        self._d.stage.wait()
        self._sleep_until(end_ns + to_ns(ARRIVAL_S))

    def reach(self, end_ns: int) -> None:
        if self._guarded:
            self._sleep_until(end_ns)
        self._d.stage.wait()

    def complete(self, step: Step) -> None:
        """A step goes on for a while after its last frame, so that the next one does not start when
        the host happens to be ready."""
        if self.in_press and step.frames:
            self._until(self.pose.asked_ns + POSE_PERIOD_NS)
        self._poll_force()

    def change(self, name: str) -> str | None:
        """Between presses nothing streams."""
        self._stop_force()
        report = self._d.change_indenter(name)
        if self._guarded:
            self._start_force()
        return report

    @contextmanager
    def lifting(self) -> Iterator[None]:
        """Nothing is felt. A dead sensor does not leave the tip in the gel."""
        with suppress(DeltactFabError):
            self._stop_force()
        yield

    def close(self) -> list[str]:
        """End what goes on by itself; names of what did not end within its time."""
        return []

    def check(self) -> None:
        """Raise the reason for which another thread stopped the stage, if one did."""

    # ---- one press -------------------------------------------------------------------------------

    @property
    def in_press(self) -> bool:
        """From the tare of a press to its last step."""
        return self._origin_ns is not None

    def begin(self, step: Step) -> None:
        """Nothing touches: flush, tare, and start the streams of this press."""
        self._press_frames = {}
        self.frames.forget()
        self._begin_devices(step)
        self.event("begun", "tared" if self.force is not None else "no force sensor", step)

    def finish(self, step: Step, planned_s: float, start_ns: int, last: bool) -> None:
        """The step is complete: journal it; last: of its press."""
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
        """Keep what the streams held when the run broke off. Raises RunFailed."""
        self._account(step)
        self._writer.cut_off(step, self._take())

    def event(self, kind: str, text: str, step: Step | None = None) -> None:
        self._writer.event(kind, text, self._d.clock.now_s(), step)

    def now_ns(self) -> int:
        return self._d.clock.now_ns()

    # ---- inside ----------------------------------------------------------------------------------

    def _begin_devices(self, step: Step) -> None:
        if self._d.camera is not None:
            self._d.camera.begin(step.press)
        self._stop_force()  # what the guard saw was on another tare
        self._origin_ns = self.pose.asked_ns = self.now_ns()
        if self.force is not None:
            self._force_streams = self.force.keeping = True
            self.force.force.begin(step.press)

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

    def _waits_for_room(self, request: FrameRequest) -> bool:
        return True

    def _until(self, t_ns: int) -> None:
        """Let time pass; in a press look at the stage and the force sensor every LOOK_NS.

        Never within LOOK_NS of the end, where a frame may have the stage's position read.
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
        """Hear the stage meanwhile; where there is a guard, it sees the force every GUARD_NS."""
        while (left_ns := t_ns - self.now_ns()) > 0:
            if not (self._guarded and self._force_streams) or left_ns <= GUARD_PERIOD_NS:
                self._d.stage.listen(left_ns / 1e9)
                return
            self._d.stage.listen((GUARD_PERIOD_NS - SAMPLE_WAIT_NS) / 1e9)
            self._poll_force()

    def _poll_force(self) -> None:
        """What the force sensor has sent. Raises SensorError beyond limits."""
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
        return chunks + (self.force.take(self._origin_ns) if self.force is not None else [])

    def _record_frame(
        self,
        request: FrameRequest,
        frame: CameraFrame | None,
        t_ns: int,
        dropped: int,
        repeated: int,
    ) -> None:
        """One frame that was wanted goes into the record."""
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
        """Tell what was lost in a step, each kind in one event; how many frames will not come."""
        counts, self._step_counts = self._step_counts, Counter()
        counts[N_MISSED], self.frames.missed = self.frames.missed, 0
        for kind, text in FRAME_EVENTS.items():
            if counts[kind]:
                self.event(kind, f"{counts[kind]} {text}", step)
        self.counts += counts
        return counts[N_MISSED] + counts[N_UNWRITTEN]
