"""A run on the wall clock: a real terminal, a real UDP box, a camera that is a real process."""

from __future__ import annotations

import os
import re
from pathlib import Path

import numpy as np
import pytest
from wall_bench import N_PER_MM, sine_n, wall_bench

from deltact_fab import record
from deltact_fab.rig.run.live import Live

pytestmark = pytest.mark.skipif(not hasattr(os, "openpty"), reason="needs pseudo terminals")


@pytest.mark.slow
def test_streams_of_a_run_belong_together_by_their_times(tmp_path: Path) -> None:
    seen: list[Live] = []
    with wall_bench(tmp_path) as bench:

        def look(live: Live) -> None:
            if live.step.endswith("p1/d1.00/press") and not any(s.step == live.step for s in seen):
                (tmp_path / "skip").write_text("7")
            seen.append(live)

        taken = bench.run(bench.writer(), live=look)
    run = record.open(tmp_path / "r")
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
    assert seen[-1].done == planned
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
