"""Marlin 2, as on a 3D printer's board that carries the stage.

Configure it with EMERGENCY_PARSER (M410 and M112 are heard at once), M114_REALTIME (`M114 R`), all
axes homing to their positive ends, and each axis from -travel to 0. Marlin answers a line when it
has been planned; `M400` answers when all has been driven.
"""

from __future__ import annotations

import re
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from ....aliases import Vector
from ....errors import InputError, StageError
from ....optics import StageFrame
from ....protocols.motion import minus, move_duration_s
from ...interface import Clock, StageState
from ..limits import Limits
from ..port import LinkLost, Port

if TYPE_CHECKING:
    from ..config import StageSettings

AT = re.compile(r"X:(-?[\d.]+) Y:(-?[\d.]+) Z:(-?[\d.]+)")
BOOT_S, ANSWER_S, HOMING_S, LATE_S = 5.0, 1.0, 120.0, 2.0
NEAR_MM = 0.011  # `M114` has two decimals
QUICK_STOP, KILL = b"M410\n", b"M112\n"


class MarlinStage:
    """A `Stage` on a Marlin controller; see `rig.interface.Stage` for what each method owes.

    What goes wrong in an exchange stops the motion and is a StageError; the position is in doubt
    from then on, and nothing but `home` moves. Another thread may ask where it is or stop it.
    """

    def __init__(self, config: StageSettings, clock: Clock, url: str) -> None:
        self.frame: StageFrame = config.frame
        self._url, self._clock = url, clock
        self._port = Port(url, clock, config.baud)
        limits = config.max_feed_mm_min, config.acceleration_mm_s2, config.travel_mm
        # Numbered as GRBL numbers the same things.
        self._limits = Limits(
            {110 + 10 * k + a: row[a] for k, row in enumerate(limits) for a in range(3)}
        )
        self._lock = threading.RLock()
        self._at_mm: Vector = (0.0, 0.0, 0.0)
        self._target_mm: Vector | None = None
        self._end_s = 0.0
        self._firmware = ""
        self._homed = self._cancelled = False

    @property
    def homed(self) -> bool:
        """Whether positions are known."""
        return self._homed

    def connect(self) -> None:
        """Open the port; a board that restarts is waited for, one that does not is asked."""
        self.close()
        with self._exchange():
            self._port.open()
            self._lines(BOOT_S, until="start", silent=True)
            self._firmware = next(
                (line for line in self._ask("M115") if "FIRMWARE_NAME" in line), ""
            )
            if "Marlin" not in self._firmware:
                raise StageError(f"{self._url}: no Marlin: {self._firmware or 'no answer to M115'}")
            for line in ("M410", "G21", "G90"):
                self._ask(line)

    def home(self) -> None:
        """All axes, Z first."""
        self._homed = self._cancelled = False
        with self._exchange():
            for axes in ("G28 Z", "G28 X Y"):
                self._ask(axes, HOMING_S)
            self._at_mm, self._target_mm = self._where("M114"), None
            self._homed = not self._cancelled

    def set_frame(self, frame: StageFrame) -> None:
        """Tell and take positions in this frame."""
        self.frame = frame

    def rescue(self, height_mm: float, feed_mm_min: float) -> bool:
        """As Stage: nothing here tells whether the count was kept."""
        return False

    def lift(self, height_mm: float, feed_mm_min: float) -> bool:
        """Straight up; a Marlin that was not homed has no position to lift from."""
        if not self._homed:
            return False
        x, y, z = self._at_mm = self._machine_now()
        up = (x, y, min(z + height_mm, 0.0))
        self.start_move(self.frame.to_sensor_mm(up), feed_mm_min)
        self.wait()
        return True

    def start_move(self, target_mm: Vector, feed_mm_min: float) -> float:
        """One straight move. Raises InputError, with nothing sent, beyond travel or feed."""
        self._require_homed()
        x, y, z = (round(p, 3) + 0.0 for p in self.frame.to_machine_mm(target_mm))
        target, delta = (x, y, z), minus((x, y, z), self._at_mm)
        limits = self._limits
        if why := limits.target_refusal(target) or limits.feed_refusal(delta, feed_mm_min):
            raise InputError(f"{self._url}: {why}")
        planned_s = move_duration_s(delta, feed_mm_min, limits.axes(110), limits.axes(120))
        self._cancelled = False
        with self._exchange():
            self._ask(f"G1 X{x:.3f} Y{y:.3f} Z{z:.3f} F{feed_mm_min:.3f}")
        self._target_mm, self._end_s = target, self._clock.now_s() + planned_s
        return planned_s

    def wait(self) -> StageState:
        """Until all that was planned is driven, and the count is at the target."""
        self._require_homed()
        target = self._target_mm or self._at_mm
        left_s = max(self._end_s - self._clock.now_s(), 0.0)
        with self._exchange():
            self._ask("M400", left_s * 1.1 + LATE_S)
        at_ns, at_mm = self._asked()
        self._at_mm, self._target_mm = at_mm, None
        if max(abs(a - b) for a, b in zip(at_mm, target, strict=True)) > NEAR_MM:
            raise StageError(f"{self._url}: stopped at {at_mm} mm short of {target} mm")
        self._at_mm = target
        return StageState(at_mm, "Idle", 0.0, at_ns / 1e9)

    def listen(self, seconds: float) -> None:
        """Let time pass; what was said is looked at every 5 ms."""
        deadline = self._port.deadline_ns(seconds)
        while (left_ns := deadline - self._port.now_ns()) > 0:
            with self._exchange():
                for line in self._port.heard():
                    self._mind(line)
            self._clock.sleep_s(min(left_ns / 1e9, 0.005))

    def position_mm(self) -> Vector:
        """Of the tip, in the sensor frame."""
        return self.located()[1]

    def located(self) -> tuple[int, Vector]:
        """When (ns of the clock) the tip was where, in the sensor frame."""
        self._require_homed()
        at_ns, at_mm = self._asked()
        return at_ns, self.frame.to_sensor_mm(at_mm)

    def stop(self) -> None:
        """Brake; the count is kept, unless it was homing."""
        self.cancel()
        if self._homed:
            self._clock.sleep_s(self._limits.braking_s() + 0.05)
            self._at_mm, self._target_mm = self._machine_now(), None

    def cancel(self) -> None:
        """Write the quick stop and no more."""
        self._cancelled = True
        self._port.blurt(QUICK_STOP)

    def abort(self) -> None:
        """Write the kill and no more; the board needs a reset afterwards."""
        self._homed, self._cancelled = False, True
        self._port.blurt(KILL)

    def identity(self) -> dict[str, Any]:
        """What the record keeps."""
        return {"kind": "marlin", "port": self._url, "firmware": self._firmware}

    def close(self) -> None:
        """Close the port; a move under way is told to stop."""
        if self._target_mm is not None:
            self.cancel()
        self._port.close()
        self._homed, self._target_mm = False, None

    # ---- the talk -----------------------------------------------------------------------------

    @contextmanager
    def _exchange(self) -> Iterator[None]:
        with self._lock:
            try:
                yield
            except LinkLost as why:
                self._homed = False
                raise StageError(f"{self._url}: {why}") from why
            except StageError:
                self._homed = False
                self._port.blurt(QUICK_STOP)
                raise

    def _require_homed(self) -> None:
        if not self._homed:
            raise StageError(f"{self._url}: its position is not known: connect and home first")

    def _asked(self) -> tuple[int, Vector]:
        with self._exchange():
            before_ns = self._port.now_ns()
            at_mm = self._where("M114 R")
            return (before_ns + self._port.now_ns()) // 2, at_mm

    def _machine_now(self) -> Vector:
        return self._asked()[1]

    def _where(self, question: str) -> Vector:
        # An `ok` may be of a quick stop from another thread.
        for _ in range(2):
            for line in self._ask(question):
                if found := AT.match(line):
                    return float(found[1]), float(found[2]), float(found[3])
        raise StageError(f"{self._url}: no position in the answer to {question}")

    def _ask(self, line: str, limit_s: float = ANSWER_S) -> list[str]:
        for said in self._port.heard():
            self._mind(said)
        self._port.write(line.encode("ascii") + b"\n")
        return self._lines(limit_s, until="ok", what=line)

    def _lines(self, limit_s: float, until: str, what: str = "", silent: bool = False) -> list[str]:
        """What is said up to a line. Raises StageError when that does not come, unless silent."""
        deadline, said = self._port.deadline_ns(limit_s), list[str]()
        while (text := self._port.line(deadline)) is not None:
            if text == until:
                return said
            if not text.startswith("echo:"):
                self._mind(text)
                said.append(text)
        if silent:
            return said
        raise StageError(f"{self._url}: no answer to {what} within {limit_s:.1f} s")

    def _mind(self, text: str) -> None:
        if text.startswith("Error:") or (text == "start" and self._homed):
            raise StageError(f"{self._url}: {text}: its position is lost, home again")


FIRMWARE = {"marlin": MarlinStage}
