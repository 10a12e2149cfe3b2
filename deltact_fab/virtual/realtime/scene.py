"""The gel while time passes by itself: nothing is solved, for that would take longer than it may.

The ways of a protocol were solved ahead, and along them the scene is that of lockstep. A stop on
such a way is between two knots. Off it, as on the way out of the gel, force and surface are those
of the last knot, scaled as Hertz' law has it with the depth. Where no press has begun, as in a
touch-off, the force is that of `bench_face`, and the face is drawn at rest.
"""

from __future__ import annotations

import errno
import math
import os
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ...aliases import Point
from ...errors import DeltactFabError
from ...optics import StageFrame
from ...rig.camera.command import HEADER
from ..devices import Seen, TruthWriter
from ..motion import Segment
from ..picture import FrameRenderer
from ..scene import GelScene, Knot, MotionSegment, Observation

HERTZ = 1.5  # force goes with this power of the depth
OFF_PLAN, BARE = -1, -2  # keys of knots that no one solved; of a bare face nothing is drawn
OFF_LINE_MM = 1e-3
Wrench = Callable[[Point], NDArray[np.float64]]


class LiveScene(GelScene):
    """A GelScene that guesses what was not solved; one thread at a time.

    felt: force (N) and torque (N mm), (6,), of a bare face with the carriage there, machine mm;
    None: nothing is felt off the plan. near_mm: how far a line's end may be from a planned one that
    stands for it, where a touch-off has found the face.
    """

    felt: Wrench | None = None
    near_mm = 0.0
    guessed = 0
    _bare = False
    _seen_ns = 0

    def set_frame(self, frame: StageFrame) -> None:
        """Where the face truly is for the tool that is mounted."""
        self._frame = frame

    def observe(self) -> Observation:
        """As in lockstep."""
        self._seen_ns = max(self._seen_ns, self._clock.now_ns())
        return super().observe()

    def wrenches(self, t_ns: NDArray[np.int64]) -> NDArray[np.float64]:
        """As in lockstep; a time that was passed already, by milliseconds, counts as the last."""
        at_ns = np.maximum(t_ns, self._seen_ns)
        self._seen_ns = int(at_ns[-1])
        return super().wrenches(at_ns)

    def _along(self, segment: Segment, t_ns: NDArray[np.int64]) -> NDArray[np.float64]:
        found = super()._along(segment, t_ns)
        if not self._bare:
            return found
        return self._bare_at([segment.position_mm(int(t)) for t in t_ns])

    def _still(self, t_ns: NDArray[np.int64]) -> NDArray[np.float64]:
        if self._here.key != BARE:
            return super()._still(t_ns)
        found = self._bare_at([self._controller.position_mm()])
        return np.repeat(found, len(t_ns), axis=0)

    def _bare_at(self, places: Sequence[Point]) -> NDArray[np.float64]:
        if self.felt is None:
            return np.zeros((len(places), 6))
        return np.stack([self.felt(place) for place in places])

    def _line_of(self, segment: Segment) -> MotionSegment:
        before = self._line
        line = super()._line_of(segment)
        if before is None:  # else it is the same, or what a stop left of it
            self._bare = self._is_bare(line)
        return line

    def _is_bare(self, line: MotionSegment) -> bool:
        """Whether it starts off the gel, or leads into it where no press was planned."""
        start = line.knots[0]
        deep = next((tip for tip in line.where if tip[2] < 0), None)
        if start.key == 0 and deep is not None:
            return not self._is_next(start, deep)
        return start.key == BARE

    def _is_next(self, before: Knot, tip: Point) -> bool:
        """Whether the knot at tip is the planned one after `before`, and is known."""
        planned = self._next_tip(before)
        return planned is not None and planned == tip

    def _next_tip(self, before: Knot) -> Point | None:
        if self._press is None or not 0 <= before.key < len(self._press.solver.knots):
            return None
        return self._press.solver.poses[before.key].tip_mm

    def _solve_up_to(self, line: MotionSegment, last: int) -> None:
        while len(line.knots) <= last:
            k = len(line.knots)
            before, tip = line.knots[-1], line.where[k]
            if tip[2] >= 0:
                line.knots.append(self._rest)
            elif self._bare:
                line.knots.append(replace(self._rest, key=BARE))
            elif self._is_next(before, tip):
                assert self._press is not None
                line.knots.append(self._knot(self._press.solver.next(before.key, tip, 0.0)))
            else:
                line.knots.append(self._off_plan(before, line.where[k - 1], tip))

    def _off_plan(self, before: Knot, at: Point, tip: Point) -> Knot:
        """On the way to the next planned knot what lies between; elsewhere what the depth says."""
        planned = self._next_tip(before)
        if planned is not None and (way_mm := math.dist(at, planned)) > 0:
            part = math.dist(at, tip) / way_mm
            between = [a + part * (b - a) for a, b in zip(at, planned, strict=True)]
            if part <= 1 and math.dist(between, tip) < OFF_LINE_MM:
                assert self._press is not None
                after = self._knot(self._press.solver.next(before.key, planned, 0.0))
                return self._guess(before, after, part)
        deeper = (tip[2] / at[2]) ** HERTZ if at[2] < 0 else 0.0
        return self._guess(self._rest, before, deeper)

    def _guess(self, a: Knot, b: Knot, part: float) -> Knot:
        """A knot that is `part` of the way from one to another."""
        wrench = [p + part * (q - p) for p, q in zip(a.wrench, b.wrench, strict=True)]
        fields = (
            None if p is None or q is None else p + np.float32(part) * (q - p)
            for p, q in ((a.displacement_mm, b.displacement_mm), (a.traction_mpa, b.traction_mpa))
        )
        field, traction = fields
        x, y, z, u, v, w = wrench
        knot = Knot(len(self.knots), OFF_PLAN, field, (x, y, z), (u, v, w), traction)
        self.knots.append(knot)
        self.guessed += 1
        return knot

    def _planned(self, machine_mm: Point) -> Point:
        """A planned point of the press where one is near enough."""
        point = self._frame.to_sensor_mm(machine_mm)
        if self._press is None or self.near_mm == 0.0:
            return super()._planned(machine_mm)
        near = min(self._press.waypoints, key=lambda p: math.dist(p, point), default=point)
        return near if math.dist(near, point) <= self.near_mm else point


