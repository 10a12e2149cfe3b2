"""A GRBL 1.1h motion controller that jogs: bytes in, bytes out, a carriage in time.

What a host of jogs meets follows the firmware's documents and behaviour: send-response lines,
realtime bytes, the planner's queue, homing, soft limits, alarms, settings, status reports with WCO
and Ov now and then. It has no thread and no time of its own: each call first catches up with the
clock.

Where it is simpler than the firmware: it runs no G-code (error:20) and knows millimetres alone (G20
is refused, $13 changes no report); every line is a trapezoid from rest to rest, but for a jog
straight on, which prolongs the one under way; homing comes to rest at the switches, which trip
within SCATTER_MM of their place, another way at each approach. What the firmware itself answered
stands in tests/data; a test compares.
"""

from __future__ import annotations

import random
from collections import deque
from collections.abc import Callable, Generator, Mapping, Sequence
from functools import reduce
from operator import or_
from typing import Literal

from deltact_fab.bench import Clock, StageConfig
from deltact_fab.common import Point, to_ns

from .carriage import PLANNER_BLOCKS, Carriage
from .clock import NS_PER_S
from .grbl_lines import (
    DEFAULTS_GRBL,
    FIRMWARE_TEXTS,
    HOMING_PASS_MASKS,
    GrblError,
    coordinates,
    grbl_settings,
    parse_jog,
    set_value,
    settings_text,
)
from .motion import Segment

_RX_BYTES, _LINE_CHARS = 128, 79  # GRBL 1.1h, config.h
# The firmware waits for its alarm message to get out, deaf to everything, before it does the rest.
_ALARM_PAUSE_NS = NS_PER_S // 2

ControllerState = Literal["Idle", "Jog", "Run", "Hold", "Home", "Alarm", "Sleep"]
Fault = Literal[
    "reboot", "silence", "limit", "soft limit", "door", "door closes", "hold", "late jog"
]
# What a line that cannot finish yet waits for: a free planner slot, a carriage at rest, or a moment
# (ns).
TaskWait = Literal["slot", "still"] | int
Task = Generator[TaskWait, None, int]


