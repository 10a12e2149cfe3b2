"""Interfaces between a run and a rig; the runner does not know which rig it drives.

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

from deltact_fab.common import Image, Note, Point, Progress, SensorError
from deltact_fab.sensor import FlatField

from ..protocols.motion import LOCKSTEP_PACE, RigPace
from .monitor import Monitor

if TYPE_CHECKING:
    from deltact_fab.sensor import CameraModel, SensorDimensions, StageFrame

    from ..protocols import plan


MAX_SAMPLE_AGE_S = 0.05  # by hand: of the newest force sample at a look; 0.025 mm at 30 mm/min
MAX_STAMP_LEAD_S = 0.002  # by hand: a stamp may be later than the arrival; 2 um at 60 mm/min


class Clock(Protocol):
    """Common time base of host, runner, controller, camera and force sensor."""

    def now_ns(self) -> int:
        """Nanoseconds since an arbitrary, fixed origin; never goes back."""

    def now_s(self) -> float:
        """Seconds since the same origin."""

    def sleep_s(self, seconds: float) -> None:
        """Wait (wall time, or virtual time in lockstep)."""


@dataclass(frozen=True)
class StageState:
    """Status report of the controller: machine position and state.

    t_s: time of the position, uncertain by within_s. The controller reads its position between
    request and answer; t_s is the middle of that interval.
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
    number: int | None = None  # the device's frame number; None: it does not count
    dropped: int = 0  # frames lost by the device since the previous one
    repeated: int = 0  # identical images since the previous one, skipped


@dataclass(frozen=True)
class ForceSamples:
    """Samples of the wrench on the sensor about the centre of the resting face, in time order.

    In the sensor's own counts, so that a record is lossless.
    """

    t_ns: NDArray[np.int64]  # (n,) of the host's clock
    counts: NDArray[np.int32]  # (n, 6): three of force, three of torque
    per_unit: NDArray[np.float64]  # (6,) counts per N, counts per N mm
    saturated: NDArray[np.bool_]  # (n,)
    n_lost: int = 0  # samples missing before and between these
    n_late: int = 0  # number of these that arrived noticeably late
    notes: tuple[Note, ...] = ()  # events for the journal, at most one per second and id

    @property
    def force_n(self) -> NDArray[np.float64]:
        """Force (n, 3), N."""
        return np.asarray(self.counts[:, :3] / self.per_unit[:3], float)

    @property
    def torque_nmm(self) -> NDArray[np.float64]:
        """Torque (n, 3), N mm."""
        return np.asarray(self.counts[:, 3:] / self.per_unit[3:], float)


@dataclass(frozen=True)
class StopCommands:
    """Bytes by which a process with the stage's port stops it, and lifts the tip.

    cancel: ends a move; hold: ends any motion, if the first did not. query: requests the status,
    which begins with idle at rest. lift: straight up by lift_mm, within the travel; answered by
    accepted. end_marks: in lines after which nothing may move.
    """

    cancel: bytes
    hold: bytes
    query: bytes
    idle: bytes
    lift: bytes
    accepted: bytes
    lift_mm: float
    end_marks: tuple[bytes, ...]


def require_past(name: str, stamp_s: float, now_s: float) -> None:
    """Raise SensorError for a stamp later than its arrival now; name: of the device."""
    if (lead_s := stamp_s - now_s) > MAX_STAMP_LEAD_S:
        raise SensorError(
            f"{name}: a stamp {lead_s:.3f} s later than its arrival: the clock of the sender is "
            "ahead; stamp with CLOCK_MONOTONIC of this computer"
        )


