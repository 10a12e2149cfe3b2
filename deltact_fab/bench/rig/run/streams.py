"""Streams of pose, force and frames during a press, advanced one step at a time.

A step polls its device once and buffers the data. In lockstep one scheduler steps all three; on
the wall clock force and frames have threads of their own. The thread that moves the stage takes
the buffered data after each step of the protocol.
"""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from deltact_fab.common import Point, SensorError, to_ns

from ...protocols.plan import Step
from ...record.streams import FORCE_COLUMNS, Chunk
from ..force.standstill import DepthCheck
from ..interface import (
    Camera,
    CameraFrame,
    Clock,
    ForceSamples,
    ForceSensor,
    Guard,
    Stage,
    require_past,
)

MAX_SHOWN_AGE_NS = 150_000_000  # by hand: 0.05 s, and the period of a scale at 10 Hz


class PoseStream:
    """Positions of the stage with their times. asked_ns: time of the last request.

    depth: check of the force sensor's readings against them.
    """

    def __init__(self, stage: Stage, clock: Clock, depth: DepthCheck | None = None) -> None:
        self._stage = stage
        self._clock = clock
        self._depth = depth
        self._poses: list[tuple[int, float, float, float]] = []
        self.asked_ns = 0

    def step(self) -> None:
        """Request the position. Raises StageError, and SensorError by the check of depth."""
        self.asked_ns = self._clock.now_ns()
        t_ns, position_mm = self._stage.timed_position()
        require_past("stage position", t_ns / 1e9, self._clock.now_s())
        self._poses.append((t_ns, *position_mm))
        if self._depth is not None:
            self._depth.check(t_ns, position_mm[2])

    def take(self, origin_ns: int) -> list[Chunk]:
        """Return data since the last call, times relative to origin_ns."""
        poses, self._poses = self._poses, []
        if not poses:
            return []
        t_ns = np.array([pose[0] for pose in poses], np.int64) - origin_ns
        x, y, z = np.array([pose[1:] for pose in poses], float).T
        columns = {"t_ns": t_ns, "x_mm": x, "y_mm": y, "z_mm": z}
        return [Chunk("pose", origin_ns / 1e9, columns)]


@dataclass
class ForceStream:
    """Samples of the force sensor; the guard checks them first.

    note: called with id and text of a problem of the stream. keeping: samples are buffered.
    lifting: the tip is being lifted, and only the guard stops that.
    """

    force: ForceSensor
    guard: Guard | None
    note: Callable[[str, str], None]
    keeping: bool = True
    lifting: bool = False
    last_ns: int = 0  # of the last sample
    _force_n: Point | None = None  # of the last sample
    depth: DepthCheck = field(default_factory=DepthCheck)
    _batches: list[ForceSamples] = field(default_factory=list)

    def step(self) -> None:
        """Read once. Raises SensorError for a failed sensor or a tripped guard."""
        try:
            samples = self.force.read()
        except SensorError as error:
            if self.guard is not None:
                self.guard.on_sensor_lost(str(error))
            raise
        notes = samples.notes
        if self.guard is not None:
            self.guard.watch(samples)
            notes += self.guard.pop_notes()
        self.depth.watch(samples)
        if self.keeping:
            self._batches.append(samples)
        force_n = samples.force_n
        if len(force_n):
            self.last_ns = int(samples.t_ns[-1])
            x, y, z = force_n[-1].tolist()
            self._force_n = (x, y, z)
        for note in notes:
            self.note(note.id, note.text)
        if self.lifting:
            return
        if self.guard is not None and self.guard.tripped:
            raise SensorError(self.guard.tripped)
        if samples.saturated.any():
            saturated_n = tuple(force_n[samples.saturated.argmax()].tolist())
            raise SensorError(f"the force sensor is saturated at {saturated_n} N")

    def newest_n(self, now_ns: int) -> Point | None:
        """Newest force (N); None if it is older than MAX_SHOWN_AGE_NS."""
        return self._force_n if now_ns - self.last_ns <= MAX_SHOWN_AGE_NS else None

    def take(self, origin_ns: int) -> list[Chunk]:
        """Return data since the last call, times relative to origin_ns."""
        # One assignment, so that a concurrent sample is in one of both lists.
        forces, self._batches = self._batches, []
        if not forces:
            return []
        t_ns = np.concatenate([part.t_ns for part in forces]) - origin_ns
        counts = np.concatenate([part.counts for part in forces])
        per_unit = dict(zip(FORCE_COLUMNS, forces[0].per_unit.tolist(), strict=True))
        columns = {"t_ns": t_ns, **dict(zip(FORCE_COLUMNS, counts.T, strict=True))}
        columns["saturated"] = np.concatenate([part.saturated for part in forces])
        return [Chunk("force", origin_ns / 1e9, columns, per_unit)]


@dataclass(frozen=True)
class FrameRequest:
    """The k-th frame of a step, due at t_ns or as soon as possible after.

    start_ns: of the step. period_ns: to the next frame of a sweep; 0 for a frame at a stop.
    """

    step: Step
    k: int
    t_ns: int
    start_ns: int
    period_ns: int = 0

    @property
    def at_stop(self) -> bool:
        """True for the last one of its step, which is never given up."""
        return self.k == self.step.frames

    def late(self, t_ns: int) -> bool:
        """True for a frame of a sweep exposed more than half a period late."""
        return self.period_ns > 0 and t_ns - self.t_ns > self.period_ns / 2


KeepFrame = Callable[[FrameRequest, "CameraFrame | None", int, int, int], None]


class FrameStream:
    """Selects the first frame exposed at or after each requested time; drops all others.

    keep: called with request, frame, its time (ns), and the number of frames dropped and repeated
    since the last one kept. missed: requests without a frame before the next request.
    """

    def __init__(self, camera: Camera | None, clock: Clock, keep: KeepFrame) -> None:
        """camera: None if the protocol takes no images; then a frame is only a time."""
        self._camera = camera
        self._clock = clock
        self._keep = keep
        self._lock = threading.Lock()
        self._requests: deque[FrameRequest] = deque()
        self._busy = False
        self._dropped = self._repeated = 0
        self.missed = 0

    def clear(self) -> None:
        """Clear requests and counts before a new press."""
        with self._lock:
            self._requests.clear()
            self.missed = 0
            self._dropped = self._repeated = 0

    def add_request(self, request: FrameRequest) -> None:
        with self._lock:
            self._requests.append(request)

    @property
    def pending(self) -> bool:
        """True while frames are requested or being recorded."""
        with self._lock:
            return bool(self._requests) or self._busy

    def step(self) -> None:
        """Take one frame, and keep it if requested. Raises SensorError, RunFailed."""
        t_ns = self._clock.now_ns()
        frame = self._camera.capture() if self._camera is not None else None
        if frame is not None:
            t_ns = to_ns(frame.t_s)
            self._dropped += frame.dropped
            self._repeated += frame.repeated
        due = []
        with self._lock:
            while self._requests and self._requests[0].t_ns <= t_ns:
                due.append(self._requests.popleft())
            self._busy = bool(due)
        if not due:
            return
        try:
            self.missed += len(due) - 1
            dropped, self._dropped = self._dropped, 0
            repeated, self._repeated = self._repeated, 0
            self._keep(due[-1], frame, t_ns, dropped, repeated)
        finally:
            self._busy = False
