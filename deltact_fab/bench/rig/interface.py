"""The few small interfaces a run is written against. The runner does not know which rig it drives.

Positions are tip positions in the sensor frame (mm): x along the width, y along the length, z out
of the sensor, z = 0 at the resting face; a depth d is z = -d. Times are seconds of one `Clock`.
"""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import AbstractContextManager, ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import NDArray

from deltact_fab.common import Image, Note, Point, Progress
from deltact_fab.sensor import FlatField

if TYPE_CHECKING:
    from deltact_fab.sensor import CameraModel, SensorDimensions, StageFrame

    from ..protocols import plan


class Clock(Protocol):
    """The one time base of host, runner, controller, camera and force sensor."""

    def now_ns(self) -> int:
        """Nanoseconds since an arbitrary, fixed origin; never goes back."""

    def now_s(self) -> float:
        """Seconds since the same origin."""

    def sleep_s(self, seconds: float) -> None:
        """Let that much time pass (wall time, or virtual time in lockstep)."""


@dataclass(frozen=True)
class StageState:
    """What the controller last said: position in its own machine frame and what it is doing.

    t_s: when the position was true, at most within_s from it. The controller reads its position
    after it was asked and before it begins to answer; t_s is the middle of that time.
    """

    machine_mm: tuple[float, float, float]
    state: str
    t_s: float
    within_s: float = 0.0


@dataclass(frozen=True)
class CameraFrame:
    """One image with the host's monotonic time of its exposure."""

    image: Image  # (h, w, 3) BGR uint8
    t_s: float
    number: int | None = None  # of the device's own count; None: it does not count
    dropped: int = 0  # frames that the device lost since the one before
    repeated: int = 0  # frames since the one before that were the same image once more: left out


@dataclass(frozen=True)
class ForceSamples:
    """Samples of force on the sensor about the centre of the resting face, in order of time.

    Kept in the sensor's own counts, so that a record of them loses nothing.
    """

    t_ns: NDArray[np.int64]  # (n,) of the host's clock
    counts: NDArray[np.int32]  # (n, 6): three of force, three of torque
    per_unit: NDArray[np.float64]  # (6,) counts in a newton, in a newton millimetre
    saturated: NDArray[np.bool_]  # (n,)
    n_lost: int = 0  # samples that are missing before and between these
    n_late: int = 0  # of these, how many came noticeably later than they were taken
    notes: tuple[Note, ...] = ()  # events for the journal, at most one a second of each id

    @property
    def force_n(self) -> NDArray[np.float64]:
        """(n, 3) newtons."""
        return np.asarray(self.counts[:, :3] / self.per_unit[:3], float)

    @property
    def torque_nmm(self) -> NDArray[np.float64]:
        """(n, 3) newton millimetres."""
        return np.asarray(self.counts[:, 3:] / self.per_unit[3:], float)


class Stage(Protocol):
    """A motion stage in sensor coordinates; it knows its own limits."""

    frame: StageFrame
    """The sensor frame as the tip that is mounted now has it; positions are told and taken in it.
    Another may be set at any time, nothing moves."""

    @property
    def homed(self) -> bool:
        """Whether positions are known: homed since it was connected, and no fault since."""

    def connect(self) -> None: ...
    def home(self) -> None: ...
    def lift(self, height_mm: float, feed_mm_min: float) -> bool:
        """Go straight up, z of the machine alone, by that much or to the top of the travel.

        Also before homing: a controller that is not locked counts its steps, and up is away from
        the face whatever the count. False, with nothing moved, where it is locked.
        """

    def rescue(self, height_mm: float, feed_mm_min: float) -> bool:
        """After a StageError: straight up to that height (sensor frame), if it can be trusted.

        Only where the controller rests within 10 s and has kept its count. False, with nothing
        moved, elsewhere; positions are lost all the same. Raises StageError.
        """

    def start_move(self, target_mm: tuple[float, float, float], feed_mm_min: float) -> float:
        """Send one straight move to a tip position; its planned time (s), at once.

        Raises InputError, with nothing sent, for what the stage cannot do, and StageError.
        """

    def wait(self) -> StageState:
        """Wait until the last move is at its target. Raises StageError otherwise."""

    def listen(self, seconds: float) -> None:
        """Let that much time pass; an alarm or a restart is heard within 5 ms of it.

        Raises StageError, the move stopped.
        """

    def position_mm(self) -> tuple[float, float, float]:
        """Tip position in the sensor frame as the controller reports it now."""

    def located(self) -> tuple[int, tuple[float, float, float]]:
        """The same with the time at which it was true (ns of the clock), see `StageState.t_s`.

        It asks the controller, once, and may be called in a move. Raises StageError.
        """

    def stop(self) -> None:
        """Halt motion now, keep the position, leave the controller able to move again.

        From the thread that talks to the controller it waits for rest; from any other it only
        writes.
        """

    def cancel(self) -> None:
        """Write the byte that ends the motion under way, and no more: from any thread."""

    def share(self, hold: Callable[[int | None, bytes], None]) -> None:
        """Tell it, now and whenever that changes, where the stop byte goes and which that is.

        None: nowhere, for the port is about to be closed.
        """

    def abort(self) -> None:
        """Halt at once, whatever is lost by it, and never raise: written in a signal handler."""

    def identity(self) -> dict[str, Any]:
        """What the record keeps of the device: firmware, options, settings."""

    def close(self) -> None: ...