class Stage(Protocol):
    """A motion stage in sensor coordinates, with its own limits."""

    frame: StageFrame
    """Sensor frame for the mounted tip, used for all positions; may be replaced at any time without
    motion."""

    @property
    def descent_feed_mm_min(self) -> float:
        """Largest feed towards a face that was not touched yet."""

    @property
    def homed(self) -> bool:
        """True if positions are known: homed since it was connected, and no fault since."""

    def connect(self) -> None: ...
    def home(self) -> None: ...
    def lift(self, height_mm: float, feed_mm_min: float) -> float | None:
        """Go straight up along machine z, by height_mm or to the top of the travel.

        Works before homing: a controller that is not locked counts its steps, and up is away from
        the face. Returns the distance (mm); None, without motion, if it is locked.
        """

    def recovery(self) -> AbstractContextManager[tuple[float, float, float] | None]:
        """After a StageError let `lift` work in a block; yield the tip position (sensor frame).

        A lost port is opened again. Yields None if the controller does not rest within 10 s with
        its count kept. Positions are lost afterwards. Raises StageError.
        """

    def check_moves(self, moves: Iterable[tuple[Point, float]]) -> None:
        """Judge straight moves in turn, each a tip position and a feed, with nothing sent.

        Raises InputError for the first beyond the limits.
        """

    def start_move(self, target_mm: tuple[float, float, float], feed_mm_min: float) -> float:
        """Send one straight move to a tip position and return its planned time (s) at once.

        Raises InputError, with nothing sent, for a move beyond the limits, and StageError.
        """

    def wait(self, stops: Callable[[], bool] | None = None) -> StageState:
        """Wait until the last move is at its target. Raises StageError otherwise.

        stops: called while waiting, before each part of the move is sent; True stops the move.
        """

    def listen(self, seconds: float) -> None:
        """Wait while reading the controller; detects an alarm or a restart within 5 ms.

        Raises StageError after stopping the move.
        """

    def position_mm(self) -> tuple[float, float, float]:
        """Request the tip position in the sensor frame."""

    def timed_position(self) -> tuple[int, tuple[float, float, float]]:
        """Request time (ns of the clock, see `StageState.t_s`) and tip position.

        Allowed during a move. Raises StageError.
        """

    def stop(self) -> None:
        """Halt motion, keeping the position and the ability to move.

        Waits for rest in the thread that drives the controller; in any other it only writes.
        """

    def cancel(self) -> None:
        """Only write the byte that ends the present move: from any thread."""

    def hold(self) -> None:
        """Only write the byte that ends any motion, also one that `cancel` did not end."""

    def share(self, hold: Callable[[int | None, StopCommands], None]) -> None:
        """Pass descriptor (None before closing) and commands to `hold`, now and on changes."""

    def abort(self) -> None:
        """Halt at once, losing the position, and never raise: for a signal handler."""

    def identity(self) -> dict[str, Any]:
        """Return the device's firmware, options and settings for the record."""

    def close(self) -> None: ...


class Camera(Protocol):
    """A source of images with time stamps."""

    def begin(self, stream: str) -> None:
        """Start a new stream of frames (one press): flush buffers, seed simulated noise."""

    def capture(self) -> CameraFrame:
        """Return the next frame, exposed after `begin`. Raises SensorError.

        A free-running camera counts losses since the last call in `CameraFrame.dropped`. A
        simulated one exposes on this call.
        """

    def end(self, frames: Mapping[str, float]) -> None:
        """End the stream; frames: recorded ids in order, and their times (s).

        Any data that the camera itself stores is on the disk on return; only then is the press
        complete. Raises RunFailed.
        """

    def identity(self) -> dict[str, Any]: ...
    def close(self) -> None: ...


class ForceSensor(Protocol):
    """A six-axis force sensor that streams at its own rate."""

    def begin(self, stream: str) -> None:
        """Tare without contact, at the start of a press, and start the stream."""

    def start(self) -> None:
        """Restart the stream after a stop, with the same tare."""

    def read(self) -> ForceSamples:
        """Return samples since the last read, at least one; waits for the next.

        Raises SensorError when it is silent, faulted or has lost too many.
        """

    def stop(self) -> None:
        """Stop the stream; unread samples are dropped."""

    def identity(self) -> dict[str, Any]: ...
    def close(self) -> None: ...


class Guard(Protocol):
    """Stops the stage beyond a force limit; see `force.guard.ForceGuard`."""

    @property
    def tripped(self) -> str:
        """Reason of the stop, "" without one."""

    def watch(self, samples: ForceSamples) -> None:
        """Check a batch of samples."""

    def on_sensor_lost(self, reason: str) -> None:
        """Stop the stage: the sensor has failed."""

    def pop_notes(self) -> tuple[Note, ...]:
        """Return new notes about the guard."""

    def rearm(self) -> None:
        """Clear the trip."""

    def easing(self) -> AbstractContextManager[None]:
        """Raise the limits while the tip is lifted after a trip."""


# By hand: slow enough for a gel that sticks; on the last tare more is a contact, or the sensor was
# never tared.
LIFT_FEED_MM_MIN = 120.0
CONTACT_N = 0.3


def move_to(stage: Stage, target_mm: Point, feed_mm_min: float) -> None:
    """Make one straight move (sensor frame). Raises InputError, StageError."""
    stage.start_move(target_mm, feed_mm_min)
    stage.wait()


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
    """The devices of a run; camera and force sensor are None if no channel needs them."""

    clock: Clock
    stage: Stage
    camera: Camera | None
    force: ForceSensor | None
    change_indenter: Callable[[str], str | None]
    """Has an indenter mounted and finds its tip; returns a text for the record."""
    guard: Guard | None = None
    begin: Callable[[], str] | None = None
    """Runs before homing, the stage connected: asks, lifts a tip out of the gel, or raises; returns
    a text for the record."""
    change_s: float = 0.0
    """Planned duration of `change_indenter`."""
    contact_n: float = CONTACT_N
    """Force above which the tip counts as in contact."""
    wall_clock: bool = False
    """True: real time, with a thread per device; False: one scheduler steps all devices."""
    monitors: tuple[Monitor, ...] = ()
    """Of the surroundings; a run opens and closes them."""


