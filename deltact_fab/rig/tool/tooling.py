"""What is mounted: named by the operator, found on the face, and kept with the run.

`RUN/tool.json` holds every touch-off of the run, those of earlier sessions too. The first one of an
indenter is the one that later ones are compared with: a height that has moved by more than
`[touch] moved_mm` means that another indenter or another sensor is mounted, and half a run with
each is no measurement.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from ... import reading
from ...errors import InputError, RunFailed
from ...files import write_whole
from ...optics import StageFrame
from ...shapes.indenter import parse as parse_indenter
from ..interface import Clock, ForceSensor, Guard, RigSetup, Stage, go
from .config import ToolConfig, TouchConfig
from .feeler import ForceProbe
from .operator import TerminalOperator, clear_the_face, confirm
from .touch import TRAVEL_FEED_MM_MIN, FaceTouch, ForceTouch

KEPT = "tool.json"


class Tooling:
    """Behind `Devices.begin` and `Devices.change_indenter` of a real rig.

    In air nothing is confirmed or touched. operator: None is the terminal; unattended nobody is
    asked, and what the protocol names counts as mounted on the word of whoever started the run.
    """

    def __init__(
        self,
        job: RigSetup,
        stage: Stage,
        clock: Clock,
        force: ForceSensor | None = None,
        guard: Guard | None = None,
        touch: TouchConfig | None = None,
        tools: Mapping[str, ToolConfig] | None = None,
        operator: TerminalOperator | None = None,
    ) -> None:
        self._job = job
        self._stage = stage
        self._clock = clock
        self._force = force
        self._guard = guard
        self._touch = touch
        self._tools = dict(tools or {})
        self._operator = None if job.unattended else operator or TerminalOperator()
        self._frame: StageFrame = stage.frame  # of the tool that the origin was measured with
        self._base = ""
        self._mounted: dict[str, dict[str, Any]] = {}  # of this session, by indenter

    def begin(self) -> str:
        """Have the tactile base confirmed, and make the way to homing clear.

        Raises RunFailed when nobody confirms, StageError when the tip may be in the gel.
        """
        specimen = self._job.protocol.specimen
        self._base = specimen.serial or specimen.design
        if not self._job.air and self._operator is not None:
            confirm(self._operator, self._base, "this sensor is on the bench")
        cleared = clear_the_face(
            self._stage, self._clock, self._force, self._operator,
            tip_is_clear=self._job.tip_is_clear, air=self._job.air,
        )  # fmt: skip
        by = "unattended" if self._operator is None else "confirmed"
        return cleared if self._job.air else f"sensor {self._base} ({by}); {cleared}"

    def change_indenter(self, name: str) -> str:
        """Have it mounted and confirmed, find its tip, and put the stage's frame there.

        The stage ends where it was, as its machine sees it. Raises RunFailed, SensorError or
        StageError in one line.
        """
        if self._job.air:
            return f"{name} stands for whatever is mounted: in air"
        if self._operator is not None:
            confirm(self._operator, name, "it is mounted, screwed tight")
        longer_mm = self._tools[name].length_mm if name in self._tools else 0.0
        before_mm = self._stage.frame.to_machine_mm(self._stage.position_mm())
        expected = raised(self._frame, longer_mm)
        self._stage.set_frame(expected)
        touch = self._find(name)
        x, y, z = expected.to_machine_mm((*touch.at_mm, touch.z_mm))
        moved_mm = self._require_the_same(name, z)
        frame = replace(expected, origin_machine_mm=expected.to_machine_mm((0.0, 0.0, touch.z_mm)))
        self._stage.set_frame(frame)
        go(self._stage, frame.to_sensor_mm(before_mm), TRAVEL_FEED_MM_MIN)
        self._keep(name, touch, (x, y, z), longer_mm)
        moved = "" if moved_mm is None else f", {moved_mm:+.3f} mm from the run's first touch"
        return f"{name} mounted: face at machine z {z:.3f} mm, {touch.line()}{moved}"

    def identity(self) -> dict[str, Any]:
        return {
            "base": self._base,
            "unattended": self._job.unattended,
            "indenters": dict(self._mounted),
        }

    def _find(self, name: str) -> FaceTouch:
        config = self._touch
        assert config is not None, "refused without [touch]"
        assert self._force is not None, "refused without a force sensor"
        feeler = ForceProbe(self._stage, self._force, self._clock, self._guard)
        return ForceTouch(feeler, config).find(parse_indenter(name), config.at_mm)

    def _require_the_same(self, name: str, machine_z_mm: float) -> float | None:
        """How far the face has moved since the run's first touch with it; None: this is it."""
        first = next((row for row in kept(self._job.folder) if row["indenter"] == name), None)
        if first is None:
            return None
        assert self._touch is not None
        moved_mm = float(machine_z_mm - first["machine_mm"][2])
        if abs(moved_mm) > self._touch.moved_mm:
            raise RunFailed(
                f"touch-off of {name}: the face is {abs(moved_mm):.2f} mm "
                f"{'higher' if moved_mm > 0 else 'lower'} than the run had it, more than "
                f"touch.moved_mm = {self._touch.moved_mm:g}: another indenter or another sensor is "
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
        rows = [*kept(self._job.folder), row]
        if self._job.folder.is_dir():
            text = json.dumps({"touches": rows}, indent=1) + "\n"
            write_whole(self._job.folder / KEPT, text.encode())


def kept(folder: Path) -> list[dict[str, Any]]:
    """Every touch-off of a run in order, none where there was none. Raises InputError."""
    path = folder / KEPT
    if not path.exists():
        return []
    found = reading.json_object(path)
    try:
        touches = found["touches"]
        return [{**row, "machine_mm": [float(p) for p in row["machine_mm"]]} for row in touches]
    except (ValueError, KeyError, TypeError) as why:
        raise InputError(f"{path}: touches: not as a run writes them: {why}") from why


def raised(frame: StageFrame, by_mm: float) -> StageFrame:
    """The same for a tool that is so much longer: along the machine's z."""
    x, y, z = frame.origin_machine_mm
    return replace(frame, origin_machine_mm=(x, y, z + by_mm))
