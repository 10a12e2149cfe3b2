"""`gel path`: presses solved ahead in processes, found the next time and by `run`."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from click.testing import CliRunner, Result
from rig_text import VIRTUAL_STAGE

from deltact_fab.app.cli.gel import path as command
from deltact_fab.physics.gel.path.solver import SOLVED_PATHS
from deltact_fab.simulate.experiment.request import RunRequest
from deltact_fab.simulate.experiment.session import run_experiment

PROTOCOL = """
name = "ahead"
indenters = ["sphere:12"]
positions_mm = {positions}
depths_mm = [0.5]
channels = ["force"]
[capture]
rate_hz = 1.0
[specimen]
gel_model = "{level}"
"""
RIG = f"""{VIRTUAL_STAGE}[force]
range_n = [25.0, 25.0, 35.0]
range_nmm = [250.0, 250.0, 250.0]
[virtual.gel]
spacing_mm = 1.0
[virtual.gel.hyperelastic]
cell_mm = 2.5
press_increment_mm = 0.25
"""


@pytest.fixture(autouse=True)
def _own_store(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("DELTACT_FAB_CACHE", str(tmp_path / "store"))


def files(
    folder: Path, level: str = "linear", positions: str = "[[0, 0], [1, 0]]"
) -> tuple[str, str]:
    protocol, rig = folder / "ahead.toml", folder / "bench.toml"
    protocol.write_text(PROTOCOL.format(level=level, positions=positions))
    rig.write_text(RIG)
    return str(protocol), str(rig)


def ask(protocol: str, rig: str, *more: str) -> Result:
    return CliRunner().invoke(command, [protocol, "--rig", rig, *more])


@pytest.mark.slow
def test_run_reuses_solved_path(tmp_path: Path) -> None:
    protocol, rig = files(tmp_path, "hyperelastic")
    first = ask(protocol, rig, "--jobs", "1", "--json")
    assert first.exit_code == 0, first.output
    told = json.loads(first.stdout)
    assert [p["press"] for p in told["presses"]] == ["sphere-12/p1", "sphere-12/p2"]
    assert all(p["done"] == p["knots"] == 2 and not p["found"] for p in told["presses"])
    again = ask(protocol, rig)
    assert again.exit_code == 0
    assert again.stdout.count(" yes ") == 2  # found in the store
    assert " 0 knots solved" in again.stdout
    summary = run_experiment(RunRequest(protocol, rig, tmp_path / "run"))
    assert any(note.startswith("0 contact problems solved, 4 found") for note in summary["notes"])


@pytest.mark.slow
def test_failed_press_exits_1(tmp_path: Path) -> None:
    # So light a touch meets a node of so coarse a grid only at odd millimetres.
    protocol, rig = files(tmp_path, positions="[[0, 0], [11, 1]]")
    Path(protocol).write_text(Path(protocol).read_text().replace("[0.5]", "[0.02]"))
    Path(rig).write_text(RIG.replace("spacing_mm = 1.0", "spacing_mm = 2.0"))
    told = ask(protocol, rig, "--jobs", "1")
    assert told.exit_code == 1
    lines = [line for line in told.stderr.splitlines() if line.startswith("failed: ")]
    assert len(lines) == 1
    assert lines[0].startswith("failed: sphere-12/p1: contact: sphere:12 at depth 0.02 ")
    # The refusal is kept as well: asked again, nothing is solved and the same is said.
    assert len(list(SOLVED_PATHS.folder.glob("*.bin"))) == 2
    again = ask(protocol, rig, "--jobs", "1")
    assert again.exit_code == 1
    assert lines[0] in again.stderr.splitlines()
    assert "0 knots solved" in again.stdout


@pytest.mark.slow
def test_killed_path_resumes(tmp_path: Path) -> None:
    protocol, rig = files(tmp_path, "hyperelastic", "[[0, 0], [1, 0], [2, 0], [3, 0]]")
    code = "from deltact_fab.app.cli.gel import path; path()"
    arguments = [protocol, "--rig", rig, "--jobs", "1"]
    store = SOLVED_PATHS.folder
    with subprocess.Popen(
        [sys.executable, "-c", code, *arguments], env=dict(os.environ), start_new_session=True,
        stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
    ) as process:  # fmt: skip
        deadline = time.monotonic() + 120
        while not list(store.glob("*.bin")) and time.monotonic() < deadline:
            time.sleep(0.02)
        os.killpg(process.pid, signal.SIGKILL)
    whole = len(list(store.glob("*.bin")))
    assert whole >= 1
    told = json.loads(ask(*arguments[:1], rig, "--jobs", "1", "--json").stdout)
    assert sum(p["found"] for p in told["presses"]) == whole
    assert all(p["done"] == p["knots"] for p in told["presses"])
