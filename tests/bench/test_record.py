"""The run folder: whole files, a journal that another process can read, honest errors."""

from __future__ import annotations

import hashlib
import shutil
import sqlite3
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from deltact_fab.bench.protocols.plan import Step
from deltact_fab.bench.record.journal import open_journal
from deltact_fab.bench.record.run import open_run
from deltact_fab.bench.record.streams import Chunk
from deltact_fab.bench.record.writer import RunWriter
from deltact_fab.common.errors import InputError, RunFailed

STEP = Step("sphere-10/p1/d1.00/press", "sphere-10/p1", "sphere:10", "press", (0, 0, -1.0), 30.0, 2)
META = {
    "name": "t",
    "simulated": True,
    "seed": 4,
    "camera": {"mm_per_px": 0.0378, "width_px": 8, "height_px": 6, "eye_distance_mm": 12.85},
}
PATTERN = {"recipe": {}, "dots_mm": [[0.0, 1.0]], "dot_diameter_mm": 0.6}


def image(seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).integers(0, 256, (6, 8, 3), dtype=np.uint8)


def writer(folder: Path) -> RunWriter:
    return RunWriter.create(folder, META, b"name = 't'\n", PATTERN, [STEP])


def force(t_s: np.ndarray, seed: int = 0) -> Chunk:
    """A press that began at 0.5 s of the rig's clock: fz falls by 2 N a second, fx is noise."""
    noise = np.random.default_rng(seed).integers(-(2**31), 2**31, (5, len(t_s)), dtype=np.int32)
    names = ("fx_n", "fy_n", "tx_nmm", "ty_nmm", "tz_nmm")
    columns: dict[str, np.ndarray] = {"t_ns": np.rint(t_s * 1e9).astype(np.int64)}
    columns |= dict(zip(names, noise, strict=True))
    columns |= {"fz_n": np.rint(-2e6 * t_s).astype(np.int32), "saturated": t_s > 3.0}
    return Chunk("force", 0.5, columns, {"fx_n": 1e6, "fz_n": 1e6, "tz_nmm": 1e5})


def pose(t_s: list[float], z_mm: list[float]) -> Chunk:
    z = np.array(z_mm)
    t_ns = np.rint(np.array(t_s) * 1e9).astype(np.int64)
    return Chunk("pose", 0.5, {"t_ns": t_ns, "x_mm": 0 * z + 1 / 3, "y_mm": 0 * z, "z_mm": z})


def test_frames_round_trip(tmp_path: Path) -> None:
    run = writer(tmp_path / "r")
    run.frame(STEP, 1, image(), 3.0, 0.5, 2.5)
    run.frame(STEP, 2, None, 4.0, 1.5, 3.5)
    run.step(STEP, 2.0, 2.5, 4.5)
    run.close({"frames": 2})
    opened = open_run(tmp_path / "r")
    frames = opened.frames()
    assert list(frames["frame_id"]) == [f"{STEP.id}#001", f"{STEP.id}#002"]
    file = str(frames.loc[0, "file"])
    data = (tmp_path / "r" / file).read_bytes()
    assert hashlib.sha256(data).hexdigest() == frames.loc[0, "sha256"]
    assert np.array_equal(opened.image(file), image())
    assert list(opened.steps()["step_id"]) == [STEP.id]
    assert opened.dots_mm().tolist() == [[0.0, 1.0]]
    assert (tmp_path / "r" / "protocol.toml").read_bytes() == b"name = 't'\n"
    assert opened.summary() == {"frames": 2}


def test_streams_round_trip_bit_for_bit(tmp_path: Path) -> None:
    run = writer(tmp_path / "r")
    first = force(np.arange(4000) / 997.0)
    run.step(STEP, 2.0, 2.5, 4.5, [first, pose([0.0, 0.1], [0.123, -1e-3])])
    run.close({})
    opened = open_run(tmp_path / "r")
    found = opened.force()
    t_s = np.arange(4000) / 997.0
    assert list(found) == [
        "press", "step_id", "t_s", "t_press_s",
        "fx_n", "fy_n", "fz_n", "tx_nmm", "ty_nmm", "tz_nmm", "saturated",
    ]  # fmt: skip
    assert found["t_press_s"].to_numpy() == pytest.approx(t_s, abs=5e-10)
    assert (found["t_s"] - found["t_press_s"]).to_numpy() == pytest.approx(0.5)
    for name, per_unit in (("fx_n", 1e6), ("fy_n", 1.0), ("fz_n", 1e6), ("tz_nmm", 1e5)):
        assert (found[name] == first.columns[name] / per_unit).all()
    assert found["saturated"].tolist() == (t_s > 3.0).tolist()
    assert opened.pose()[["x_mm", "z_mm"]].to_numpy().tolist() == [[1 / 3, 0.123], [1 / 3, -1e-3]]
    assert len(opened.force(STEP.press)) == 4000
    assert len(opened.force("another")) == 0