LOOK_S = 0.02
STALE_NS = 3_000_000_000  # to draw, on a computer with better things to do; beyond it is no news
SAME_NS = 1000  # two stamps that are one but for their way through a float


class LiveCamera:
    """Draws images at the rate it is given, or as fast as it can, while they are being read.

    look: the surface and the time (ns, monotonic) at which it is so. What an image shows is that
    moment, however long it took to draw.
    """

    def __init__(
        self,
        picture: FrameRenderer,
        look: Callable[[], tuple[int, Observation]],
        fifo: Path,
        rate_hz: float,
        seed: int,
    ) -> None:
        self._picture, self._look = picture, look
        self._fifo = fifo
        self._period_s = 1 / rate_hz
        self._seed = seed
        self._number = 0
        self._lock = threading.Lock()
        self._drawn: dict[int, Seen] = {}
        self.seconds = 0.0
        """Spent drawing."""
        self._since_s = math.inf
        os.mkfifo(fifo)
        self._thread = threading.Thread(target=self._run, name="camera", daemon=True)
        self._thread.start()

    @property
    def drawn(self) -> int:
        """Images so far."""
        return self._number

    @property
    def seen_s(self) -> float:
        """Since when someone reads, in seconds."""
        return max(time.monotonic() - self._since_s, 0.0)

    def begin(self) -> None:
        """A press begins: images of the one before are no longer asked for."""
        with self._lock:
            self._drawn.clear()

    def keep(self, truth: TruthWriter, press: str, frames: Mapping[str, float]) -> None:
        """Write the truth of these frames, ids and times (s). Raises RunFailed, KeyError."""
        with self._lock:
            stamps = np.fromiter(self._drawn, np.int64)
            seen = list(self._drawn.values())
        found = []
        for frame_id, t_s in frames.items():
            off_ns = np.abs(stamps - round(t_s * 1e9))
            k = int(np.argmin(off_ns)) if len(off_ns) else -1
            if k < 0 or off_ns[k] > SAME_NS:
                raise KeyError(f"{frame_id}: no image of that time was drawn")
            found.append(seen[k])
        truth.write(press, list(frames), found)

    def _run(self) -> None:
        while True:
            pipe = self._opened()
            with suppress(BrokenPipeError):
                self._stream(pipe)
            os.close(pipe)

    def _opened(self) -> int:
        """Wait for a reader."""
        while True:
            try:
                pipe = os.open(self._fifo, os.O_WRONLY | os.O_NONBLOCK)
            except OSError as why:
                if why.errno != errno.ENXIO:
                    raise
                time.sleep(LOOK_S)
                continue
            os.set_blocking(pipe, True)
            return pipe

    def _stream(self, pipe: int) -> None:
        self._since_s = due_s = time.monotonic()
        while True:
            time.sleep(max(due_s - time.monotonic(), 0.0))
            due_s = max(due_s + self._period_s, time.monotonic())
            rng = np.random.default_rng(np.random.SeedSequence([self._seed, 4, self._number]))
            try:
                t_ns, seen = self._look()
                started = time.thread_time()
                image = self._picture.render(seen.displacement_mm(), rng)
            except DeltactFabError:
                continue  # no view of it can be drawn: it is an image less
            self.seconds += time.thread_time() - started
            if time.monotonic_ns() - t_ns > STALE_NS:
                self._number += 1  # lost, and by its number the host knows it
                continue
            with self._lock:
                self._drawn[t_ns] = (seen.a.index, seen.b.index, seen.fraction)
            parts = [memoryview(HEADER.pack(t_ns, self._number, 0)), image.reshape(-1).data]
            self._number += 1
            for part in parts:
                while part:
                    part = part[os.write(pipe, part) :]
