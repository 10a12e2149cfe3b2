"""One scheduler steps all streams: time passes only when it lets it.

From the tare of a press to its end it asks the stage ten times a second where it is and takes what
the force sensor has sent, and both at each frame. A way out of the gel that is not filmed is not
felt either: a simulated gel would have to be solved for it. Where there is a guard, it sees the
force from the connection on, every GUARD_NS, in every motion but homing.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress

from ...errors import DeltactFabError, SensorError
from ...protocols.motion import ARRIVAL_S
from ...protocols.plan import Step
from ...units import to_ns
from .schedule import LOOK_NS, Schedule, in_step
from .streams import FrameRequest

GUARD_NS = 8_000_000  # between two looks of the guard
SAMPLE_NS = 1_000_000  # a reading waits for the next sample


class Lockstep(Schedule):
    """Same seed, same bytes: each stream is stepped at a time that the plan gives."""

    _felt = False  # the force sensor streams
    _step: Step  # that was entered last

    def open(self) -> None:
        """Nothing streams outside of a press but for the guard."""
        if self._guarded and self._d.force is not None and self.force is not None:
            self.force.keeping = False
            self._felt = True
            self._d.force.start()

    def enter(self, step: Step) -> None:
        """The force sensor rests while the tip leaves the gel, unless that is filmed."""
        self._step = step
        if step.kind == "retract" and not step.frames and not self._guarded:
            self._feel_no_more()
        elif self.in_press and not self._felt and self._d.force is not None:
            self._felt = True
            self._d.force.start()
        self.pose.looked_ns = self.now_ns()

    def film(self, wanted: FrameRequest) -> None:
        self._until(wanted.step, wanted.t_ns)
        self.frames.want(wanted)
        self.frames.step()
        self.pose.step()
        self._feel(wanted.step)
        self._tell(wanted.step)

    def arrive(self, step: Step, end_ns: int) -> None:
        """Wait for the end of the move, then for the moment that its plan gives."""
        self._until(step, end_ns)
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
            self._until(step, self.pose.looked_ns + LOOK_NS)
        self._feel(step)

    def change(self, name: str) -> str | None:
        """Between presses nothing streams."""
        self._feel_no_more()
        found = self._d.change_indenter(name)
        if self._guarded and self._d.force is not None:
            self._felt = True
            self._d.force.start()
        return found

    @contextmanager
    def lifting(self) -> Iterator[None]:
        """Nothing is felt. A dead sensor does not leave the tip in the gel."""
        with suppress(DeltactFabError):
            self._feel_no_more()
        yield

    def _begin_devices(self, step: Step) -> None:
        if self._d.camera is not None:
            self._d.camera.begin(step.press)
        self._feel_no_more()  # what the guard saw was on another tare
        self._origin_ns = self.pose.looked_ns = self.now_ns()
        if self._d.force is not None:
            assert self.force is not None
            self._felt = self.force.keeping = True
            self._d.force.begin(step.press)

    def _end_camera(self, frames: Mapping[str, float]) -> None:
        assert self._d.camera is not None
        self._d.camera.end(frames)

    def _end_devices(self) -> None:
        if self._guarded and self.force is not None:
            self.force.keeping = False
        else:
            self._feel_no_more()

    @property
    def _guarded(self) -> bool:
        return self._d.guard is not None

    def _waits(self, wanted: FrameRequest) -> bool:
        return True

    def _until(self, step: Step, t_ns: int) -> None:
        """Let time pass; in a press look at the stage and the force sensor every LOOK_NS.

        Never within LOOK_NS of the end, where a frame may have the stage's position read.
        """
        while self.in_press:
            look_ns = max(self.pose.looked_ns + LOOK_NS, self.now_ns())
            if look_ns + LOOK_NS > t_ns:
                break
            self._sleep_until(look_ns)
            self.pose.step()
            self._feel(step)
        self._sleep_until(t_ns)

    def _sleep_until(self, t_ns: int) -> None:
        """Hear the stage meanwhile; where there is a guard, it sees the force every GUARD_NS."""
        while (left_ns := t_ns - self.now_ns()) > 0:
            if not (self._guarded and self._felt) or left_ns <= GUARD_NS:
                self._d.stage.listen(left_ns / 1e9)
                return
            self._d.stage.listen((GUARD_NS - SAMPLE_NS) / 1e9)
            self._feel(self._step)

    def _feel(self, step: Step) -> None:
        """What the force sensor has sent. Raises SensorError beyond limits."""
        if self.force is None or not self._felt or not (self.in_press or self._guarded):
            return
        try:
            self.force.step()
        except SensorError as why:
            raise in_step(step, why) from why

    def _feel_no_more(self) -> None:
        if self._felt and self._d.force is not None:
            self._felt = False
            self._d.force.stop()
