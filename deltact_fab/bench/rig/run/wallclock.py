"""Streams of a run in real time: camera and force sensor have a thread each.

The camera's thread takes every frame and keeps the requested ones. The force sensor's thread reads
from the connection to the end, so that the guard is armed in every motion; it pauses only while an
indenter is changed, when the touch-off uses the sensor. The thread that moves the stage polls the
pose at most ten times per second: a frame's pose lies between two answers. A thread that fails
writes the stop byte, and the moving thread raises its error.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress

from deltact_fab.common import DeltactFabError, RunFailed, SensorError, to_ns

from ...protocols.plan import Step
from ...record.writer import RunWriter
from ..interface import Devices
from .contact import FeltForce, eased, mean_force_n
from .loop import LOOP_ANSWER_S, Loop
from .schedule import PAUSE_LOOK_S, POSE_PERIOD_NS, Schedule
from .streams import FrameRequest

# By hand: longer times see a fault later, shorter ones load the host.
FRAME_LIMIT_S = 10.0  # after a frame is due; a stalled camera reports itself before
THREAD_POLL_S = 0.005  # of other threads' results
STAGE_POLL_S = 0.02  # a thread that fails stops the stage itself


class ThreadedSchedule(Schedule):
    """A thread per device. `check` raises the first failure of any of them."""

    def __init__(self, devices: Devices, writer: RunWriter, report: Callable[[Step], None]) -> None:
        super().__init__(devices, writer, report)
        self._lock = threading.Lock()
        self._error: BaseException | None = None
        self._ending = False
        self._last_frame_ns = 0
        self._camera_loop: Loop | None = None
        self._force_loop: Loop | None = None

    def open(self) -> None:
        """Start the threads; the guard is armed on return. Raises SensorError."""
        self._writer.failed = self._fail
        self._open_monitors()
        if self._d.camera is not None:
            self._writer.load_encoder()
            self._camera_loop = Loop("camera", self.frames.step, self._fail)
            self._loops.append(self._camera_loop)
        if self.force is not None:
            self.force.keeping = False
            self._force_loop = Loop("force sensor", self.force.step, self._fail)
            self._loops.append(self._force_loop)
            self._force_loop.ask(self.force.force.start, LOOP_ANSWER_S, going=True)

    def enter(self, step: Step) -> None:
        """Begin a step, unless another thread has failed."""
        self._step = step
        self.check()

    def move_sent(self, step: Step) -> None:
        if self.in_press:
            self.pose.step()

    def film(self, request: FrameRequest) -> None:
        """Request a frame from the camera's thread; without a camera wait for its time."""
        self._last_frame_ns = request.t_ns
        self.frames.add_request(request)
        if self._camera_loop is None:
            self._until(request.t_ns)
            self.frames.step()

    def reach(self, end_ns: int) -> None:
        """Wait for the planned end, then for the stage to report it, with the guard armed."""
        self._until(end_ns)
        self._d.stage.wait()
        self.check()

    def arrive(self, step: Step, end_ns: int) -> None:
        self.reach(end_ns)

    def complete(self, step: Step) -> None:
        """Wait for the frames and for a force sample after them, then poll the pose.

        Raises SensorError when frames do not arrive.
        """
        if not self.in_press:
            return
        limit_ns = max(self._last_frame_ns, self.now_ns()) + to_ns(FRAME_LIMIT_S)
        while self.frames.pending:
            if self.now_ns() > limit_ns:
                raise SensorError(f"camera: no frame within {FRAME_LIMIT_S:g} s of its due time")
            self._until(min(self.now_ns() + to_ns(THREAD_POLL_S), limit_ns))
        if self.force is not None and step.frames:
            asked_ns = self.now_ns()
            # A silent or late sensor ends this through its own thread.
            while self.force.last_ns < asked_ns:
                self._until(self.now_ns() + to_ns(THREAD_POLL_S))
        self.pose.step()
        self.check()
        self._report(step)

    def change(self, name: str) -> str | None:
        """Change the indenter with the force stream stopped, then restart it."""
        if self._force_loop is None or self.force is None:
            return self._d.change_indenter(name)
        self._force_loop.ask(self.force.force.stop, LOOP_ANSWER_S, going=False)
        report = self._d.change_indenter(name)
        self._force_loop.ask(self.force.force.start, LOOP_ANSWER_S, going=True)
        return report

    @contextmanager
    def lifting(self) -> Iterator[FeltForce]:
        """Lift with the guard's limits raised slightly above the peak; yields the force."""
        self._ending = True
        guard, loop, stream, clock = self._d.guard, self._force_loop, self.force, self._d.clock
        if loop is None or stream is None:
            yield lambda: None
            return
        stream.lifting, stream.keeping = True, False

        def felt_n() -> float | None:
            forces_n: list[float | None] = [None]
            with suppress(SensorError):
                loop.ask(lambda: forces_n.append(mean_force_n(clock, stream.force)), LOOP_ANSWER_S)
            return forces_n[-1]

        with eased(guard):
            with suppress(SensorError):  # a failed sensor does not prevent the lift
                loop.ask(stream.force.start, LOOP_ANSWER_S, going=True)
            yield felt_n

    def close(self) -> list[str]:
        self._ending = True
        return super().close()

    def wait_paused(self) -> None:
        """Ask the stage where it is, then wait a moment with the guard armed.

        Raises StageError for an alarm, a restart or silence.
        """
        self._d.stage.position_mm()
        self._until(self.now_ns() + to_ns(PAUSE_LOOK_S))

    def _begin_devices(self, step: Step) -> None:
        camera, stream = self._d.camera, self.force
        if self._force_loop is not None and stream is not None:
            self._force_loop.ask(lambda: stream.force.begin(step.press), LOOP_ANSWER_S)
            stream.keeping = True
        if self._camera_loop is not None and camera is not None:
            self._camera_loop.ask(lambda: camera.begin(step.press), LOOP_ANSWER_S, going=True)
        self._origin_ns = self.now_ns()
        self.pose.step()

    def _end_camera(self, frames: Mapping[str, float]) -> None:
        camera = self._d.camera
        assert self._camera_loop is not None
        assert camera is not None
        self._camera_loop.ask(lambda: camera.end(frames), LOOP_ANSWER_S, going=False)

    def _end_devices(self) -> None:
        if self.force is not None:
            self.force.keeping = False

    def _waits_for_room(self, request: FrameRequest) -> bool:
        return request.at_stop

    def _until(self, t_ns: int) -> None:
        """Wait; in a press poll the pose every POSE_PERIOD_NS. Raises errors of threads."""
        while True:
            self.check()
            now_ns = self.now_ns()
            if now_ns >= t_ns:
                return
            due_ns = max(self.pose.asked_ns + POSE_PERIOD_NS, now_ns)
            if due_ns == now_ns:
                self.pose.asked_ns = now_ns
                if self.in_press:
                    self.pose.step()
                if self._step is not None:
                    self._report(self._step)
                continue
            self._d.stage.listen(min((min(t_ns, due_ns) - now_ns) / 1e9, STAGE_POLL_S))

    def check(self) -> None:
        """Raise the first error of another thread, with the id of the present step."""
        error = self._error
        if error is None:
            return
        prefix = f"{self._step.id}: " if self._step is not None else ""
        if isinstance(error, DeltactFabError):
            raise type(error)(f"{prefix}{error}") from error
        raise RunFailed(f"{prefix}{type(error).__name__}: {error}") from error

    def _fail(self, error: BaseException) -> None:
        """Stop the stage at once, in the thread that failed; `check` raises the error."""
        with self._lock:
            if self._error is None:
                # Before the error is visible, or the byte would end the lift.
                if not self._ending:
                    self._d.stage.cancel()
                self._error = error
