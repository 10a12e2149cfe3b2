"""What is mounted: confirmed by name, found on the face, kept with the run and compared on resume.

The runner, the real host and client in lockstep; the operator types through a pipe.
"""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from felt import EXPECTED, Bench, bench

from deltact_fab.bench.protocols import plan
from deltact_fab.bench.record.run import open_run
from deltact_fab.bench.record.writer import RunWriter
from deltact_fab.bench.rig.interface import Devices, RigSetup
from deltact_fab.bench.rig.run.runner import Runner
from deltact_fab.bench.rig.tables import ToolConfig, TouchConfig
from deltact_fab.bench.rig.tool import session
from deltact_fab.bench.rig.tool.feeler import ForceProbe
from deltact_fab.bench.rig.tool.tooling import (
    TOUCH_FILE,
    TerminalOperator,
    Tooling,
    clear_the_face,
    confirm,
)
from deltact_fab.common.errors import InputError, RunFailed, SensorError, StageError
from deltact_fab.fabricate.cad.design import load_design
from deltact_fab.fabricate.patterns.recipe import load_recipe
from deltact_fab.sensor.shapes.indenter import parse_indenter
from deltact_fab.sensor.shapes.sensor import SkinDimensions
from examples.find_the_block import BlockPlace, BlockTouch

PROTOCOL = plan.Protocol.model_validate(
    {
        "name": "short",
        "indenters": ["sphere:10"],
        "positions_mm": [[0.0, 0.0], [3.0, 1.0]],
        "depths_mm": [0.5],
        "channels": ["force"],
        "capture": {"settle_s": 0.02},
        "specimen": {"serial": "S-12"},
        "motion": {"travel_feed_mm_min": 1200.0, "park_mm": 8.0},
    }
)
TOUCH = TouchConfig(repeats=1)


@contextmanager
def typing(*lines: str) -> Iterator[None]:
    """An operator's keyboard: the lines, then the end."""
    read, write = os.pipe()
    os.write(write, "".join(f"{line}\n" for line in lines).encode())
    os.close(write)
    before = sys.stdin
    with os.fdopen(read) as sys.stdin:
        try:
            yield
        finally:
            sys.stdin = before


def job(folder: Path, **more: Any) -> RigSetup:
    design = load_design("deltact")
    return RigSetup(PROTOCOL, design, load_recipe("dense-with-dots"), None, 1, folder, **more)


def tooling(
    it: Bench, folder: Path, operator: TerminalOperator | None = None, **more: Any
) -> Tooling:
    return Tooling(
        job(folder, **more), it.stage, it.clock, it.force, it.guard, TOUCH,
        {"sphere:10": ToolConfig(length_mm=1.0)}, operator,
    )  # fmt: skip


def carry_out(it: Bench, folder: Path, resume: bool = False, stop_after: str = "") -> Tooling:
    """One session of the protocol."""
    steps = plan.expand_protocol(PROTOCOL)
    mounted = tooling(it, folder)
    meta: dict[str, Any] = {
        "name": "r", "protocol": PROTOCOL.model_dump(mode="json"), "rig_name": "bench", "rig": {},
        "sensor": {}, "camera": None, "simulated": False, "air": False, "seed": 1, "versions": {},
    }  # fmt: skip
    meta["protocol"]["channels"] = ["force"]
    if resume:
        writer = RunWriter.resume(folder, steps)
    else:
        writer = RunWriter.create(folder, meta, b"", {"dots_mm": []}, steps)
    devices = Devices(
        it.clock, it.stage, None, it.force, mounted.change_indenter, it.guard, mounted.begin
    )

    def progress(done: int, total: int, step: str) -> None:
        if stop_after and step.startswith(stop_after):
            raise KeyboardInterrupt

    try:
        Runner(devices, writer, progress).run(steps)
        writer.close({})
    except BaseException:
        writer.abandon()
        raise
    return mounted


def low(it: Bench) -> None:
    """Near the face, as a change of indenter ends; the way down from homing is felt too."""
    it.stage.start_move((0.0, 0.0, 7.0), 1200)
    it.stage.wait()


