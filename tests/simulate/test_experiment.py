"""A whole run on the virtual rig: repeatable, labelled, stopped safely, leaving out what it can."""

from __future__ import annotations

import hashlib
import sqlite3
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from deltact_fab.bench.protocols import plan
from deltact_fab.bench.record.journal import WALL_COLUMNS
from deltact_fab.bench.record.run import open_run
from deltact_fab.common.errors import InputError, RunFailed
from deltact_fab.simulate.experiment.request import RunRequest
from deltact_fab.simulate.experiment.session import run_experiment


def test_planned_frames_exist_with_their_hashes(mini: tuple[Path, Path], mini_run: Path) -> None:
    protocol, _ = plan.load_protocol(str(mini[0]))
    steps = plan.expand_protocol(protocol)
    run = open_run(mini_run)
    frames = run.frames()
    wanted = [f"{s.id}#{k:03d}" for s in steps for k in range(1, s.frames + 1)]
    assert list(frames["frame_id"]) == wanted
    assert list(run.steps()["step_id"]) == [s.id for s in steps]
    for row in frames.itertuples():
        data = (mini_run / str(row.file)).read_bytes()
        assert hashlib.sha256(data).hexdigest() == row.sha256


def test_stage_follows_the_plan(mini: tuple[Path, Path], mini_run: Path) -> None:
    protocol, _ = plan.load_protocol(str(mini[0]))
    targets = {s.id: s.target_mm for s in plan.expand_protocol(protocol)}
    last = open_run(mini_run).frames().groupby("step_id").tail(1)
    for row in last.itertuples():
        assert (row.x_mm, row.y_mm, row.z_mm) == pytest.approx(targets[str(row.step_id)], abs=2e-3)


def test_force_and_pose_have_own_rates(mini_run: Path) -> None:
    run = open_run(mini_run)
    frames, steps = run.frames(), run.steps().set_index("step_id")
    assert frames["pose_skew_s"].max() < 2e-4  # a byte on the wire
    assert frames["force_skew_s"].max() <= 1.1e-3
    for press, part in run.force().groupby("press"):
        felt_s = part["t_press_s"].diff().dropna()
        gaps = felt_s[felt_s > 1.5e-3]
        assert felt_s[felt_s < 1.5e-3].to_numpy() == pytest.approx(1e-3, abs=2e-9)
        assert len(gaps) == 1  # the way out of the gel
        legs = part.groupby("step_id").size()
        assert f"{press}/retract" not in legs
        seconds = steps.loc[legs.index, "t_end_s"] - steps.loc[legs.index, "t_start_s"]
        whole = legs.index[~legs.index.str.endswith("/rest")]
        assert (legs[whole] / seconds[whole]).to_numpy() == pytest.approx(1000.0, rel=0.06)
    pose = run.pose("sphere-10/p1")
    assert pose["t_press_s"].diff().dropna().min() >= 0.0999
    down = pose[pose["step_id"].str.endswith("/d1.00/press")]
    assert len(down) > 20  # 1.5 mm at 0.5 mm/s
    assert (down["z_mm"].diff().dropna() <= 0).all()


def test_force_between_frames_matches_the_gel(mini_run: Path) -> None:
    run = open_run(mini_run)
    force = run.force("sphere-10/p1")
    press = force[force["step_id"].str.endswith("/d1.00/press")]
    pose = run.pose("sphere-10/p1")
    depth_mm = -np.interp(press["t_press_s"], pose["t_press_s"], pose["z_mm"])
    fz_n = press["fz_n"].rolling(51, center=True).mean().to_numpy()
    assert (
        np.abs(fz_n[(depth_mm < -0.05) & (fz_n == fz_n)]).max() < 0.05
    )  # in the air, but for the tare
    deep = np.flatnonzero((depth_mm > 0.2) & (fz_n == fz_n))
    assert (np.diff(fz_n[deep[::100]]) < 0).all()
    assert fz_n[deep[-1]] == pytest.approx(press["fz_n"].iloc[-100:].mean(), abs=0.01)


def test_signs_of_press_and_shear(mini_run: Path) -> None:
    run = open_run(mini_run)
    frames = run.frames().set_index("frame_id")
    pressed = frames[frames["step_id"] == "sphere-10/p1/d1.00/press"].iloc[-1]
    sheared = frames[frames["step_id"] == "sphere-10/p1/d1.00/shear-x+"].iloc[-1]
    assert pressed["fz_n"] < -1.0
    assert sheared["fx_n"] > 0.3
    truth = run.truth()
    assert truth is not None
    flow = truth.flow_px(str(sheared.name))
    at = run.camera.rest_px(np.array([0.5 + 0.7, -0.5])).astype(int)  # under the moving tip
    assert flow[at[1], at[0], 0] > 5


@pytest.mark.slow
def test_runs_differ_in_wall_time_only(
    mini: tuple[Path, Path], mini_run: Path, tmp_path: Path
) -> None:
    run_experiment(RunRequest(str(mini[0]), str(mini[1]), tmp_path / "again", seed=3))
    for table in ("frames", "samples", "events", "steps"):
        rows = []
        for folder in (mini_run, tmp_path / "again"):
            with closing(sqlite3.connect(folder / "journal.sqlite")) as db, db:
                names = [c[1] for c in db.execute(f"PRAGMA table_info({table})")]
                keep = ",".join(n for n in names if n not in WALL_COLUMNS)
                rows.append(db.execute(f"SELECT {keep} FROM {table} ORDER BY seq").fetchall())
        assert rows[0] == rows[1]  # the images' hashes are among the columns
        assert rows[0]


