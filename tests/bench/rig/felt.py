"""A simulated bench in lockstep whose face is not where it is expected, to test a tool on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from slow_link import EventClock, SlowLink

from deltact_fab.bench.rig.force.guard import ForceGuard, GuardLimits
from deltact_fab.bench.rig.force.netft import SENSOR_SILENT_S, NetFTSensor
from deltact_fab.bench.rig.stage.grbl import GrblStage
from deltact_fab.bench.rig.tables import ForceConfig, GuardConfig, TouchConfig
from deltact_fab.bench.rig.tool.feeler import ForceProbe
from deltact_fab.bench.rig.tool.touch import ForceTouch
from deltact_fab.sensor.optics.camera import StageFrame
from deltact_fab.sensor.shapes.sensor import SkinDimensions
from deltact_fab.simulate.virtual.bench_face import BenchFace
from deltact_fab.simulate.virtual.clock import VirtualClock
from deltact_fab.simulate.virtual.controller import GrblController
from deltact_fab.simulate.virtual.netft import LockstepLink, NetFTBox
from deltact_fab.simulate.virtual.wire import SerialLink

EXPECTED = StageFrame((-60.0, -60.0, -40.0))


class Block(BenchFace):
    """A hard block with upright sides around the gel, which a ball of 10 mm meets from beside."""

    size_mm: tuple[float, float, float]  # half sides, and top above the face

    def wrench(self, carriage_mm: tuple[float, float, float]) -> NDArray[np.float64]:
        x, y, z = carriage_mm
        ball = np.array(self._frame.to_sensor_mm((x, y, z + 5.0)))
        off = ball - np.clip(ball, np.negative(self.size_mm), self.size_mm)
        away = float(np.hypot(*off[:2]))
        found = super().wrench(carriage_mm)
        if ball[2] <= self.size_mm[2] and 0 < away < 5.0:
            found[:2] -= 400.0 * (5.0 - away) / away * off[:2]
        return found


@dataclass
class Bench:
    """The devices, and what is below their wires."""

    clock: VirtualClock
    grbl: GrblController
    face: BenchFace
    box: NetFTBox
    stage: GrblStage
    force: NetFTSensor
    guard: ForceGuard
    link: SerialLink

    def touch(self, config: TouchConfig | None = None) -> ForceTouch:
        """A touch-off on it."""
        config = config or TouchConfig()
        return ForceTouch(ForceProbe(self.stage, self.force, self.clock, self.guard), config)

    def lowest_mm(self) -> float:
        """Lowest height of the carriage so far, machine mm."""
        ends = [z for s in self.grbl.segments for z in (s.start_mm[2], s.end_mm[2])]
        return min(ends)


def bench(
    indenter: str = "sphere:10",
    off_mm: tuple[float, float, float] = (0.0, 0.0, 0.0),
    longer_mm: float = 0.0,
    noise_n: float = 0.01,
    tilt_deg: tuple[float, float] = (0.0, 0.0),
    guard_n: float = 5.0,
    homed: bool = True,
    block_mm: tuple[float, float, float] | None = None,
    turn_deg: float = 0.0,
    delay_s: tuple[float, float] = (0.0, 0.0),
    rate_hz: float = 1000.0,
) -> Bench:
    """off_mm: of the face from where it is expected, machine axes.

    delay_s: of the stage's link each way, and its variation. rate_hz: of the force sensor.
    """
    clock = EventClock()
    grbl = GrblController({}, clock, start_mm=(-30.0, -30.0, -10.0))
    x, y, z = (o + d for o, d in zip(EXPECTED.origin_machine_mm, off_mm, strict=True))
    true = StageFrame((x, y, z), turn_deg, tilt_deg)
    face = (BenchFace if block_mm is None else Block)(true, SkinDimensions())
    if isinstance(face, Block) and block_mm is not None:
        face.size_mm = block_mm
    face.mount(indenter, longer_mm)

    def wrenches(t_ns: NDArray[np.int64]) -> NDArray[np.float64]:
        at = [face.wrench(grbl.position_mm(t / 1e9)) for t in t_ns.tolist()]
        return np.reshape(at, (-1, 6))

    box = NetFTBox(ForceConfig(rate_hz=rate_hz), clock, 1, wrenches, noise_n)
    link = SlowLink(grbl, clock, *delay_s) if delay_s[0] else SerialLink(grbl, clock)
    stage = GrblStage(link, clock, EXPECTED)
    force = NetFTSensor(LockstepLink(box), clock, max(SENSOR_SILENT_S, 3 / rate_hz))
    limits = GuardLimits.from_config(GuardConfig(force_n=guard_n), ForceConfig())
    guard = ForceGuard(stage.cancel, limits, clock)
    if homed:
        stage.connect()
        stage.home()
    return Bench(clock, grbl, face, box, stage, force, guard, link)
