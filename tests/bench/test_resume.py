"""A run that is killed goes on with --resume, and ends as if nothing had happened."""

from __future__ import annotations

import hashlib
import os
import shutil
import signal
import sqlite3
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from called import called
from short_run import MIXED, ShortRun

from deltact_fab.bench.record.files import truth_file
from deltact_fab.bench.record.journal import CLOCK_COLUMNS, PRESS_TABLES
from deltact_fab.bench.record.run import Run, open_run
from deltact_fab.bench.record.writer import RunWriter
from deltact_fab.bench.rig.config import VirtualConfig
from deltact_fab.common.errors import InputError
from deltact_fab.simulate.experiment.request import RunRequest
from deltact_fab.simulate.experiment.session import run_presses

DRIFT = """
[virtual.drift]
force_gain_per_h = 0.5
light_per_h = -0.5
residual = 0.3
"""
# The command line in a process that kills itself inside the n-th call of a function of the record:
# `write_whole` (an image), before it or after its rename, or os.fsync (anything).
KILLED = """
import os, signal, sys
from deltact_fab.bench.record import journal

where, last, calls = sys.argv[1], int(sys.argv[2]), [0]
fsync, write_whole = os.fsync, journal.write_whole

def counted():
    calls[0] += 1
    return calls[0] == last

def die():
    os.kill(os.getpid(), signal.SIGKILL)

def in_fsync(handle):
    if where == "fsync" and counted():
        die()
    name = os.readlink(f"/proc/self/fd/{handle}")
    if where == "image" and name.endswith(f".png.{os.getpid()}.part"):
        if counted():
            die()
    fsync(handle)

def in_write(path, data, sync_name):
    write_whole(path, data, sync_name)
    if where == "renamed" and counted():
        die()

os.fsync, journal.write_whole = in_fsync, in_write
sys.argv = ["deltact-fab", *sys.argv[3:]]
from deltact_fab.app.cli.main import entry
entry()
"""


@pytest.fixture(scope="module")
def tiny(tmp_path_factory: pytest.TempPathFactory) -> ShortRun:
    return ShortRun(tmp_path_factory.mktemp("tiny"))


@pytest.fixture(scope="module")
def mixed(tmp_path_factory: pytest.TempPathFactory) -> ShortRun:
    return ShortRun(tmp_path_factory.mktemp("mixed"), MIXED, DRIFT)


def rows(folder: Path, table: str) -> list[tuple[object, ...]]:
    """All columns but the clocks', in order."""
    with sqlite3.connect(folder / "journal.sqlite") as db:
        names = [c[1] for c in db.execute(f"PRAGMA table_info({table})")]
        keep = ",".join(n for n in names if n not in CLOCK_COLUMNS)
        found = db.execute(f"SELECT {keep} FROM {table} ORDER BY 1, 2").fetchall()
    db.close()
    return found


def files(folder: Path) -> dict[str, str]:
    """Every file below a folder with its hash."""
    return {
        str(p.relative_to(folder)): hashlib.sha256(p.read_bytes()).hexdigest()
        for p in sorted(folder.rglob("*"))
        if p.is_file()
    }


def assert_equal(tiny: ShortRun, resumed: Path) -> None:
    """The resumed record is the undisturbed one but for clocks, and whole in itself."""
    for table in PRESS_TABLES:
        assert rows(resumed, table) == rows(tiny.finished, table)
    run = open_run(resumed)
    assert list(run.steps()["step_id"]) == [step.id for step in tiny.steps]
    for row in run.frames().itertuples():
        data = (resumed / str(row.file)).read_bytes()
        assert hashlib.sha256(data).hexdigest() == row.sha256
        assert run.image(str(row.file)).shape == (120, 160, 3)
    # Images, truth, pattern and protocol byte for byte, and not one file more.
    free = ("journal.sqlite", "run.json", "summary.json")
    wanted, found = files(tiny.finished), files(resumed)
    assert found.keys() == wanted.keys()
    assert {k for k in wanted if found[k] != wanted[k]} <= set(free)
    assert run.summary()["frames"] == len(run.frames())
    assert not list(resumed.parent.glob(".*.part"))
    truth, first = run.truth(), open_run(tiny.finished).truth()
    assert truth is not None
    assert first is not None
    assert truth.frames == first.frames
    frame_id = str(run.frames()["frame_id"].iloc[-3])
    assert np.array_equal(truth.displacement_mm(frame_id), first.displacement_mm(frame_id))


# In this process: the record is copied, spoilt and resumed.