class Camera(Protocol):
    """A source of images with times."""

    def begin(self, stream: str) -> None:
        """A new stream of frames (one press) starts: flush buffers; simulated noise re-seeds."""

    def capture(self) -> CameraFrame:
        """The next frame after the last, and none from before `begin`. Raises SensorError.

        A camera that runs by itself is asked over and over; what was lost in between is in
        `CameraFrame.dropped`. A simulated one exposes when it is asked.
        """

    def end(self, frames: Mapping[str, float]) -> None:
        """The stream is over: ids under which frames were recorded, in order, and their times (s).

        Whatever a camera keeps of a stream is on the disk on return; the press counts as complete
        only after that. Raises RunFailed.
        """

    def identity(self) -> dict[str, Any]: ...
    def close(self) -> None: ...


class ForceSensor(Protocol):
    """A six-axis force sensor that streams at its own rate."""

    def begin(self, stream: str) -> None:
        """Tare with nothing touching, at the start of a press, and start the stream."""

    def start(self) -> None:
        """Let samples come again after a stop, on the same tare."""

    def read(self) -> ForceSamples:
        """All samples since the last read, at least one; waits for the next to come.

        Raises SensorError when it is silent, faulted or has lost too many to go on.
        """

    def stop(self) -> None:
        """Let no more samples come; those not read are dropped."""

    def identity(self) -> dict[str, Any]: ...
    def close(self) -> None: ...


class Guard(Protocol):
    """What stops the stage beyond a force; see `force.guard.ForceGuard`."""

    @property
    def tripped(self) -> str:
        """Why it stopped the stage, "" while it has not."""

    def watch(self, samples: ForceSamples) -> None:
        """Look at what was read."""

    def on_sensor_lost(self, reason: str) -> None:
        """The sensor says nothing that can be trusted."""

    def pop_notes(self) -> tuple[Note, ...]:
        """What it has to say of itself."""

    def rearm(self) -> None:
        """Forget why it stopped."""

    def easing(self) -> AbstractContextManager[None]:
        """While the tip is lifted after a trip."""


LIFT_FEED_MM_MIN = 120.0
"""Out of the gel: slow enough for one that sticks."""


def move_to(stage: Stage, target_mm: Point, feed_mm_min: float) -> None:
    """One straight move (sensor frame) to its end. Raises InputError, StageError."""
    stage.start_move(target_mm, feed_mm_min)
    stage.wait()


def rise(stage: Stage, height_mm: float, feed_mm_min: float) -> None:
    """Straight up to that height, or stay where the tip is higher. Raises as `go`."""
    x, y, z = stage.position_mm()
    move_to(stage, (x, y, max(z, height_mm)), feed_mm_min)


class WallClock:
    """Monotonic wall time. One instance is shared by host, runner, camera and force sensor."""

    def now_ns(self) -> int:
        return time.monotonic_ns()

    def now_s(self) -> float:
        return self.now_ns() / 1e9

    def sleep_s(self, seconds: float) -> None:
        time.sleep(seconds)