class GrblController:
    """One simulated board with its three axes: bytes in, bytes out, and a carriage.

    settings: `$` numbers to values, over `SETTINGS`. start_mm: where the carriage stands at
    power-on, in the true machine frame (the switches are at 0, or at -travel where $23 says so).
    boot_s: time from power-on or a hardware reset to the banner. firmware: of `FIRMWARE_TEXTS`.
    homing_passes: masks of the axes homed together, a compile option of GRBL; grblHAL reads them
    from $44 to $46. axis_count: numbers in a status; axes beyond Z stand still at 0. pendant: one
    has control; it refuses motion, or "mute": nothing but `?` is heard. May be set at any time.
    """

    _state: ControllerState
    _boot_ns: int | None
    _after_alarm: tuple[int, Callable[[], None]] | None
    _wait_ns: int | None
    _waiting: TaskWait | None
    _task: Task | None
    _rx: deque[int]
    _deferred: list[int]

    def __init__(
        self,
        settings: Mapping[int, float] | None,
        clock: Clock,
        *,
        start_mm: Point = (-20.0, -20.0, -10.0),
        boot_s: float = 1.0,
        firmware: str = "GRBL",
        homing_passes: Sequence[int] = (4, 3),
        axis_count: int = 3,
        pendant: Literal["", "refuses", "mute"] = "",
    ) -> None:
        defaults = {**DEFAULTS_GRBL, **(HOMING_PASS_MASKS if firmware == "grblHAL" else {})}
        self.settings = {**defaults, **(settings or {})}
        if unknown := sorted(set(self.settings) - set(defaults)):
            raise ValueError(f"no such GRBL setting: ${unknown[0]}")
        self.banner, *self._info = FIRMWARE_TEXTS[firmware]
        self.pendant = pendant
        self._homing_passes, self._more_axes = homing_passes, (0.0,) * (axis_count - 3)
        self._late = False  # the next jog comes as the present one ends
        self._clock, self._t = clock, clock.now_ns()
        self._carriage = Carriage(self.settings, start_mm, self._t)
        self._out: list[tuple[int, bytes]] = []
        self._boot = to_ns(boot_s)
        self._faults: list[tuple[int, Fault]] = []
        self._mute = False
        self._ajar = False  # the safety door's switch
        self._scatter = random.Random(0)
        self._trips_ns: int | None = None  # when the move under way meets a switch
        self._power_on()

    @classmethod
    def for_stage(cls, stage: StageConfig, clock: Clock) -> GrblController:
        """Controller with the limits of a rig file's stage and default settings otherwise."""
        limits = stage.travel_mm, stage.max_feed_mm_min, stage.acceleration_mm_s2
        return cls(grbl_settings(*limits), clock)

    # ---- the wire -----------------------------------------------------------------------------

    def write(self, data: bytes) -> None:
        """Bytes from the host, all received now."""
        self._advance()
        for byte in data:
            if self._mute or self._boot_ns is not None:
                continue
            if self.pendant == "mute" and byte != ord("?"):
                continue
            if byte in b"?!~\x18" or byte >= 0x80:
                self._realtime(byte)
            elif len(self._rx) < _RX_BYTES:
                self._rx.append(byte)
                self._pump()

    def hard_reset(self) -> None:
        """The reset pin (opening the port of an Arduino pulls it), or power off and on."""
        self._advance()
        self._strike("reboot")

    def fault(self, kind: Fault, at_s: float | None = None) -> None:
        """Make something go wrong, now or at a later time of the clock.

        reboot: a brown-out. silence: the cable is pulled, motion goes on. limit: a hard limit.
        soft limit: as if the line under way led out of the travel.
        door: the safety door opens, and stays so until it closes. hold: the button for it.
        late jog: the next line that would prolong a jog is read as that jog ends. GRBL starts it
        as Run, in which it is deaf to 0x85 and refuses jogs.
        """
        self._advance()
        self._faults.append((self._t if at_s is None else to_ns(at_s), kind))
        self._faults.sort()
        self._advance()

    def read_available(self) -> bytes:
        """Everything said up to now and not yet read."""
        return b"".join(data for _, data in self.take_output())

    def take_output(self) -> list[tuple[int, bytes]]:
        """The same, in pieces with the time (ns) at which each was said."""
        self._advance()
        out, self._out = self._out, []
        return out

    def next_event_ns(self) -> int | None:
        """When something next happens by itself (and the controller may speak), None: never."""
        self._advance()
        return self._next_ns()

    def now_ns(self) -> int:
        return self._clock.now_ns()

    # ---- the truth, for the scene -------------------------------------------------------------

    @property
    def segments(self) -> list[Segment]:
        """Every straight piece of the carriage's path, the planned one last."""
        self._advance()
        return self._carriage.path.segments

    def position_mm(self, t_s: float | None = None) -> Point:
        """Position of the carriage, machine mm, now or at a past time.

        Raises ValueError for a time that has not come: what will be is not decided yet.
        """
        self._advance()
        t_ns = self._t if t_s is None else to_ns(t_s)
        if t_ns > self._t:
            raise ValueError(f"{t_s} s has not come yet: it is {self._t / NS_PER_S} s")
        return self._carriage.path.position_mm(t_ns)

    @property
    def state(self) -> str:
        """State of the controller: Idle, Jog, Run, Hold, Home, Alarm or Sleep."""
        self._advance()
        return self._state

    # ---- time ---------------------------------------------------------------------------------

    def _next_ns(self) -> int | None:
        times = [self._boot_ns, self._wait_ns, self._trips_ns]
        times += [t for t, _ in self._faults[:1]]
        times += [self._carriage.moving.end_ns] if self._carriage.moving else []
        times += [self._after_alarm[0]] if self._after_alarm else []
        return min((t for t in times if t is not None), default=None)

    def _advance(self) -> None:
        now_ns = self._clock.now_ns()
        while (t := self._next_ns()) is not None and t <= now_ns:
            self._t = max(t, self._t)
            if self._faults and self._faults[0][0] <= t:
                self._strike(self._faults.pop(0)[1])
                continue
            if self._after_alarm is not None and self._after_alarm[0] <= t:
                _, then = self._after_alarm
                self._after_alarm = None
                then()
            if self._boot_ns is not None and self._boot_ns <= t:
                self._boot_ns = None
                self._greet()
            if self._trips_ns is not None and self._trips_ns <= t:
                self._trips_ns = None
                self._strike("limit")
            if self._carriage.moving is not None and self._carriage.moving.end_ns <= t:
                self._segment_done()
            if self._wait_ns is not None and self._wait_ns <= t:
                self._wait_ns = None
            self._pump()
        self._t = now_ns

    def _power_on(self) -> None:
        """Only the settings are remembered: the count starts at 0 wherever the carriage is."""
        self._state = "Alarm" if self.settings[22] else "Idle"
        self._carriage.forget()
        self._boot_ns = self._t + self._boot
        self._clear()

    def _strike(self, kind: Fault) -> None:
        if kind == "silence":
            self._mute = True
        elif kind == "late jog":
            self._late = True
        elif kind in ("door", "door closes"):
            self._ajar = kind == "door"
            if self._ajar and self._boot_ns is None:
                self._open_door()
        elif kind == "hold":
            if self._boot_ns is None and self._state not in ("Alarm", "Sleep", "Home"):
                self._hold()
        elif kind == "reboot":
            self._stop_dead()
            self._power_on()
        elif self._boot_ns is None and self._state != "Alarm":
            self._stop_dead()
            self._alarm(1 if kind == "limit" else 2, self._lock)

    # ---- lines --------------------------------------------------------------------------------

    def _say(self, text: str) -> None:
        if not self._mute:
            self._out.append((self._t, text.encode("ascii") + b"\r\n"))

    def _greet(self) -> None:
        if not self._mute:
            self._out.append((self._t, b"\r\n"))
        self._say(self.banner)
        if self._state == "Alarm":
            self._say("[MSG:'$H'|'$X' to unlock]")

    def _clear(self) -> None:
        """Reset everything that no kind of reset keeps."""
        self._after_alarm = None
        self._rx = deque()
        self._line = ""
        self._overflow = False
        self._task = self._waiting = self._wait_ns = None
        self._carriage.drop()
        self._holding = False  # braking for a hold or a jog cancel
        self._door = False  # what holds, or will, is the safety door
        self._locked = False  # a critical alarm: only a reset is heard
        self._deferred = []
        self._wco_in = self._ov_in = 0
        self._programmed_mm = self._carriage.count_mm()

    def _pump(self) -> None:
        """Run lines until one has to wait, or there is none."""
        while not (
            self._locked
            or self._after_alarm is not None
            or self._boot_ns is not None
            or self._state == "Sleep"
            or self._state == "Hold"
            or (self._state == "Jog" and self._holding)
        ):
            if self._task is None:
                if not self._next_line():
                    return
            elif not self._may_go_on():
                return
            assert self._task is not None
            try:
                self._waiting = next(self._task)
                if isinstance(self._waiting, int):
                    self._wait_ns = self._waiting
            except StopIteration as end:
                self._task = self._waiting = None
                self._say(f"error:{end.value}" if end.value else "ok")
                if self._state == "Sleep":
                    self._say("[MSG:Sleeping]")
                deferred, self._deferred = self._deferred, []
                for byte in deferred:
                    self._realtime(byte)

    def _may_go_on(self) -> bool:
        if self._waiting == "slot":
            return self._carriage.free_blocks > 0
        if self._waiting == "still":
            return self._carriage.moving is None
        return self._wait_ns is None

    def _next_line(self) -> bool:
        while self._rx:
            c = chr(self._rx.popleft())
            if c in "\r\n":
                self._task = self._run(self._line, self._overflow)
                self._line, self._overflow = "", False
                return True
            if c > " " and not self._overflow:
                self._overflow = len(self._line) >= _LINE_CHARS
                self._line += c.upper()
        return False

    def _run(self, line: str, overflow: bool) -> Task:
        try:
            if overflow:
                return 11
            if not line:
                return 0
            if line[0] == "$":
                return (yield from self._system(line))
            return 9 if self._state in ("Alarm", "Jog") else 20  # no program is run here
        except GrblError as error:
            return error.code

    # ---- realtime bytes -----------------------------------------------------------------------

    def _realtime(self, byte: int) -> None:
        if self._after_alarm is not None:
            return
        if byte == 0x18:
            self._soft_reset()
        elif self._locked or (self._state == "Sleep" and byte != ord("?")):
            return
        elif self._state == "Home":
            if byte in b"?!" and byte not in self._deferred:
                self._deferred.append(byte)
        elif byte == ord("?"):
            self._report()
        elif byte == ord("!") or (byte == 0x85 and self._state == "Jog"):
            self._hold()
        elif byte == 0x84:
            self._open_door()
        elif byte == ord("~") and self._state == "Hold" and not (self._holding or self._ajar):
            self._state = "Run"
            self._door = False
            self._begin()
            self._pump()

    def _open_door(self) -> None:
        if self._state == "Home":
            self._stop_dead()
            self._alarm(7, self._restart)
        elif self._state not in ("Alarm", "Sleep"):
            self._say("[MSG:Check Door]")
            self._door = True
            self._hold()

    def _hold(self) -> None:
        if self._state == "Idle":
            self._state = "Hold"
        if self._state not in ("Jog", "Run") or self._holding:
            return
        self._holding = True
        if self._state == "Run":
            self._state = "Hold"
        if not self._carriage.brake(self._t):
            self._segment_done()
        elif self._trips_ns is not None:
            self._meet_switch()

    def _meet_switch(self) -> None:
        if self.settings[21]:
            self._trips_ns = self._carriage.trips_ns(self._scatter.uniform)

    def _soft_reset(self) -> None:
        homing, moving = self._state == "Home", self._carriage.moving is not None
        if homing or moving:
            self._stop_dead()
            self._alarm(6 if homing else 3, self._restart)
        else:
            self._restart()

    def _restart(self) -> None:
        # The line that was under way still gets its answer, just before the banner.
        if self._task is not None:
            self._say("ok")
        self._state = "Alarm" if self._state in ("Alarm", "Sleep") else "Idle"
        self._clear()
        self._greet()
        if self._ajar:
            self._open_door()

    def _alarm(self, number: int, then: Callable[[], None]) -> None:
        self._state = "Alarm"
        self._carriage.drop()
        self._say(f"ALARM:{number}")
        self._after_alarm = self._t + _ALARM_PAUSE_NS, then

    def _lock(self) -> None:
        self._say("[MSG:Reset to continue]")
        self._locked = True

    # ---- motion -------------------------------------------------------------------------------

    def _begin(self) -> None:
        """Start the next line of the queue, if the state is one that moves."""
        self._carriage.catch(self._t)
        self._trips_ns = None
        if self._state in ("Jog", "Run"):
            if not self._carriage.begin(self._t):
                self._state = "Idle"
            else:
                self._meet_switch()

    def _segment_done(self) -> None:
        self._trips_ns = None
        arrived = self._state != "Home" and not self._holding
        self._carriage.finish(arrived)
        if arrived:
            self._begin()
        elif self._holding:
            self._holding = False
            if self._state == "Jog":  # what is left of a Run is kept for `~`
                self._carriage.drop()
                self._programmed_mm = self._carriage.count_mm()
                self._state = "Hold" if self._door else "Idle"

    def _stop_dead(self) -> None:
        self._trips_ns = None
        self._carriage.stop_dead(self._t)
        self._holding = False

    def _home(self) -> Task:
        self._state = "Home"
        self._carriage.catch(self._t)
        declared = [int(self.settings[n]) for n in HOMING_PASS_MASKS if n in self.settings]
        passes = declared or [*self._homing_passes]
        for goal, rate in self._carriage.homing_legs(passes):
            while self._carriage.seek(goal, rate, self._t):
                yield "still"
            yield self._t + to_ns(self.settings[26] / 1000)
        self._carriage.set_home(reduce(or_, passes, 0))
        self._programmed_mm = self._carriage.count_mm()
        self._state = "Idle"
        return 0

    # ---- $ commands ---------------------------------------------------------------------------

    def _system(self, line: str) -> Task:
        command = line[1:]
        if self.pendant and command[:1] in ("J", "H"):
            return 9
        if command.startswith("J"):
            if self._state not in ("Idle", "Jog"):
                return 8
            if not command.startswith("J="):
                return 3
            return (yield from self._jog(command[2:]))
        if command[:1] in ("$", "X"):
            return self._print_or_unlock(command)
        if self._state not in ("Idle", "Alarm"):
            return 8
        if command == "H":
            if not self.settings[22]:
                return 5
            return (yield from self._home())
        if command == "SLP":
            self._state = "Sleep"
        elif command == "I":
            for text in self._info:
                self._say(text)
        elif not command or command[0] in "#GCHISRN":
            return 3
        else:
            set_value(self.settings, command)
            self._wco_in = 0
        return 0

    def _print_or_unlock(self, command: str) -> int:
        if len(command) > 1:
            return 3
        if command == "$":
            if self._state in ("Run", "Hold"):
                return 8
            for line in settings_text(self.settings):
                self._say(line)
        elif self._state == "Alarm":
            self._say("[MSG:Caution: Unlocked]")
            self._state = "Idle"
        return 0

    def _report(self) -> None:
        name: str = self._state
        if name == "Hold":
            door = 2 if self._holding else int(self._ajar)
            name = f"Door:{door}" if self._door else f"Hold:{int(self._holding)}"
        mm = self._carriage.count_mm(self._t)
        mask = int(self.settings[10])
        parts = [name, f"{'MPos' if mask & 1 else 'WPos'}:{coordinates((*mm, *self._more_axes))}"]
        if mask & 2:
            parts.append(f"Bf:{self._carriage.free_blocks},{_RX_BYTES - len(self._rx)}")
        parts.append(f"FS:{self._carriage.speed_mm_min(self._t):.0f},0")
        busy = self._state in ("Jog", "Run", "Hold")
        if self._wco_in:
            self._wco_in -= 1
        else:
            self._wco_in = 29 if busy else 9
            self._ov_in = self._ov_in or 1
            parts.append(f"WCO:{coordinates((0.0, 0.0, 0.0, *self._more_axes))}")
        if self._ov_in:
            self._ov_in -= 1
        else:
            self._ov_in = 19 if busy else 9
            parts.append("Ov:100,100,100")
        if self.pendant:
            parts.append("MPG:1")
        self._say(f"<{'|'.join(parts)}>")

    # ---- jogs ---------------------------------------------------------------------------------

    def _jog(self, line: str) -> Task:
        target_mm, feed_mm_min = parse_jog(line, self._programmed_mm)
        if self.settings[20] and self._carriage.outside(target_mm):
            raise GrblError(15)
        yield "slot"
        if late := self._late and self._state == "Jog":
            self._late, before_mm = False, self._programmed_mm
            yield "still"
            late = self._programmed_mm is before_mm  # not cancelled meanwhile
        self._programmed_mm = target_mm
        if self._state == "Jog" and self._carriage.prolong(target_mm, feed_mm_min, self._t):
            self._meet_switch()
            return 0
        self._carriage.plan(target_mm, feed_mm_min)
        if self._state == "Idle" and self._carriage.free_blocks < PLANNER_BLOCKS:
            self._state = "Run" if late else "Jog"
            self._begin()
        return 0
