"""Short sessions on a bench without a run or record, and registration of the face.

A ball touches a tilted face in the same way everywhere, so the plane of its touches is parallel to
the face. Three touches give a plane; the flatness needs a fourth.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from itertools import combinations
from pathlib import Path

import numpy as np

from deltact_fab.common import InputError, RunFailed, Stopped, toml_text, write_whole
from deltact_fab.sensor import Indenter, SensorDimensions, SkinDimensions, parse_indenter

from ..config import GrblConfig, load_rig
from ..force.watchdog import open_guarded
from ..interface import WallClock
from ..run.contact import lift_after_error
from ..run.loop import interruptible
from ..stage.grbl import GrblStage
from ..tables import RegisteredTouch, RegistrationFile, TouchConfig
from .feeler import ForceProbe
from .tooling import TerminalOperator, confirm, home_safely, raised_frame
from .touch import ForceTouch, powers_of

# Decision 0033; by hand: smaller triangles give a less certain tilt.
MAX_TILT_DEG = 2.0
MAX_RESIDUAL_MM = 0.1
CORNER_SHARE = 0.7  # of the largest half-widths at which the indenter fits
MIN_TRIANGLE_SHARE = 0.05  # largest triangle of the points, of the area of the face
FacePoint = tuple[float, float]


@contextmanager
def home_stage(
    config: GrblConfig, source: Path, operator: TerminalOperator, tip_is_clear: bool = False
) -> Iterator[ForceProbe]:
    """Open and home the bench of a rig file; lift the tip after an error, and close all devices.

    Raises InputError for a rig without a force sensor, errors of the devices, and Stopped when the
    operator interrupts.
    """
    if config.force is None or not config.force.reachable:
        raise InputError(
            f"{source}: force: no force sensor, the only protection of gel and sensor against a "
            "crash: add [force.netft] or [force.serial]"
        )
    stage = GrblStage.from_config(config.stage, WallClock())
    with ExitStack() as stack:
        stack.callback(stage.close)
        guard = open_guarded(config.force, config.guard, stage)
        stack.callback(guard.close)
        with interruptible(stage.abort):
            try:
                stage.connect()
                home_safely(stage, stage.clock, guard, guard, operator, tip_is_clear)
            except KeyboardInterrupt as error:
                stage.stop()
                raise Stopped("stopped by the operator") from error
            with lift_after_error(stage, stage.clock, guard, guard):
                yield ForceProbe(stage, guard, stage.clock, guard)


@contextmanager
def open_probe(rig: str, tip: str) -> Iterator[tuple[ForceProbe, TouchConfig]]:
    """Home a real rig and have a tip mounted; yield its probe and touch-off settings.

    Raises InputError for a virtual rig, and as `home_stage` and `confirm`.
    """
    config, source = load_rig(rig)
    if not isinstance(config, GrblConfig):
        raise InputError(f"{source}: kind: a {config.kind!r} rig cannot touch; use a 'grbl' rig")
    operator = TerminalOperator()
    with home_stage(config, source, operator) as probe:
        confirm(operator, tip, "it is mounted and tightened")
        yield probe, config.touch or TouchConfig()


@dataclass(frozen=True)
class RegistrationRequest:
    """A checked request: ball, points where it fits, touch-off settings.

    longer_mm: length minus that of the reference tool. rig: name of the rig file.
    """

    ball: Indenter
    places: tuple[FacePoint, ...]
    touch: TouchConfig
    longer_mm: float
    rig: str


def registration_request(
    config: GrblConfig,
    source: Path,
    sensor: SensorDimensions,
    indenter: str,
    places: tuple[FacePoint, ...] = (),
) -> RegistrationRequest:
    """Check a request before a device is opened. Raises InputError.

    places: points to touch; empty: four default ones.
    """
    ball = parse_indenter(indenter)
    touch = config.touch or TouchConfig()
    places = places or places_for(sensor.skin, ball)
    require_fit(sensor.skin, ball, places)
    longer_mm = config.tools[ball.name].length_mm if ball.name in config.tools else 0.0
    return RegistrationRequest(ball, places, touch, longer_mm, source.name)


def register_face(
    probe: ForceProbe, request: RegistrationRequest, operator: TerminalOperator
) -> RegistrationFile:
    """Have the ball mounted, touch the face at each point, and fit the plane of the face.

    Raises SensorError, StageError and RunFailed, the last also for a tilt over MAX_TILT_DEG and
    for touches further than MAX_RESIDUAL_MM from their plane.
    """
    stage, ball = probe.stage, request.ball
    confirm(operator, ball.name, "it is mounted and tightened")
    stage.frame = frame = raised_frame(stage.frame, request.longer_mm)
    touch = ForceTouch(probe, request.touch)
    touches = [touch.find(ball, place) for place in request.places]
    points = np.array([frame.to_machine_mm((*t.at_mm, t.z_mm)) for t in touches])
    level = np.column_stack((np.ones(len(points)), points[:, :2]))
    (height, along_x, along_y), *_ = np.linalg.lstsq(level, points[:, 2], rcond=None)
    residual_mm = float(abs(level @ (height, along_x, along_y) - points[:, 2]).max())
    x, y, _ = frame.origin_machine_mm
    z = float(height + along_x * x + along_y * y) - request.longer_mm
    face = replace(frame, origin_machine_mm=(x, y, z)).with_normal((-along_x, -along_y, 1.0))
    a, b = map(math.radians, face.tilt_deg)
    tilt_deg = math.degrees(math.acos(math.cos(a) * math.cos(b)))
    if tilt_deg > MAX_TILT_DEG:
        raise RunFailed(
            f"the face is tilted by {tilt_deg:.2f} deg against the stage, more than "
            f"{MAX_TILT_DEG:g} deg: level the sensor and register again"
        )
    if residual_mm > MAX_RESIDUAL_MM:
        raise RunFailed(
            f"the touches lie up to {residual_mm:.3f} mm from one plane, more than "
            f"{MAX_RESIDUAL_MM:g}: something moved, or the face is not flat"
        )
    places = points.round(4).tolist()
    return RegistrationFile(
        date=datetime.now(UTC).isoformat(timespec="seconds"),
        rig=request.rig,
        indenter=ball.name,
        by=touches[0].by,
        origin_machine_mm=(x, y, round(z, 4)),
        angle_deg=round(face.angle_deg, 4),
        tilt_deg=(round(face.tilt_deg[0], 4), round(face.tilt_deg[1], 4)),
        residual_mm=round(residual_mm, 4),
        touches=tuple(
            RegisteredTouch(at_mm=t.at_mm, machine_mm=place, spread_mm=t.spread_mm)
            for t, place in zip(touches, places, strict=True)
        ),
    )


def register_rig(
    rig: str,
    sensor: SensorDimensions,
    indenter: str,
    places: tuple[FacePoint, ...],
    out: Path,
    tip_is_clear: bool = False,
) -> RegistrationFile:
    """Home a real rig, touch the face of its sensor with a ball, and write its position.

    places: points to touch, mm; empty: four default ones. out: the registration file. Raises
    InputError for a virtual rig, and as `registration_request`, `home_stage`, `register_face`.
    """
    config, source = load_rig(rig)
    if not isinstance(config, GrblConfig):
        raise InputError(
            f"{source}: kind: only a real rig can be registered; this one is {config.kind!r}"
        )
    request = registration_request(config, source, sensor, indenter, places)
    operator = TerminalOperator()
    with home_stage(config, source, operator, tip_is_clear) as probe:
        registration = register_face(probe, request, operator)
    write_registration(registration, out)
    return registration


def write_registration(registration: RegistrationFile, out: Path) -> None:
    """Write it to a file. Raises RunFailed for a disk error."""
    about = "Position of the face; named by `[stage] registration` of the rig file."
    write_whole(out, toml_text(registration.model_dump(mode="json"), [about]).encode())


def places_for(skin: SkinDimensions, indenter: Indenter) -> tuple[FacePoint, ...]:
    """Return the corners of a rectangle on the face, with the ball well inside."""
    (x, y), (rx, ry) = skin.opening_half_mm, indenter.footprint_half_mm
    x, y = CORNER_SHARE * (x - rx), CORNER_SHARE * (y - ry)
    return ((-x, -y), (x, -y), (x, y), (-x, y))


def require_fit(skin: SkinDimensions, indenter: Indenter, places: Sequence[FacePoint]) -> None:
    """Raise InputError for an indenter that is not a ball, or points that fix no plane."""
    if len(indenter.tips) != 1 or powers_of(indenter) != (1.5,):
        raise InputError(
            f"--indenter {indenter.name}: registration needs a ball, as sphere:10, which "
            "touches a tilted face everywhere in the same way"
        )
    half, reach = skin.opening_half_mm, indenter.footprint_half_mm
    for place in places:
        if any(abs(p) + r > h for p, r, h in zip(place, reach, half, strict=True)):
            raise InputError(
                f"--at {place[0]:g},{place[1]:g}: {indenter.name} does not fit on the face of "
                f"{2 * half[0]:g} x {2 * half[1]:g} mm there"
            )
    least_mm2 = MIN_TRIANGLE_SHARE * 4 * half[0] * half[1]
    if len(places) < 3 or _largest_mm2(places) < least_mm2:
        raise InputError(
            "--at: at least three points are needed, not in a line: their largest triangle needs "
            f"an area of {least_mm2:.0f} mm2"
        )


def _largest_mm2(places: Sequence[FacePoint]) -> float:
    return max(
        (
            abs((b[0] - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (b[1] - a[1])) / 2
            for a, b, c in combinations(places, 3)
        ),
        default=0.0,
    )
