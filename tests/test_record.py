"""The run folder: whole files, a journal that another process can read, honest errors."""

from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np
import pytest

from deltact_fab import record
from deltact_fab.errors import InputError, RunFailed
from deltact_fab.protocols.plan import Step
from deltact_fab.record import RunWriter

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


def test_frames_come_back_as_they_went_in(tmp_path: Path) -> None:
    run = writer(tmp_path / "r")
    run.frame(STEP, 1, image(), 3.0, 0.5, (0.0, 0.0, -1.0), (0.1, 0.2, -3.0), (1.0, 2.0, 3.0))
    run.frame(STEP, 2, None, 4.0, 1.5, (0.0, 0.0, -1.0), None, None)
    run.step(STEP, 2.0, 2.5, 4.5)
    run.close({"frames": 2})
    opened = record.open(tmp_path / "r")
    frames = opened.frames()
    assert list(frames["frame_id"]) == [f"{STEP.id}#001", f"{STEP.id}#002"]
    assert frames.loc[0, "fz_n"] == -3.0
    assert np.isnan(frames.loc[1, "fz_n"])
    file = str(frames.loc[0, "file"])
    data = (tmp_path / "r" / file).read_bytes()
    assert hashlib.sha256(data).hexdigest() == frames.loc[0, "sha256"]
    assert np.array_equal(opened.image(file), image())
    assert list(opened.steps()["step_id"]) == [STEP.id]
    assert opened.dots_mm().tolist() == [[0.0, 1.0]]
    assert (tmp_path / "r" / "protocol.toml").read_bytes() == b"name = 't'\n"
    assert opened.summary() == {"frames": 2}


def test_every_frame_is_committed_before_the_next(tmp_path: Path) -> None:
    run = writer(tmp_path / "r")
    run.frame(STEP, 1, image(), 3.0, 0.5, (0.0, 0.0, -1.0), None, None)
    assert len(record.open(tmp_path / "r").frames()) == 1  # read while the writer is still open
    run.abandon()


def test_the_journal_is_durable(tmp_path: Path) -> None:
    run = writer(tmp_path / "r")
    assert run._db.execute("PRAGMA journal_mode").fetchone() == ("wal",)
    assert run._db.execute("PRAGMA synchronous").fetchone() == (2,)  # FULL
    run.abandon()


def test_a_frame_is_stored_once(tmp_path: Path) -> None:
    run = writer(tmp_path / "r")
    run.frame(STEP, 1, None, 3.0, 0.5, (0.0, 0.0, -1.0), None, None)
    with pytest.raises(RunFailed, match="UNIQUE"):
        run.frame(STEP, 1, None, 3.0, 0.5, (0.0, 0.0, -1.0), None, None)
    run.abandon()


def test_a_folder_that_is_there_is_never_written_into(tmp_path: Path) -> None:
    (tmp_path / "r").mkdir()
    with pytest.raises(InputError, match="already there"):
        writer(tmp_path / "r")
    assert list((tmp_path / "r").iterdir()) == []


def test_a_write_that_fails_leaves_nothing(tmp_path: Path) -> None:
    target = tmp_path / "folder-in-the-way"
    target.mkdir()
    with pytest.raises(RunFailed, match="folder-in-the-way"):
        record.write_whole(target, b"x")
    assert [p.name for p in tmp_path.iterdir()] == ["folder-in-the-way"]


def test_faults_of_a_folder_are_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="not a run folder"):
        record.open(tmp_path)
    run = writer(tmp_path / "r")
    run.frame(STEP, 1, image(), 3.0, 0.5, (0.0, 0.0, -1.0), None, None)
    run.abandon()
    opened = record.open(tmp_path / "r")
    file = tmp_path / "r" / str(opened.frames().loc[0, "file"])
    file.write_bytes(file.read_bytes()[:40])
    with pytest.raises(RunFailed, match="damaged: 40 bytes that differ"):
        opened.image(f"images/{file.name}")
    file.unlink()
    with pytest.raises(RunFailed, match="cannot be read"):
        opened.image(f"images/{file.name}")
    (tmp_path / "r" / "journal.sqlite").write_bytes(b"not a database" * 100)
    with pytest.raises(RunFailed, match="journal cannot be read"):
        opened.frames()
