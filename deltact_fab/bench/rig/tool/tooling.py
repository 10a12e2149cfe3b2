"""Operator and mounted tool: prompts and confirmations, safe homing, and touch-off of the tip.

A session begins at an unknown position, after a failure perhaps with the tip in the gel. Homing
goes up first (GRBL homes z before x and y), but fast, and a firmware built with another order drags
the tip through the gel.

`RUN/tool.json` holds every touch-off of the run, also of earlier sessions. Later ones are compared
with the first one of the same indenter: a shift by more than `[touch] moved_mm` means that another
indenter or sensor is mounted, which would invalidate the run.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from deltact_fab.common import InputError, RunFailed, StageError, read_json, write_whole
from deltact_fab.sensor import StageFrame, parse_indenter

from ..interface import (
    CONTACT_N,
    LIFT_FEED_MM_MIN,
    Clock,
    ForceSensor,
    Guard,
    RigSetup,
    Stage,
    move_to,
)
from ..run.contact import mean_force_n
from ..run.loop import watch_force
from ..tables import ToolConfig, TouchConfig
from .feeler import ForceProbe
from .touch import TRAVEL_FEED_MM_MIN, FaceTouch, ForceTouch

TOUCH_FILE = "tool.json"
# Decision 0033; by hand: a longer mean is less noisy, a higher force misses light contacts.
CONFIRM_ATTEMPTS = 5
HOMING_LIFT_MM = 25.0
CLEAR_ANSWER = "clear"


class TerminalOperator:
    """Prompts on standard error and reads lines from standard input."""

    def tell(self, text: str) -> None:
        """Print a line on standard error; standard output is for the command's result."""
        print(text, file=sys.stderr, flush=True)

    def ask(self, text: str) -> str:
        """Prompt and return the stripped answer. Raises RunFailed at the end of the input."""
        print(f"{text}: ", end="", file=sys.stderr, flush=True)
        line = sys.stdin.readline()
        if not line:
            raise RunFailed(f"no answer ({text}): standard input has ended")
        return line.strip()


def confirm(operator: TerminalOperator, name: str, claim: str) -> None:
    """Ask the operator to type a name as confirmation; ask again after another answer.

    claim: completes "type NAME to confirm that". Raises RunFailed after CONFIRM_ATTEMPTS.
    """
    for _ in range(CONFIRM_ATTEMPTS):
        answer = operator.ask(f"type {name} to confirm that {claim}")
        if answer == name:
            return
        operator.tell(f"got {answer!r}, expected {name!r}")
    raise RunFailed(f"{name}: not confirmed in {CONFIRM_ATTEMPTS} attempts")


def clear_the_face(
    stage: Stage,
    clock: Clock,
    force: ForceSensor | None,
    operator: TerminalOperator | None,
    *,
    tip_is_clear: bool = False,
    air: bool = False,
) -> str:
    """Make sure that homing drags no tip through the gel; return how, as text.

    stage: connected, not moved yet. With a known position it goes straight up, slowly, by up to
    HOMING_LIFT_MM within the travel. With a lost position it cannot: then the force sensor must
    read no contact, or the operator confirm, now (`operator`) or before (tip_is_clear). air: no
    confirmation on a rig without a force sensor, which never presses. Raises StageError otherwise.
    """
    if stage.lift(HOMING_LIFT_MM, LIFT_FEED_MM_MIN) is not None:
        return "position known: lifted straight up before homing"
    if tip_is_clear:
        return "position lost; operator stated that the tip is clear"
    reason = "without a force sensor a contact cannot be excluded"
    if force is not None:
        force.start()
        try:
            force_n = mean_force_n(clock, force)
        finally:
            force.stop()
        if force_n <= CONTACT_N:
            return f"position lost; force sensor reads {force_n:.2f} N: clear"
        reason = (
            f"the force sensor reads {force_n:.2f} N: the tip may be in the gel (or the sensor was "
            "not tared since it was mounted)"
        )
    elif air:
        return "position lost; rig without a force sensor, in air"
    if operator is None:
        raise StageError(
            f"not homed: position lost, and {reason}; check the tip, turn z up by hand, and give "
            "--tip-is-clear"
        )
    operator.tell(f"position lost, and {reason}; check the tip, and turn z up by hand if needed")
    confirm(operator, CLEAR_ANSWER, "the tip touches nothing")
    return "position lost; operator confirmed that the tip is clear"


def home_safely(
    stage: Stage,
    clock: Clock,
    force: ForceSensor | None,
    guard: Guard | None,
    operator: TerminalOperator | None,
    tip_is_clear: bool = False,
) -> str:
    """Clear the face, return how, and home guarded. Raises StageError, SensorError."""
    how = clear_the_face(stage, clock, force, operator, tip_is_clear=tip_is_clear)
    with watch_force(stage, force, guard):
        stage.home()
    return how