@dataclass
class Devices:
    """The devices that a run drives; a camera or force sensor that no channel asks for is None."""

    clock: Clock
    stage: Stage
    camera: Camera | None
    force: ForceSensor | None
    change_indenter: Callable[[str], str | None]
    """Has an indenter mounted and finds its tip; returns what the record is to keep of it."""
    guard: Guard | None = None
    begin: Callable[[], str] | None = None
    """Before a session's homing, the stage connected: asks, lifts a tip out of the gel, or raises;
    returns what the record is to keep of it."""
    change_s: float = 0.0
    """What `change_indenter` takes by plan."""
    wall_clock: bool = False
    """Time passes by itself: every device has a thread of its own; else one scheduler steps all."""


class PrintedPattern(Protocol):
    """The specimen's pattern: all of a recipe that a bench reads."""

    @property
    def patch_mm(self) -> float | None: ...


@dataclass(frozen=True)
class RigSetup:
    """One run as it was asked for: what a rig is built from. folder: of the run."""

    protocol: plan.Protocol
    sensor: SensorDimensions
    recipe: PrintedPattern
    view: CameraModel | None
    """Of the images that are tracked, see `RigKind.camera`."""
    seed: int
    folder: Path
    air: bool = False
    """Nothing is touched, see `bench.protocols.plan.expand_protocol`."""
    unattended: bool = False
    """Run without prompts: nobody changes an indenter or answers."""
    tip_is_clear: bool = False
    """The operator's word that the tip touches nothing when the session begins."""


class OpenBench(ABC):
    """All devices of one run. Whoever builds it closes it, however the run ends."""

    clock: Clock
    camera: Camera | None
    force: ForceSensor | None

    @abstractmethod
    def identity(self) -> dict[str, Any]:
        """What the summary keeps of each device; None for one that is not there."""

    @abstractmethod
    def notes(self) -> Iterable[Note]:
        """What a reader of the results must know, once the run is over."""

    def omissions(self) -> Iterator[Note]:
        """What was not built, driven or solved, and why."""
        if self.camera is None:
            yield Note("camera", "no channel asks for images")

    @abstractmethod
    def close(self) -> None:
        """Close every device, also after one that fails to; again does nothing."""


class Rig(Devices, OpenBench):
    """A bench whose stage carries out the run. opened: closes its devices, the last one first."""

    exit_stack: ExitStack

    def identity(self) -> dict[str, Any]:
        devices = {"stage": self.stage, "camera": self.camera, "force": self.force}
        return {name: d.identity() if d is not None else None for name, d in devices.items()}

    def close(self) -> None:
        self.exit_stack.close()


class RigKind(ABC):
    """A kind of rig: what it says before any device is opened, and how it is built."""

    part: str
    """What `refusals` speaks of, for a table of checks."""

    def __init__(self, config: Any, source: Path) -> None:
        """source: of the rig file, from which the paths in it count."""
        self._config = config
        self._source = source

    @abstractmethod
    def refusals(self, protocol: plan.Protocol, sensor: SensorDimensions, source: str) -> list[str]:
        """Why a protocol cannot be carried out on it, a line each; source: of the protocol."""

    @abstractmethod
    def camera(self, protocol: plan.Protocol, sensor: SensorDimensions) -> CameraModel | None:
        """The projection of the images that are tracked; None without a camera.

        Raises InputError for a calibration that cannot be read, or not serve here.
        """

    def flat(self, protocol: plan.Protocol) -> FlatField | None:
        """How the light falls off in that camera's images, where it is known. Raises InputError."""
        camera = self._config.camera
        if camera is None or camera.model is None or "image" not in protocol.channels:
            return None
        return FlatField.beside(self._source.parent / camera.model)

    def change_s(self, protocol: plan.Protocol) -> float:
        """What finding the face with another indenter takes by plan; 0 where nothing is felt."""
        return 0.0

    def undeclared_lengths(self, protocol: plan.Protocol) -> list[str]:
        """A line for indenters of unknown length, where a hand changes them."""
        return []

    def unmet_conditions(
        self, protocol: plan.Protocol, sensor: SensorDimensions, unattended: bool
    ) -> list[str]:
        """Why the rig must not press, or not alone, a line each; none for one that cannot break."""
        return []

    @abstractmethod
    def build(self, job: RigSetup, progress: Progress | None = None) -> OpenBench:
        """Every device of the run, or none: what was opened is closed when another fails.

        progress: told of what has to be solved first.
        """
