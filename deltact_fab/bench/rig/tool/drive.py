"""A real rig's stage driven by hand, one command at a time: opened, guarded, moved, closed."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack, closing, contextmanager
from dataclasses import dataclass
from pathlib import Path

from deltact_fab.common import InputError, StageError, Vector
from deltact_fab.sensor import SensorDimensions

from ..config import GrblConfig, load_rig
from ..force.watchdog import Watchdog, open_guarded
from ..interface import WallClock, move_to
from ..run.loop import watch_force
from ..stage.exchange import state_text
from ..stage.grbl import GrblStage
from .hand import HandSession, Key, go_to, plan_move, position_text, stopped_by_ctrl_c
from .session import GuardedStage, register_face, requested_tool, write_registration
from .tooling import TerminalOperator, home_safely


@dataclass(frozen=True)
class StageStatus:
    """State and position, as the controller reports them; sensor_mm: None where it is locked."""

    state: str
    machine_mm: Vector
    sensor_mm: Vector | None

    def line(self) -> str:
        """State and position in one line."""
        mm = self.sensor_mm
        where = "locked: home first" if mm is None else position_text(mm)
        machine = ", ".join(f"{p:.3f}" for p in self.machine_mm)
        return f"{state_text(self.state)}, {where}; machine {machine}"


class HandStage:
    """The stage of a real rig, driven by hand; each command opens its port and closes it.

    The force sensor of the rig file, where it has one, guards every motion as in a run. Ctrl-C
    stops a motion. Commands raise InputError, StageError, SensorError, and Stopped for Ctrl-C.
    """

    def __init__(self, rig: str) -> None:
        """Read the rig file; nothing is opened yet. Raises InputError for a virtual rig."""
        config, self._source = load_rig(rig)
        if not isinstance(config, GrblConfig):
            raise InputError(
                f"{self._source}: kind: a {config.kind!r} rig has no stage to drive; 'grbl' has"
            )
        self._config = config
        self._stage = GrblStage.of(config.stage, WallClock())

    def status(self) -> StageStatus:
        """What the stage is doing and where it is; nothing moves."""
        with closing(self._stage):
            self._stage.connect()
            return self._state()

    def home(self, tip_is_clear: bool, ask: bool) -> tuple[str, float, StageStatus]:
        """Home every axis; returns how the face was cleared, the seconds, and the state.

        ask: the operator at the terminal may be asked whether the tip is clear.
        """
        with self._driven() as guard:
            start_s = time.monotonic()
            with stopped_by_ctrl_c(self._stage):
                operator = TerminalOperator() if ask else None
                how = self._home(guard, operator, tip_is_clear)
            return how, time.monotonic() - start_s, self._state()

    def jog(self, by_mm: Vector, feed_mm_min: float, most_mm: float, into_gel: bool) -> StageStatus:
        """Move the tip by a vector (sensor frame) that is no longer than most_mm.

        into_gel: it may end below the clearance height, slowly.
        """
        length_mm = math.hypot(*by_mm)
        if not length_mm <= most_mm:  # before a port is opened, which may restart the board
            raise InputError(
                f"DX DY DZ: {length_mm:g} mm is more than {most_mm:g}; give --most {length_mm:g} "
                "if that is meant"
            )
        with self._driven() as guard:
            self._require_count()
            with stopped_by_ctrl_c(self._stage), self._watched(guard):
                move_to(self._stage, *plan_move(self._stage, by_mm, feed_mm_min, into_gel))
            return self._state()

    def go_to(
        self, target_mm: Vector, feed_mm_min: float, into_gel: bool, home_first: bool
    ) -> StageStatus:
        """Move the tip to a place (sensor frame): up, then sideways, then down.

        home_first: home before, on the operator's word that the tip is clear; else the position
        that the controller has counted is taken.
        """
        with self._driven() as guard:
            with stopped_by_ctrl_c(self._stage):
                if home_first:
                    self._home(guard, None, tip_is_clear=True)
                else:
                    self._require_count()
                with self._watched(guard):
                    go_to(self._stage, target_mm, feed_mm_min, into_gel)
            return self._state()

    def drive_by_keys(
        self,
        keys: Callable[[], AbstractContextManager[Key]],
        whole_lines: Callable[[], AbstractContextManager[None]],
        tell: Callable[[str], None],
        show: Callable[[str], None],
        sensor: SensorDimensions,
        indenter: str,
        into_gel: bool,
    ) -> StageStatus:
        """Move the tip key by key until the operator ends it; homing and registration as well.

        keys: opens the keyboard; whole_lines: while open, lines are typed as usual. tell: a line
        for the operator. show: the state, over and over. indenter: the ball to register with.
        """
        stage = self._stage
        out, operator = Path(f"{self._source.stem}-registration.toml"), TerminalOperator()
        asked = requested_tool(self._config, self._source, sensor, indenter)
        with self._driven() as guard:

            def home() -> str:
                with whole_lines():
                    return self._home(guard, operator) + "; homed"

            def register() -> str:
                if guard is None:
                    return "registration needs a force sensor"
                with whole_lines():
                    found = register_face(GuardedStage(stage, guard, guard), asked, operator)
                write_registration(found, out)
                return f"{out}: {found.line()}"

            others = {"h": home, "r": register}
            with keys() as key, stopped_by_ctrl_c(stage):
                HandSession(stage, guard, guard, key, tell, show, into_gel, others).run()
            return self._state()

    def reset(self) -> str:
        """Reset the controller, which loses its position; returns its banner."""
        with closing(self._stage):
            self._stage.reset()
            return str(self._stage.identity()["banner"])

    @contextmanager
    def _driven(self) -> Iterator[Watchdog | None]:
        """Connect; the guard on the force sensor, None where the file names none."""
        config = self._config
        with ExitStack() as opened:
            opened.callback(self._stage.close)
            self._stage.connect()
            guard = None
            if config.force is not None and config.force.reachable:
                guard = open_guarded(config.force, config.guard, self._stage)
                opened.callback(guard.close)
            yield guard

    def _watched(self, guard: Watchdog | None) -> AbstractContextManager[object]:
        return watch_force(self._stage, self._stage.clock, guard, guard)

    def _home(
        self, guard: Watchdog | None, operator: TerminalOperator | None, tip_is_clear: bool = False
    ) -> str:
        stage = self._stage
        return home_safely(
            stage, stage.clock, guard, operator, tip_is_clear=tip_is_clear, guard=guard
        )

    def _require_count(self) -> None:
        if not self._stage.trust_count():
            raise StageError("the controller is locked, its position is lost: `rig home` first")

    def _state(self) -> StageStatus:
        report = self._stage.look()
        known = report.state.partition(":")[0] not in ("Alarm", "Sleep")
        machine_mm = report.machine_mm
        sensor_mm = self._config.stage.frame.to_sensor_mm(machine_mm) if known else None
        return StageStatus(report.state, machine_mm, sensor_mm)
