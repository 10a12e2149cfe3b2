"""A rig of kind `grbl` over a real terminal device, at the wall clock, in air."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from board import Board, board, rig_file
from called import started
from click.testing import CliRunner

from deltact_fab.app.cli.main import main
from deltact_fab.bench.protocols import plan
from deltact_fab.bench.record.run import open_run
from deltact_fab.common.errors import InputError, RunFailed
from deltact_fab.simulate.experiment.request import RunRequest
from deltact_fab.simulate.experiment.session import run_experiment

PROTOCOL = """
name = "poses"
indenters = ["sphere:10", "4dots"]
positions_mm = [[0.0, 0.0], [2.0, -1.0]]
depths_mm = [1.0, 2.0]
channels = {channels}
[capture]
settle_s = 0.02
[motion]
clearance_mm = 4.0
park_mm = 8.0
travel_feed_mm_min = 6000.0
press_feed_mm_min = 3000.0
"""
FLOOR_MM = -40.0 + 4.0  # of the carriage: the clearance plane in machine coordinates
RUN = """
import sys
from deltact_fab.app.cli.main import entry
sys.argv = ["deltact-fab", *sys.argv[1:]]
try:
    entry()
finally:
    print("loaded:", *(m for m in sys.modules if m.startswith("deltact_fab.simulate.virtual")),
          file=sys.stderr)
"""

pytestmark = pytest.mark.skipif(not hasattr(os, "openpty"), reason="needs pseudo terminals")


def files(folder: Path, board: Board, channels: str = "[]") -> tuple[str, str]:
    """Paths of a short protocol and of the board's rig file."""
    protocol = folder / "poses.toml"
    protocol.write_text(PROTOCOL.format(channels=channels))
    return str(protocol), str(rig_file(folder, board.port))


@pytest.mark.slow
def test_protocol_runs_in_air_without_simulator(tmp_path: Path) -> None:
    with board(arduino=True) as it:
        protocol, rig = files(tmp_path, it)
        words = ["run", protocol, "--rig", rig, "--air", "--out", "r", "--json"]
        done = subprocess.run(
            [sys.executable, "-c", RUN, *words],
            capture_output=True, text=True, cwd=tmp_path, timeout=120, check=False,
        )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert done.stderr.splitlines()[-1] == "loaded:"
    summary = json.loads(done.stdout)
    assert (summary["simulated"], summary["air"]) == (False, True)
    assert summary["devices"]["stage"]["port"] == it.port
    assert summary["devices"]["stage"]["banner"].startswith("Grbl 1.1")
    assert it.links == ["opened", "closed"]
    assert it.lowest_mm() == FLOOR_MM

    run = open_run(tmp_path / "r")
    steps = plan.expand_protocol(plan.load_protocol(protocol)[0], air=True)
    assert run.finished
    assert run.meta["air"] is True
    assert not run.simulated
    assert list(run.steps()["step_id"]) == [s.id for s in steps]
    assert it.jogs == len(steps)
    frames = run.frames()
    assert len(frames) == sum(s.frames for s in steps) == summary["frames"]
    at = {s.id: s.target_mm for s in steps}
    for row in frames.itertuples():
        assert (row.x_mm, row.y_mm, row.z_mm) == pytest.approx(at[str(row.step_id)], abs=2e-3)
    assert frames["t_s"].is_monotonic_increasing
    planned_s = run.steps()["planned_s"].sum()
    assert 1 < planned_s < summary["rig_seconds"] <= summary["wall_seconds"]
    with pytest.raises(InputError, match="without a camera"):
        _ = run.camera


def test_missing_device_opens_nothing(tmp_path: Path) -> None:
    with board(arduino=True) as it:
        protocol, rig = files(tmp_path, it)
        declared = Path(rig).read_text() + "max_force_n = [60.0, 60.0, 60.0]\n"
        declared += "[force]\nrange_n = [50.0, 50.0, 70.0]\nrange_nmm = [500.0, 500.0, 500.0]\n"
        for text in (Path(rig).read_text(), declared):
            Path(rig).write_text(text)
            with pytest.raises(InputError, match=r"bench\.toml: force: .* needs a force sensor"):
                run_experiment(RunRequest(protocol, rig, tmp_path / "r"))
        protocol, rig = files(tmp_path, it, '["image", "force"]')
        with pytest.raises(InputError, match=r"'image' needs a camera, .* has no \[camera\]"):
            run_experiment(RunRequest(protocol, rig, tmp_path / "r", air=True))
    assert it.links == []
    assert not (tmp_path / "r").exists()


def test_dry_run_queries_devices_without_motion(tmp_path: Path) -> None:
    with board(arduino=True) as it:
        protocol, rig = files(tmp_path, it)
        done = CliRunner().invoke(main, ["run", protocol, "--rig", rig, "--air", "--dry-run"])
        assert done.exit_code == 0, done.output
        assert "nothing was moved or recorded" in done.output
        assert "stage: Grbl 1.1" in done.output
        assert sorted(p.name for p in tmp_path.iterdir()) == ["bench.toml", "poses.toml"]
        done = CliRunner().invoke(main, ["run", protocol, "--rig", rig, "--air"])
        assert done.exit_code == 2
        assert "--out" in done.output
    assert it.jogs == 0
    assert it.links == ["opened", "closed"]


@pytest.mark.slow
def test_sigterm_lifts_and_keeps_the_record(tmp_path: Path) -> None:
    with board(arduino=True) as it:
        protocol, rig = files(tmp_path, it)
        slow = Path(protocol).read_text().replace("settle_s = 0.02", "settle_s = 4.0")
        Path(protocol).write_text(slow)
        words = ["run", protocol, "--rig", rig, "--air", "--out", "r"]
        pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
        with started("-c", RUN, *words, cwd=tmp_path, **pipes) as host:
            deadline = time.monotonic() + 90
            while time.monotonic() < deadline and not _frames(tmp_path / "r"):
                time.sleep(0.1)
            host.send_signal(signal.SIGTERM)
            out, err = host.communicate(timeout=60)
    assert host.returncode == 130
    assert out == ""
    line = next(told for told in err.splitlines() if not told.startswith("run: "))
    assert line.startswith("deltact-fab: stopped by the operator in ")
    assert "the tip was raised by" in line
    assert line.endswith("complete presses are kept: continue with --resume")
    assert open_run(tmp_path / "r").events()["kind"].iloc[-1] == "stop"


def _frames(folder: Path) -> int:
    """Committed so far."""
    try:
        return len(open_run(folder).frames())
    except (InputError, RunFailed):
        return 0