@pytest.mark.slow
def test_damaged_press_is_repeated_in_place(tiny: ShortRun, tmp_path: Path) -> None:
    out = tiny.unfinished(tmp_path / "r", "sphere-8/p2")
    image = sorted((out / "images").glob("sphere-6_p2_*"))[2]
    image.write_bytes(image.read_bytes()[:-40])
    truth = out / truth_file("sphere-8/p1")
    data = bytearray(truth.read_bytes())
    data[len(data) // 2] ^= 1
    truth.write_bytes(bytes(data))
    with sqlite3.connect(out / "journal.sqlite") as db:
        which = "WHERE stream = 'force' AND step_id = 'sphere-6/p1/d0.40/press'"
        packed = bytearray(db.execute(f"SELECT data FROM samples {which}").fetchone()[0])
        packed[len(packed) // 2] ^= 1
        db.execute(f"UPDATE samples SET data = ? {which}", (bytes(packed),))
    db.close()
    summary = tiny.resume(out)
    assert summary["redone"] == {
        "sphere-6/p1": f"{out}/journal.sqlite: force of sphere-6/p1/d0.40/press: damaged samples",
        "sphere-6/p2": f"images/{image.name}: differs from its hash in the journal",
        "sphere-8/p1": summary["redone"]["sphere-8/p1"],
    }
    assert summary["redone"]["sphere-8/p1"].startswith(f"truth/{truth.name}: truth damaged")
    assert_equal(tiny, out)


def test_finished_run_is_left_unchanged(tiny: ShortRun, tmp_path: Path) -> None:
    out = tmp_path / "r"
    shutil.copytree(tiny.finished, out)
    before = files(out)
    done = called(*tiny.words(out, "--resume"))
    assert done.stdout == f"{out}: already finished, 32 frames; nothing changed\n"
    assert files(out) == before


def test_other_conditions_are_refused_by_name(tiny: ShortRun, tmp_path: Path) -> None:
    out = tiny.unfinished(tmp_path / "r", "sphere-8/p2")
    before, protocol, rig = files(out), tmp_path / "other.toml", tmp_path / "rig.toml"
    text = tiny.protocol.read_text()
    rig.write_text(tiny.rig.read_text().replace("spacing_mm = 0.5", "spacing_mm = 0.4"))
    cases: list[tuple[dict[str, Any], str, str]] = [
        ({"seed": 4}, "", r"seed: 3 in the folder, 4 now"),
        ({"protocol": str(protocol)}, text.replace("[0.4]", "[0.5]"),
         r"protocol\.depths_mm: \[0\.4\] in the .*\[0\.5\] now"),
        ({"protocol": str(protocol)}, text + "# a note\n",
         r"other text.; resume with .*protocol\.toml"),
        ({"rig": str(rig)}, "", r"rig\.virtual\.gel\.spacing_mm: 0\.5 in the folder, 0\.4 now"),
    ]  # fmt: skip
    for other, written, says in cases:
        protocol.write_text(written)
        with pytest.raises(InputError, match=says):
            tiny.resume(out, **other)
    for file, was, now, named in (
        ("run.json", '"thickness_mm": 12.0', '"thickness_mm": 11.0', r"sensor\.skin\.thickness_mm"),
        ("run.json", '"numpy": "', '"numpy": "0.', r"versions\.numpy"),
        ("pattern.json", '"seed": ', '"seed": 1', r"pattern\.recipe\.seed"),
    ):
        text = (out / file).read_text()
        assert was in text
        (out / file).write_text(text.replace(was, now))
        with pytest.raises(InputError, match=rf"cannot be resumed: {named}: "):
            tiny.resume(out)
        (out / file).write_text(text)
    assert files(out) == before
    writer = RunWriter.resume(out, tiny.steps)
    with pytest.raises(InputError, match="another process is writing this run"):
        RunWriter.resume(out, tiny.steps)
    writer.abandon()
    # The frozen copy is the protocol, so it may be given instead of the original.
    tiny.resume(out, protocol=str(out / "protocol.toml"))
    assert_equal(tiny, out)


# In processes that are killed.


def compiled(tiny: ShortRun) -> dict[str, str]:
    """An environment in which compiled modules are kept: half of a short run is start-up."""
    env = {k: v for k, v in os.environ.items() if k != "PYTHONDONTWRITEBYTECODE"}
    return env | {"PYTHONPYCACHEPREFIX": str(tiny.folder / "compiled")}


def kill_at(tiny: ShortRun, where: str, n: int, out: Path, *more: str) -> None:
    words = [sys.executable, "-c", KILLED, where, str(n), *tiny.words(out, *more)]
    done = subprocess.run(words, env=compiled(tiny), capture_output=True, check=False)
    assert done.returncode == -signal.SIGKILL, done.stderr


@pytest.mark.slow
def test_killed_run_ends_like_undisturbed_one(tiny: ShortRun, tmp_path: Path) -> None:
    """Three moments, one in each third of the images; after one of them it is killed once more."""
    rng = np.random.default_rng(20)
    for n in range(3):
        out, images = tmp_path / f"kill-{n}", int(32 * (n + rng.uniform()) / 3)
        for more in ((), ("--resume",)) if n == 1 else ((),):
            words = [sys.executable, "-m", "deltact_fab.app.cli.main", *tiny.words(out, *more)]
            with subprocess.Popen(words, env=compiled(tiny)) as process:
                while process.poll() is None and len([*out.glob("images/*.png")]) < images:
                    time.sleep(0.002)
                process.kill()
            images += 5
        tiny.resume(out)
        assert_equal(tiny, out)
        shutil.rmtree(out)


@pytest.mark.slow
def test_random_order_killed_three_times(mixed: ShortRun, tmp_path: Path) -> None:
    """With drift, repeats, reference presses; and each press alone, in any order, is the same."""
    out, images = tmp_path / "r", 0
    presses = [name for name in mixed.presses if "change" not in name]
    assert len(presses) == 24
    for share in (0.2, 0.5, 0.9):
        images, resume = int(share * 73), ("--resume",) if images else ()
        words = [sys.executable, "-m", "deltact_fab.app.cli.main", *mixed.words(out, *resume)]
        with subprocess.Popen(words, env=compiled(mixed)) as process:
            while process.poll() is None and len([*out.glob("images/*.png")]) < images:
                time.sleep(0.002)
            process.kill()
    mixed.resume(out)
    assert open_run(out).summary()["sessions"] == 4
    assert_equal(mixed, out)
    whole = open_run(mixed.finished)
    request = RunRequest(str(mixed.protocol), str(mixed.rig), seed=3)
    assert isinstance(request.rig, VirtualConfig)
    for k in range(2):  # by two workers, backwards
        part = presses[k::2][::-1]
        run_presses(request.setup(tmp_path / f"part{k}"), request.rig, request.rig_path, part)
        run = open_run(tmp_path / f"part{k}")
        for press in part:
            assert_same_press(run, whole, press)
    repeats = [whole.force(name)["fz_n"].to_numpy() for name in presses
               if name.startswith("sphere-6/p1")]  # fmt: skip
    n = min(map(len, repeats))
    assert len({tuple(force[:n]) for force in repeats}) == 3  # other noise


def assert_same_press(run: Run, whole: Run, press: str) -> None:
    """Images and forces."""
    images = [r.frames(press)[["frame_id", "sha256", "t_press_s"]] for r in (run, whole)]
    pd.testing.assert_frame_equal(*images)
    columns = ["t_press_s", "fx_n", "fy_n", "fz_n"]
    pd.testing.assert_frame_equal(*(r.force(press)[columns] for r in (run, whole)))


@pytest.mark.slow
def test_kill_while_writing_an_image(tiny: ShortRun, tmp_path: Path) -> None:
    out = tmp_path / "r"
    kill_at(tiny, "image", 8 + 4, out)  # one of the second press, not yet renamed
    part = list((out / "images").glob(".*.part"))
    assert len(part) in (1, 2)  # two are written at a time
    kept = files(out / "images").keys()
    for path in part:
        assert "images/" + path.name.removeprefix(".").removesuffix(".part") not in kept
    kill_at(tiny, "renamed", 4, out, "--resume")  # and not in the journal
    images = {f"images/{p.name}" for p in (out / "images").glob("*.png")}
    assert len(images - set(open_run(out).frames()["file"])) >= 1
    tiny.resume(out)
    assert_equal(tiny, out)
    events = open_run(out).events()
    sessions = events[events["kind"] == "session"]["text"]
    assert [text.partition(";")[0] for text in sessions] == [
        "begun", "resumed: 8 frames kept", "resumed: 8 frames kept",
    ]  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("n", [1, 7, 12, 40])
def test_killed_at_every_kind_of_write(tiny: ShortRun, tmp_path: Path, n: int) -> None:
    """Creation (1-7), images, their folder, truth (of each of four presses)."""
    out = tmp_path / "r"
    kill_at(tiny, "fsync", n, out)
    if n < 7:  # the folder was not there yet
        assert [p.name for p in tmp_path.iterdir()] == [".r.part"]
    tiny.resume(out)
    assert_equal(tiny, out)
