"""Manual control of a real rig's stage: by single commands, or by keys in one session.

An Arduino that restarts whenever its port is opened loses its position with each command; in a
session the port stays open: homing, steps, origin and registration with the guard armed.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack, closing, contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path

from deltact_fab.common import DeltactFabError, InputError, Point, SensorError, StageError, Stopped
from deltact_fab.sensor import SensorDimensions

from ...protocols.motion import add_vectors
from ..config import GrblConfig, load_rig
from ..force.watchdog import Watchdog, open_guarded
from ..interface import ForceSensor, Guard, Stage, WallClock, move_to
from ..run.contact import end_contact, lift_after_error, position_text, streaming
from ..run.loop import Watch, interruptible, watch_force
from ..stage.exchange import state_text
from ..stage.grbl import GrblStage
from .feeler import ForceProbe
from .session import register_face, registration_request, write_registration
from .tooling import TerminalOperator, home_safely

# By hand: higher and slower is safer for the gel, and takes longer.
CLEARANCE_MM = 5.0  # decision 0072
HAND_FEED_MM_MIN = 300.0
NEAR_FEED_MM_MIN = 30.0  # below the clearance height; decision 0072
SAME_PLACE_MM = 2e-3
KEY_STEPS_MM = (0.02, 0.1, 1.0, 10.0)
DISPLAY_PERIOD_S = 0.2
KEY_HELP = (
    "arrows: x and y   page up, u / page down, d: z   1 2 3 4: steps of 0.02, 0.1, 1, 10 mm   "
    "space: stop\nh: home   o: set the origin here   r: register the face   q: quit"
)
ReadKey = Callable[[float], str]
"""Wait up to so many seconds for a key; its name, "" for none."""


@contextmanager
def stopped_by_ctrl_c(stage: Stage) -> Iterator[None]:
    """Stop the motion on Ctrl-C, SIGTERM and SIGHUP and raise Stopped; a second one resets."""
    with interruptible(stage.abort):
        try:
            yield
        except KeyboardInterrupt as error:
            stage.stop()
            place = f" at {position_text(stage.position_mm())}" if stage.homed else ""
            raise Stopped(f"stopped by the operator{place}") from error


def plan_move(
    stage: Stage, by_mm: Point, feed_mm_min: float, into_gel: bool
) -> tuple[Point, float]:
    """Return target and feed of a relative straight move (sensor frame); nothing moves.

    A descent is slow, as the face may be higher than expected. Raises InputError for one that,
    without into_gel, ends below CLEARANCE_MM or goes sideways there; straight up is always allowed.
    """
    start = stage.position_mm()
    end = add_vectors(start, by_mm)
    low_mm, up = min(start[2], end[2]), by_mm[0] == by_mm[1] == 0 and by_mm[2] >= 0
    near = low_mm < CLEARANCE_MM and not up
    if near and not into_gel:
        raise InputError(_too_low(low_mm))
    if by_mm[2] < 0:
        feed_mm_min = min(feed_mm_min, stage.descent_feed_mm_min)
    return end, min(feed_mm_min, NEAR_FEED_MM_MIN) if near else feed_mm_min


def go_to(stage: Stage, target_mm: Point, feed_mm_min: float, into_gel: bool) -> None:
    """Go to a position (sensor frame): up to the clearance height, sideways, then slowly down.

    Raises InputError, with nothing sent, for one below CLEARANCE_MM without into_gel, and for a leg
    beyond the limits.
    """
    if not all(map(math.isfinite, target_mm)):
        raise InputError(f"X Y Z: {target_mm} mm is not a position")
    x, y, z = target_mm
    if z < CLEARANCE_MM and not into_gel:
        raise InputError(_too_low(z))
    start = stage.position_mm()
    legs, high_mm = [], start[2]
    if math.dist(start[:2], (x, y)) > SAME_PLACE_MM:
        high_mm = max(start[2], CLEARANCE_MM)
        legs = [((*start[:2], high_mm), feed_mm_min), ((x, y, high_mm), feed_mm_min)]
    if z < high_mm:
        feed_mm_min = min(feed_mm_min, stage.descent_feed_mm_min)
    if z < CLEARANCE_MM:
        if high_mm > CLEARANCE_MM:
            legs.append(((x, y, CLEARANCE_MM), feed_mm_min))
        feed_mm_min = min(feed_mm_min, NEAR_FEED_MM_MIN)
    legs.append((target_mm, feed_mm_min))
    stage.check_moves(legs)
    for place_mm, leg_feed_mm_min in legs:
        move_to(stage, place_mm, leg_feed_mm_min)


def _too_low(z_mm: float) -> str:
    return (
        f"z = {z_mm:g} mm is below {CLEARANCE_MM:g} mm above the face, where the tip may touch the "
        "gel: give --into-gel (slow), or go up first"
    )


KEY_DIRECTIONS: dict[str, Point] = {  # definition: sensor axes
    "left": (-1, 0, 0), "right": (1, 0, 0), "down": (0, -1, 0), "up": (0, 1, 0),
    "page up": (0, 0, 1), "page down": (0, 0, -1), "u": (0, 0, 1), "d": (0, 0, -1),
}  # fmt: skip


@dataclass
class HandSession:
    """Session by keys. tell: prints a line. show: refreshes the state. into_gel: allow moves below
    the clearance height without a guard. actions: other keys, each returns a message."""

    stage: GrblStage
    force: ForceSensor | None
    guard: Guard | None
    key: ReadKey
    tell: Callable[[str], None]
    show: Callable[[str], None]
    into_gel: bool = False
    actions: dict[str, Callable[[], str]] = field(default_factory=dict)
    step_mm: float = 1.0

    def run(self) -> None:
        """Run until the key q. Raises StageError if the stage cannot be reached any more."""
        self.tell(KEY_HELP)
        if not self.stage.trust_count():
            self.tell("position lost: press h to home")
        while True:
            try:
                with watch_force(self.stage, self.force, self.guard) as watch:
                    key = self._move_by_keys(watch)
            except SensorError as error:
                self._lift_after_trip(str(error))
                key = ""
                while not key:
                    key = self.key(DISPLAY_PERIOD_S)
            if key == "q":
                return
            if key in self.actions:
                try:
                    self.tell(self.actions[key]())
                except DeltactFabError as error:
                    self.tell(str(error))

    def _move_by_keys(self, watch: Watch) -> str:
        """Move by keys; return the first other key, "" when the guard has stopped the stage."""
        while not watch.errors:
            self.show(self._state_line(watch))
            key = self.key(DISPLAY_PERIOD_S)
            if key in self.actions or key == "q":
                return key
            if key in KEY_DIRECTIONS:
                self._move(KEY_DIRECTIONS[key], watch)
            elif key == "o":
                self.tell(self._set_origin())
            elif key.isdigit() and 0 < int(key) <= len(KEY_STEPS_MM):
                self.step_mm = KEY_STEPS_MM[int(key) - 1]
        return ""

    def _move(self, direction: Point, watch: Watch) -> None:
        x, y, z = (self.step_mm * part for part in direction)
        stage, clock = self.stage, self.stage.clock
        deep = self.into_gel or self.guard is not None
        try:
            target_mm, feed = plan_move(stage, (x, y, z), HAND_FEED_MM_MIN, deep)
            end_s = clock.now_s() + stage.start_move(target_mm, feed)
            while clock.now_s() < end_s and not watch.errors:
                self.show(self._state_line(watch, asks=False))
                stage.listen(min(DISPLAY_PERIOD_S / 10, max(end_s - clock.now_s(), 0.0)))
                if self.key(0.0) == " ":
                    stage.stop()
                    return
            stage.wait()
        except (InputError, StageError) as error:
            self.tell(str(error))

    def _set_origin(self) -> str:
        """Set the origin (0, 0, 0), the centre of the face, at the present position."""
        if not self.stage.homed:
            return "home first: h"
        origin_mm = self.stage.frame.to_machine_mm(self.stage.position_mm())
        self.stage.frame = replace(self.stage.frame, origin_machine_mm=origin_mm)
        x, y, z = origin_mm
        return f"origin_machine_mm = [{x:.3f}, {y:.3f}, {z:.3f}]  # for [stage] of the rig file"

    def _lift_after_trip(self, reason: str) -> None:
        """End the contact after a trip."""
        self.tell(f"{reason}; lifting; q quits, any other key continues")
        assert self.guard is not None, "without a guard nothing trips"
        with self.guard.easing(), streaming(self.stage.clock, self.force) as felt_n:
            self.tell(end_contact(self.stage, felt_n))
        self.guard.rearm()

    def _state_line(self, watch: Watch, asks: bool = True) -> str:
        place = "moving"
        if asks:
            homed = self.stage.homed
            place = position_text(self.stage.position_mm()) if homed else "not homed"
        force = "no force sensor, no guard"
        if watch.stream is not None:
            force_n = watch.stream.newest_n(self.stage.clock.now_ns())
            force = "F {:+.2f} {:+.2f} {:+.2f} N".format(*force_n) if force_n else "no new force"
        return f"{place} | step {self.step_mm:g} mm | {force} | {time.strftime('%H:%M:%S')}"


@dataclass(frozen=True)
class StageStatus:
    """Reported state and position; sensor_mm: None if the controller is locked."""

    state: str
    machine_mm: Point
    sensor_mm: Point | None

    def line(self) -> str:
        """Return state and position in one line."""
        mm = self.sensor_mm
        place = "locked: home first" if mm is None else position_text(mm)
        machine = ", ".join(f"{p:.3f}" for p in self.machine_mm)
        return f"{state_text(self.state)}, {place}; machine {machine}"


class HandStage:
    """Manual control of a real rig's stage; each command opens and closes its port.

    A force sensor in the rig file guards every motion as in a run. Ctrl-C stops a motion. Commands
    raise InputError, StageError, SensorError, and Stopped for Ctrl-C.
    """

    def __init__(self, rig: str) -> None:
        """Read the rig file; nothing is opened yet. Raises InputError for a virtual rig."""
        config, self._source = load_rig(rig)
        if not isinstance(config, GrblConfig):
            raise InputError(
                f"{self._source}: kind: a {config.kind!r} rig has no stage; use a 'grbl' rig"
            )
        self._config = config
        self._stage = GrblStage.from_config(config.stage, WallClock())

    def status(self) -> StageStatus:
        """Query state and position; nothing moves."""
        with closing(self._stage):
            self._stage.connect()
            return self._state()

    def home(self, tip_is_clear: bool, ask: bool) -> tuple[str, float, StageStatus]:
        """Home every axis; return how the face was cleared, the duration (s), and the state.

        ask: ask the operator at the terminal if needed.
        """
        with self._connected() as guard:
            start_s = time.monotonic()
            with stopped_by_ctrl_c(self._stage):
                operator = TerminalOperator() if ask else None
                how = self._home(guard, operator, tip_is_clear)
            return how, time.monotonic() - start_s, self._state()

    def jog(self, by_mm: Point, feed_mm_min: float, most_mm: float, into_gel: bool) -> StageStatus:
        """Move the tip by a vector (sensor frame) of length most_mm at most.

        into_gel: allow an end below the clearance height, slowly.
        """
        length_mm = math.hypot(*by_mm)
        if not length_mm <= most_mm:  # before a port is opened, which may restart the board
            raise InputError(
                f"DX DY DZ: {length_mm:g} mm exceeds {most_mm:g} mm; give --most {length_mm:g} "
                "to allow it"
            )
        with self._connected() as guard:
            self._require_count()
            with self._moving(guard):
                move_to(self._stage, *plan_move(self._stage, by_mm, feed_mm_min, into_gel))
            return self._state()

    def go_to(
        self, target_mm: Point, feed_mm_min: float, into_gel: bool, home_first: bool
    ) -> StageStatus:
        """Move the tip to a position (sensor frame): up, then sideways, then down.

        home_first: home before, the operator having confirmed that the tip is clear; else the
        controller's count is trusted.
        """
        with self._connected() as guard:
            if home_first:
                with stopped_by_ctrl_c(self._stage):
                    self._home(guard, None, tip_is_clear=True)
            else:
                self._require_count()
            with self._moving(guard):
                go_to(self._stage, target_mm, feed_mm_min, into_gel)
            return self._state()

    def drive_by_keys(
        self,
        keys: Callable[[], AbstractContextManager[ReadKey]],
        whole_lines: Callable[[], AbstractContextManager[None]],
        tell: Callable[[str], None],
        show: Callable[[str], None],
        sensor: SensorDimensions,
        indenter: str,
        into_gel: bool,
    ) -> StageStatus:
        """Move the tip by keys until the operator quits; includes homing and registration.

        keys: opens the keyboard; whole_lines: restores line input while open. tell: prints a line.
        show: refreshes the state. indenter: the ball to register with.
        """
        stage = self._stage
        out, operator = Path(f"{self._source.stem}-registration.toml"), TerminalOperator()
        request = registration_request(self._config, self._source, sensor, indenter)
        with self._connected() as guard:

            def home() -> str:
                with whole_lines():
                    return self._home(guard, operator) + "; homed"

            def register() -> str:
                if guard is None:
                    return "registration needs a force sensor"
                with whole_lines():
                    probe = ForceProbe(stage, guard, stage.clock, guard)
                    face = register_face(probe, request, operator)
                write_registration(face, out)
                return f"{out}: {face.line()}"

            actions = {"h": home, "r": register}
            lifting = lift_after_error(stage, stage.clock, guard, guard)
            with keys() as key, interruptible(stage.abort), lifting:
                HandSession(stage, guard, guard, key, tell, show, into_gel, actions).run()
            return self._state()

    def reset(self) -> str:
        """Reset the controller, which loses its position; return its banner."""
        with closing(self._stage):
            self._stage.reset()
            return str(self._stage.identity()["banner"])

    @contextmanager
    def _connected(self) -> Iterator[Watchdog | None]:
        """Connect; yield the guard on the force sensor, None without one."""
        config = self._config
        with ExitStack() as stack:
            stack.callback(self._stage.close)
            self._stage.connect()
            guard = None
            if config.force is not None and config.force.reachable:
                guard = open_guarded(config.force, config.guard, self._stage)
                stack.callback(guard.close)
            yield guard

    @contextmanager
    def _moving(self, guard: Watchdog | None) -> Iterator[None]:
        """Guard a motion; whatever stops it ends a contact of the tip."""
        stage, clock = self._stage, self._stage.clock
        lifting = lift_after_error(stage, clock, guard, guard)
        with interruptible(stage.abort), lifting, watch_force(stage, guard, guard):
            yield

    def _home(
        self, guard: Watchdog | None, operator: TerminalOperator | None, tip_is_clear: bool = False
    ) -> str:
        stage = self._stage
        return home_safely(stage, stage.clock, guard, guard, operator, tip_is_clear)

    def _require_count(self) -> None:
        if not self._stage.trust_count():
            raise StageError("controller locked, position lost: run `rig home` first")

    def _state(self) -> StageStatus:
        report = self._stage.report()
        has_position = report.state.partition(":")[0] not in ("Alarm", "Sleep")
        machine_mm = report.machine_mm
        sensor_mm = self._config.stage.frame.to_sensor_mm(machine_mm) if has_position else None
        return StageStatus(report.state, machine_mm, sensor_mm)