@dataclass
class Tooling:
    """Implements `Devices.begin` and `Devices.change_indenter` of a real rig.

    In air nothing is confirmed or touched. operator: None is the terminal; unattended runs ask
    nothing and take the protocol's indenter as mounted.
    """

    job: RigSetup
    stage: Stage
    clock: Clock
    force: ForceSensor | None = None
    guard: Guard | None = None
    touch: TouchConfig | None = None
    tools: Mapping[str, ToolConfig] = field(default_factory=dict)
    operator: TerminalOperator | None = None

    def __post_init__(self) -> None:
        self.operator = None if self.job.unattended else self.operator or TerminalOperator()
        self._frame = self.stage.frame  # of the reference tool
        self._base = ""
        self._mounted: dict[str, dict[str, Any]] = {}  # of this session, by indenter

    def begin(self) -> str:
        """Have the sensor confirmed, and clear the face for homing.

        Raises RunFailed without a confirmation, StageError when the tip may be in the gel.
        """
        specimen = self.job.protocol.specimen
        self._base = specimen.serial or specimen.design
        if not self.job.air and self.operator is not None:
            confirm(self.operator, self._base, "this sensor is on the bench")
        cleared = clear_the_face(
            self.stage, self.clock, self.force, self.operator,
            tip_is_clear=self.job.tip_is_clear, air=self.job.air,
        )  # fmt: skip
        confirmation = "unattended" if self.operator is None else "confirmed"
        return cleared if self.job.air else f"sensor {self._base} ({confirmation}); {cleared}"

    def change_indenter(self, name: str) -> str:
        """Have an indenter mounted and confirmed, touch off, and set the stage's frame.

        The stage returns to its machine position. Raises RunFailed, SensorError or StageError, one
        line.
        """
        if self.job.air:
            return f"{name} not mounted: run in air"
        if self.operator is not None:
            confirm(self.operator, name, "it is mounted and tightened")
        longer_mm = self.tools[name].length_mm if name in self.tools else 0.0
        before_mm = self.stage.frame.to_machine_mm(self.stage.position_mm())
        expected = raised_frame(self._frame, longer_mm)
        self.stage.frame = expected
        touch = self._find(name)
        x, y, z = expected.to_machine_mm((*touch.at_mm, touch.z_mm))
        moved_mm = self._require_same_face(name, z)
        frame = replace(expected, origin_machine_mm=expected.to_machine_mm((0.0, 0.0, touch.z_mm)))
        self.stage.frame = frame
        move_to(self.stage, frame.to_sensor_mm(before_mm), TRAVEL_FEED_MM_MIN)
        self._keep(name, touch, (x, y, z), longer_mm)
        shift = "" if moved_mm is None else f", {moved_mm:+.3f} mm from the run's first touch"
        return f"{name} mounted: face at machine z {z:.3f} mm, {touch.line()}{shift}"

    def identity(self) -> dict[str, Any]:
        return {
            "base": self._base,
            "unattended": self.job.unattended,
            "indenters": dict(self._mounted),
        }

    def _find(self, name: str) -> FaceTouch:
        config = self.touch
        assert config is not None, "refused without [touch]"
        assert self.force is not None, "refused without a force sensor"
        feeler = ForceProbe(self.stage, self.force, self.clock, self.guard)
        return ForceTouch(feeler, config).find(parse_indenter(name), config.at_mm)

    def _require_same_face(self, name: str, machine_z_mm: float) -> float | None:
        """Return the shift since the run's first touch with this indenter; None for the first."""
        touches = load_touches(self.job.folder)
        first = next((row for row in touches if row["indenter"] == name), None)
        if first is None:
            return None
        assert self.touch is not None
        moved_mm = float(machine_z_mm - first["machine_mm"][2])
        if abs(moved_mm) > self.touch.moved_mm:
            raise RunFailed(
                f"touch-off of {name}: the face is {abs(moved_mm):.2f} mm "
                f"{'higher' if moved_mm > 0 else 'lower'} than at the run's first touch, more than "
                f"touch.moved_mm = {self.touch.moved_mm:g}: the indenter or the sensor was changed "
                "or remounted; restore the first setup, or begin a new run"
            )
        return moved_mm

    def _keep(
        self, name: str, touch: FaceTouch, machine_mm: tuple[float, float, float], longer_mm: float
    ) -> None:
        row = {
            "indenter": name,
            "base": self._base,
            "machine_mm": [round(p, 4) for p in machine_mm],
            "expected_longer_mm": longer_mm,
            **touch.as_dict(),
        }
        self._mounted[name] = row
        rows = [*load_touches(self.job.folder), row]
        if self.job.folder.is_dir():
            text = json.dumps({"touches": rows}, indent=1) + "\n"
            write_whole(self.job.folder / TOUCH_FILE, text.encode())


def load_touches(folder: Path) -> list[dict[str, Any]]:
    """Return all touch-offs of a run in order, [] without any. Raises InputError."""
    path = folder / TOUCH_FILE
    if not path.exists():
        return []
    data = read_json(path)
    try:
        touches = data["touches"]
        return [{**row, "machine_mm": [float(p) for p in row["machine_mm"]]} for row in touches]
    except (ValueError, KeyError, TypeError) as error:
        raise InputError(f"{path}: touches: invalid: {error}") from error


def raised_frame(frame: StageFrame, by_mm: float) -> StageFrame:
    """Return the frame for a tool longer by by_mm, along the machine's z."""
    x, y, z = frame.origin_machine_mm
    return replace(frame, origin_machine_mm=(x, y, z + by_mm))
