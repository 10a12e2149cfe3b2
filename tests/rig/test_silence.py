"""The silence that a real box is allowed, on real sockets: 50 ms, and the press is over."""

from __future__ import annotations

import os
import time
from contextlib import ExitStack
from pathlib import Path

import pytest
from served_bench import bench_served

from deltact_fab import record
from deltact_fab.errors import SensorError
from deltact_fab.optics import StageFrame
from deltact_fab.protocols import plan
from deltact_fab.record import RunWriter
from deltact_fab.rig.clock import WallClock
from deltact_fab.rig.force.config import ForceConfig, NetFTConfig
from deltact_fab.rig.force.guard import ForceGuard, GuardLimits
from deltact_fab.rig.force.open import open_force
from deltact_fab.rig.job import Devices
from deltact_fab.rig.run.live import Live
from deltact_fab.rig.run.runner import Runner
from deltact_fab.rig.stage.grbl import GrblStage

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not hasattr(os, "openpty"), reason="needs pseudo terminals"),
]
ORIGIN_MM = (-30.0, -30.0, -20.0)
CLEARANCE_MM = 3.0
SOON_S = 1.0  # 0.05 s where the machine is idle
TRIES = 4  # a busy machine may be silent for 50 ms by itself
PROTOCOL = f"""
name = "slow"
indenters = ["sphere:6"]
positions_mm = [[0.0, 0.0]]
depths_mm = [1.0]
channels = ["force"]
[capture]
rate_hz = 10.0
settle_s = 0.1
[motion]
clearance_mm = {CLEARANCE_MM}
park_mm = 4.0
travel_feed_mm_min = 600.0
press_feed_mm_min = 20.0
"""


def test_silence_of_50_ms_ends_a_press(tmp_path: Path) -> None:
    for k in range(TRIES):
        (folder := tmp_path / str(k)).mkdir()
        why, told, saw = silenced(folder)
        if told:
            break
        print(f"silent by itself: {why}")
    else:
        pytest.skip(f"this machine is too busy: {TRIES} times silent by itself for 50 ms")
    print(why, saw)
    assert "sphere-6/p1/d1.00/press: force sensor: no sample within 50 ms" in why
    assert why.endswith("(the tip was lifted)")
    assert 0.04 < saw["stopped_after_s"] < SOON_S
    assert saw["at_mm"][2] == pytest.approx(ORIGIN_MM[2] + CLEARANCE_MM, abs=0.01)
    run = record.open(folder / "r")
    assert not run.finished
    assert run.events()["kind"].iloc[-1] == "fault"
    assert -0.9 < run.pose()["z_mm"].min() < CLEARANCE_MM, "the press was cut off"


def silenced(folder: Path) -> tuple[str, bool, dict[str, float]]:
    """A run whose box falls silent in its press: the error, whether it was told to, what it saw."""
    (folder / "p.toml").write_text(PROTOCOL)
    protocol = plan.load(str(folder / "p.toml"))[0]
    steps = plan.expand(protocol)
    told_s: list[float] = []
    with bench_served() as bench, ExitStack() as held:

        def fall_silent(live: Live) -> None:
            # The press takes 3 s from where it may begin to touch.
            if live.step.endswith("/press") and not told_s:
                told_s.append(time.monotonic())
                bench.silence()

        clock = WallClock()
        stage = GrblStage(bench.ports["stage"], clock, StageFrame(ORIGIN_MM))
        held.callback(stage.close)
        net = NetFTConfig(
            host="127.0.0.1",
            rdt_port=bench.ports["rdt_port"],
            http_port=bench.ports["http_port"],
        )
        force = open_force(ForceConfig(netft=net), clock)  # as a real bench: 50 ms
        held.callback(force.close)
        guard = ForceGuard(stage, GuardLimits.of(None, ForceConfig()), clock, 0.1)
        devices = Devices(clock, stage, None, force, lambda name: None, guard, wall_clock=True)
        meta = {"name": "r", "simulated": False, "camera": None, "rig": {}}
        meta["protocol"] = {
            **protocol.model_dump(mode="json"),
            "channels": sorted(protocol.channels),
        }
        writer = RunWriter.create(
            folder / "r", meta, b"", {"dots_mm": [], "dot_diameter_mm": 0.0}, steps
        )
        try:
            with pytest.raises(SensorError) as caught:
                Runner(devices, writer, live=fall_silent).run(steps)
        finally:
            writer.abandon()
    return str(caught.value), bool(told_s), bench.saw
