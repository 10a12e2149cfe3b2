"""A bench for a few minutes, without a run or a record, and where the face lies on it.

A ball touches a tilted face in the same way everywhere, so the plane of its touches is parallel to
the face. Three touches give a plane, and only the fourth says how far from flat it is.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from itertools import combinations
from pathlib import Path

import numpy as np

from ...aliases import Vector
from ...errors import DeltactFabError, InputError, RunFailed, StageError, Stopped
from ...files import write_whole
from ...optics import StageFrame
from ...shapes import Indenter, SensorDimensions, SkinDimensions
from ...shapes.indenter import parse as parse_indenter
from ..config import GrblConfig
from ..force.watchdog import open_guarded
from ..interface import LIFT_FEED_MM_MIN, Clock, ForceSensor, Guard, Stage, WallClock
from ..run.loop import interruptible
from ..stage.grbl import GrblStage
from .config import TouchConfig
from .feeler import ForceProbe
from .operator import LIFT_MM, TerminalOperator, confirm, home_safely
from .tooling import raised
from .touch import FaceTouch, ForceTouch, powers_of

MAX_TILT_DEG = 2.0
MAX_RESIDUAL_MM = 0.1
REACH = 0.7  # of what the face leaves to the indenter's middle
MIN_AREA = 0.05  # of the face, of the largest triangle among the places
Place = tuple[float, float]


@dataclass
class GuardedStage:
    """A stage that is homed, with its force sensor and the guard on it."""

    clock: Clock
    stage: Stage
    force: ForceSensor
    guard: Guard


@contextmanager
def homed(
    config: GrblConfig, source: Path, operator: TerminalOperator, tip_is_clear: bool = False
) -> Iterator[GuardedStage]:
    """Open and home the bench of a rig file; lift the tip and close all, however it ends.

    Raises InputError for a rig without a force sensor, and whatever the devices raise; Stopped
    when the operator interrupts.
    """
    if config.force is None or not config.force.reachable:
        raise InputError(
            f"{source}: force: no way to a force sensor, and nothing else keeps the tip from "
            "breaking what it meets: add [force.netft] or [force.serial]"
        )
    clock = WallClock()
    stage = GrblStage.of(config.stage, clock)
    with ExitStack() as opened:
        opened.callback(stage.close)
        force = guard = open_guarded(config.force, config.guard, stage)
        opened.callback(force.close)
        with interruptible(stage.abort):
            try:
                stage.connect()
                home_safely(stage, clock, force, operator, tip_is_clear=tip_is_clear, guard=guard)
                yield GuardedStage(clock, stage, force, guard)
            except StageError:
                raise
            except BaseException as why:
                with suppress(DeltactFabError):
                    stage.stop()
                    stage.lift(LIFT_MM, LIFT_FEED_MM_MIN)
                if isinstance(why, KeyboardInterrupt):
                    raise Stopped("stopped by the operator") from why
                raise


@dataclass(frozen=True)
class RegistrationRequest:
    """A registration as it was asked for, judged: a ball, places that it fits at, how it touches.

    longer_mm: than the reference tool it is.
    """

    ball: Indenter
    places: tuple[Place, ...]
    touch: TouchConfig
    longer_mm: float


def wanted(
    config: GrblConfig,
    source: Path,
    sensor: SensorDimensions,
    indenter: str,
    places: tuple[Place, ...] = (),
) -> RegistrationRequest:
    """Judge what was asked for, before a device is opened. Raises InputError.

    places: none is four of them.
    """
    ball = parse_indenter(indenter)
    touch = config.touch or TouchConfig()
    places = places or places_for(sensor.skin, ball)
    require_fit(sensor.skin, ball, places)
    longer_mm = config.tools[ball.name].length_mm if ball.name in config.tools else 0.0
    return RegistrationRequest(ball, places, touch, longer_mm)


def register_face(
    bench: GuardedStage, asked: RegistrationRequest, operator: TerminalOperator
) -> Registration:
    """Have the ball mounted, touch the face at each place, and fit where it lies.

    Raises RunFailed, SensorError, StageError.
    """
    stage, ball, touch = bench.stage, asked.ball, asked.touch
    confirm(operator, ball.name, "it is mounted, screwed tight")
    frame = raised(stage.frame, asked.longer_mm)
    stage.set_frame(frame)

    def find(place: Place) -> FaceTouch:
        feeler = ForceProbe(stage, bench.force, bench.clock, bench.guard)
        return ForceTouch(feeler, touch).find(ball, place)

    return register(find, frame, asked.longer_mm, ball, asked.places)


def write(registration: Registration, rig: Path, out: Path) -> None:
    """Keep it in a file. Raises RunFailed when the disk refuses."""
    date = datetime.now(UTC).isoformat(timespec="seconds")
    write_whole(out, registration.toml(rig.name, date).encode())


@dataclass(frozen=True)
class Registration:
    """frame: of the reference tool. touches: by place, with where the stage was (machine mm).

    residual_mm: farthest touch from the plane; of three touches there is none to tell.
    """

    frame: StageFrame
    indenter: str
    by: str
    touches: tuple[tuple[FaceTouch, Vector], ...]
    residual_mm: float

    @property
    def tilt_deg(self) -> float:
        """Angle between the face and the stage's xy plane."""
        a, b = map(math.radians, self.frame.tilt_deg)
        return math.degrees(math.acos(math.cos(a) * math.cos(b)))

    def line(self) -> str:
        """For a person."""
        x, y, z = self.frame.origin_machine_mm
        tx, ty = self.frame.tilt_deg
        known = f"{self.residual_mm:.3f} mm from flat" if len(self.touches) > 3 else "no residual"
        return (
            f"face at machine ({x:.3f}, {y:.3f}, {z:.3f}) mm, tilted {tx:+.3f} deg about x and "
            f"{ty:+.3f} about y, {known} by {len(self.touches)} touches"
        )

    def toml(self, rig: str, date: str) -> str:
        """The text of a registration file. rig: the file it is of."""
        rows = "".join(
            f"\n[[touches]]\nat_mm = {_list(touch.at_mm)}\nmachine_mm = {_list(machine)}\n"
            f"spread_mm = {touch.spread_mm:.4f}\n"
            for touch, machine in self.touches
        )
        return (
            "# Where the face lies; `[stage] registration` of the rig file names this file.\n"
            f'date = "{date}"\nrig = "{rig}"\nindenter = "{self.indenter}"\nby = "{self.by}"\n'
            f"origin_machine_mm = {_list(self.frame.origin_machine_mm)}\n"
            f"angle_deg = {self.frame.angle_deg:.4f}\n"
            f"tilt_deg = {_list(self.frame.tilt_deg)}\n"
            f"residual_mm = {self.residual_mm:.4f}\n{rows}"
        )