class PrintedPattern(Protocol):
    """The part of a pattern recipe that a bench reads."""

    @property
    def patch_mm(self) -> float | None: ...


@dataclass(frozen=True)
class RigSetup:
    """Input for building the rig of one run. folder: of the run."""

    protocol: plan.Protocol
    sensor: SensorDimensions
    recipe: PrintedPattern
    view: CameraModel | None
    """Camera model of the tracked images, see `RigKind.camera`."""
    seed: int
    folder: Path
    air: bool = False
    """True: no contact, see `bench.protocols.plan.expand_protocol`."""
    unattended: bool = False
    """Run without prompts: nobody changes an indenter or answers."""
    tip_is_clear: bool = False
    """The operator states that the tip touches nothing when the session begins."""


class OpenBench(ABC):
    """All devices of one run, closed by their creator in any case."""

    clock: Clock
    camera: Camera | None
    force: ForceSensor | None

    @abstractmethod
    def identity(self) -> dict[str, Any]:
        """Return the identity of each device for the summary; None for an absent one."""

    @abstractmethod
    def notes(self) -> Iterable[Note]:
        """Notes for a reader of the results, after the run."""

    def omissions(self) -> Iterator[Note]:
        """Notes on devices or models that were not built, with the reason."""
        if self.camera is None:
            yield Note("camera", "no channel needs images")

    @abstractmethod
    def close(self) -> None:
        """Close every device, even if one fails to close; idempotent."""


class Rig(Devices, OpenBench):
    """A bench with a stage. exit_stack: closes its devices, the last one first."""

    exit_stack: ExitStack

    def identity(self) -> dict[str, Any]:
        devices = {"stage": self.stage, "camera": self.camera, "force": self.force}
        return {name: d.identity() if d is not None else None for name, d in devices.items()}

    def close(self) -> None:
        self.exit_stack.close()


class RigKind(ABC):
    """A kind of rig: checks before any device is opened, and its construction."""

    part: str
    """Subject of `refusals` in a table of checks."""

    def __init__(self, config: Any, source: Path) -> None:
        """source: path of the rig file, base of its relative paths."""
        self._config = config
        self._source = source

    @abstractmethod
    def refusals(self, protocol: plan.Protocol, sensor: SensorDimensions, source: str) -> list[str]:
        """Reasons why a protocol cannot run on it, a line each; source: of the protocol."""

    @abstractmethod
    def camera(self, protocol: plan.Protocol, sensor: SensorDimensions) -> CameraModel | None:
        """Return the projection of the tracked images; None without a camera.

        Raises InputError for an unreadable or unsuitable calibration.
        """

    def truth(self, protocol: plan.Protocol, sensor: SensorDimensions) -> dict[str, Any] | None:
        """Return the properties of a simulated sensor that no estimator may read; None without."""
        return None

    def flat(self, protocol: plan.Protocol) -> FlatField | None:
        """Return the flat field of that camera if there is one. Raises InputError."""
        camera = self._config.camera
        if camera is None or camera.model is None or "image" not in protocol.channels:
            return None
        return FlatField.from_camera_file(self._source.parent / camera.model)

    def change_s(self, protocol: plan.Protocol) -> float:
        """Planned duration of a touch-off after a change of indenter; 0 without one."""
        return 0.0

    def pace(self) -> RigPace:
        """Return the overhead of the rig's steps."""
        return LOCKSTEP_PACE

    def monitors(self) -> tuple[Monitor, ...]:
        """Return the rig's monitors, not opened."""
        return tuple(Monitor(table, self._source.parent) for table in self._config.monitor or ())

    def undeclared_lengths(self, protocol: plan.Protocol) -> list[str]:
        """Return a line for indenters without a declared length, on a real rig."""
        return []

    def unmet_conditions(
        self, protocol: plan.Protocol, sensor: SensorDimensions, unattended: bool
    ) -> list[str]:
        """Reasons why the rig must not press, or not unattended; none on a simulated rig."""
        return []

    @abstractmethod
    def build(self, job: RigSetup, progress: Progress | None = None) -> OpenBench:
        """Open all devices, or none if one fails. progress: of preparing a simulation."""
