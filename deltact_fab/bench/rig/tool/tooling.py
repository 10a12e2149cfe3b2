"""The operator and what is mounted: who is asked and what counts as a confirmation; homing, which
may need his word; the tip named by him, found on the face, and kept with the run.

A session begins at a stage that somebody left somewhere, after a failure with the tip in the gel as
likely as not. Homing goes up first (GRBL homes z before x and y), but fast, and a firmware that was
built with another order drags the tip through the gel.

`RUN/tool.json` holds every touch-off of the run, those of earlier sessions too. The first one of an
indenter is the one that later ones are compared with: a height that has moved by more than
`[touch] moved_mm` means that another indenter or another sensor is mounted, and half a run with
each is no measurement.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deltact_fab.common import InputError, RunFailed, StageError, read_json, write_whole
from deltact_fab.sensor import StageFrame, parse_indenter

from ..interface import LIFT_FEED_MM_MIN, Clock, ForceSensor, Guard, RigSetup, Stage, move_to
from ..run.loop import watch_force
from ..tables import ToolConfig, TouchConfig
from .feeler import ForceProbe
from .touch import TRAVEL_FEED_MM_MIN, FaceTouch, ForceTouch

TOUCH_FILE = "tool.json"
CONFIRM_ATTEMPTS = 5
HOMING_LIFT_MM = 25.0
REST_FORCE_S = 0.1
TIP_CONTACT_N = 0.3
"""More than this, on the tare of whoever measured last, is a tip that touches or a sensor that was
never tared: both are for the operator to see."""
CLEAR_ANSWER = "clear"


class TerminalOperator:
    """Asks on standard error and reads lines of standard input."""

    def tell(self, text: str) -> None:
        """A line on standard error, so that standard output stays what the command prints."""
        print(text, file=sys.stderr, flush=True)

    def ask(self, text: str) -> str:
        """Wait for a line, without blanks at its ends. Raises RunFailed when none can come."""
        print(f"{text}: ", end="", file=sys.stderr, flush=True)
        line = sys.stdin.readline()
        if not line:
            raise RunFailed(f"nobody answered ({text}): standard input has ended")
        return line.strip()


def confirm(operator: TerminalOperator, name: str, claim: str) -> None:
    """Wait until somebody types the name of what they mounted; another name is asked again.

    what: ends "type NAME to confirm that". Raises RunFailed after TRIES other answers.
    """
    for _ in range(CONFIRM_ATTEMPTS):
        answer = operator.ask(f"type {name} to confirm that {claim}")
        if answer == name:
            return
        operator.tell(f"that was {answer!r}, not {name!r}")
    raise RunFailed(f"{name}: not confirmed in {CONFIRM_ATTEMPTS} answers")


def clear_the_face(
    stage: Stage,
    clock: Clock,
    force: ForceSensor | None,
    operator: TerminalOperator | None,
    *,
    tip_is_clear: bool = False,
    air: bool = False,
) -> str:
    """Make sure that homing drags no tip through the gel; says how.

    stage: connected, not moved yet. Where its position is known it goes straight up, slowly, as far
    as its travel goes but no more than LIFT_MM. Where it is lost nothing can be lifted: then the
    force sensor has to feel nothing, or the operator to give his word, here (`operator`) or before
    (tip_is_clear). air: of a rig without a force sensor nothing is asked, for no run of it pressed.
    Raises StageError when neither is there.
    """
    if stage.lift(HOMING_LIFT_MM, LIFT_FEED_MM_MIN):
        return "the position was known: lifted straight up before homing"
    if tip_is_clear:
        return "the position was lost; the operator's word that the tip is clear"
    reason = "no force sensor can tell whether the tip is in the gel"
    if force is not None:
        force_n = _rest_force_n(clock, force)
        if force_n <= TIP_CONTACT_N:
            return f"the position was lost; the force sensor feels {force_n:.2f} N: clear"
        reason = (
            f"the force sensor feels {force_n:.2f} N: the tip may be in the gel (or the sensor was "
            "not tared since it was mounted)"
        )
    elif air:
        return "the position was lost; a rig without a force sensor, in air"
    if operator is None:
        raise StageError(
            f"not homed: the position is lost, and {reason}; look, turn z up by hand, and give "
            "--tip-is-clear"
        )
    operator.tell(f"the position is lost, and {reason}; look, and turn z up by hand if it is")
    confirm(operator, CLEAR_ANSWER, "the tip touches nothing")
    return "the position was lost; the operator confirmed that the tip is clear"


def home_safely(
    stage: Stage,
    clock: Clock,
    force: ForceSensor | None,
    operator: TerminalOperator | None,
    *,
    tip_is_clear: bool = False,
    guard: Guard | None = None,
) -> str:
    """Clear the face, then home with the guard armed; says how. Raises StageError, SensorError."""
    how = clear_the_face(stage, clock, force, operator, tip_is_clear=tip_is_clear)
    with watch_force(stage, clock, force, guard):
        stage.home()
    return how


def _rest_force_n(clock: Clock, force: ForceSensor) -> float:
    """Size of the mean force while nothing moves, on the tare that the sensor still has."""
    force.start()
    try:
        parts: list[NDArray[np.float64]] = []
        end_s = clock.now_s() + REST_FORCE_S
        while not parts or clock.now_s() < end_s:
            parts.append(force.read().force_n)
        return float(np.linalg.norm(np.concatenate(parts).mean(axis=0)))
    finally:
        force.stop()


@dataclass
class Tooling:
    """Behind `Devices.begin` and `Devices.change_indenter` of a real rig.

    In air nothing is confirmed or touched. operator: None is the terminal; unattended nobody is
    asked, and what the protocol names counts as mounted on the word of whoever started the run.
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
        self._frame = self.stage.frame  # of the tool that the origin was measured with
        self._base = ""
        self._mounted: dict[str, dict[str, Any]] = {}  # of this session, by indenter

    def begin(self) -> str:
        """Have the tactile base confirmed, and make the way to homing clear.

        Raises RunFailed when nobody confirms, StageError when the tip may be in the gel.
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
        """Have it mounted and confirmed, find its tip, and put the stage's frame there.

        The stage ends where it was, as its machine sees it. Raises RunFailed, SensorError or
        StageError in one line.
        """
        if self.job.air:
            return f"{name} stands for whatever is mounted: in air"
        if self.operator is not None:
            confirm(self.operator, name, "it is mounted, screwed tight")
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
        """How far the face has moved since the run's first touch with it; None: this is it."""
        touches = load_touches(self.job.folder)
        first = next((row for row in touches if row["indenter"] == name), None)
        if first is None:
            return None
        assert self.touch is not None
        moved_mm = float(machine_z_mm - first["machine_mm"][2])
        if abs(moved_mm) > self.touch.moved_mm:
            raise RunFailed(
                f"touch-off of {name}: the face is {abs(moved_mm):.2f} mm "
                f"{'higher' if moved_mm > 0 else 'lower'} than the run had it, more than "
                f"touch.moved_mm = {self.touch.moved_mm:g}: another indenter or another sensor is "
                "mounted, or it sits otherwise; mount what the run began with, or begin a new run"
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
    """Every touch-off of a run in order, none where there was none. Raises InputError."""
    path = folder / TOUCH_FILE
    if not path.exists():
        return []
    data = read_json(path)
    try:
        touches = data["touches"]
        return [{**row, "machine_mm": [float(p) for p in row["machine_mm"]]} for row in touches]
    except (ValueError, KeyError, TypeError) as error:
        raise InputError(f"{path}: touches: not as a run writes them: {error}") from error


def raised_frame(frame: StageFrame, by_mm: float) -> StageFrame:
    """The same for a tool that is so much longer: along the machine's z."""
    x, y, z = frame.origin_machine_mm
    return replace(frame, origin_machine_mm=(x, y, z + by_mm))