def places_for(skin: SkinDimensions, indenter: Indenter) -> tuple[Place, ...]:
    """The corners of a rectangle on the face, with the ball well inside."""
    (x, y), (rx, ry) = skin.opening_half_mm, indenter.footprint_half_mm
    x, y = REACH * (x - rx), REACH * (y - ry)
    return ((-x, -y), (x, -y), (x, y), (-x, y))


def require_fit(skin: SkinDimensions, indenter: Indenter, places: Sequence[Place]) -> None:
    """Raise InputError for an indenter that is no ball, or places that give no plane."""
    if len(indenter.tips) != 1 or powers_of(indenter) != (1.5,):
        raise InputError(
            f"--indenter {indenter.name}: a face is registered with a ball, as sphere:10, which "
            "touches a tilted one everywhere in the same way"
        )
    half, reach = skin.opening_half_mm, indenter.footprint_half_mm
    for place in places:
        if any(abs(p) + r > h for p, r, h in zip(place, reach, half, strict=True)):
            raise InputError(
                f"--at {place[0]:g},{place[1]:g}: {indenter.name} does not fit on the face of "
                f"{2 * half[0]:g} x {2 * half[1]:g} mm there"
            )
    least_mm2 = MIN_AREA * 4 * half[0] * half[1]
    if len(places) < 3 or _largest_mm2(places) < least_mm2:
        raise InputError(
            "--at: three places at least are needed, and not in a line: the largest triangle of "
            f"them is to have {least_mm2:.0f} mm2"
        )


def register(
    find: Callable[[Place], FaceTouch],
    frame: StageFrame,
    longer_mm: float,
    indenter: Indenter,
    places: Sequence[Place],
) -> Registration:
    """Touch at each place, and fit the plane.

    find: touches there, with heights in `frame`, which is that of the mounted tool; longer_mm: than
    the reference tool it is. Raises RunFailed for a tilt over MAX_TILT_DEG, or touches that lie
    further than MAX_RESIDUAL_MM from their plane.
    """
    touches = [find(place) for place in places]
    machine = [frame.to_machine_mm((*t.at_mm, t.z_mm)) for t in touches]
    at = np.array(machine)
    level = np.column_stack((np.ones(len(at)), at[:, :2]))
    (height, along_x, along_y), *_ = np.linalg.lstsq(level, at[:, 2], rcond=None)
    residual_mm = float(abs(level @ (height, along_x, along_y) - at[:, 2]).max())
    x, y, _ = frame.origin_machine_mm
    z = float(height + along_x * x + along_y * y) - longer_mm
    found = replace(frame, origin_machine_mm=(x, y, z)).facing((-along_x, -along_y, 1.0))
    rows = tuple(zip(touches, machine, strict=True))
    result = Registration(found, indenter.name, touches[0].by, rows, residual_mm)
    if result.tilt_deg > MAX_TILT_DEG:
        raise RunFailed(
            f"the face is tilted by {result.tilt_deg:.2f} degrees against the stage, more than "
            f"{MAX_TILT_DEG:g}: put the sensor level and register again"
        )
    if residual_mm > MAX_RESIDUAL_MM:
        raise RunFailed(
            f"the touches lie up to {residual_mm:.3f} mm from one plane, more than "
            f"{MAX_RESIDUAL_MM:g}: something moved, or the face is not flat"
        )
    return result


def _largest_mm2(places: Sequence[Place]) -> float:
    return max(
        (
            abs((b[0] - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (b[1] - a[1])) / 2
            for a, b, c in combinations(places, 3)
        ),
        default=0.0,
    )


def _list(values: Sequence[float]) -> str:
    return "[" + ", ".join(f"{value:.4f}" for value in values) + "]"
