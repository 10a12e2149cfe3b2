"""A run at the wall clock, on real wires: its streams belong together, and a fault stops it.

Of a fault: it is named, the stage stops, and the record is whole.

The other faults, and all moments, are struck in virtual time
(`deltact_fab.studies.numerics.faults`).
"""

from __future__ import annotations

import os
import re
import threading
import time
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from wall_bench import N_PER_MM, ORIGIN_MM, WallBench, sine_n, wall_bench

from deltact_fab.bench.record.run import open_run
from deltact_fab.bench.rig.interface import Devices, WallClock
from deltact_fab.bench.rig.run.runner import RunProgress
from deltact_fab.bench.rig.run.wallclock import ThreadedSchedule
from deltact_fab.common.errors import RunFailed, SensorError, StageError

pytestmark = pytest.mark.skipif(not hasattr(os, "openpty"), reason="needs pseudo terminals")
slow = pytest.mark.slow
PRESS = "p1/d1.00/press"


def threads() -> set[str]:
    return {t.name for t in threading.enumerate()} & {"camera", "force sensor", "journal"}


def stalls(bench: WallBench) -> None:
    bench.devices.camera.timeout_s = 0.5  # type: ignore[union-attr]
    (bench.folder / "stall").touch()


def board_fault(name: str) -> Callable[[WallBench], None]:
    def strike(bench: WallBench) -> None:
        with bench.board.terminal.lock:
            bench.board.grbl.fault(name)

    return strike