def test_frames_have_interpolated_force_and_pose(tmp_path: Path) -> None:
    run = writer(tmp_path / "r")
    run.frame(STEP, 1, None, 1.5, 0.5, 1.0)
    run.frame(STEP, 2, None, 2.25, 1.25, 1.75)
    run.flush()
    unread = open_run(tmp_path / "r").frames()
    assert unread[["fz_n", "z_mm", "force_skew_s", "pose_skew_s"]].isna().all(axis=None)
    samples = force(np.array([0.9, 1.004, 1.1, 1.7]))
    run.step(STEP, 2.0, 1.0, 3.0, [samples, pose([1.0, 1.5, 2.0], [-1.0, -1.2, -1.6])])
    run.abandon()
    frames = open_run(tmp_path / "r").frames()
    assert frames["fz_n"].tolist() == pytest.approx([-2.0, -3.4])  # the last one has the nearest
    assert frames["force_skew_s"].tolist() == pytest.approx([0.004, 0.05])
    assert frames["z_mm"].tolist() == pytest.approx([-1.0, -1.4])
    assert frames["pose_skew_s"].tolist() == pytest.approx([0.0, 0.25])
    assert list(frames)[9:21] == [
        "t_s", "t_step_s", "x_mm", "y_mm", "z_mm",
        "fx_n", "fy_n", "fz_n", "tx_nmm", "ty_nmm", "tz_nmm", "wall_s",
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("t_press_s", "force_skew_s", "pose_skew_s"),
    [(0.8, 0.1, 0.2), (1.01, 0.006, 0.01), (1.09, 0.01, 0.09), (2.2, 0.5, 0.2)],
)
def test_skew_is_time_to_nearest_sample(
    tmp_path: Path, t_press_s: float, force_skew_s: float, pose_skew_s: float
) -> None:
    run = writer(tmp_path / "r")
    run.frame(STEP, 1, None, t_press_s + 0.5, 0.0, t_press_s)
    samples = force(np.array([0.9, 1.004, 1.1, 1.7]))
    run.step(STEP, 2.0, 1.0, 3.0, [samples, pose([1.0, 1.5, 2.0], [-1.0, -1.2, -1.6])])
    run.abandon()
    (row,) = open_run(tmp_path / "r").frames().to_dict("records")
    assert row["force_skew_s"] == pytest.approx(force_skew_s)
    assert row["pose_skew_s"] == pytest.approx(pose_skew_s)


def test_damaged_chunk_names_its_step(tmp_path: Path) -> None:
    run = writer(tmp_path / "r")
    run.step(STEP, 2.0, 1.0, 3.0, [force(np.arange(100) / 1000)])
    run.close({})
    with sqlite3.connect(tmp_path / "r" / "journal.sqlite") as db:
        (data,) = db.execute("SELECT data FROM samples").fetchone()
        spoilt = bytes([*data[:-30], data[-30] ^ 1, *data[-29:]])
        db.execute("UPDATE samples SET data = ?", (spoilt,))
    db.close()
    with pytest.raises(RunFailed, match=f"force of {STEP.id}: damaged"):
        open_run(tmp_path / "r").force()


def test_events_tell_the_history(tmp_path: Path) -> None:
    run = writer(tmp_path / "r")
    run.event("homed", "positions are known", 2.5)
    run.event("gap", "3 force samples missing", 4.5, STEP)
    run.abandon()
    events = open_run(tmp_path / "r").events()
    assert events["kind"].tolist() == ["session", "homed", "gap"]
    assert events["t_s"].tolist()[1:] == [2.5, 4.5]
    assert events["step_id"].tolist()[2] == STEP.id
    assert (events["wall_s"].diff().dropna() >= 0).all()


def test_what_was_flushed_is_committed(tmp_path: Path) -> None:
    run = writer(tmp_path / "r")
    run.frame(STEP, 1, image(), 3.0, 0.5, 2.5)
    run.flush()
    assert len(open_run(tmp_path / "r").frames()) == 1  # read while the writer is still open
    run.abandon()


def test_the_journal_is_durable(tmp_path: Path) -> None:
    run = writer(tmp_path / "r")
    assert run._db.execute("PRAGMA journal_mode").fetchone() == ("wal",)
    assert run._db.execute("PRAGMA synchronous").fetchone() == (2,)  # FULL
    run.abandon()


def test_a_frame_is_stored_once(tmp_path: Path) -> None:
    run = writer(tmp_path / "r")
    run.frame(STEP, 1, None, 3.0, 0.5, 2.5)
    run.frame(STEP, 1, None, 3.0, 0.5, 2.5)
    with pytest.raises(RunFailed, match="UNIQUE"):
        run.flush()
    run.abandon()


def test_existing_folder_is_never_overwritten(tmp_path: Path) -> None:
    (tmp_path / "r").mkdir()
    with pytest.raises(InputError, match="already exists"):
        writer(tmp_path / "r")
    assert list((tmp_path / "r").iterdir()) == []


def test_faults_of_a_folder_are_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="not a run folder"):
        open_run(tmp_path)
    run = writer(tmp_path / "r")
    run.frame(STEP, 1, image(), 3.0, 0.5, 2.5)
    run.abandon()
    opened = open_run(tmp_path / "r")
    file = tmp_path / "r" / str(opened.frames().loc[0, "file"])
    file.write_bytes(file.read_bytes()[:40])
    with pytest.raises(RunFailed, match="damaged: its 40 bytes do not match"):
        opened.image(f"images/{file.name}")
    file.unlink()
    with pytest.raises(RunFailed, match="cannot be read"):
        opened.image(f"images/{file.name}")
    (tmp_path / "r" / "journal.sqlite").write_bytes(b"not a database" * 100)
    with pytest.raises(RunFailed, match="journal cannot be read"):
        opened.frames()


def test_log_that_vanishes_stops_no_reader(mini_run: Path, tmp_path: Path) -> None:
    """A reader that closes removes the logs between their listing and a look at their size."""
    run = shutil.copytree(mini_run, tmp_path / "run")
    (run / "journal.sqlite-gone").symlink_to(tmp_path / "nowhere")
    with closing(open_journal(run, "ro")) as db:
        assert db.execute("SELECT count(*) FROM steps").fetchone()[0] > 0
