"""Writing off the caller's thread: room, order, what a failure leaves, JPEG XL."""

from __future__ import annotations

import threading
import time
from pathlib import Path

import numpy as np
import pytest

from deltact_fab.bench.protocols.plan import Step
from deltact_fab.bench.record import journal
from deltact_fab.bench.record.images import decode
from deltact_fab.bench.record.run import open_run
from deltact_fab.bench.record.writer import RunWriter
from deltact_fab.common.errors import RunFailed

STEP = Step("a/p1/d1.00/press", "a/p1", "sphere:10", "press", (0, 0, -1.0), 30.0, 40)
PATTERN = {"recipe": {}, "dots_mm": [], "dot_diameter_mm": 0.0}


def image(seed: int) -> np.ndarray:
    return np.random.default_rng(seed).integers(0, 256, (6, 8, 3), dtype=np.uint8)


def writer(folder: Path, suffix: str = "png") -> RunWriter:
    meta = {"simulated": False, "camera": None, "rig": {"camera": {"format": suffix}}}
    return RunWriter.create(folder, meta, b"", PATTERN, [STEP])


def put(run: RunWriter, k: int, wait: bool = True) -> str | None:
    return run.frame(STEP, k, image(k), k, k, k, wait=wait)


@pytest.fixture
def held(monkeypatch: pytest.MonkeyPatch) -> threading.Event:
    """No file is written before it is set."""
    go, write = threading.Event(), journal.write_whole

    def waiting(path: Path, data: bytes, sync_name: bool) -> None:
        go.wait(30)
        write(path, data, sync_name)

    monkeypatch.setattr(journal, "write_whole", waiting)
    return go


def test_jpeg_xl_is_lossless_and_journalled(tmp_path: Path) -> None:
    pytest.importorskip("imagecodecs")
    run = writer(tmp_path / "r", "jxl")
    put(run, 1)
    run.close({})
    opened = open_run(tmp_path / "r")
    file = str(opened.frames().loc[0, "file"])
    assert file.endswith("press_001.jxl")
    assert np.array_equal(opened.image(file), image(1))
    (tmp_path / "r" / file).write_bytes(b"\xff\x0a no image")
    with pytest.raises(RunFailed, match="damaged"):
        opened.image(file)
    with pytest.raises(ValueError, match="not a readable image"):
        decode(b"\xff\x0a no image", "a.jxl")


def test_rows_keep_the_call_order(tmp_path: Path) -> None:
    run = writer(tmp_path / "r")
    for k in range(1, 41):
        assert put(run, k) == f"{STEP.id}#{k:03d}"
        run.event("tick", str(k))
    run.step(STEP, 1.0, 0.0, 1.0)
    run.flush()
    opened = open_run(tmp_path / "r")
    assert opened.frames()["k"].tolist() == list(range(1, 41))
    assert opened.events()["text"].tolist()[1:] == [str(k) for k in range(1, 41)]
    run.abandon()


def test_full_queue_refuses_or_waits(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, held: threading.Event
) -> None:
    monkeypatch.setattr(journal, "MAX_QUEUED_IMAGES", 4)
    run = writer(tmp_path / "r")
    assert all(put(run, k) for k in range(1, 5))
    assert put(run, 5, wait=False) is None
    waited: list[str | None] = []
    thread = threading.Thread(target=lambda: waited.append(put(run, 6)))
    thread.start()
    thread.join(0.1)
    assert not waited
    held.set()
    thread.join(30)
    run.step(STEP, 1.0, 0.0, 1.0, missed=35)
    run.abandon()
    assert waited == [f"{STEP.id}#006"]
    assert open_run(tmp_path / "r").frames()["k"].tolist() == [1, 2, 3, 4, 6]
    # What was given up counts as missed, and the press as complete.
    again = RunWriter.resume(tmp_path / "r", [STEP])
    assert again.kept_presses == {STEP.press}
    assert again.missed == 35
    again.abandon()


def test_queue_is_limited_in_bytes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, held: threading.Event
) -> None:
    monkeypatch.setattr(journal, "MAX_QUEUED_BYTES", 3 * image(0).nbytes)
    run = writer(tmp_path / "r")
    assert [put(run, k, wait=False) is not None for k in range(1, 6)] == [True] * 3 + [False] * 2
    held.set()
    run.abandon()


def test_unwritable_file_ends_the_commits(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write, told = journal.write_whole, threading.Event()

    def full(path: Path, data: bytes, sync_name: bool) -> None:
        if path.name.endswith("007.png"):
            raise RunFailed(f"{path}: cannot be written: No space left on device")
        write(path, data, sync_name)

    monkeypatch.setattr(journal, "write_whole", full)
    run = writer(tmp_path / "r")
    reasons: list[RunFailed] = []

    def failed(why: RunFailed) -> None:
        reasons.append(why)
        told.set()

    run.failed = failed
    for k in range(1, 8):
        put(run, k)
    assert told.wait(30)
    with pytest.raises(RunFailed, match=r"007\.png: cannot be written: No space left"):
        put(run, 8)
    with pytest.raises(RunFailed, match=r"007\.png"):
        run.step(STEP, 1.0, 0.0, 1.0)
    run.event("fault", "the disk is full")
    with pytest.raises(RunFailed, match=r"007\.png"):
        run.flush()
    run.abandon()
    assert len(reasons) == 1
    opened = open_run(tmp_path / "r")
    assert opened.frames()["k"].tolist() == list(range(1, 7))
    assert opened.events()["text"].tolist()[-1] == "the disk is full"
    assert len(opened.steps()) == 0


def test_frame_is_committed_within_a_second(tmp_path: Path) -> None:
    run = writer(tmp_path / "r")
    put(run, 1)
    opened, until_s = open_run(tmp_path / "r"), time.monotonic() + 30
    while not len(opened.frames()) and time.monotonic() < until_s:
        time.sleep(0.05)
    assert len(opened.frames()) == 1
    run.abandon()


def test_late_sweep_frames_are_flagged(tmp_path: Path) -> None:
    meta = {
        "simulated": False,
        "camera": None,
        "protocol": {"capture": {"rate_hz": 20.0, "settle_s": 0.1}},
    }
    step = Step(STEP.id, STEP.press, STEP.indenter, "press", (0, 0, -1.0), 30.0, 3, 0.1, True)
    run = RunWriter.create(tmp_path / "r", meta, b"", PATTERN, [step])
    for k, late_s in ((1, 0.02), (2, 0.03), (3, 0.2)):
        run.frame(step, k, None, k, k, k, late_s=late_s, dropped=k, repeated=2 * k)
    run.close({})
    frames = open_run(tmp_path / "r").frames()
    assert frames["late"].tolist() == [False, True, False]  # the last one is waited for
    assert frames["late_s"].tolist() == [0.02, 0.03, 0.2]
    assert frames["dropped"].tolist() == [1, 2, 3]
    assert frames["repeated"].tolist() == [2, 4, 6]