@pytest.mark.parametrize(
    ("strike", "given", "error", "says", "lifted"),
    [
        pytest.param(None, {"guard_n": 1.5}, SensorError, "Fz = .*the guard's 1.5 N", True,
                     id="force", marks=slow),
        pytest.param(lambda bench: setattr(bench.server.faults, "silent", True), {}, SensorError,
                     "force sensor: no sample within", True, id="silent"),
        pytest.param(lambda bench: setattr(bench.server.faults, "late_s", 0.8), {"behind_s": 0.5},
                     SensorError, "ms behind its stream", True, id="late", marks=slow),
        pytest.param(stalls, {}, SensorError, "camera .*stalled", True, id="camera", marks=slow),
        pytest.param(None, {}, RunFailed, "press_005.png: cannot be written: No space left", True,
                     id="disk", marks=slow),
        pytest.param(board_fault("reboot"), {}, StageError, "restarted", False, id="reboot",
                     marks=slow),
        pytest.param(lambda bench: bench.board.terminal.unplug(), {"silent_s": 5.0}, StageError,
                     "the link is lost", False, id="unplugged", marks=slow),
    ],
)  # fmt: skip
def test_fault_in_press_stops_and_lifts(
    strike: Callable[[WallBench], None] | None, given: dict[str, float], error: type[Exception],
    says: str, lifted: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    struck: list[str] = []
    real = os.fsync

    def full(handle: int) -> None:
        if os.readlink(f"/proc/self/fd/{handle}").endswith(f"press_005.png.{os.getpid()}.part"):
            raise OSError(28, "No space left on device")
        real(handle)

    if error is RunFailed:
        monkeypatch.setattr(os, "fsync", full)
    with wall_bench(tmp_path, **given) as bench:

        def once(live: RunProgress) -> None:
            if live.step.endswith(PRESS) and strike is not None and not struck:
                struck.append(live.step)
                strike(bench)

        with pytest.raises(error, match=says) as why:
            bench.run(bench.writer(), live=once)
        assert f"{PRESS}: " in str(why.value) or not lifted or error is RunFailed
        time.sleep(0.6)  # a jog that no byte can reach has run to its end
        at_mm = bench.board.at_mm()
        if lifted:
            assert re.search(r"\(the tip was (lifted|raised) by \d\.\d\d mm, ", str(why.value))
            assert at_mm[2] >= ORIGIN_MM[2] + 3.0 - 0.01
        time.sleep(0.2)
        assert bench.board.at_mm() == at_mm
    assert not threads()
    assert open_run(tmp_path / "r").events()["kind"].iloc[-1] == "fault"
    if given.get("guard_n") or says == "the link is lost":
        with wall_bench(tmp_path) as bench:
            bench.run(bench.writer())
        run = open_run(tmp_path / "r")
        assert [*run.steps()["step_id"]] == [step.id for step in bench.steps]
        assert run.frames()["frame_id"].is_unique


@pytest.mark.parametrize("by_hand", [False, pytest.param(True, marks=slow)])
def test_guard_trip_in_homing_prevents_motion(tmp_path: Path, by_hand: bool) -> None:
    with wall_bench(tmp_path, camera=not by_hand) as bench:
        bench.board.grbl.settings[25] = 60.0  # a slow search

        def push() -> None:
            bench.board.hears(b"$H")
            time.sleep(0.2)
            bench.server.faults.saturated = True

        pushing = threading.Thread(target=push)
        pushing.start()
        with pytest.raises(SensorError, match="saturated"):
            bench.home() if by_hand else bench.run(bench.writer())
        pushing.join()
        bench.board.hears(b"\x18")
        at_mm = bench.board.at_mm()
        time.sleep(0.2)
        assert bench.board.at_mm() == at_mm
        assert bench.board.state() == "Alarm"
    assert not threads()


def test_unloaded_tip_homes_then_sensor_pauses(tmp_path: Path) -> None:
    with wall_bench(tmp_path, camera=False) as bench:
        assert "operator stated" in bench.home()
        assert bench.devices.stage.homed
        force = bench.devices.force
        assert force is not None
        force.start()  # left stopped, and ready for whoever feels next
        assert len(force.read().t_ns)
    assert not threads()


def test_failing_thread_stops_stage_at_once() -> None:
    stopped: list[str] = []
    stage = SimpleNamespace(cancel=lambda: stopped.append("stop"))
    writer = SimpleNamespace()
    devices = Devices(WallClock(), stage, None, None, lambda name: None)  # type: ignore[arg-type]
    schedule = ThreadedSchedule(devices, writer, lambda step: None)  # type: ignore[arg-type]
    schedule.open()
    writer.failed(SensorError("no space"))
    assert stopped == ["stop"]
    with pytest.raises(SensorError, match="no space"):
        schedule.check()


@pytest.mark.slow
def test_streams_agree_by_their_times(tmp_path: Path) -> None:
    seen: list[RunProgress] = []
    with wall_bench(tmp_path) as bench:

        def look(live: RunProgress) -> None:
            if live.step.endswith("p1/d1.00/press") and not any(s.step == live.step for s in seen):
                (tmp_path / "skip").write_text("7")
            seen.append(live)

        taken = bench.run(bench.writer(), live=look)
    run = open_run(tmp_path / "r")
    frames, events = run.frames(), run.events()
    planned = sum(s.frames for s in bench.steps)
    missed = int(run.steps()["missed"].sum())
    assert taken == len(frames) == planned - missed
    assert taken > 0.7 * planned  # a busy machine misses some, and says so
    assert set(run.steps()["step_id"]) == {s.id for s in bench.steps}
    assert frames["seq"].is_monotonic_increasing
    assert frames["t_s"].is_monotonic_increasing
    assert (frames["late_s"] >= 0).all()
    # A busy machine may have more to tell, as of force records that came late.
    told = events[events["kind"].isin(["begun", "complete"])]
    presses = [(row.kind, row.press) for row in told.itertuples()]
    assert next(kind for kind, press in presses if press == "sphere-6/p2") == "begun"
    assert presses[-1] == ("complete", "sphere-6/p2")
    # Force and pose at the time of a frame are those of that time, not of when they were read.
    assert frames["force_skew_s"].quantile(0.9) < 2e-3
    off_n = frames["fx_n"] - sine_n(frames["t_s"].to_numpy())  # and what it was when it was tared
    off_n -= off_n.groupby(frames["press"]).transform("median")
    assert off_n.abs().quantile(0.9) < np.pi * 2e-3
    looks = run.pose()["t_s"].diff().dropna()
    assert looks.median() > 0.09
    assert seen[-1].frames_done == planned
    assert re.search(r"after  Fz [+-]0\.\d\d N  .*0 s left$", seen[-1].line())
    settled = frames[frames["settled"] & (frames["kind"] == "press")]
    assert settled["z_mm"].to_numpy() == pytest.approx(-1.0, abs=2e-3)
    assert settled["fz_n"].to_numpy() == pytest.approx(-N_PER_MM, abs=0.02)
    moving = frames[(frames["kind"] == "press") & ~frames["settled"]]
    for _, part in moving.groupby("press"):
        line = np.polyfit(part["t_s"], part["z_mm"], 1)
        assert line[0] * 60 == pytest.approx(-90.0, rel=0.05)
        wanted_s = (part["t_step_s"] - part["late_s"]).to_numpy()
        numbers = part["frame_id"].str.rpartition("#")[2].astype(int).to_numpy()
        assert wanted_s / numbers == pytest.approx(wanted_s[-1] / numbers[-1], rel=1e-3)
    assert frames["dropped"].sum() >= 7
    assert "7 lost by the camera" in set(events[events["kind"] == "frames dropped"]["text"])