def test_interrupt_lifts_tip_and_keeps_frames(mini: tuple[Path, Path], tmp_path: Path) -> None:
    def press_ctrl_c(done: int, total: int, what: str) -> None:
        if what.endswith("shear-x+"):
            raise KeyboardInterrupt

    with pytest.raises(RunFailed, match=r"shear-x\+; the tip was (lifted|raised) by"):
        run_experiment(
            RunRequest(str(mini[0]), str(mini[1]), tmp_path / "r", progress=press_ctrl_c)
        )
    frames = open_run(tmp_path / "r").frames()
    assert list(frames["kind"])[-1] == "shear"
    assert open_run(tmp_path / "r").summary() == {}


@pytest.mark.slow
def test_overload_stops_and_lifts(mini: tuple[Path, Path], tmp_path: Path) -> None:
    weak = tmp_path / "weak.toml"
    weak.write_text(mini[1].read_text().replace("[25.0, 25.0, 35.0]", "[25.0, 25.0, 0.5]"))
    with pytest.raises(RunFailed, match=r"saturated .*the tip was (lifted|raised) by"):
        run_experiment(RunRequest(str(mini[0]), str(weak), tmp_path / "r"))
    run = open_run(tmp_path / "r")
    # Between two frames, and what was felt until then is kept.
    assert run.frames()["frame_id"].tolist()[1:] == ["sphere-10/p1/d1.00/press#001"]  # of two
    force = run.force()
    assert force["saturated"].sum() >= 1
    felt_s = force["t_press_s"].iloc[-1] - force["t_press_s"][force["saturated"]].iloc[0]
    assert felt_s < 0.12
    assert force["fz_n"].min() == pytest.approx(-0.5, abs=0.05)
    last = run.events().iloc[-1]
    assert (last.kind, last.step_id) == ("fault", "sphere-10/p1/d1.00/press")
    assert "saturated" in last.text
    assert "lifted" in last.text


@pytest.mark.slow
def test_run_in_air_reports_no_contact(mini: tuple[Path, Path], tmp_path: Path) -> None:
    def press_ctrl_c(done: int, total: int, what: str) -> None:
        if done > 3:
            raise KeyboardInterrupt

    protocol = tmp_path / "force.toml"
    protocol.write_text(mini[0].read_text().replace('"image", "dots", ', ""))
    out, words = tmp_path / "r", (str(protocol), str(mini[1]))
    with pytest.raises(RunFailed):
        run_experiment(RunRequest(*words, out, seed=3, progress=press_ctrl_c, air=True))
    with pytest.raises(InputError, match="air: true in the folder, false now"):
        run_experiment(RunRequest(*words, out, seed=3), resume=True)
    summary = run_experiment(RunRequest(*words, out, seed=3, air=True), resume=True)
    run = open_run(out)
    declared = plan.load_protocol(str(protocol))[0]
    steps = plan.expand_protocol(declared, air=True)
    assert [s.id for s in steps] == [s.id for s in plan.expand_protocol(declared)]
    assert min(s.target_mm[2] for s in steps) == declared.motion.clearance_mm
    frames = run.frames()
    assert len(frames) == sum(s.frames for s in steps)
    assert frames["z_mm"].min() >= declared.motion.clearance_mm - 2e-3
    assert frames[["fx_n", "fy_n", "fz_n"]].abs().to_numpy().max() < 0.1  # noise alone
    assert summary["air"] is run.meta["air"] is True
    assert summary["notes"][0].startswith("air run: ")
    assert not any("WARNING" in note or "solved" in note.split(";")[0] for note in summary["notes"])


def test_without_channels_only_poses_are_recorded(mini: tuple[Path, Path], tmp_path: Path) -> None:
    text = mini[0].read_text().replace('["image", "dots", "force", "shear"]', "[]")
    bare = tmp_path / "bare.toml"
    bare.write_text(text.replace('[shear]\namplitude_mm = 1.5\naxes = ["x"]\n', ""))
    summary = run_experiment(RunRequest(str(bare), str(mini[1]), tmp_path / "r"))
    assert any(line.startswith("gel: ") for line in summary["left_out"])
    assert not any("solved" in note for note in summary["notes"])
    frames = open_run(tmp_path / "r").frames()
    assert len(frames) == summary["frames"] > 0
    assert frames[["file", "fz_n"]].isna().all(axis=None)
    assert frames["z_mm"].min() == pytest.approx(-1.0, abs=2e-3)


def test_unmeshable_press_is_refused_beforehand(mini: tuple[Path, Path], tmp_path: Path) -> None:
    bad = tmp_path / "bad.toml"
    text = mini[0].read_text() + '[specimen]\ngel_model = "hyperelastic"\n'
    bad.write_text(text.replace("sphere:10", "sphere:0.5"))
    row = next(r for r in RunRequest(str(bad), str(mini[1])).checks() if r.name == "simulated gel")
    assert row.failed
    assert "sphere-0p5/p1" in row.remedy
    assert "not resolved by cells" in row.remedy
    with pytest.raises(InputError, match="not resolved by cells"):
        run_experiment(RunRequest(str(bad), str(mini[1]), tmp_path / "r"))
    assert not (tmp_path / "r").exists()