@pytest.mark.slow
def test_press_depth_holds_on_shifted_face(tmp_path: Path) -> None:
    """The face 0.4 mm lower, the indenter 1.3 mm longer where the file says 1."""
    it = bench("sphere:10", (0.0, 0.0, -0.4), 1.3, homed=False)
    with typing("S-12", "sphere:10"):
        mounted = carry_out(it, tmp_path / "r")
    assert it.face.deepest_mm == pytest.approx(0.5, abs=0.02)
    row = mounted.identity()["indenters"]["sphere:10"]
    assert row["machine_mm"][2] == pytest.approx(-40 - 0.4 + 1.3, abs=0.02)
    assert row["z_mm"] == pytest.approx(-0.1, abs=0.02)
    assert json.loads((tmp_path / "r" / TOUCH_FILE).read_text())["touches"][0]["base"] == "S-12"
    events = open_run(tmp_path / "r").events()
    said = dict(zip(events["kind"], events["text"], strict=True))
    assert said["begin"].startswith("sensor S-12 (confirmed); position lost; force")
    assert "face at machine z -39.1" in said["indenter"]


def test_wrong_name_asked_again_silence_ends(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    it = bench("sphere:10", homed=False)
    with (
        typing("S-12", "sphere:12", ""),
        pytest.raises(RunFailed, match="standard input has ended"),
    ):
        carry_out(it, tmp_path / "r")
    asked = capsys.readouterr().err
    assert "type S-12 to confirm that this sensor is on the bench" in asked
    assert asked.count("type sphere:10 to confirm") == 3
    assert "got 'sphere:12', expected 'sphere:10'" in asked
    assert it.face.deepest_mm < 0  # nothing was touched
    with typing(*["no"] * 9), pytest.raises(RunFailed, match="not confirmed in 5 attempts"):
        confirm(TerminalOperator(), "star", "it is mounted")


@pytest.mark.slow
def test_resumed_run_refuses_another_length(tmp_path: Path) -> None:
    it = bench("sphere:10", longer_mm=1.0, homed=False)
    folder = tmp_path / "r"
    with typing("S-12", "sphere:10"), pytest.raises(RunFailed, match="stopped by the operator"):
        carry_out(it, folder, stop_after="sphere-10/p2")
    other = bench("sphere:10", longer_mm=1.5, homed=False)
    with typing("S-12", "sphere:10"), pytest.raises(RunFailed) as why:
        carry_out(other, folder, resume=True)
    assert "0.50 mm higher than at the run's first touch, more than touch.moved_mm" in str(
        why.value
    )
    assert other.face.deepest_mm < 0.2
    again = bench("sphere:10", longer_mm=1.2, homed=False)
    with typing("S-12", "sphere:10"):
        carry_out(again, folder, resume=True)
    assert again.face.deepest_mm == pytest.approx(0.5, abs=0.02)
    run = open_run(folder)
    assert run.finished
    assert len(run.steps()) == len(plan.expand_protocol(PROTOCOL))
    touches = json.loads((folder / TOUCH_FILE).read_text())["touches"]
    heights = [touch["machine_mm"][2] for touch in touches]
    assert heights == pytest.approx([-39.0, -38.8], abs=0.02)
    (folder / TOUCH_FILE).write_text("{")
    with pytest.raises(InputError, match=r"tool\.json: not valid JSON"):
        tooling(it, folder, unattended=True).change_indenter("sphere:10")


def test_unattended_contact_is_refused_without_prompt(tmp_path: Path) -> None:
    it = bench("sphere:10", homed=False)
    it.stage.connect()
    with typing():
        assert "sensor S-12 (unattended)" in tooling(it, tmp_path, unattended=True).begin()
    it.face.mount("sphere:10", 20.0)  # so long that the tip stands in the gel
    it.grbl._carriage.path._origin_mm = (-60.0, -60.0, -21.0)
    with typing(), pytest.raises(StageError, match=r"force sensor reads .* --tip-is-clear"):
        tooling(it, tmp_path, unattended=True).begin()
    assert it.grbl.segments == []
    with typing("S-12", "clear"):
        assert "operator confirmed" in tooling(it, tmp_path).begin()
    assert "operator stated" in tooling(it, tmp_path, unattended=True, tip_is_clear=True).begin()


def test_known_position_lifts_straight_up() -> None:
    it = bench("sphere:10")
    it.stage.start_move((2.0, 1.0, 3.0), 1200)
    it.stage.wait()
    it.stage.start_move((2.0, 1.0, -0.5), 60)
    it.stage.wait()
    moved = len(it.grbl.segments)
    said = clear_the_face(it.stage, it.clock, it.force, None)
    assert said.startswith("position known")
    lift = it.grbl.segments[moved:]
    assert {s.end_mm[:2] for s in lift} == {(-58.0, -59.0)}
    assert it.stage.position_mm() == pytest.approx((2.0, 1.0, 24.5), abs=0.003)
    assert it.stage.homed


def test_air_without_force_sensor_no_prompt(tmp_path: Path) -> None:
    it = bench("sphere:10", homed=False)
    it.stage.connect()
    mounted = Tooling(job(tmp_path, air=True), it.stage, it.clock)
    with typing():
        assert "in air" in mounted.begin()
        assert "in air" in mounted.change_indenter("sphere:10")
    with typing(), pytest.raises(RunFailed, match="no answer"):
        clear_the_face(it.stage, it.clock, None, TerminalOperator())
    with pytest.raises(StageError, match="without a force sensor"):
        clear_the_face(it.stage, it.clock, None, None)


@pytest.mark.slow
def test_tilt_of_face_is_measured() -> None:
    ball, skin = parse_indenter("sphere:10"), SkinDimensions()
    it = bench("sphere:10", (0.0, 0.0, 0.4), 1.0, tilt_deg=(0.8, -0.5))
    low(it)
    asked = session.RegistrationRequest(
        ball, session.places_for(skin, ball), TOUCH, 1.0, "bench.toml"
    )
    devices = ForceProbe(it.stage, it.force, it.clock, it.guard)
    with typing("sphere:10"):
        found = session.register_face(devices, asked, TerminalOperator())
    assert found.tilt_deg == pytest.approx((0.8, -0.5), abs=0.02)
    assert found.origin_machine_mm == pytest.approx((-60.0, -60.0, -39.6), abs=0.02)
    assert found.residual_mm < 0.01
    assert "4 touches" in found.line()


def test_invalid_registration_points_are_refused() -> None:
    skin, ball = SkinDimensions(), parse_indenter("sphere:10")
    for name, places, why in (
        ("star", session.places_for(skin, ball), "needs a ball"),
        ("sphere:10", ((0.0, 0.0), (5.0, 5.0), (8.0, 8.0)), "not in a line"),
        ("sphere:10", ((0.0, 0.0), (5.0, 5.0)), "three points"),
        ("sphere:10", ((0.0, 0.0), (15.0, 0.0), (0.0, 8.0)), "does not fit"),
    ):
        with pytest.raises(InputError, match=why):
            session.require_fit(skin, parse_indenter(name), places)


@pytest.mark.slow
def test_block_sides_locate_face_sideways() -> None:
    it = bench(
        "sphere:10", (0.7, -0.4, 0.0), guard_n=10.0, block_mm=(24.0, 22.0, -2.0), turn_deg=1.2
    )
    low(it)
    feeler = ForceProbe(it.stage, it.force, it.clock, it.guard)

    def find(half_x: float) -> BlockPlace:
        return BlockTouch(feeler, TOUCH, (half_x, 22.0), -2.0, parse_indenter("sphere:10")).find()

    frame = find(24.0).frame(EXPECTED)
    assert frame.origin_machine_mm == pytest.approx((-59.3, -60.4, -40.0), abs=0.02)
    assert frame.angle_deg == pytest.approx(1.2, abs=0.02)
    assert feeler.peak_n < 3.0
    with pytest.raises(SensorError, match="no contact with the block at -x within 3 mm"):
        find(28.0)
    assert it.stage.position_mm()[2] > 5
