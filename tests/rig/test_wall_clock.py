"""A run on the wall clock: a real terminal, a real UDP box, a camera that is a real process."""

from __future__ import annotations

import os
import re
import threading
import time
from pathlib import Path

import numpy as np
import pytest
from wall_bench import N_PER_MM, ORIGIN_MM, sine_n, wall_bench

from deltact_fab import record
from deltact_fab.errors import RunFailed, SensorError, StageError
from deltact_fab.rig.run.live import Live

pytestmark = pytest.mark.skipif(not hasattr(os, "openpty"), reason="needs pseudo terminals")


def threads() -> set[str]:
    return {t.name for t in threading.enumerate()} & {"camera", "force sensor", "journal"}


@pytest.mark.slow
def test_streams_of_a_run_belong_together_by_their_times(tmp_path: Path) -> None:
    seen: list[Live] = []
    with wall_bench(tmp_path) as bench:
        writer = bench.writer()
        taken = bench.run(writer, live=seen.append)
    assert not threads()
    run = record.open(tmp_path / "r")
    frames, events = run.frames(), run.events()
    planned = sum(s.frames for s in bench.steps)
    missed = int(run.steps()["missed"].sum())
    assert taken == len(frames) == planned - missed
    assert taken > 0.9 * planned
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
    assert seen[-1].done == planned
    assert re.search(r"after  Fz [+-]0\.\d\d N  .*0 s left$", seen[-1].line())
    settled = frames[frames["settled"] & (frames["kind"] == "press")]
    assert settled["z_mm"].to_numpy() == pytest.approx(-1.0, abs=2e-3)
    assert settled["fz_n"].to_numpy() == pytest.approx(-N_PER_MM, abs=0.02)
    moving = frames[(frames["kind"] == "press") & ~frames["settled"]]
    for _, part in moving.groupby("press"):
        line = np.polyfit(part["t_s"], part["z_mm"], 1)
        assert line[0] * 60 == pytest.approx(-90.0, rel=0.05)


@pytest.mark.slow
def test_a_guard_that_trips_stops_lifts_and_says_why(tmp_path: Path) -> None:
    with wall_bench(tmp_path, guard_n=1.5) as bench:
        with pytest.raises(SensorError, match=r"/press: Fz = .*the guard's 1.5 N \(the tip was"):
            bench.run(bench.writer())
        assert bench.board.at_mm()[2] == pytest.approx(ORIGIN_MM[2] + 3.0, abs=0.01)
    assert not threads()
    events = record.open(tmp_path / "r").events()
    assert events["kind"].iloc[-1] == "fault"
    with wall_bench(tmp_path) as bench:
        bench.run(bench.writer())
    run = record.open(tmp_path / "r")
    assert set(run.steps()["step_id"]) == {s.id for s in bench.steps}
    assert run.frames()["frame_id"].is_unique


@pytest.mark.parametrize("what", ["silent", pytest.param("error", marks=pytest.mark.slow)])
def test_a_force_sensor_that_is_lost_stops_the_run(tmp_path: Path, what: str) -> None:
    with wall_bench(tmp_path) as bench:

        def fail(live: Live) -> None:
            if live.step.endswith("p1/d1.00/press"):
                setattr(bench.server.faults, what, True)

        with pytest.raises(SensorError, match=r"/press: .*force sensor: .*\(the tip was lifted\)"):
            bench.run(bench.writer(), live=fail)
        assert bench.board.at_mm()[2] == pytest.approx(ORIGIN_MM[2] + 3.0, abs=0.01)
    assert not threads()


