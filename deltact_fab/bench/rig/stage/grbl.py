"""A GRBL 1.1 motion stage over a serial port.

One line is outstanding at a time and every line is answered before the next. Moves are jogs in
machine coordinates: a jog outside of the travel is refused without an alarm, and one byte (0x85)
stops it cleanly. The end of a move is polled (`?` until Idle at the target), since an `ok` only
confirms the line.

Before a StageError is raised the stop byte is sent, 0x85 in a move and 0x18 while homing. After an
alarm, a restart or silence motion is refused until `home` succeeds, which then begins with a reset
(0x18); `$X` is never sent. Hold and the safety door keep the position: a reset at rest ends them,
never `~`, which would resume obsolete motion. This is no emergency stop.

One thread drives the stage; another may request the position; `stop`, `cancel` and `abort` may be
called from any thread, and then only write.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from typing import Any, ClassVar, Self

from deltact_fab.common import Check, InputError, Point, to_ns
from deltact_fab.sensor import StageFrame

from ...protocols.motion import StageConfig
from ..interface import LIFT_FEED_MM_MIN, Clock, StageState, StopCommands
from . import jogs
from .controller import FEED_HOLD, JOG_CANCEL, PIECE_S, PLANNED_AHEAD_S, Controller
from .exchange import SETTING_PATTERN, SOFT_RESET, LineRefused, TalkFault, state_text
from .port import Cable
from .settings import Limits, as_commanded, check_firmware, check_settings, first_failure

RESCUE_S = 10.0  # wait for an answer after a fault; decision 0073
FACE_CLEARANCE_MM = 1.0  # above the expected face a move is clear; decision 0073
ORPHAN_LIFT_MM = 2.0  # by hand: per command of a process that does not track the position
GRBL_COMMANDS = StopCommands(
    JOG_CANCEL, FEED_HOLD, b"?", b"<Idle",
    f"$J=G91G21Z{ORPHAN_LIFT_MM:g}F{LIFT_FEED_MM_MIN:g}\n".encode(), b"ok", ORPHAN_LIFT_MM,
    (b"ALARM", b"Grbl", b"<Alarm", b"error", b"<Sleep", b"<Door"),
)  # fmt: skip


class GrblStage:
    """A `Stage` on a GRBL 1.1 or grblHAL controller.

    url: a serial device, a pyserial URL or a cable. frame: sensor to machine frame. config: limits
    against which `connect` checks the controller's settings. Machine coordinates are 0 at the
    positive end of each axis and negative below.
    """

    planned_ahead_s: ClassVar = PLANNED_AHEAD_S + PIECE_S
    """Longest motion sent but not yet made, s."""

    def __init__(
        self,
        url: str | Cable,
        clock: Clock,
        frame: StageFrame,
        *,
        baud: int = 115200,
        config: StageConfig | None = None,
    ) -> None:
        self._url = url
        self.clock = clock
        self.frame = frame
        self._config = config
        self._c = Controller(url, clock, baud)
        self._driver = threading.current_thread()  # the thread that moves it
        self._unfit = "not connected: connect before homing"
        self._info: list[str] = []
        self._within_s = 0.0  # largest uncertainty of a position's time
        self.whole_moves = False
        """True: moves are sent at once, for hosts that cannot die or be late (virtual time)."""
        self.setting_checks: list[Check] = []
        """Findings of `connect` about the controller's settings."""

    @classmethod
    def from_config(cls, config: StageConfig, clock: Clock, url: str | Cable | None = None) -> Self:
        """Create the stage of a rig file, port closed; url: replaces the file's port."""
        port = url if url is not None else config.port
        assert port is not None, "the configuration has a port"
        return cls(port, clock, config.frame, baud=config.baud, config=config)

    # ---- the Stage interface ------------------------------------------------------------------

    def connect(self) -> None:
        """Open the port, wait for the controller, read and judge its settings.

        Nothing moves, and motion in progress is stopped. A controller that does not restart on
        opening is asked for its status instead. It is reset only if it accepts nothing else
        (asleep, locked by ALARM:1 or 2) or waits in Hold or behind a door that was closed. Firmware
        other than GRBL 1.1 and grblHAL is refused. Raises InputError for an unknown kind of URL,
        StageError otherwise.
        """
        self.close()
        self._driver = threading.current_thread()
        with self._c.exchange():
            self._c.port.open()
            self._c.clear_state()
            self._unfit = "not connected: connect before homing"
            self._c.wake()
            self._info = [d for d in self._c.talk.command("$I") if d.startswith("[")]
            matches = (SETTING_PATTERN.fullmatch(d) for d in self._c.talk.command("$$"))
            settings = {int(m[1]): float(m[2]) for m in matches if m}
            self._c.limits = Limits(
                settings, None if self._config is None else self._config.travel_mm
            )
            foreign = check_firmware(self._c.banner, self._info)
            self.setting_checks = foreign or check_settings(settings, self._info, self._config)
            self._unfit = "its settings were refused: correct them and connect again"
            if reason := first_failure(self.setting_checks):
                raise TalkFault(reason)
            self._c.rest(alarmed=True)
            self._unfit = ""

    def home(self) -> None:
        """Run the homing cycle, after a reset if there was a fault; makes positions known.

        Raises StageError; with nothing sent if `connect` refused the controller. An axis that does
        not stand at its end less the pull-off was not homed.
        """
        self._driver = threading.current_thread()
        self._c.cancelled = False
        with self._c.exchange():
            if not self._c.port.is_open or self._unfit:
                raise TalkFault(self._c.trouble or self._unfit)
            if self._c.reset_due:
                self.reset()
            self._c.clear_state()
            self._c.rest(alarmed=True)
            self._c.homing = True
            if self._c.cancelled:
                raise TalkFault("stopped before homing")
            self._c.talk.command("$H", self._c.limits.homing_s())
            self._c.homing = False
            state = self._c.status()
            if state.state != "Idle":
                raise TalkFault(f"{state_text(state.state)} after homing, expected Idle")
            if refusal := self._c.limits.homing_refusal(state.machine_mm):
                raise TalkFault(refusal, position_lost=True)
            self._c.at_mm = state.machine_mm
            self._c.homed = True

    def check_moves(self, moves: Iterable[tuple[Point, float]]) -> None:
        """Judge moves in turn, see Stage; before homing from where it will end."""
        start_mm = self._c.at_mm if self._c.homed else self._c.limits.homed_mm
        for target_mm, feed_mm_min in moves:
            machine_mm = as_commanded(self.frame.to_machine_mm(target_mm))
            if refusal := self._c.limits.move_refusal(start_mm, machine_mm, feed_mm_min):
                raise InputError(f"{self._url}: {refusal}")
            start_mm = machine_mm

    def start_move(self, target_mm: Point, feed_mm_min: float) -> float:
        """Send one move, see Stage. Raises InputError, with nothing sent, for a target outside of
        the travel or a feed above the limit of an axis; StageError if the stage is not ready.
        """
        self._driver = threading.current_thread()
        self._c.cancelled = False
        with self._c.exchange():
            self._c.require_ready()
            if self._c.move is not None:
                raise TalkFault("a move is in progress: wait for its end or stop it first")
            if self._c.stopping:
                self.stop()
            machine_mm = self.frame.to_machine_mm(target_mm)
            low_mm = min(self.frame.to_sensor_mm(self._c.at_mm)[2], target_mm[2])
            clear = low_mm > FACE_CLEARANCE_MM
            return jogs.start_move(self._c, machine_mm, feed_mm_min, clear, self.whole_moves)

    def wait(self, stops: Callable[[], bool] | None = None) -> StageState:
        """Wait for the target, see Stage; a move that stops short or takes too long fails."""
        self._driver = threading.current_thread()
        with self._c.exchange():
            self._c.require_ready()
            if self._c.move is None and self._c.stopping:
                raise TalkFault("the last move was stopped")
        state = jogs.wait_for_target(self._c, stops)
        if state is None:
            self.stop()
            return self.report()
        return state

    def listen(self, seconds: float) -> None:
        jogs.listen(self._c, seconds)

    def position_mm(self) -> Point:
        return self.timed_position()[1]

    def timed_position(self) -> tuple[int, Point]:
        """Request time and position, see Stage; `identity` has the worst uncertainty."""
        with self._c.exchange():
            self._c.require_ready()
            state = jogs.poll(self._c)
            self._within_s = max(self._within_s, state.within_s)
        return to_ns(state.t_s), self.frame.to_sensor_mm(state.machine_mm)

    def stop(self) -> None:
        """Halt motion with the controller's own deceleration and wait for Idle.

        The position is kept and the next move may start, except after homing, which only a reset
        ends. Ends Hold and a door that was closed again. In any thread but the driving one it only
        writes the byte; the driving thread handles the outcome. Raises StageError if it does not
        come to rest, or the door is open.
        """
        if threading.current_thread() is not self._driver and self._driver.is_alive():
            self.cancel()
            return
        if self._c.homing:
            self.reset()
            return
        self._c.port.write_at_once(JOG_CANCEL)
        with self._c.exchange():
            if self._c.trouble:
                raise TalkFault(self._c.trouble)
            if not self._c.homed:
                return  # no move was begun
            self._c.move = None
            if self._c.talk.posted is not None:  # a line read after the byte starts a new jog
                with suppress(LineRefused):  # by a jog that was begun as Run
                    self._c.talk.settle(jogs.JOG_ANSWER_S)
                self._c.port.write(JOG_CANCEL)
            self._c.rest()
            self._c.stopping = False

    def cancel(self) -> None:
        self._c.cancelled = True
        self._c.port.write_at_once(SOFT_RESET if self._c.homing else JOG_CANCEL)

    def hold(self) -> None:
        self._c.port.write_at_once(FEED_HOLD)

    def share(self, hold: Callable[[int | None, StopCommands], None]) -> None:
        """Pass on descriptor and commands, see Stage; their bytes do not stop homing."""
        self._c.port.share(lambda port: hold(port, GRBL_COMMANDS))

    def abort(self) -> None:
        """Only write the reset byte: for a signal handler.

        The position is lost; `home` is needed.
        """
        self._c.port.write_at_once(SOFT_RESET)
        self._c.cancelled = True
        self._c.lose_position("the controller was reset: home again")

    def identity(self) -> dict[str, Any]:
        return {
            "kind": "grbl",
            "port": str(self._url),
            "banner": self._c.banner,
            "info": list(self._info),
            "settings": {f"${n}": v for n, v in sorted(self._c.limits.settings.items())},
            "origin_machine_mm": list(self.frame.origin_machine_mm),
            "angle_deg": self.frame.angle_deg,
            "tilt_deg": list(self.frame.tilt_deg),
            "pose_within_s": self._within_s,
            "waits": self._c.waits,
        }

    def close(self) -> None:
        """Stop any move and close the port."""
        self._c.halt()
        self._c.port.close()

    @property
    def descent_feed_mm_min(self) -> float:
        return math.inf if self._config is None else self._config.descent_feed_mm_min

    @property
    def homed(self) -> bool:
        return self._c.homed and not self._c.trouble

    def lift(self, height_mm: float, feed_mm_min: float) -> float | None:
        was_homed = self._c.homed
        if not self._take_count():
            return None
        x, y, z = self._c.at_mm
        try:
            top_mm = min(z + height_mm, self._c.limits.ends_mm(2)[1])
            if top_mm > z:
                self.start_move(self.frame.to_sensor_mm((x, y, top_mm)), feed_mm_min)
                self.wait()
        finally:
            self._c.homed = self._c.homed and was_homed
        return max(top_mm - z, 0.0)

    @contextmanager
    def recovery(self) -> Iterator[Point | None]:
        """Allow lifts after a fault, see Stage; a restarted or alarmed controller is not Idle."""
        c = self._c
        with c.exchange():
            state = c.idle_again(RESCUE_S)
        reason = c.trouble
        try:
            if state is not None:
                c.trouble = ""
            yield None if state is None else self.frame.to_sensor_mm(state.machine_mm)
        finally:
            c.lose_position(reason)

    # ---- beyond the interface -----------------------------------------------------------------

    def trust_count(self) -> bool:
        """Accept the controller's step count since its last homing as the position.

        Nothing moves. Returns False if it is locked after a restart or an alarm, or an axis stands
        where a homed one never does. Else an unlock with `$X`, or an axis that the firmware does
        not home, invalidates the count undetectably. Raises StageError.
        """
        was_homed, limits = self._c.homed, self._c.limits
        if not self._take_count():
            return False
        outside = limits.target_refusal(limits.homed_mm, self._c.at_mm)
        self._c.homed = was_homed or not outside
        return self._c.homed

    def _take_count(self) -> bool:
        with self._c.exchange():
            if not self._c.port.is_open or self._unfit or self._c.trouble:
                return False
            state = self._c.status()
            if state.state != "Idle":
                return False
            self._c.at_mm, self._c.homed = state.machine_mm, True
        return True

    def report(self) -> StageState:
        """Query the status, locked or not. Raises StageError without an answer."""
        with self._c.exchange():
            return self._c.status()

    def reset(self) -> None:
        """Reset the controller (0x18) and wait for its banner. The position is lost.

        Opens the port if needed. Raises StageError without a banner.
        """
        self._driver = threading.current_thread()
        with self._c.exchange():
            if not self._c.port.is_open:
                self._c.port.open()
            self._c.lose_position("the controller was reset: home again")
            self._c.homing, self._c.move = False, None
            self._c.reset()
