"""A simulated board with Marlin 2: what `MarlinStage` says to it and hears, on a carriage in time.

Lines are answered in order: G28, G1, M400, M114, M115; M410 and M112 are heard at once. Whatever
else is said gets the `ok` of a line that changes nothing here.
"""

from __future__ import annotations

import re
from collections import deque
from collections.abc import Iterator
from typing import TYPE_CHECKING

from ...units import NS_PER_S
from ..board import SimulatedBoard
from ..grbl_settings import settings_for

if TYPE_CHECKING:
    from ...rig.config import StageConfig
    from ..clock import NsClock

WORD = re.compile(r"([XYZF])(-?[\d.]+)")
BOOT_NS = NS_PER_S


class MarlinBoard(SimulatedBoard):
    """Marlin's answers on the carriage of every simulated board."""

    def __init__(self, config: StageConfig, clock: NsClock) -> None:
        limits = config.travel_mm, config.max_feed_mm_min, config.acceleration_mm_s2
        super().__init__(settings_for(*limits), clock, (-20.0, -20.0, -10.0))
        self._power_on()

    # ---- the wire -----------------------------------------------------------------------------

    def write(self, data: bytes) -> None:
        """Bytes from the host, all received now."""
        self._advance()
        if self._boot_ns is not None or self._dead:
            return
        *whole, self._partial = (self._partial + data).split(b"\n")
        for line in (raw.decode("ascii").strip() for raw in whole):
            if line == "M112":
                self._carriage.stop_dead(self._t)
                self._dead = True
                self._say("Error:Printer halted. kill() called!")
                return
            if line == "M410":
                self._quick_stop()
            self._lines.append(line)
        self._pump()

    def hard_reset(self) -> None:
        """The reset pin."""
        self._advance()
        self._carriage.stop_dead(self._t)
        self._power_on()

    # ---- time and lines -----------------------------------------------------------------------

    def _power_on(self) -> None:
        self._carriage.forget()
        self._boot_ns: int | None = self._t + BOOT_NS
        self._partial, self._lines = b"", deque[str]()
        self._homing: Iterator[bool] | None = None
        self._dead = self._braking = False

    def _next_ns(self) -> int | None:
        moving = self._carriage.moving
        times = (self._boot_ns, moving.end_ns if moving else None)
        return min((t for t in times if t is not None), default=None)

    def _advance(self) -> None:
        now = self._clock.now_ns()
        while (t := self._next_ns()) is not None and t <= now:
            self._t = max(t, self._t)
            if self._boot_ns is not None:
                self._boot_ns = None
                self._say("start")
            else:
                self._arrived()
            self._pump()
        self._t = now

    def _arrived(self) -> None:
        self._carriage.done(arrived=not (self._braking or self._homing))
        if self._braking:
            self._carriage.drop()
            self._braking = False
        elif self._homing is None:
            self._carriage.begin(self._t)

    def _quick_stop(self) -> None:
        self._lines.clear()
        self._homing = None
        if self._carriage.moving is not None and not self._braking:
            self._braking = True
            if not self._carriage.brake(self._t):
                self._arrived()

    def _pump(self) -> None:
        """Answer lines until one has to wait."""
        while self._lines and not self._dead:
            if self._homing is not None:
                if next(self._homing, False):
                    return
                self._homing = None
            elif not self._answered(self._lines[0]):
                return
            self._lines.popleft()
            self._say("ok")

    def _answered(self, line: str) -> bool:
        """Whether a line is done with; what it makes is under way by then."""
        carriage = self._carriage
        if line.startswith("G1"):
            if not carriage.free_blocks:
                return False
            words = dict(WORD.findall(line))
            at = carriage.count_mm() if carriage.idle else self._planned_mm
            x, y, z = (float(words.get(a, p)) for a, p in zip("XYZ", at, strict=True))
            self._planned_mm = (x, y, z)
            carriage.plan(self._planned_mm, float(words["F"]))
            if carriage.moving is None:
                carriage.begin(self._t)
        elif line.startswith("G28"):
            if not carriage.idle:
                return False
            self._homing = self._home((2,) if "Z" in line else (0, 1))
            if next(self._homing, False):
                return False
            self._homing = None
        elif line == "M400":
            return carriage.idle
        elif line.startswith("M114"):
            x, y, z = carriage.count_mm(self._t if "R" in line else None)
            self._say(f"X:{x:.2f} Y:{y:.2f} Z:{z:.2f} E:0.00")
        elif line == "M115":
            self._say("FIRMWARE_NAME:Marlin 2.1 (simulated) EMERGENCY_PARSER:1")
        return True

    def _home(self, axes: tuple[int, ...]) -> Iterator[bool]:
        """True for every leg that has begun."""
        for goal, rate in self._carriage.homing_legs():
            if set(goal) == set(axes):
                while self._carriage.seek(goal, rate, self._t):
                    yield True
        self._carriage.homed()

    def _say(self, text: str) -> None:
        self._out.append((self._t, text.encode("ascii") + b"\n"))


BOARDS = {"marlin": MarlinBoard}