@pytest.mark.slow
def test_a_guard_that_looks_at_old_samples_stops_the_run(tmp_path: Path) -> None:
    with wall_bench(tmp_path, behind_s=0.5) as bench:

        def lag(live: Live) -> None:
            if live.step.endswith("p1/d1.00/press"):
                bench.server.faults.late_s = 0.8

        with pytest.raises(SensorError, match=r"/press: .*ms behind its stream; .*was lifted\)"):
            bench.run(bench.writer(), live=lag)
        assert bench.board.at_mm()[2] == pytest.approx(ORIGIN_MM[2] + 3.0, abs=0.01)
    assert not threads()
    told = record.open(tmp_path / "r").events()
    assert "behind" in set(told["kind"])


@pytest.mark.slow
def test_a_camera_that_stalls_stops_the_run(tmp_path: Path) -> None:
    with wall_bench(tmp_path) as bench:

        def stall(live: Live) -> None:
            if live.step.endswith("p1/d1.00/press"):
                (tmp_path / "stall").touch()

        bench.devices.camera.timeout_s = 0.5  # type: ignore[union-attr]
        with pytest.raises(SensorError, match=r"/press: camera .*stalled.*\(the tip was lifted\)"):
            bench.run(bench.writer(), live=stall)
    assert not threads()


def test_a_guard_that_trips_while_homing_moves_nothing_any_more(tmp_path: Path) -> None:
    with wall_bench(tmp_path) as bench:
        bench.board.grbl.settings[25] = 60.0  # a slow search

        def push() -> None:
            bench.board.hears(b"$H")
            time.sleep(0.3)
            bench.server.faults.saturated = True

        pushing = threading.Thread(target=push)
        pushing.start()
        with pytest.raises(SensorError, match="saturated"):
            bench.run(bench.writer())
        pushing.join()
        bench.board.hears(b"\x18")
        at_mm = bench.board.at_mm()
        time.sleep(0.3)
        assert bench.board.at_mm() == at_mm
        assert bench.board.state() == "Alarm"
    assert not threads()


@pytest.mark.slow
def test_a_disk_that_refuses_in_an_encoder_s_thread_stops_the_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with wall_bench(tmp_path) as bench:
        writer = bench.writer()
        real = os.fsync

        def full(handle: int) -> None:
            if os.readlink(f"/proc/self/fd/{handle}").endswith(f"press_005.png.{os.getpid()}.part"):
                raise OSError(28, "No space left on device")
            real(handle)

        monkeypatch.setattr(os, "fsync", full)
        with pytest.raises(RunFailed, match=r"_press_005.png: cannot be written: No space left"):
            bench.run(writer)
        assert bench.board.at_mm()[2] == pytest.approx(ORIGIN_MM[2] + 3.0, abs=0.01)
    frames = record.open(tmp_path / "r").frames()
    assert "sphere-6/p1/d1.00/press#004" in set(frames["frame_id"])
    assert not threads()


@pytest.mark.slow
def test_an_alarm_leaves_the_tip_where_it_is(tmp_path: Path) -> None:
    with wall_bench(tmp_path) as bench:

        def reboot(live: Live) -> None:
            if live.step.endswith("p1/d1.00/press"):
                with bench.board.terminal.lock:
                    bench.board.grbl.fault("reboot")

        with pytest.raises(StageError):
            bench.run(bench.writer(), live=reboot)
        jogs = sum(b"$J=" in data for _, data in bench.board.heard)
        time.sleep(0.3)
        assert sum(b"$J=" in data for _, data in bench.board.heard) == jogs
    assert not threads()


@pytest.mark.slow
def test_frames_that_the_camera_loses_are_counted(tmp_path: Path) -> None:
    with wall_bench(tmp_path) as bench:

        def skip(live: Live) -> None:
            if live.step.endswith("p1/d1.00/press") and not seen:
                seen.append(live)
                (tmp_path / "skip").write_text("7")

        seen: list[Live] = []
        bench.run(bench.writer(), live=skip)
    run = record.open(tmp_path / "r")
    assert run.frames()["dropped"].sum() >= 7
    told = run.events()
    assert "7 lost by the camera" in set(told[told["kind"] == "frames dropped"]["text"])
