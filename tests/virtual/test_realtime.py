"""`run --realtime`: the real bench on real wires, through stops, kills and resumes."""

from __future__ import annotations

import os
import signal
import sqlite3
import subprocess
import time
from collections.abc import Callable
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from called import started

from deltact_fab import experiment, record
from deltact_fab.errors import InputError
from deltact_fab.protocols import plan
from deltact_fab.virtual.realtime.rig import RealtimeRig

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not hasattr(os, "openpty"), reason="needs pseudo terminals"),
]
PROTOCOL = """
name = "tiny"
indenters = ["sphere:6"]
positions_mm = [[0.0, 0.0], [1.0, 0.5]]
depths_mm = [0.6]
channels = ["image", "force"]
[capture]
rate_hz = 2.0
settle_s = 0.3
[motion]
clearance_mm = 2.0
park_mm = 6.0
travel_feed_mm_min = 1200.0
press_feed_mm_min = 30.0
[specimen]
design = "{design}"
"""
DESIGN = """
[optics]
image_width_px = 160
image_height_px = 120
"""
# The face is .2 mm higher than the rig file says and the tool .15 mm longer.
RIG = """
kind = "virtual"
[stage]
origin_machine_mm = [-60.0, -60.0, -40.0]
travel_mm = [120.0, 120.0, 60.0]
max_feed_mm_min = [1500.0, 1500.0, 1200.0]
acceleration_mm_s2 = [200.0, 200.0, 200.0]
max_force_n = [60.0, 60.0, 60.0]
[force]
range_n = [25.0, 25.0, 35.0]
range_nmm = [250.0, 250.0, 250.0]
origin_mm = [0.0, 0.0, 0.0]
[touch]
clear_mm = 1.0
search_mm = 0.8
repeats = 1
feed_mm_min = 60.0
[virtual.mount]
offset_mm = [0.0, 0.0, 0.2]
[virtual.mount.longer_mm]
"sphere:6" = 0.15
[virtual.gel]
spacing_mm = 0.5
press_increment_mm = 0.2
"""
RAISED_MM = 0.35
HOST = """
from deltact_fab.cli.main import entry
entry()
"""


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> tuple[str, str]:
    folder = tmp_path_factory.mktemp("tiny")
    design, protocol, rig = (folder / f"{n}.toml" for n in ("design", "tiny", "bench"))
    design.write_text(DESIGN)
    protocol.write_text(PROTOCOL.format(design=design))
    rig.write_text(RIG)
    return str(protocol), str(rig)


