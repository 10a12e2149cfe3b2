"""A bench for a few minutes: what `rig register` and its kin drive, without a run or a record."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from ...errors import DeltactFabError, InputError, StageError, Stopped
from ...files import write_whole
from ...shapes import Indenter, SensorDimensions
from ...shapes.indenter import parse as parse_indenter
from ..config import GrblConfig
from ..interface import LIFT_FEED_MM_MIN, Clock, ForceSensor, Guard, Stage, WallClock
from ..run.interrupt import interruptible
from ..stage.grbl import GrblStage
from .config import TouchConfig
from .feeler import ForceProbe
from .homing import LIFT_MM, home_safely
from .operator import Operator, confirm
from .register import Place, Registration, places_for, register, require_fit
from .tooling import raised
from .touch import FaceTouch, ForceTouch


@dataclass
class GuardedStage:
    """A stage that is homed, with its force sensor and the guard on it."""

    clock: Clock
    stage: Stage
    force: ForceSensor
    guard: Guard


@contextmanager
def homed(
    config: GrblConfig, source: Path, operator: Operator, tip_is_clear: bool = False
) -> Iterator[GuardedStage]:
    """Open and home the bench of a rig file; lift the tip and close all, however it ends.

    Raises InputError for a rig without a force sensor, and whatever the devices raise; Stopped
    when the operator interrupts.
    """
    from ..force.watchdog import open_guarded

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
    bench: GuardedStage, asked: RegistrationRequest, operator: Operator
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
