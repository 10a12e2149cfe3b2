"""The real host on the simulated controller, in virtual time."""

from __future__ import annotations

from typing import Any

from deltact_fab.bench.protocols.motion import StageConfig
from deltact_fab.bench.rig.stage.grbl import GrblStage
from deltact_fab.simulate.virtual import wire
from deltact_fab.simulate.virtual.clock import VirtualClock
from deltact_fab.simulate.virtual.controller import GrblController

TARGET_MM = (0.0, 0.0, 5.0)  # some 84 mm from home
MACHINE_MM = (-60.0, -50.0, -35.0)
FEED_MM_MIN = 600.0


class Bench:
    """Clock, controller, cable and the real host."""

    def __init__(
        self, *, angle_deg: float = 0.0, start_s: float = 0.0, resets_on_open: bool = True,
        controller: type[GrblController] = GrblController, **options: Any,
    ) -> None:  # fmt: skip
        self.clock = VirtualClock(start_s)
        self.start_s = start_s
        self.trace: list[wire.WireExchange] = []
        self.grbl = controller(None, self.clock, **options)
        self.link = wire.SerialLink(
            self.grbl, self.clock, resets_on_open=resets_on_open, trace=self.trace
        )
        config = StageConfig(
            origin_machine_mm=(-60.0, -50.0, -40.0), angle_deg=angle_deg,
            travel_mm=(120.0, 120.0, 60.0), max_feed_mm_min=(1.0,) * 3,
            acceleration_mm_s2=(1.0,) * 3,
        )  # fmt: skip
        self.stage = GrblStage.from_config(config, self.clock, self.link)

    def homed(self, booted_s: float = 0.0) -> Any:
        self.clock.sleep_s(booted_s)
        self.stage.connect()
        self.stage.home()
        return self

    def moving(self) -> Any:
        """In mid-move, 1 s after its start."""
        self.stage.start_move(TARGET_MM, FEED_MM_MIN)
        self.stage.listen(1.0)
        return self

    def sent(self) -> list[bytes]:
        return [data for _, who, data in self.trace if who == "host" and data != b"?"]
