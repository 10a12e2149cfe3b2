"""A bench driven key by key in one session: homing, steps, origin, registration, the guard armed.

An Arduino that restarts whenever its port is opened loses its position with each command; here the
port stays open.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace

from deltact_fab.common import DeltactFabError, InputError, SensorError, StageError, Stopped, Vector

from ...protocols.motion import add_vectors
from ..interface import LIFT_FEED_MM_MIN, ForceSensor, Guard, Stage, move_to
from ..run.loop import Watch, interruptible, watch_force
from ..stage.grbl import GrblStage

CLEARANCE_MM = 5.0
FEED_MM_MIN = 300.0
NEAR_FEED_MM_MIN = 30.0
"""Below the clearance height."""
SAME_MM = 2e-3
STEPS_MM = (0.02, 0.1, 1.0, 10.0)
EASE_MM = 2.0  # up, after the guard has stopped it
TELL_S = 0.2
HELP = (
    "arrows: x and y   page up, u / page down, d: z   1 2 3 4: steps of .02, .1, 1, 10 mm   "
    "space: stop\nh: home   o: the tip stands at the origin   r: register the face   q: end"
)
Key = Callable[[float], str]
"""Waits so long (s) for a key: its name, "" where none came."""


@contextmanager
def stopped_by_ctrl_c(stage: Stage) -> Iterator[None]:
    """Ctrl-C, SIGTERM and SIGHUP stop the motion, the second one resets; raises Stopped then."""
    with interruptible(stage.abort):
        try:
            yield
        except KeyboardInterrupt as why:
            stage.stop()
            where = f" at {position_text(stage.position_mm())}" if stage.homed else ""
            raise Stopped(f"stopped by the operator{where}") from why


def plan_move(
    stage: Stage, by_mm: Vector, feed_mm_min: float, into_gel: bool
) -> tuple[Vector, float]:
    """Where a straight move by so much (sensor frame) leads, and how fast; nothing moves.

    Raises InputError for one that, without into_gel, ends below CLEARANCE_MM or goes sideways
    there; straight up is always allowed.
    """
    here = stage.position_mm()
    there = add_vectors(here, by_mm)
    low_mm, up = min(here[2], there[2]), by_mm[0] == by_mm[1] == 0 and by_mm[2] >= 0
    near = low_mm < CLEARANCE_MM and not up
    if near and not into_gel:
        raise InputError(_too_low(low_mm))
    return there, min(feed_mm_min, NEAR_FEED_MM_MIN) if near else feed_mm_min


def go_to(stage: Stage, target_mm: Vector, feed_mm_min: float, into_gel: bool) -> None:
    """To a place (sensor frame): up to the clearance height, sideways, then down.

    Raises InputError, with nothing sent, for one below CLEARANCE_MM without into_gel.
    """
    if not all(map(math.isfinite, target_mm)):
        raise InputError(f"X Y Z: {target_mm} mm is not a place")
    x, y, z = target_mm
    if z < CLEARANCE_MM and not into_gel:
        raise InputError(_too_low(z))
    here = stage.position_mm()
    if math.dist(here[:2], (x, y)) > SAME_MM:
        high_mm = max(here[2], CLEARANCE_MM)
        for place in ((here[0], here[1], high_mm), (x, y, high_mm)):
            move_to(stage, place, feed_mm_min)
    if z < CLEARANCE_MM:
        if stage.position_mm()[2] > CLEARANCE_MM:
            move_to(stage, (x, y, CLEARANCE_MM), feed_mm_min)
        feed_mm_min = min(feed_mm_min, NEAR_FEED_MM_MIN)
    move_to(stage, target_mm, feed_mm_min)


def position_text(position_mm: Vector) -> str:
    """A tip position for a person."""
    x, y, z = (round(p, 3) + 0.0 for p in position_mm)
    return f"x {x:.3f}, y {y:.3f}, z {z:.3f} mm (sensor)"


def _too_low(z_mm: float) -> str:
    return (
        f"z = {z_mm:g} mm is below {CLEARANCE_MM:g} mm over the face, where the tip may touch the "
        "gel: give --into-gel (slow), or go up first"
    )


MOVES: dict[str, Vector] = {
    "left": (-1, 0, 0), "right": (1, 0, 0), "down": (0, -1, 0), "up": (0, 1, 0),
    "page up": (0, 0, 1), "page down": (0, 0, -1), "u": (0, 0, 1), "d": (0, 0, -1),
}  # fmt: skip


@dataclass
class HandSession:
    """tell: a line for the operator. show: the state, over and over. into_gel: below the clearance
    height without a guard as well. others: what a key does between two watches, and says."""

    stage: GrblStage
    force: ForceSensor | None
    guard: Guard | None
    key: Key
    tell: Callable[[str], None]
    show: Callable[[str], None]
    into_gel: bool = False
    others: dict[str, Callable[[], str]] = field(default_factory=dict)
    step_mm: float = 1.0

    def run(self) -> None:
        """Until the key q. Raises StageError where the stage cannot be talked to any more."""
        self.tell(HELP)
        if not self.stage.trust_count():
            self.tell("the position is lost: h homes")
        while True:
            try:
                with watch_force(self.stage, self.stage.clock, self.force, self.guard) as watch:
                    what = self._drive(watch)
            except SensorError as why:
                self._ease(str(why))
                what = ""
                while not what:
                    what = self.key(TELL_S)
            if what == "q":
                return
            if what in self.others:
                try:
                    self.tell(self.others[what]())
                except DeltactFabError as why:
                    self.tell(str(why))

    def _drive(self, watch: Watch) -> str:
        """Keys that move, until one that does not; "" when the guard has stopped the stage."""
        while not watch.trouble:
            self.show(self._line(watch))
            key = self.key(TELL_S)
            if key in self.others or key == "q":
                return key
            if key in MOVES:
                self._move(MOVES[key], watch)
            elif key == "o":
                self.tell(self._origin())
            elif key.isdigit() and 0 < int(key) <= len(STEPS_MM):
                self.step_mm = STEPS_MM[int(key) - 1]
        return ""

    def _move(self, way: Vector, watch: Watch) -> None:
        x, y, z = (self.step_mm * part for part in way)
        stage, clock = self.stage, self.stage.clock
        deep = self.into_gel or self.guard is not None
        try:
            target_mm, feed = plan_move(stage, (x, y, z), FEED_MM_MIN, deep)
            end_s = clock.now_s() + stage.start_move(target_mm, feed)
            while clock.now_s() < end_s and not watch.trouble:
                self.show(self._line(watch, asks=False))
                stage.listen(min(TELL_S / 10, max(end_s - clock.now_s(), 0.0)))
                if self.key(0.0) == " ":
                    stage.stop()
                    return
            stage.wait()
        except (InputError, StageError) as why:
            self.tell(str(why))

    def _origin(self) -> str:
        """The tip stands where the face has its middle, from now on (0, 0, 0)."""
        if not self.stage.homed:
            return "home first: h"
        here = self.stage.frame.to_machine_mm(self.stage.position_mm())
        self.stage.frame = replace(self.stage.frame, origin_machine_mm=here)
        x, y, z = here
        return f"origin_machine_mm = [{x:.3f}, {y:.3f}, {z:.3f}]  # for [stage] of the rig file"

    def _ease(self, why: str) -> None:
        """After a trip, a little up; only a force that still grows would stop that."""
        self.tell(f"{why}; lifting by {EASE_MM:g} mm; any key goes on, q ends")
        if self.guard is None:
            return
        with self.guard.easing():
            try:
                self.stage.stop()
                self.stage.lift(EASE_MM, LIFT_FEED_MM_MIN)
            except StageError as fault:
                self.tell(str(fault))
        self.guard.rearm()

    def _line(self, watch: Watch, asks: bool = True) -> str:
        where = "moving"
        if asks:
            homed = self.stage.homed
            where = position_text(self.stage.position_mm()) if homed else "not homed"
        force_n = None if watch.stream is None else watch.stream.force_n
        felt = "no force sensor: no guard"
        if watch.stream is not None:
            felt = "..." if force_n is None else "F {:+.2f} {:+.2f} {:+.2f} N".format(*force_n)
        return f"{where} | step {self.step_mm:g} mm | {felt} | {time.strftime('%H:%M:%S')}"
