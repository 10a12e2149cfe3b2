"""What keeps the streams of a run going, as the thread that moves the stage sees it."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager

from ...errors import DeltactFabError
from ...protocols.motion import LOOK_S
from ...protocols.plan import Step
from ...record import Chunk, RunWriter
from ...units import to_ns
from ..interface import CameraFrame, Devices
from .streams import ForceStream, FrameRequest, FrameStream, PoseStream

LOOK_NS = to_ns(LOOK_S)
TAKEN = "taken"
# What became of frames, as the record's events name it.
LATE, MISSED, UNWRITTEN = "frames late", "frames missed", "frames unwritten"
DROPPED, REPEATED = "frames dropped", "frames repeated"
FATES = {
    MISSED: "did not come in time",
    UNWRITTEN: "were not kept: the disk was too slow",
    LATE: "exposed more than half a period after they were wanted",
    DROPPED: "lost by the camera",
    REPEATED: "the same image once more",
}


class Schedule(ABC):
    """Pose, force and frames of one run. `Lockstep` and `WallClock` differ in who steps them.

    tell: called when something came that an operator may want to see.
    """

    def __init__(self, devices: Devices, writer: RunWriter, tell: Callable[[Step], None]) -> None:
        self._d = devices
        self._writer = writer
        self._tell = tell
        self._step: Step | None = None  # under way
        self._origin_ns: int | None = None  # of the press under way, from its tare on
        self._kept: dict[str, float] = {}  # frames of the press under way, and their times (s)
        self._of_step: Counter[str] = Counter()  # what became of frames
        self.counts: Counter[str] = Counter()
        """The same over the run, and TAKEN: frames that were kept."""
        self.pose = PoseStream(devices.stage, devices.clock)
        self.frames = FrameStream(devices.camera, devices.clock, self._keep)
        self.force: ForceStream | None = None
        if devices.force is not None:
            self.force = ForceStream(devices.force, devices.guard, devices.clock, self._note)

    # ---- what the thread that moves the stage asks for ------------------------------------------

    @abstractmethod
    def open(self) -> None:
        """The stage is connected, and nothing has moved yet."""

    @abstractmethod
    def enter(self, step: Step) -> None:
        """A step is about to start."""

    def set_out(self, step: Step) -> None:  # noqa: B027 - lockstep asks later
        """Its move has just been sent."""

    @abstractmethod
    def film(self, wanted: FrameRequest) -> None:
        """Have a frame taken at that moment; in lockstep it is there on return."""

    @abstractmethod
    def reach(self, end_ns: int) -> None:
        """Wait for the end of a move, planned for end_ns."""

    def arrive(self, step: Step, end_ns: int) -> None:
        """The same of a step, which streams are kept of."""
        self.reach(end_ns)

    @abstractmethod
    def complete(self, step: Step) -> None:
        """Wait until all frames of the step and all that goes with them have come."""

    @abstractmethod
    def change(self, name: str) -> str | None:
        """Mount an indenter: whoever mounts it has stage and force sensor to himself.

        Returns what the record is to keep of it.
        """

    @abstractmethod
    def lifting(self) -> AbstractContextManager[None]:
        """The run ends: the tip goes up, and of all that may fail only the guard stops that."""

    def close(self) -> list[str]:
        """End what goes on by itself; names of what did not end within its time."""
        return []

    def check(self) -> None:  # noqa: B027 - lockstep has no other thread
        """Raise the reason for which another thread stopped the stage, if one did."""

    # ---- one press -------------------------------------------------------------------------------

    @property
    def in_press(self) -> bool:
        """From the tare of a press to its last step."""
        return self._origin_ns is not None

    def begin(self, step: Step) -> None:
        """Nothing touches: flush, tare, and start the streams of this press."""
        self._kept = {}
        self.frames.forget()
        self._begin_devices(step)
        self.event("begun", "tared" if self.force is not None else "no force sensor", step)

    def finish(self, step: Step, planned_s: float, start_ns: int, last: bool) -> None:
        """The step is complete: journal it; last: of its press."""
        end_ns = self.now_ns()
        if last and self._d.camera is not None and step.kind != "change":
            self._end_camera(self._kept)
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

    # ---- for both ways ---------------------------------------------------------------------------

    @abstractmethod
    def _begin_devices(self, step: Step) -> None: ...
    @abstractmethod
    def _end_camera(self, frames: Mapping[str, float]) -> None: ...
    @abstractmethod
    def _end_devices(self) -> None: ...
    @abstractmethod
    def _waits(self, wanted: FrameRequest) -> bool:
        """Whether a frame waits for room in the queue, or is dropped."""

    def _note(self, kind: str, text: str) -> None:
        self.event(kind, text, self._step)

    def _take(self) -> list[Chunk]:
        if self._origin_ns is None:
            return []
        chunks = self.pose.take(self._origin_ns)
        return chunks + (self.force.take(self._origin_ns) if self.force is not None else [])

    def _keep(
        self,
        wanted: FrameRequest,
        frame: CameraFrame | None,
        t_ns: int,
        dropped: int,
        repeated: int,
    ) -> None:
        """One frame that was wanted goes into the record."""
        assert self._origin_ns is not None, "a press begins before its first frame"
        frame_id = self._writer.frame(
            wanted.step,
            wanted.k,
            frame.image if frame is not None else None,
            t_ns / 1e9,
            (t_ns - wanted.start_ns) / 1e9,
            (t_ns - self._origin_ns) / 1e9,
            late_s=(t_ns - wanted.t_ns) / 1e9,
            dropped=dropped,
            repeated=repeated,
            wait=self._waits(wanted),
        )
        self._of_step += Counter({DROPPED: dropped, REPEATED: repeated})
        if frame_id is None:
            self._of_step[UNWRITTEN] += 1
            return
        self._kept[frame_id] = t_ns / 1e9
        self.counts[TAKEN] += 1
        self._of_step[LATE] += wanted.late(t_ns)

    def _account(self, step: Step) -> int:
        """Tell what was lost in a step, each kind in one event; how many frames will not come."""
        found, self._of_step = self._of_step, Counter()
        found[MISSED], self.frames.missed = self.frames.missed, 0
        for kind, text in FATES.items():
            if found[kind]:
                self.event(kind, f"{found[kind]} {text}", step)
        self.counts += found
        return found[MISSED] + found[UNWRITTEN]


def in_step(step: Step, why: DeltactFabError) -> DeltactFabError:
    """The same error with the step in which it came."""
    return type(why)(f"{step.id}: {why}")
