"""State of one GRBL controller: faults, validity of its position, and how it is brought to rest.

A fault stops the motion before it is raised, see `Controller.exchange`. A move keeps track of the
part already sent, which is the link-loss stop: if the host stops, the controller moves no further.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from operator import mul
from typing import NoReturn

from deltact_fab.common import Point, StageError

from ...protocols.motion import subtract_vectors
from ..interface import Clock, StageState
from .exchange import ALARM_TEXTS, BANNER_S, SOFT_RESET, Talk, TalkFault, explain, state_text
from .port import Cable, LinkLost, Port
from .settings import Limits

JOG_CANCEL, FEED_HOLD = b"\x85", b"!"
STOPS_BY_STATE = {"Jog": JOG_CANCEL, "Run": FEED_HOLD}
# By hand: longer times report a stuck stage later, shorter ones load the line.
POLL_END_S = 0.02
STOP_MARGIN_S = 2.0
HELD_STATES = ("Hold", "Hold:0", "Door:0", "Check")  # at rest: a reset ends them without motion
# Decision 0073, figures on GRBL in docs/evidence/firmware.md; by hand: more overruns a lost link.
PLANNED_AHEAD_S = 0.17  # in the gel; 0.22 with one more piece whose answer is lost
AHEAD_CLEAR_S = 0.5  # clear of the face
PIECE_S = 0.05  # of motion per line, at the feed
HOST_LATE_S = 0.3  # for so long after a late host a delay is no fault
MIN_PIECE_MM = 2e-4  # per line: positions have four decimals
CLOCK_GAIN = 0.2  # of the delay, corrected at each status


@dataclass(frozen=True)
class Move:
    """A straight move: machine positions (mm), start (ns of the clock), planned time (s).

    ahead_s: motion sent before it is due; infinite: all at once. sent_mm: distance sent.
    late_ns: time of the last line that came too late to prevent braking.
    """

    start_mm: Point
    target_mm: Point
    feed_mm_min: float
    accel_mm_s2: float
    start_ns: int
    planned_s: float
    ahead_s: float
    sent_mm: float = 0.0
    late_ns: int = 0

    def since_s(self, now_ns: int) -> float:
        return (now_ns - self.start_ns) / 1e9

    @property
    def is_sent(self) -> bool:
        """True if all of it was sent."""
        return self.sent_mm >= self._length_mm

    def due_mm(self, now_ns: int) -> float | None:
        """Return the distance at the end of the next line, None while none is due."""
        since_s = self.since_s(now_ns)
        due_mm = self._distance_mm(since_s + self.ahead_s)
        if due_mm < self._length_mm:
            early_mm = self._distance_mm(since_s + self.ahead_s - PIECE_S)
            if early_mm < self.sent_mm or due_mm < self.sent_mm + MIN_PIECE_MM:
                return None
        return None if self.is_sent else due_mm

    def first_mm(self) -> float:
        return max(self._distance_mm(self.ahead_s), MIN_PIECE_MM)

    def point_at_mm(self, distance_mm: float) -> Point:
        """Return the point at a distance along the line, rounded as in a command."""
        if distance_mm >= self._length_mm:
            return self.target_mm
        share = distance_mm / self._length_mm
        x, y, z = (
            round(a + share * (b - a), 4) + 0.0
            for a, b in zip(self.start_mm, self.target_mm, strict=True)
        )
        return (x, y, z)

    def runs_dry(self, now_ns: int, braking: bool = False) -> bool:
        """True if the controller is at the end of the sent motion; braking: or brakes for it."""
        since_s, ahead_mm = self.since_s(now_ns), 0.0
        if braking:
            speed = min(self.feed_mm_min / 60, self.accel_mm_s2 * max(since_s, 0.0))
            ahead_mm = speed**2 / (2 * self.accel_mm_s2)
        return not self.is_sent and self._distance_mm(since_s) + ahead_mm > self.sent_mm

    def retimed(self, state: StageState) -> Move:
        """Re-time the move to the reported position, as host and controller clocks differ."""
        if self.is_sent:
            return self
        share = 1.0 if self._host_was_late(state) else CLOCK_GAIN
        return replace(self, start_ns=self.start_ns + round(share * 1e9 * self._delay_s(state)))

    def was_held(self, state: StageState, more_than_s: float) -> bool:
        """True if a jog was ended from elsewhere and the next one would start from rest."""
        if self.is_sent:
            return False
        dry = self.runs_dry(round(state.t_s * 1e9), braking=True)
        behind_s = self._delay_s(state) - state.within_s
        return behind_s > more_than_s and not dry and not self._host_was_late(state)

    def _host_was_late(self, state: StageState) -> bool:
        """True if the delay is due to a late host."""
        ramp_s = self.feed_mm_min / 60 / self.accel_mm_s2
        return state.t_s - self.late_ns / 1e9 < HOST_LATE_S + ramp_s

    def _delay_s(self, state: StageState) -> float:
        travelled = subtract_vectors(state.machine_mm, self.start_mm)
        path = subtract_vectors(self.target_mm, self.start_mm)
        travelled_mm = sum(map(mul, travelled, path)) / self._length_mm
        planned_mm = self._distance_mm(state.t_s - self.start_ns / 1e9)
        return (planned_mm - travelled_mm) / (self.feed_mm_min / 60)

    @property
    def _length_mm(self) -> float:
        return math.dist(self.start_mm, self.target_mm)

    def _distance_mm(self, t_s: float) -> float:
        """Planned distance after t_s, without braking at the end."""
        if t_s <= 0:
            return 0.0
        if math.isinf(t_s):
            return self._length_mm
        speed = self.feed_mm_min / 60
        ramp_s = speed / self.accel_mm_s2
        distance_mm = self.accel_mm_s2 * t_s**2 / 2 if t_s < ramp_s else speed * (t_s - ramp_s / 2)
        return min(distance_mm, self._length_mm)


class Controller:
    """url: a serial device or a pyserial URL."""

    def __init__(self, url: str | Cable, clock: Clock, baud: int) -> None:
        self.url = url
        self.port = Port(url, clock, baud)
        self.talk = Talk(self.port)
        self.limits = Limits({})
        self.banner = ""
        self.at_mm: Point = (0.0, 0.0, 0.0)
        """Machine position, last reported or reached."""
        self.move: Move | None = None
        """The present move, as far as is known."""
        self.clear = False
        """True if the move stays clear of the face."""
        self.waits = 0
        """Number of waits for a late host, and of answers lost clear of the face."""
        self.homed = False
        self.homing = False
        self.cancelled = False
        """A stop was requested: the byte is repeated if it came too early."""
        self.stopping = False
        """A fault sent a stop, and rest is not confirmed yet."""
        self.trouble = ""
        """Reason why the position is in doubt."""
        self.reset_due = False
        """A reset is needed before the next homing."""
        self.clock = clock
        self._lock = threading.RLock()  # of one exchange

    def clear_state(self) -> None:
        """Clear position and faults, before connecting and homing."""
        self.homed = self.homing = self.stopping = self.reset_due = False
        self.trouble, self.move = "", None

    # ---- faults -------------------------------------------------------------------------------

    @contextmanager
    def exchange(self) -> Iterator[None]:
        """Lock the controller for one exchange; a fault in it stops the motion, then StageError.

        All communication takes place within one.
        """
        with self._lock:
            try:
                yield
            except TalkFault as fault:
                if fault.position_lost:
                    self.lose_position(fault.reason)
                self._raise(fault.reason, fault)
            except LinkLost as error:
                if not self.port.is_open:
                    self._raise(self.trouble or str(error), error)
                halted = self.halt()
                self.port.close()
                self.lose_position(f"{error}{halted}")
                self._raise(f"{error}{halted}", error)

    def _raise(self, reason: str, cause: Exception) -> NoReturn:
        raise StageError(f"{self.url}: {reason}{self.halt()}") from cause

    def lose_position(self, reason: str) -> None:
        """Mark the position as lost. The first reason is kept, as it causes later ones."""
        self.trouble = self.trouble or reason
        self.homed, self.reset_due = False, True

    def status(self) -> StageState:
        """Query position and state. Raises TalkFault; silence stops the motion."""
        return self.talk.status(self.halt)

    def require_position(self, state: StageState) -> None:
        """Raise TalkFault for a state without a valid position."""
        if state.state.partition(":")[0] in ("Alarm", "Sleep"):
            raise TalkFault(
                f"the controller is in {state_text(state.state)}: its position is lost, home again",
                position_lost=True,
            )

    def require_ready(self) -> None:
        """Raise TalkFault unless it is homed and without a fault since."""
        if self.trouble:
            raise TalkFault(f"no motion after a fault ({self.trouble})")
        if not self.port.is_open:
            raise TalkFault("not connected")
        if not self.homed:
            raise TalkFault("the position is unknown: home first")

    # ---- bringing it to rest ------------------------------------------------------------------

    def wake(self) -> None:
        """Read the banner of a controller that restarts on opening; wake any other.

        Only one that says nothing at all, or is asleep, is reset.
        """
        lines = self.talk.banner()
        report = None if lines else self.talk.peek_status()
        state = "" if report is None else report.state
        if not lines and state in ("", "Sleep"):
            if not (lines := self.talk.late_banner() or self.talk.reset()):
                raise TalkFault(
                    f"no banner within {BANNER_S:g} s and no answer to '?' at {self.port.baud} "
                    "baud, nor to a reset (0x18); is it a GRBL 1.1 controller?"
                )
        elif state.partition(":")[0] not in ("", "Idle", "Alarm"):
            self.rest(alarmed=True)
        self.banner = lines[0] if lines else ""

    def rest(self, *, alarmed: bool = False) -> StageState:
        """Bring it to Idle by braking only; motion waiting in Hold or Door is discarded.

        alarmed: accept Alarm as well.
        """
        deadline = self.port.deadline_ns(self.limits.braking_s() + STOP_MARGIN_S)
        while True:
            state = self.status()
            name = state.state.partition(":")[0]
            if name == "Idle" or (alarmed and name == "Alarm"):
                self.at_mm = state.machine_mm
                return state
            self.require_position(state)
            if self.port.now_ns() > deadline:
                raise TalkFault(f"still {state.state} at {in_mm(state.machine_mm)} after a stop")
            if state.state in HELD_STATES:
                self._release(state)
                continue
            if state.state == "Door:1":
                raise TalkFault("the safety door is open: close it, then try again")
            if name not in (*STOPS_BY_STATE, "Hold", "Door"):
                raise TalkFault(f"the controller is in {state_text(state.state)}; reset it first")
            self.clock.sleep_s(POLL_END_S)
            if name in STOPS_BY_STATE:  # the first byte is ignored before the jog has begun
                self.port.write(STOPS_BY_STATE[name])

    def idle_again(self, limit_s: float) -> StageState | None:
        """Wait for rest after a fault, sending stops; None if it does not rest with its count.

        Opens a lost port again; ends Hold and a door that was closed, as `rest` does.
        """
        deadline = self.port.deadline_ns(limit_s)
        while self.port.now_ns() < deadline:
            try:
                if not self.port.is_open:
                    self.port.open()
                state = self.talk.peek_status()
                if state is None:
                    continue
                name = state.state.partition(":")[0]
                if name == "Idle":
                    self.move, self.stopping = None, False
                    return state
                if state.state in HELD_STATES:
                    self._release(state, counted=True)
                elif name in STOPS_BY_STATE:
                    self.port.write(STOPS_BY_STATE[name])
                elif name not in ("Hold", "Door") or state.state == "Door:1":
                    return None
            except TalkFault:
                return None
            except (LinkLost, StageError):
                self.port.close()
            self.clock.sleep_s(POLL_END_S)
        return None

    def _release(self, held_state: StageState, counted: bool = False) -> None:
        """End Hold, or Door with the door closed, by a reset, which keeps the position at rest.

        counted: check that it did, also for a position that is not trusted now.
        """
        reset_due = self.reset_due
        for text in self.reset():
            if text.startswith("ALARM:"):
                raise TalkFault(f"{explain(text, ALARM_TEXTS)}; home again", position_lost=True)
        self.reset_due = reset_due
        if self.homed or counted:
            new_state = self.status()
            unmoved = self.limits.same_place(held_state.machine_mm, new_state.machine_mm)
            if not unmoved or new_state.state.startswith("Alarm"):
                text = f"the position was lost when {held_state.state} was ended"
                raise TalkFault(text, position_lost=True)

    def reset(self) -> list[str]:
        """Reset it; return its lines, the banner first. Raises TalkFault without a banner."""
        lines = self.talk.reset()
        if not lines:
            raise TalkFault("no banner after a reset (0x18)", position_lost=True)
        self.banner, self.reset_due = lines[0], False
        return lines

    def halt(self) -> str:
        """Write the byte that ends any motion; return the outcome, "" if there was none."""
        move, homing = self.move, self.homing
        if move is None and not homing:
            return ""
        self.stopping, self.reset_due = True, self.reset_due or homing
        motion = "homing" if move is None else f"the move to {in_mm(move.target_mm)}"
        reached = self.port.write_stop(SOFT_RESET if homing else JOG_CANCEL)
        self.move, self.homing = None, False
        return f"; {motion}{': stop sent' if reached else ' continues'}"


def in_mm(p: Point) -> str:
    """Format a position for a message."""
    return f"({p[0]:.3f}, {p[1]:.3f}, {p[2]:.3f}) mm"