def test_stamps_poses_and_truth(
    files: tuple[str, str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Frame and pose are of one moment, as the carriage of the simulator has it."""
    asked: dict[str, Any] = {}
    notes = RealtimeRig.notes

    def before_it_ends(self: RealtimeRig) -> list[str]:
        run = record.open(tmp_path / "r")
        asked["frames"] = self.hands.ask("carriage", t_s=run.frames()["t_s"].tolist())
        return notes(self)

    monkeypatch.setattr(RealtimeRig, "notes", before_it_ends)
    summary = experiment.run(experiment.RunRequest(*files, tmp_path / "r", seed=5, realtime=True))
    run = record.open(tmp_path / "r")
    assert run.finished
    assert run.simulated
    assert (summary["realtime"], summary["seed"]) == (True, 5)
    assert run.meta["realtime"] is True
    frames = run.frames()
    steps = plan.expand(plan.load(files[0])[0])
    assert len(frames) + int(run.steps()["missed"].sum()) == sum(s.frames for s in steps)
    assert frames["frame_id"].is_unique
    assert frames["late_s"].between(0, 5).all()  # loose: the machine may be busy

    touch = summary["devices"]["tool"]["indenters"]["sphere:6"]
    assert touch["z_mm"] == pytest.approx(RAISED_MM, abs=0.02)

    # Poses: two stamps within 2 ms of one another are at most feed x 2 ms apart.
    found = np.array(asked["frames"]) - (-60.0, -60.0, -40.0 + touch["z_mm"])
    off_mm = np.abs(found - frames[["x_mm", "y_mm", "z_mm"]].to_numpy()).max()
    print(f"pose off by {off_mm:.4f} mm at most")
    assert off_mm < 30 / 60 * 2e-3 + 2.5e-3 + 0.02  # and what the touch-off was rounded to

    truth = run.truth()
    assert truth is not None
    assert set(truth.frames) == set(frames["frame_id"])
    deep = frames[frames["z_mm"] < -0.59]["frame_id"].iloc[0]
    assert truth.displacement_mm(deep)[..., 2].min() == pytest.approx(-0.6, abs=0.05)
    assert not np.abs(truth.displacement_mm(frames["frame_id"].iloc[0])).any()
    with pytest.raises(InputError, match="realtime"):
        experiment.run(experiment.RunRequest(*files, tmp_path / "r", seed=5), resume=True)


def run_of(files: tuple[str, str], out: Path) -> AbstractContextManager[subprocess.Popen[str]]:
    """A run in a process of its own."""
    words = ["run", files[0], "--rig", files[1], "--out", str(out), "--realtime"]
    return started("-c", HOST, *words, stdout=subprocess.PIPE, stderr=subprocess.PIPE)


def in_second_press(out: Path, host: subprocess.Popen[str]) -> None:
    """Wait until the second press is under way, its tip on the way into the gel."""
    await_(host, lambda: "begun" in _events(out, "sphere-6/p2"))
    time.sleep(1.5)


def _events(out: Path, press: str) -> list[str]:
    try:
        with sqlite3.connect(f"file:{out}/journal.sqlite?mode=ro", uri=True) as db:
            rows = db.execute("SELECT kind FROM events WHERE press = ?", (press,)).fetchall()
        db.close()
    except sqlite3.OperationalError:
        return []
    return [kind for (kind,) in rows]


def await_(host: subprocess.Popen[str], what: Callable[[], bool], within_s: float = 240) -> None:
    deadline = time.monotonic() + within_s
    while not what():
        assert host.poll() is None, host.communicate()[1]
        assert time.monotonic() < deadline
        time.sleep(0.05)


def bench_of(host: subprocess.Popen[str]) -> int:
    """The process in which the bench of a run is simulated."""
    children = Path(f"/proc/{host.pid}/task/{host.pid}/children").read_text().split()
    commands = {int(pid): Path(f"/proc/{pid}/cmdline").read_bytes() for pid in children}
    return next(pid for pid, command in commands.items() if b"virtual.realtime" in command)


def gone(pid: int) -> bool:
    try:
        return b") Z" in Path(f"/proc/{pid}/stat").read_bytes()
    except OSError:
        return True


def whole_after_resume(files: tuple[str, str], out: Path) -> None:
    """Finish the run; every id is there once, and nothing committed was lost."""
    before = set(record.open(out).frames()["frame_id"]) & {
        i for i in record.open(out).frames()["frame_id"] if "/p1/" in i
    }
    summary = experiment.run(experiment.RunRequest(*files, out, realtime=True), resume=True)
    run = record.open(out)
    ids = run.frames()["frame_id"].tolist()
    assert run.finished
    assert len(ids) == len(set(ids))
    assert len(ids) + int(run.steps()["missed"].sum()) == summary["frames"]
    assert before <= set(ids)
    assert summary["kept_frames"] >= len(before) > 0


def test_ctrl_c_in_mid_press_stops_and_lifts_and_resume_finishes(
    files: tuple[str, str], tmp_path: Path
) -> None:
    out = tmp_path / "r"
    with run_of(files, out) as host:
        in_second_press(out, host)
        bench = bench_of(host)
        host.send_signal(signal.SIGINT)
        _, err = host.communicate(timeout=120)
    assert host.returncode == 130, err
    assert "stopped by the operator" in err.splitlines()[-1]
    assert "the tip was lifted" in err.splitlines()[-1]
    assert gone(bench)
    whole_after_resume(files, out)


def test_a_host_that_is_killed_takes_the_bench_with_it_and_can_be_resumed(
    files: tuple[str, str], tmp_path: Path
) -> None:
    out = tmp_path / "r"
    with run_of(files, out) as host:
        in_second_press(out, host)
        bench = bench_of(host)
        host.kill()
        host.communicate(timeout=60)
    for _ in range(600):
        if gone(bench):
            break
        time.sleep(0.05)
    assert gone(bench)
    whole_after_resume(files, out)


def test_a_bench_that_is_gone_is_an_error_of_one_line(
    files: tuple[str, str], tmp_path: Path
) -> None:
    out = tmp_path / "r"
    with run_of(files, out) as host:
        in_second_press(out, host)
        os.kill(bench_of(host), signal.SIGKILL)
        _, err = host.communicate(timeout=120)
    assert host.returncode == 1, err
    last = err.splitlines()[-1]
    assert last.startswith("deltact-fab: ")
    assert any(what in last for what in ("force sensor", "stage", "camera", "simulated bench"))
    assert "Traceback" not in err
    assert not record.open(out).finished


def test_a_real_rig_has_no_realtime(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="--realtime is for a virtual rig"):
        experiment.run(
            experiment.RunRequest(
                "first-moves", "grbl-bench", tmp_path / "r", air=True, realtime=True
            )
        )
