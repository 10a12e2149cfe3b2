"""A run that is filmed on the way and settles at each stop: what settled means in its record."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from deltact_fab.bench.protocols import plan
from deltact_fab.bench.protocols.limits import MAX_BETWEEN_FRAMES_MM
from deltact_fab.bench.record.check import check_run
from deltact_fab.bench.record.journal import CLOCK_COLUMNS
from deltact_fab.bench.record.run import open_run
from deltact_fab.common.errors import RunFailed
from deltact_fab.simulate.experiment.request import RunRequest
from deltact_fab.simulate.experiment.session import run_experiment
from deltact_fab.simulate.virtual.clock import VirtualClock

pytestmark = pytest.mark.slow
SETTLE_S = 0.4
PROTOCOL = """
name = "settles"
indenters = ["sphere:8"]
positions_mm = [[-1.0, 0.5]]
depths_mm = [0.3, 0.6]
channels = ["image", "force", "shear"]
[shear]
amplitude_of_depth = 0.4
grid = true
first = "outward"
[capture]
rate_hz = 5.0
settle_s = 0.4
[specimen]
design = "{design}"
"""
DESIGN = "[optics]\nimage_width_px = 160\nimage_height_px = 120\n"


@pytest.fixture(scope="module")
def files(mini: tuple[Path, Path], tmp_path_factory: pytest.TempPathFactory) -> tuple[str, str]:
    folder = tmp_path_factory.mktemp("settles")
    (folder / "design.toml").write_text(DESIGN)
    (folder / "p.toml").write_text(PROTOCOL.format(design=folder / "design.toml"))
    return str(folder / "p.toml"), str(mini[1])


@pytest.fixture(scope="module")
def folder(files: tuple[str, str], tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("settled") / "run"
    run_experiment(RunRequest(*files, out, seed=3))
    return out


def test_settled_frame_ends_each_stop(files: tuple[str, str], folder: Path) -> None:
    steps = plan.expand_protocol(plan.load_protocol(files[0])[0])
    frames = open_run(folder).frames()
    assert frames["settled"].dtype == bool
    settled = frames[frames["settled"]]
    wanted = {s.id: s for s in steps if s.settled}
    assert settled["step_id"].tolist() == list(wanted)
    assert len(wanted) == 1 + 2 * 9
    for row in settled.itertuples():
        step = wanted[str(row.step_id)]
        assert row.k == step.frames
        assert (row.x_mm, row.y_mm, row.z_mm) == pytest.approx(step.target_mm, abs=2e-3)


def test_tip_rests_for_the_settling_time(folder: Path) -> None:
    run = open_run(folder)
    frames, pose = run.frames(), run.pose()
    t_s, at = pose["t_press_s"].to_numpy(), pose[["x_mm", "y_mm", "z_mm"]].to_numpy()
    for row in frames[frames["settled"]].itertuples():
        if row.kind != "travel":  # before the frame at rest no stream has begun
            held = at[(t_s > row.t_press_s - SETTLE_S) & (t_s <= row.t_press_s)]
            assert len(held) >= 3
            assert np.ptp(held, axis=0).max() == 0.0
    moving = frames[~frames["settled"] & (frames["kind"] != "travel")]
    assert len(moving) > 20


def test_tip_moves_little_between_frames(folder: Path) -> None:
    frames = open_run(folder).frames()
    tips = frames.loc[frames["z_mm"] < 0, ["x_mm", "y_mm", "z_mm"]].to_numpy()
    ways_mm = np.linalg.norm(np.diff(tips, axis=0), axis=1)
    assert 0.02 < ways_mm.max() < MAX_BETWEEN_FRAMES_MM


def test_interrupted_settling_is_repeated_on_resume(
    files: tuple[str, str], folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    frames = open_run(folder).frames()
    stop = frames[frames["settled"]].iloc[12]
    sleep_s = VirtualClock.sleep_s

    def press_ctrl_c(clock: VirtualClock, seconds: float) -> None:
        sleep_s(clock, seconds)
        if clock.now_s() > stop.t_s - SETTLE_S / 2:
            monkeypatch.undo()
            raise KeyboardInterrupt

    monkeypatch.setattr(VirtualClock, "sleep_s", press_ctrl_c)
    with pytest.raises(RunFailed, match=r"by the operator .* the tip was (lifted|raised) by"):
        run_experiment(RunRequest(*files, tmp_path / "r", seed=3))
    run = open_run(tmp_path / "r")
    assert run.events().iloc[-1]["step_id"] == stop.step_id
    assert stop.frame_id not in run.frames()["frame_id"].tolist()
    # It ends as the undisturbed run.
    run_experiment(RunRequest(*files, tmp_path / "r", seed=3), resume=True)
    wanted, found = (
        open_run(p).frames().drop(columns=list(CLOCK_COLUMNS), errors="ignore")
        for p in (folder, tmp_path / "r")
    )
    assert found.equals(wanted)


def test_hold_and_retract_are_recorded(files: tuple[str, str], tmp_path: Path) -> None:
    text = Path(files[0]).read_text()
    head, _, tail = text.partition("[shear]")
    filmed = "[capture]\nsettle_s = 0.2\nhold = {s = 3.0, rate_hz = 1.0}\n"
    asked = head.replace("[0.3, 0.6]", "[0.6]") + filmed + "retract = {rate_hz = 4.0}\n"
    (tmp_path / "p.toml").write_text(asked + tail[tail.index("[specimen]") :])
    request = RunRequest(str(tmp_path / "p.toml"), files[1], tmp_path / "r", seed=3)
    run_experiment(request)
    run = open_run(tmp_path / "r")
    frames, truth = run.frames(), run.truth()
    assert truth is not None
    assert check_run(tmp_path / "r").intact
    assert not frames["late"].any()
    hold, out = (frames[frames["kind"] == kind] for kind in ("hold", "retract"))
    assert np.diff(hold["t_press_s"])[:-1] == pytest.approx(1.0, abs=0.01)
    assert hold["z_mm"].to_numpy() == pytest.approx(-0.6, abs=2e-3)
    assert len(out) == round(1.1 / 0.5 * 4.0)
    assert out["z_mm"].is_monotonic_increasing
    assert out["z_mm"].iloc[-1] == pytest.approx(0.5, abs=2e-3)
    force_n = -out["fz_n"].to_numpy()
    assert (np.diff(force_n[out["z_mm"] < 0]) < 0).all()
    assert np.abs(force_n[out["z_mm"] > 0]).max() < 0.1
    sunk_mm = [np.abs(truth.displacement_mm(i)[..., 2]).max() for i in out["frame_id"]]
    depths_mm = np.maximum(-out["z_mm"], 0.0)
    assert sunk_mm == pytest.approx(list(depths_mm), abs=0.03)
