"""A GRBL 1.1 motion stage over a serial port.

One line is outstanding at a time and every line is answered before the next. Moves are jogs in
machine coordinates: a jog outside of the travel is refused without an alarm, and one byte (0x85)
stops it cleanly. The end of a move is read from the controller (`?` until Idle at the target), for
an `ok` only says that a line was understood.

A StageError leaves nothing moving, as far as a byte can still reach the controller: before it is
raised the stop byte goes out, 0x85 in a move and 0x18 while homing. After an alarm, a restart of
the controller or silence motion commands are refused until `home` succeeds, which begins with a
reset (0x18) then; `$X` is never sent. A cable that is out carries no byte, and a move runs to its
target. This is no emergency stop.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, NoReturn, TypeVar

import serial

from ...errors import InputError, StageError
from ...optics import StageFrame
from ...protocols.motion import Vec3, minus, move_duration_s
from ..interface import Clock, StageState
from .limits import Limits
from .words import ALARMS, BANNER, ERRORS, RATE, SETTING, STATUS, explain

T = TypeVar("T")

AXES = "XYZ"
JOG_CANCEL, RESET = b"\x85", b"\x18"
RESET_S = 1.0  # to the banner after a reset; half a second of that is for the message of an alarm
QUIET_S = 0.2  # nothing said for so long: nothing more is to come
SETTLE_S = 0.02  # from the end of a line to the start of its jog, before which 0x85 does nothing
REOPEN_S = 1.0  # a cable that was only loose is back by then
SLICE_S = 0.05  # one read; a longer wait is several
BANNER_S = 2.5  # an Arduino's boot loader takes up to 2 s
ANSWER_S = 1.0
JOG_ANSWER_S = 0.5  # it comes within .1 s, and without it the carriage may be on its way
STATUS_S = 0.5  # a `?` is answered within milliseconds
LISTEN_S = 2.0  # after silence: time for a restarting controller to say so
POLL_S = 0.1  # while a move is under way; the firmware's documents ask for at most 10 a second
POLL_END_S = 0.02
HEAR_S = 0.005  # between two looks at what was said without being asked for
MARGIN_S = 2.0


@dataclass(frozen=True)
class _Move:
    """A jog that was sent: machine target (mm), start (ns of the clock), planned time (s)."""

    target_mm: Vec3
    start_ns: int
    planned_s: float


class GrblStage:
    """A `Stage` on a GRBL 1.1 or grblHAL controller.

    url: a serial device or a pyserial URL. frame: sensor frame to machine frame. The controller's
    own settings give travel ($130-$132), feeds ($110-$112) and accelerations ($120-$122);
    `connect` refuses a controller with less than require_travel_mm or require_feed_mm_min.
    Machine coordinates are 0 at the homed end and negative below.
    """

    def __init__(
        self,
        url: str,
        clock: Clock,
        frame: StageFrame,
        *,
        baud: int = 115200,
        require_travel_mm: Vec3 | None = None,
        require_feed_mm_min: Vec3 | None = None,
    ) -> None:
        self._url = url
        self._clock = clock
        self._frame = frame
        self._baud = baud
        self._require_travel_mm = require_travel_mm
        self._require_feed_mm_min = require_feed_mm_min
        self._port: Any = None
        self._partial = b""
        self._talker = 0  # the thread that last asked for something
        self._unfit = "not connected: connect before homing"
        self._banner = ""
        self._info: list[str] = []
        self._limits = Limits({})
        self._at_mm: Vec3 = (0.0, 0.0, 0.0)
        self._move: _Move | None = None
        self._homed = False
        self._homing = False
        self._awaiting_ok = False
        self._trouble = ""
        self._reset_due = False  # before the next homing
        self._stopping = False  # told to stop by a fault, not seen at rest yet
        self._within_s = 0.0  # a position's time was off by at most so much

    # ---- the Stage interface ------------------------------------------------------------------

    def connect(self) -> None:
        """Open the port, wait for the controller, read and check its settings. Nothing moves.

        A controller that does not restart on opening is asked for its status instead. It is reset
        only where it hears nothing else: asleep, or locked by ALARM:1 or 2. Raises InputError for
        an unknown kind of URL, StageError for all else.
        """
        self.close()
        self._open()
        self._homed, self._awaiting_ok, self._reset_due = False, False, False
        self._trouble, self._stopping, self._partial = "", False, b""
        self._unfit = "not connected: connect before homing"
        self._banner = self._await_banner(BANNER_S)
        if self._banner:
            self._await_quiet()
        else:
            state = self._first_status()
            if state in ("", "Sleep"):
                if not self._greeted():
                    self._fail(
                        f"no banner within {BANNER_S:g} s and no answer to '?' at {self._baud} "
                        "baud, nor to a reset (0x18); expected a GRBL 1.1 controller"
                    )
            elif state not in ("Idle", "Alarm"):
                self._fail(f"the controller is in {state}; wait until it is Idle, or reset it")
        version = BANNER.search(self._banner)
        if version is not None and (int(version[1]), int(version[2])) < (1, 1):
            self._fail(f"found {version[0]!r}; jogging needs GRBL 1.1 or later")
        self._info = [d for d in self._command("$I") if d.startswith("[")]
        found = (SETTING.match(d) for d in self._command("$$"))
        self._limits = Limits({int(m[1]): float(m[2]) for m in found if m})
        self._unfit = "its settings were refused: set them right and connect again"
        if why := self._limits.refusal(self._require_travel_mm, self._require_feed_mm_min):
            self._fail(why)
        self._unfit = ""

    def home(self) -> None:
        """Run the homing cycle, after a fault behind a reset; positions are known afterwards.

        Raises StageError; with nothing sent when `connect` refused the controller.
        """
        self._require_port()
        if self._unfit:
            self._fail(self._unfit)
        if self._reset_due:
            self.reset()
        self._homed, self._trouble, self._stopping, self._move = False, "", False, None
        self._drain()
        self._homing = True
        self._command("$H", self._limits.homing_s())
        self._homing = False
        state = self._query()
        if state.state != "Idle":
            self._fail(f"{state.state} after homing, expected Idle")
        self._at_mm = state.machine_mm
        self._homed = True

    def start_move(self, target_mm: Vec3, feed_mm_min: float) -> float:
        """Send one straight move to a tip position (sensor frame, mm); return its planned time (s).

        Raises InputError, with nothing sent, for a target outside of the controller's travel or a
        feed above one of its axes' limits; StageError when the stage is not fit to move.
        """
        self._require_ready()
        if self._move is not None:
            self._fail("a move is under way: wait for it or stop it first")
        if self._stopping:
            self.stop()
        limits = self._limits
        x, y, z = (round(p, 4) + 0.0 for p in self._frame.to_machine_mm(target_mm))
        machine = (x, y, z)
        delta = minus(machine, self._at_mm)
        if why := limits.target_refusal(machine) or limits.feed_refusal(delta, feed_mm_min):
            raise InputError(f"{self._url}: {why}")
        planned_s = move_duration_s(delta, feed_mm_min, limits.axes(110), limits.axes(120))
        words = "".join(f"{axis}{p:.4f}" for axis, p in zip(AXES, machine, strict=True))
        self._drain()
        self._move = _Move(machine, self._now_ns(), planned_s)
        self._command(f"$J=G90G21G53{words}F{feed_mm_min:.3f}", JOG_ANSWER_S)
        return planned_s

    def wait(self) -> StageState:
        """Wait until the last move is at its target, polling the controller.

        Raises StageError when it stops short, takes much longer than planned, or fails.
        """
        self._require_ready()
        move = self._move
        if move is None:
            return self.poll()
        limit_s = move.planned_s * 1.1 + MARGIN_S
        idle_short = 0
        while True:
            left_s = move.planned_s - self._since_s(move.start_ns)
            if left_s > 0 or idle_short:
                self.listen(min(POLL_S, max(left_s + 0.002, POLL_END_S)))
            state = self.poll()
            if state.state == "Idle":
                if self._limits.same_place(move.target_mm, state.machine_mm):
                    self._move = None
                    # The next move starts from what was commanded, not from its rounding.
                    self._at_mm = move.target_mm
                    return state
                idle_short += 1
                if idle_short == 2:
                    self._move = None
                    self._fail(f"stopped at {_mm(state.machine_mm)} short of {_mm(move.target_mm)}")
            elif state.state != "Jog":
                self._fail(f"{state.state} during a move to {_mm(move.target_mm)}, expected Jog")
            if self._since_s(move.start_ns) > limit_s:
                self._fail(
                    f"still {state.state} at {_mm(state.machine_mm)} after {limit_s:.1f} s; the "
                    f"move to {_mm(move.target_mm)} was planned to take {move.planned_s:.1f} s"
                )
            if left_s <= 0 and not idle_short:
                self.listen(POLL_END_S)

    def listen(self, seconds: float) -> None:
        """Let that much time pass, and hear what the controller says meanwhile.

        So an alarm or a restart stops the move when it is told, not at the next question. Raises
        StageError.
        """
        if self._port is None:
            self._clock.sleep_s(seconds)
            return
        self._talker = threading.get_ident()
        deadline = self._deadline(seconds)
        while True:
            if waiting := self._io(lambda: self._port.in_waiting):
                *lines, self._partial = (
                    self._partial + self._io(lambda: self._port.read(waiting))
                ).split(b"\n")
                for raw in lines:
                    self._watch(raw.decode("ascii", "replace").strip())
            left_ns = deadline - self._now_ns()
            if left_ns <= 0:
                return
            self._clock.sleep_s(min(left_ns / 1e9, HEAR_S))

    def position_mm(self) -> Vec3:
        """Tip position in the sensor frame (mm) as the controller reports it now."""
        self._require_ready()
        return self.located()[1]

    def located(self) -> tuple[int, Vec3]:
        """When (ns of the clock) the tip was where (sensor frame, mm): asked now.

        The time is as near as can be known, see `StageState.t_s`; `identity` has the worst case.
        """
        self._require_ready()
        state = self.poll()
        self._within_s = max(self._within_s, state.within_s)
        return round(state.t_s * 1e9), self._frame.to_sensor_mm(state.machine_mm)

    def stop(self) -> None:
        """Halt motion with the controller's own deceleration and wait for Idle.

        The position is kept and the next move may start, unless it was homing, which only a reset
        ends. While another thread talks to the controller the byte is written and no more: that
        thread hears what comes of it. Raises StageError when it does not come to rest.
        """
        if threading.get_ident() != self._talker:
            self._blurt(RESET if self._homing else JOG_CANCEL)
            return
        if self._homing:
            self.reset()
            return
        self.cancel()
        if self._trouble:
            self._fail(self._trouble)
        if not self._homed:
            return  # no move was begun
        deadline = self._deadline(self._limits.braking_s() + MARGIN_S)
        while (state := self.poll()).state != "Idle":
            if state.state != "Jog":
                self._write(b"!")
                self._fail(f"{state.state} after a jog cancel, expected Idle")
            if self._now_ns() > deadline:
                self._fail(f"still {state.state} at {_mm(state.machine_mm)} after a jog cancel")
            self._clock.sleep_s(POLL_END_S)
            self.cancel()  # the first came to nothing if the jog had not begun
        self._move, self._stopping = None, False

    def identity(self) -> dict[str, Any]:
        """Banner, version, options and settings as the controller gave them, and the frame."""
        return {
            "kind": "grbl",
            "port": self._url,
            "banner": self._banner,
            "info": list(self._info),
            "settings": {f"${n}": v for n, v in sorted(self._limits.settings.items())},
            "origin_machine_mm": list(self._frame.origin_machine_mm),
            "angle_deg": self._frame.angle_deg,
            "tilt_deg": list(self._frame.tilt_deg),
            "pose_within_s": self._within_s,
        }

    def close(self) -> None:
        """Close the port; a move under way is told to stop, for nobody will watch it."""
        self._halt()
        port, self._port = self._port, None
        if port is not None:
            port.close()

    @property
    def frame(self) -> StageFrame:
        """The sensor frame as the tip that is mounted now has it."""
        return self._frame

    @property
    def homed(self) -> bool:
        """Whether positions are known: homed since it was connected, and no fault since."""
        return self._homed and not self._trouble

    def set_frame(self, frame: StageFrame) -> None:
        """Tell and take positions in this frame from now on; nothing moves."""
        self._frame = frame

    def lift(self, height_mm: float, feed_mm_min: float) -> bool:
        """Go straight up, z of the machine alone, by that much or to the top of the travel.

        Also before homing: a controller that is not locked counts its steps, and up is away from
        the face whatever the count. False, with nothing moved, where it is locked. Raises
        StageError.
        """
        self._require_port()
        if self._unfit or self._trouble:
            return False
        state = self._query()
        if state.state != "Idle":
            return False
        x, y, z = self._at_mm = state.machine_mm
        was, self._homed = self._homed, True
        try:
            self.start_move(self._frame.to_sensor_mm((x, y, min(z + height_mm, 0.0))), feed_mm_min)
            self.wait()
        finally:
            self._homed = self._homed and was
        return True

    # ---- beyond the interface -----------------------------------------------------------------

    def poll(self) -> StageState:
        """Ask the controller once. Raises StageError for an alarm, a restart or silence."""
        self._require_port()
        if self._trouble:
            self._fail(self._trouble)
        state = self._query()
        self._at_mm = state.machine_mm
        if state.state in ("Alarm", "Sleep"):
            self._break(f"the controller is in {state.state}: its position is lost, home again")
        return state

    def cancel(self) -> None:
        """Write the byte that ends the motion under way and nothing else: from any thread."""
        self._blurt(RESET if self._homing else JOG_CANCEL)

    def abort(self) -> None:
        """Write the reset byte and nothing else: for a signal handler.

        The position is lost; `home` comes next.
        """
        self._blurt(RESET)
        self._lose("the controller was reset: home again")
        self._homing, self._move = False, None

    def reset(self) -> None:
        """Reset the controller (0x18) and wait for its banner. The position is lost; `home` next.

        Raises StageError when no banner comes.
        """
        self._require_port()
        self._lose("the controller was reset: home again")
        self._homing, self._move = False, None
        if not self._greeted():
            self._break("no banner after a reset (0x18)")

    # ---- talking ------------------------------------------------------------------------------

    def _open(self) -> None:
        own = {} if "://" in self._url else {"exclusive": True}
        try:
            self._port = serial.serial_for_url(
                self._url, baudrate=self._baud, timeout=SLICE_S, write_timeout=ANSWER_S, **own
            )
        except ValueError as why:
            raise InputError(f"{self._url}: not a serial port: {why}") from why
        except OSError as why:
            raise StageError(f"{self._url}: cannot be opened: {why}") from why

    def _await_banner(self, limit_s: float) -> str:
        """Wait for the banner; whatever a first boot prints before it is no concern of ours."""
        deadline = self._deadline(limit_s)
        while (text := self._line(deadline)) is not None:
            if found := BANNER.search(text):
                return text[found.start() :]
        return ""

    def _greeted(self) -> bool:
        """Reset, and hear the banner and all that comes with it; False if none comes."""
        self._talker = threading.get_ident()
        # Within half a second of an alarm a reset is not heard; the banner of one that came before
        # may still be under way. Neither is worth a word.
        for limit_s in (RESET_S, LISTEN_S):
            self._write(RESET)
            if banner := self._await_banner(limit_s):
                self._banner, self._reset_due = banner, False
                self._await_quiet()
                return True
        return False

    def _await_quiet(self) -> None:
        while self._line(self._deadline(QUIET_S)) is not None:
            pass

    def _first_status(self) -> str:
        """What it is doing, "" when it does not answer."""
        self._write(b"?")
        deadline = self._deadline(ANSWER_S)
        while (text := self._line(deadline)) is not None:
            if found := STATUS.search(text):
                return found[1].partition(":")[0]
        return ""

    def _command(self, line: str, limit_s: float = ANSWER_S) -> list[str]:
        """Send a line, wait for its ok, return what came before it."""
        self._drain()
        self._awaiting_ok = True
        self._write(line.encode("ascii") + b"\n")
        deadline = self._deadline(limit_s)
        data: list[str] = []
        while (text := self._line(deadline)) is not None:
            if text == "ok":
                self._awaiting_ok = False
                return data
            if text.startswith("error:"):
                self._awaiting_ok = False
                self._halt()  # it may have been the error of another line
                self._fail(f"{line} was refused: {explain(text, ERRORS)}")
            self._watch(text)
            data.append(text)
        return self._break(f"no answer to {line} within {limit_s:.1f} s")

    def _query(self) -> StageState:
        """One status report.

        Silence is borne once. After the second time what moves is stopped, then a restarting
        controller gets its say.
        """
        self._drain()
        stopped = ""
        # The first: what comes after a second question may still answer it.
        asked_ns = self._now_ns() + self._on_wire_ns(1)
        for limit_s in (STATUS_S, STATUS_S, LISTEN_S):
            if limit_s == LISTEN_S:
                stopped = self._halt()
            self._write(b"?")
            deadline = self._deadline(limit_s)
            while (text := self._line(deadline)) is not None:
                found = STATUS.search(text)
                if found is None:
                    self._watch(text)
                elif found[2] == "W":
                    self._fail("status reports give the work position; set $10=1 or $10=3")
                elif not stopped:
                    rate = RATE.search(text)
                    t_s, within_s = self._true_at(asked_ns, len(text) + len("\r\n"))
                    return StageState(
                        (float(found[3]), float(found[4]), float(found[5])),
                        found[1],
                        float(rate[1]) if rate else 0.0,
                        t_s,
                        within_s,
                    )
        return self._break(f"no answer to '?' within {2 * STATUS_S:g} s{stopped}")

    def _true_at(self, asked_ns: int, n: int) -> tuple[float, float]:
        """When the position in an answer of n bytes that is complete now was true; give or take.

        It was read between the question and the answer's first byte. That one is as old as the
        answer is long, unless the link is faster than its baud rate (USB).
        """
        answered_ns = self._now_ns()
        begun_ns = answered_ns - self._on_wire_ns(n)
        if begun_ns < asked_ns:
            begun_ns = max(answered_ns, asked_ns)
        return (asked_ns + begun_ns) / 2e9, (begun_ns - asked_ns) / 2e9

    def _on_wire_ns(self, n: int) -> int:
        return n * 10 * 1_000_000_000 // self._baud

    def _watch(self, text: str) -> None:
        """Raise for what nobody asked to hear: an alarm, or the banner of a restart."""
        if text.startswith("ALARM:"):
            self._break(f"{explain(text, ALARMS)}; home again")
        if found := BANNER.search(text):
            self._break(f"the controller restarted ({found[0]}): its position is lost, home again")
        if text == "ok" and self._awaiting_ok:
            self._awaiting_ok = False

    def _drain(self) -> None:
        """Hear what has come since the last exchange, so that it is not taken for an answer."""
        self._talker = threading.get_ident()
        while self._io(lambda: self._port.in_waiting):
            text = self._line(self._deadline(SLICE_S))
            if text is not None:
                self._watch(text)

    def _line(self, deadline_ns: int) -> str | None:
        """The next line that is not empty, None at the deadline (what came of it is kept)."""
        while True:
            self._partial += self._io(lambda: self._port.read_until(b"\n"))
            if self._partial.endswith(b"\n"):
                raw, self._partial = self._partial, b""
                text = raw.decode("ascii", "replace").strip()
                if text:
                    return text
            elif self._now_ns() >= deadline_ns:
                return None

    def _blurt(self, data: bytes) -> None:
        """Write from any thread or signal handler; whoever talks to the port hears its faults."""
        with suppress(Exception):
            self._port.write(data)

    def _write(self, data: bytes) -> None:
        self._io(lambda: self._port.write(data))

    def _io(self, what: Callable[[], T]) -> T:
        self._require_port()
        try:
            return what()
        except OSError as why:
            came_of_it = self._halt()
            self.close()
            self._break(f"the link is lost ({why}){came_of_it}")

    def _halt(self) -> str:
        """Write the byte that ends what may be moving; say what came of it, "" if nothing was."""
        move, homing = self._move, self._homing
        if move is None and not homing:
            return ""
        self._stopping, self._reset_due = True, self._reset_due or homing
        what = "homing" if move is None else f"the move to {_mm(move.target_mm)}"
        reached = self._reach(RESET if homing else JOG_CANCEL)
        self._move, self._homing = None, False
        return f"; {what} {'was told to stop' if reached else 'goes on'}"

    def _reach(self, stop: bytes) -> bool:
        """Write a stop byte, through a port opened anew if this one is gone; True if it went out.

        Opening the port restarts an Arduino: that stops a move as well.
        """
        deadline = self._deadline(REOPEN_S)
        while True:
            with suppress(Exception):  # a terminal that is gone has errors of its own
                if self._port is None:
                    self._open()
                self._port.write(stop)
                self._clock.sleep_s(SETTLE_S)
                self._port.write(stop)
                return True
            port, self._port = self._port, None
            with suppress(OSError):
                if port is not None:
                    port.close()
            if self._now_ns() >= deadline:
                return False
            self._clock.sleep_s(POLL_S)

    # ---- state --------------------------------------------------------------------------------

    def _require_port(self) -> None:
        if self._port is None:
            self._fail(self._trouble or "not connected")

    def _require_ready(self) -> None:
        if self._trouble:
            self._fail(f"no motion after a fault ({self._trouble})")
        self._require_port()
        if not self._homed:
            self._fail("its position is not known: home first")

    def _break(self, why: str) -> NoReturn:
        """A fault that leaves the position in doubt: nothing moves until it is homed."""
        self._lose(why)
        self._fail(why)

    def _lose(self, why: str) -> None:
        # The first reason is the one to tell: silence after an alarm is no news.
        self._trouble = self._trouble or why
        self._homed, self._awaiting_ok, self._reset_due = False, False, True

    def _fail(self, why: str) -> NoReturn:
        raise StageError(f"{self._url}: {why}{self._halt()}")

    def _now_ns(self) -> int:
        # Whole nanoseconds: sums and differences do not depend on how far the clock has come.
        return round(self._clock.now_s() * 1e9)

    def _since_s(self, start_ns: int) -> float:
        return (self._now_ns() - start_ns) / 1e9

    def _deadline(self, seconds: float) -> int:
        return self._now_ns() + round(seconds * 1e9)


def _mm(p: Vec3) -> str:
    return f"({p[0]:.3f}, {p[1]:.3f}, {p[2]:.3f}) mm"
