"""The real bench of kind `grbl`: stage, camera and force sensor, at the wall clock.

Only devices that the protocol's channels need are opened, and always the force sensor if the rig
file says how to reach it, because the guard needs it. `unmet_conditions` lists what a rig lacks
before it may press, and before it may run unattended.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Any

from deltact_fab.common import InputError, Note, Progress
from deltact_fab.sensor import CameraModel, SensorDimensions, parse_indenter

from ..protocols.motion import WALL_CLOCK_PACE, RigPace
from ..protocols.plan import Protocol, expand_protocol
from .camera.model import load_view, open_camera, view_notes
from .config import GrblConfig
from .force.guard import GuardLimits
from .force.watchdog import Watchdog, open_guarded
from .interface import CONTACT_N, Camera, OpenBench, Rig, RigKind, RigSetup, WallClock
from .stage.grbl import GrblStage
from .tables import TouchConfig
from .tool.tooling import Tooling
from .tool.touch import MAX_FORCE_RATIO, tool_change_s

SIMULATED_CHANNELS = frozenset({"traction"})


class GrblKind(RigKind):
    """Rig with a real GRBL stage: why it refuses a protocol, and how its devices are opened."""

    part = "devices of the rig"
    _config: GrblConfig

    def refusals(self, protocol: Protocol, sensor: SensorDimensions, source: str) -> list[str]:
        """Return a line for each device that the protocol needs and the rig lacks."""
        config = self._config
        # Weights are the force.
        channels = protocol.channels - ({"force"} if protocol.weights is not None else set())
        lines = [
            f"{source}: channels: {name!r} exists on a virtual rig only; remove it"
            for name in sorted(channels & SIMULATED_CHANNELS)
        ]
        if "image" in channels and config.camera is None:
            lines.append(
                f"{source}: channels: 'image' needs a camera, and {self._source} has no [camera]; "
                'add one, as source = 0, or remove "image"'
            )
        if "force" in channels and not (config.force and config.force.reachable):
            lines.append(
                f"{source}: channels: 'force' needs a sensor, and {self._source} defines no "
                "connection to one; add [force.netft] or [force.serial] with its ranges, or remove "
                '"force"'
            )
        return lines

    def camera(self, protocol: Protocol, sensor: SensorDimensions) -> CameraModel | None:
        if self._config.camera is None or "image" not in protocol.channels:
            return None
        return load_view(self._config.camera, sensor, self._source)

    def change_s(self, protocol: Protocol) -> float:
        config = self._config
        park_mm = protocol.motion.park_mm
        return tool_change_s(config.stage, config.touch, park_mm, config.sample_s)

    def pace(self) -> RigPace:
        frames_s = WALL_CLOCK_PACE.frames_s + self._config.sample_s
        return replace(WALL_CLOCK_PACE, frames_s=frames_s)

    def undeclared_lengths(self, protocol: Protocol) -> list[str]:
        """Indenters without a declared length; none when the protocol uses only one."""
        config = self._config
        missing = [name for name in protocol.tips if name not in config.tools]
        if len(protocol.tips) < 2 or not missing or config.touch is None:
            return []
        return [
            f'[tools."{missing[0]}"] length_mm is not declared'
            + (f" (nor {len(missing) - 1} more)" if len(missing) > 1 else "")
            + f": its tip is searched for within touch.search_mm = {config.touch.search_mm:g} mm "
            "of the reference tip's position"
        ]

    def unmet_conditions(
        self, protocol: Protocol, sensor: SensorDimensions, unattended: bool
    ) -> list[str]:
        """Reasons why this rig must not press, or not unattended; each follows the rig file's name.

        `preflight` compares predicted forces with the limits of stage and sensor.
        """
        config = self._config
        force, touch = config.force, config.touch
        lines = list(missing_tables(config).values())
        if force is not None and force.reachable and "force" not in protocol.channels:
            lines.append(
                f"channels of {protocol.name!r}: a press on a real rig must record the force: "
                'add "force", or give --air'
            )
        if touch is not None:
            lines += _touch_off_face(touch, protocol, sensor)
            if force is not None:
                lines += _touch_above_guard(config, touch)
        changes = sum(step.kind == "change" for step in expand_protocol(protocol))
        if unattended and changes > 1:
            lines.append(
                f"--unattended: {protocol.name!r} mounts an indenter {changes} times, which an "
                "operator must do: use a protocol with one mounting"
            )
        return lines

    def build(self, job: RigSetup, progress: Progress | None = None) -> OpenBench:
        """Weights are placed by hand; everything else is done by the stage."""
        if job.protocol.weights is None:
            rig = GrblRig(self._config, self._source.parent, job)
            rig.monitors = self.monitors()
            return rig
        from .weights import WeightsBench

        return WeightsBench(self._config, self._source.parent, job)


class GrblRig(Rig):
    """Devices of a real rig; those already open are closed when the next one fails."""

    def __init__(self, config: GrblConfig, folder: Path, job: RigSetup) -> None:
        """folder: of the rig file."""
        self._job, clock = job, WallClock()
        stage = GrblStage.from_config(config.stage, clock)
        park_mm = job.protocol.motion.park_mm
        change_s = tool_change_s(config.stage, config.touch, park_mm, config.sample_s)
        with ExitStack() as stack:
            stack.callback(stage.close)
            contact_n = CONTACT_N if config.touch is None else config.touch.force_n
            force: Watchdog | None = None
            if config.force is not None and config.force.reachable:
                force = open_guarded(config.force, config.guard, stage, contact_n)
                stack.callback(force.close)
            elif not job.air:
                raise InputError(
                    "force: a press needs a force sensor for the guard; add [force.netft] or "
                    "[force.serial] to the rig file, or give --air"
                )
            self._tooling = Tooling(job, stage, clock, force, force, config.touch, config.tools)
            camera: Camera | None = None
            if "image" in job.protocol.channels:
                assert config.camera is not None, "refused without one"
                camera = open_camera(config.camera, folder, clock)
                stack.callback(camera.close)
            super().__init__(
                clock,
                stage,
                camera,
                force,
                change_indenter=self._tooling.change_indenter,
                guard=force,
                begin=self._tooling.begin,
                contact_n=contact_n,
                change_s=0.0 if job.air else change_s,
                wall_clock=True,
            )
            self.exit_stack = stack.pop_all()

    def omissions(self) -> Iterator[Note]:
        yield from super().omissions()
        if self.force is None:
            text = "none in the rig file; nothing is touched"
            yield Note("force sensor and guard", text)

    def notes(self) -> Iterator[Note]:
        if self.camera is not None:
            yield from view_notes(self._job.view, self._job.recipe.patch_mm)
        if self._job.air and len(self._job.protocol.tips) > 1:
            yield Note("indenters", "no indenter was changed: nothing was touched")

    def identity(self) -> dict[str, Any]:
        return {**super().identity(), "tool": self._tooling.identity()}


def missing_tables(config: GrblConfig) -> dict[str, str]:
    """Tables that every press needs and the rig file lacks: name to message."""
    lines = {}
    if config.force is None or not config.force.reachable:
        lines["force"] = (
            "force: a press on a real rig needs a force sensor, for the guard and to find the "
            "face: add [force.netft] or [force.serial], or give --air to stay above the clearance "
            "plane"
        )
    if config.touch is None:
        lines["touch"] = (
            "touch: missing table; a press on a real rig needs the position of the face: add "
            "[touch], or give --air"
        )
    return lines


def _touch_off_face(touch: TouchConfig, protocol: Protocol, sensor: SensorDimensions) -> list[str]:
    """Return a line if an indenter at touch.at_mm reaches beyond the face."""
    lines = []
    for name in protocol.tips:
        reach = parse_indenter(name).footprint_half_mm
        for axis, (centre_mm, half_mm, edge_mm) in enumerate(
            zip(touch.at_mm, reach, sensor.skin.opening_half_mm, strict=True)
        ):
            if abs(centre_mm) + half_mm > edge_mm:
                lines.append(
                    f"touch.at_mm: {'xy'[axis]} = {centre_mm:g} mm: {name} reaches "
                    f"{abs(centre_mm) + half_mm:g} mm out, and the face ends at {edge_mm:g} mm"
                )
    return lines[:1]


def _touch_above_guard(config: GrblConfig, touch: TouchConfig) -> list[str]:
    assert config.force is not None
    try:
        limits = GuardLimits.from_config(config.guard, config.force)
    except InputError as error:
        return [str(error)]
    lowest_n = min(*limits.force_n, limits.resultant_n)
    if MAX_FORCE_RATIO * touch.force_n < lowest_n:
        return []
    return [
        f"touch.force_n: {touch.force_n:g} N: a touch-off reaches up to {MAX_FORCE_RATIO:g} times "
        f"that, and the guard trips at {lowest_n:g} N"
    ]
