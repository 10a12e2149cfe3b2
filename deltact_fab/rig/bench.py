"""The real bench of kind `grbl`: a stage on a serial port, at the wall clock, in air."""

from __future__ import annotations

from typing import Any

from ..protocols.plan import Protocol
from ..shapes import SensorDimensions
from .clock import WallClock
from .config import GrblConfig
from .interface import Devices, Job
from .stage.grbl import GrblStage

MOTION = frozenset({"shear"})  # channels that ask for nothing but a path of the stage


class GrblKind:
    """Implements rig.interface.RigKind."""

    part = "devices of the rig"

    def __init__(self, config: GrblConfig) -> None:
        self._config = config

    def refusals(self, protocol: Protocol, sensor: SensorDimensions, source: str) -> list[str]:
        """A line when the protocol asks for a device that is not there."""
        asked = sorted(protocol.channels - MOTION)
        if not asked:
            return []
        return [
            f"{source}: channels: {', '.join(asked)} asked for, and a 'grbl' rig has only "
            f"{', '.join(sorted(MOTION))}: no driver of a camera or force sensor exists yet; "
            "channels = [] records the poses"
        ]

    def camera(self, protocol: Protocol, sensor: SensorDimensions) -> None:
        """There is none."""

    def flat(self, protocol: Protocol) -> None:
        """There is no camera."""

    def build(self, job: Job) -> GrblRig:
        """The stage, its port not yet open."""
        return GrblRig(self._config, job)


class GrblRig:
    """Implements rig.interface.Rig: the stage, and no other device."""

    def __init__(self, config: GrblConfig, job: Job) -> None:
        assert config.stage.port is not None, "the configuration has a port"
        self._job = job
        stage = config.stage
        self.clock = WallClock()
        self.stage = GrblStage(
            config.stage.port,
            self.clock,
            stage.frame,
            baud=stage.baud,
            require_travel_mm=stage.travel_mm,
            require_feed_mm_min=stage.max_feed_mm_min,
        )

    def devices(self) -> Devices:
        """What the runner drives. In air it is all the same which indenter is mounted."""
        return Devices(
            self.clock, self.stage, None, None, change_indenter=lambda name: None, wall_clock=True
        )

    def left_out(self) -> list[str]:
        """The devices that no channel asks for."""
        return ["camera, force sensor: no channel asks for them"]

    def notes(self) -> list[str]:
        """What was not done in air."""
        if len(self._job.protocol.indenters) > 1:
            return ["no indenter was changed: nothing was touched"]
        return []

    def identity(self) -> dict[str, Any]:
        """What the summary keeps of the devices."""
        return {"stage": self.stage.identity(), "camera": None, "force": None}

    def close(self) -> None:
        """Close the port."""
        self.stage.close()
