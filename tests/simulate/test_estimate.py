"""The estimated time of a run against the time that it takes, in lockstep and on the wall clock."""

from __future__ import annotations

import math
import os
from pathlib import Path

import pytest

from deltact_fab.bench.protocols import plan
from deltact_fab.bench.rig import config
from deltact_fab.bench.rig.run import runner
from deltact_fab.bench.rig.tables import TouchConfig
from deltact_fab.bench.rig.tool.touch import tool_change_s
from deltact_fab.common import catalog
from deltact_fab.fabricate.cad.design import load_design
from deltact_fab.fabricate.patterns.recipe import load_recipe
from deltact_fab.simulate.experiment.request import RunRequest
from deltact_fab.simulate.experiment.session import run_experiment
from deltact_fab.simulate.virtual.served import serve_rig

STEPS = """
name = "steps"
indenters = ["sphere:10", "4dots"]
positions_mm = [[0.0, 0.0], [2.0, -1.0]]
depths_mm = [0.5, 1.0]
channels = []
[capture]
settle_s = 0.3
[motion]
clearance_mm = 4.0
park_mm = 10.0
travel_feed_mm_min = 900.0
press_feed_mm_min = 120.0
"""

ONE = STEPS.replace(', "4dots"', "").replace(", [2.0, -1.0]", "").replace(", 1.0", "")
ONE = ONE.replace("channels = []", 'channels = ["force"]')

CELL = """
kind = "grbl"
[stage]
origin_machine_mm = [-60.0, -60.0, -40.0]
travel_mm = [120.0, 120.0, 60.0]
max_feed_mm_min = [1500.0, 1500.0, 1200.0]
acceleration_mm_s2 = [50.0, 50.0, 50.0]
port = "none"
[force.serial]
port = "none"
rate_hz = {rate_hz}
[touch]
"""

HELD = """settle_s = {press = 1.5, after = 0.5}
rate_hz = 2.0
hold = {s = 7.0, rate_hz = 1.0}
retract = {rate_hz = 4.0}
"""


@pytest.mark.parametrize(("name", "rig"), [("smoke", "fisheye"), ("held", "virtual")])
def test_within_5_percent_of_the_run(name: str, rig: str, tmp_path: Path) -> None:
    """Images and forces take no time of a lockstep run, so they are left out."""
    text = STEPS.replace("settle_s = 0.3\n", HELD)
    if name == "smoke":
        text = catalog.find_file("protocols", "smoke").read_text()
        text = text.replace('["image", "dots", "force", "shear"]', '["shear"]')
    protocol = tmp_path / "p.toml"
    protocol.write_text(text)
    summary = run_experiment(RunRequest(str(protocol), rig, tmp_path / "r"))
    estimate = RunRequest(str(protocol), rig).estimate()
    assert estimate.seconds == pytest.approx(summary["rig_seconds"], rel=0.01)


@pytest.mark.parametrize("name", ["demo", "shapes", "pattern-selection", "force-calibration-small"])
def test_remaining_time_within_factor_two(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """By a made-up cost of the gel, of which an indenter's first press takes twice as much."""
    steps = plan.expand_protocol(plan.load_protocol(name)[0])
    presses = {s.indenter: s.press for s in reversed(steps) if s.kind == "press"}
    wall_s, at_mm = [], steps[0].target_mm
    for step in steps:
        depth_mm = max(0.0, -step.target_mm[2], -at_mm[2])
        in_gel = min(1.0, depth_mm / max(abs(step.target_mm[2] - at_mm[2]), 1e-9))
        way_mm = math.dist(at_mm, step.target_mm) * in_gel * (step.target_mm[2] < 0)
        solved_s = (2.0 * (way_mm > 0) + 4.0 * way_mm) * (1 + depth_mm / 4)
        wall_s.append(solved_s * (1 + (presses[step.indenter] == step.press)) + 0.1 * step.frames)
        at_mm = step.target_mm
    now_s, end_s = 0.0, sum(wall_s)
    looked = paused_s = 0
    monkeypatch.setattr(runner.time, "monotonic", lambda: now_s + paused_s)
    left = runner.RemainingTime(steps, range(len(steps)), wall_clock=False)
    for i, took_s in enumerate(wall_s):
        paused_s += 900
        left.leave_out(900.0)
        now_s += took_s
        left.finished(i)
        if 0.1 * end_s < now_s < 0.95 * end_s:
            looked += 1
            assert 0.5 <= left.left_s() / (end_s - now_s) <= 2, (steps[i].id, now_s / end_s)
    assert looked > 3


def test_estimate_includes_force_sensor_rate(tmp_path: Path) -> None:
    """A load cell at 10 Hz against one at 1 kHz: a touch-off, and a wait at each step's frames."""
    protocol, file, told_s, touch_s = tmp_path / "one.toml", tmp_path / "rig.toml", [], []
    protocol.write_text(ONE)
    steps = [s for s in plan.expand_protocol(plan.load_protocol(str(protocol))[0]) if s.frames]
    for rate_hz in (10, 1000):
        file.write_text(CELL.format(rate_hz=rate_hz))
        request = RunRequest(str(protocol), str(file))
        told_s.append(request.estimate().seconds)
        touch_s.append(tool_change_s(request.rig.stage, TouchConfig(), 10.0, 1 / rate_hz))
    assert touch_s[0] - touch_s[1] > 30
    added_s = touch_s[0] - touch_s[1] + len(steps) * (0.1 - 0.001)
    assert told_s[0] - told_s[1] == pytest.approx(added_s, abs=1e-6)


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(os, "openpty"), reason="needs pseudo terminals")
@pytest.mark.parametrize("air", [True, False])
def test_on_the_wall_clock_too(air: bool, tmp_path: Path) -> None:
    """With a touch-off where something is touched; within 10 % where the machine is idle."""
    protocol = tmp_path / "one.toml"
    protocol.write_text(ONE)
    rig, design = config.load_rig("virtual")[0], load_design("deltact")
    with serve_rig(rig, design, load_recipe("dense"), "sphere:10", tmp_path / "bench") as file:
        request = RunRequest(str(protocol), str(file), tmp_path / "r", air=air, unattended=True)
        summary = run_experiment(request)
    assert summary["simulated"]
    estimate = request.estimate()
    print(f"{estimate.seconds:.2f} s told, {summary['rig_seconds']:.2f} s taken")
    assert estimate.seconds == pytest.approx(summary["rig_seconds"], rel=0.2)
