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
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from rig_text import VIRTUAL_STAGE

from deltact_fab import experiment, record
from deltact_fab.cli.main import main
from deltact_fab.errors import InputError
from deltact_fab.protocols import plan
from deltact_fab.record import CLOCK_COLUMNS, PRESS_TABLES, RunWriter

pytestmark = pytest.mark.slow
# Two positions of two indenters, so that a resume may start after a change or after a press.
PROTOCOL = """
name = "tiny"
indenters = ["sphere:6", "sphere:8"]
positions_mm = [[0.0, 0.0], [1.0, 0.5]]
depths_mm = [0.4]
channels = ["image", "dots", "force", "shear"]
[shear]
amplitude_mm = 0.5
axes = ["x"]
[capture]
rate_hz = 1.0
settle_s = 0.3
[specimen]
design = "{design}"
"""
DESIGN = """
[optics]
image_width_px = 160
image_height_px = 120
"""
RIG = f"""{VIRTUAL_STAGE}[force]
range_n = [25.0, 25.0, 35.0]
range_nmm = [250.0, 250.0, 250.0]
[virtual.gel]
spacing_mm = 0.5
press_increment_mm = 0.4
shear_increment_mm = 0.5
"""
# The command line in a process that kills itself inside the n-th call of a function of the record:
# `write_whole` (an image), before it or after its rename, or os.fsync (anything).
KILLED = """
import os, signal, sys
from deltact_fab.record import pipeline

where, last, calls = sys.argv[1], int(sys.argv[2]), [0]
fsync, write_whole = os.fsync, pipeline.write_whole

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

os.fsync, pipeline.write_whole = in_fsync, in_write
sys.argv = ["deltact-fab", *sys.argv[3:]]
from deltact_fab.cli.main import entry
entry()
"""


@dataclass
class Bench:
    """A short protocol, its undisturbed run and how long that takes in a process of its own."""

    folder: Path
    protocol: Path
    rig: Path
    undisturbed: Path
    seconds: float
    env: dict[str, str]

    def arguments(self, out: Path, *more: str) -> list[str]:
        return [
            "run", str(self.protocol), "--rig", str(self.rig), "--seed", "3", "--out", str(out),
            *more,
        ]  # fmt: skip

    def cli(self, out: Path, *more: str) -> subprocess.Popen[str]:
        return subprocess.Popen(
            [sys.executable, "-m", "deltact_fab.cli.main", *self.arguments(out, *more)],
            env=self.env, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        )  # fmt: skip

    def resume(self, out: Path) -> str:
        process = self.cli(out, "--resume")
        text, complaint = process.communicate()
        assert process.returncode == 0, complaint
        return text

    def kill_after(self, seconds: float, out: Path, *more: str) -> bool:
        """Run, SIGKILL after that time; False when it was over before."""
        with self.cli(out, *more) as process:
            try:
                process.wait(timeout=seconds)
            except subprocess.TimeoutExpired:
                process.kill()
        assert process.returncode in (0, -signal.SIGKILL)
        return process.returncode != 0

    def kill_at(self, where: str, n: int, out: Path, *more: str) -> None:
        done = subprocess.run(
            [sys.executable, "-c", KILLED, where, str(n), *self.arguments(out, *more)],
            env=self.env, capture_output=True, check=False,
        )  # fmt: skip
        assert done.returncode == -signal.SIGKILL, done.stderr


@pytest.fixture(scope="module")
def tiny(tmp_path_factory: pytest.TempPathFactory) -> Bench:
    folder = tmp_path_factory.mktemp("tiny")
    design, protocol, rig = (folder / f"{n}.toml" for n in ("design", "tiny", "bench"))
    design.write_text(DESIGN)
    protocol.write_text(PROTOCOL.format(design=design))
    rig.write_text(RIG)
    # Compiled modules are kept, wherever that is switched off: half of a short run is start-up.
    env = {k: v for k, v in os.environ.items() if k != "PYTHONDONTWRITEBYTECODE"}
    cache = tmp_path_factory.getbasetemp().parent / "deltact-fab-compiled"
    env |= {"PYTHONPYCACHEPREFIX": str(cache), "OMP_NUM_THREADS": "1"}
    made = Bench(folder, protocol, rig, folder / "undisturbed", 0.0, env)
    if not cache.exists():
        made.cli(folder / "warm-up").communicate()
    started = time.monotonic()
    with made.cli(made.undisturbed) as process:
        assert process.wait() == 0
    made.seconds = time.monotonic() - started
    return made


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


def assert_equal(tiny: Bench, resumed: Path) -> None:
    """The resumed record is the undisturbed one but for clocks, and whole in itself."""
    for table in PRESS_TABLES:
        assert rows(resumed, table) == rows(tiny.undisturbed, table)
    run = record.open(resumed)
    planned = [s.id for s in plan.expand(plan.load(str(tiny.protocol))[0])]
    assert list(run.steps()["step_id"]) == planned
    for row in run.frames().itertuples():
        data = (resumed / str(row.file)).read_bytes()
        assert hashlib.sha256(data).hexdigest() == row.sha256
        assert run.image(str(row.file)).shape == (120, 160, 3)
    # Images, truth, pattern and protocol byte for byte, and not one file more.
    free = ("journal.sqlite", "run.json", "summary.json")
    wanted, found = files(tiny.undisturbed), files(resumed)
    assert found.keys() == wanted.keys()
    assert {k for k in wanted if found[k] != wanted[k]} <= set(free)
    assert run.summary()["frames"] == len(run.frames())
    assert not list(resumed.parent.glob(".*.part"))
    truth, first = run.truth(), record.open(tiny.undisturbed).truth()
    assert truth is not None
    assert first is not None
    assert truth.frames == first.frames
    frame_id = str(run.frames()["frame_id"].iloc[-3])
    assert np.array_equal(truth.displacement_mm(frame_id), first.displacement_mm(frame_id))


def test_a_run_killed_at_any_moment_ends_as_the_undisturbed_one(
    tiny: Bench, tmp_path: Path
) -> None:
    """Four moments, one in each quarter of the run; one of them twice."""
    rng = np.random.default_rng(20)
    for n in range(4):
        at_s = tiny.seconds * (n + rng.uniform()) / 4
        out = tmp_path / f"kill-{n}"
        while not tiny.kill_after(at_s, out):
            shutil.rmtree(out)  # the machine is less busy than when the time was taken
            at_s *= 0.8
        if n == 2 and out.exists():
            tiny.kill_after(tiny.seconds * rng.uniform(0.5, 1.0), out, "--resume")
        resume(tiny, out)
        assert_equal(tiny, out)
        shutil.rmtree(out)


def test_killed_inside_the_writing_of_an_image(tiny: Bench, tmp_path: Path) -> None:
    out = tmp_path / "r"
    tiny.kill_at("image", 8 + 4, out)  # one of the second press, not yet renamed
    part = list((out / "images").glob(".*.part"))
    assert len(part) in (1, 2)  # two are written at a time
    kept = files(out / "images").keys()
    for path in part:
        assert "images/" + path.name.removeprefix(".").removesuffix(".part") not in kept
    tiny.kill_at("renamed", 4, out, "--resume")  # and not in the journal
    images = {f"images/{p.name}" for p in (out / "images").glob("*.png")}
    assert len(images - set(record.open(out).frames()["file"])) >= 1
    text = tiny.resume(out)
    assert "8 frames kept" in text
    assert_equal(tiny, out)
    events = record.open(out).events()
    sessions = events[events["kind"] == "session"]["text"]
    assert [text.partition(";")[0] for text in sessions] == [
        "begun", "resumed: 8 frames kept", "resumed: 8 frames kept",
    ]  # fmt: skip


@pytest.mark.parametrize("n", [1, 4, 7, 12, 40])
def test_killed_at_every_kind_of_write(tiny: Bench, tmp_path: Path, n: int) -> None:
    """Creation (1-7), images, their folder, truth (of each of four presses)."""
    out = tmp_path / "r"
    tiny.kill_at("fsync", n, out)
    if n < 7:  # the folder was not there yet
        assert [p.name for p in tmp_path.iterdir()] == [".r.part"]
    resume(tiny, out)
    assert_equal(tiny, out)


# The rest in this process: the record is copied, spoilt and resumed.


def cut_off(tiny: Bench, out: Path, press: str) -> None:
    """An unfinished record from a finished one: everything from a press on is gone."""
    shutil.copytree(tiny.undisturbed, out)
    (out / "summary.json").unlink()
    presses = list(dict.fromkeys(s.press for s in plan.expand(plan.load(str(tiny.protocol))[0])))
    gone = presses[presses.index(press) :]
    with sqlite3.connect(out / "journal.sqlite") as db:
        for name in gone:
            for table in PRESS_TABLES:
                db.execute(f"DELETE FROM {table} WHERE press = ?", (name,))
    db.close()


def resume(
    tiny: Bench, out: Path, seed: int = 3, protocol: Path | None = None
) -> dict[str, object]:
    return experiment.run(
        experiment.RunRequest(str(protocol or tiny.protocol), str(tiny.rig), out, seed=seed),
        resume=True,
    )


def test_a_damaged_press_is_done_again_in_its_place(tiny: Bench, tmp_path: Path) -> None:
    out = tmp_path / "r"
    cut_off(tiny, out, "sphere-8/p2")
    image = sorted((out / "images").glob("sphere-6_p2_*"))[2]
    image.write_bytes(image.read_bytes()[:-40])
    truth = record.truth_file(out, "sphere-8/p1")
    data = bytearray(truth.read_bytes())
    data[len(data) // 2] ^= 1
    truth.write_bytes(bytes(data))
    with sqlite3.connect(out / "journal.sqlite") as db:
        which = "WHERE stream = 'force' AND step_id = 'sphere-6/p1/d0.40/press'"
        packed = bytearray(db.execute(f"SELECT data FROM samples {which}").fetchone()[0])
        packed[len(packed) // 2] ^= 1
        db.execute(f"UPDATE samples SET data = ? {which}", (bytes(packed),))
    db.close()
    summary = resume(tiny, out)
    assert summary["redone"] == {
        "sphere-6/p1": "its samples are damaged: force of sphere-6/p1/d0.40/press",
        "sphere-6/p2": f"images/{image.name}: differs from its hash in the journal",
        "sphere-8/p1": summary["redone"]["sphere-8/p1"],
    }
    assert summary["redone"]["sphere-8/p1"].startswith(f"truth/{truth.name}: its truth is damaged")
    assert_equal(tiny, out)


def test_a_finished_run_is_left_as_it_is(tiny: Bench, tmp_path: Path) -> None:
    out = tmp_path / "r"
    shutil.copytree(tiny.undisturbed, out)
    before = files(out)
    done = CliRunner().invoke(main, tiny.arguments(out, "--resume"))
    assert done.exit_code == 0
    assert done.output == f"{out}: finished before, 32 frames; nothing was changed\n"
    assert files(out) == before


def test_other_conditions_are_refused_by_name(tiny: Bench, tmp_path: Path) -> None:
    out = tmp_path / "r"
    cut_off(tiny, out, "sphere-6/p2")
    before = files(out)
    other = tmp_path / "other.toml"
    text = tiny.protocol.read_text()
    with pytest.raises(InputError, match=r"seed: 3 in the folder, 4 now"):
        resume(tiny, out, seed=4)
    other.write_text(text.replace("depths_mm = [0.4]", "depths_mm = [0.5]"))
    with pytest.raises(InputError, match=r"protocol\.depths_mm: \[0\.4\] in the .*\[0\.5\] now"):
        resume(tiny, out, protocol=other)
    other.write_text(text + "# a note\n")
    with pytest.raises(InputError, match=r"another text; resume with .*protocol\.toml"):
        resume(tiny, out, protocol=other)
    rig = tmp_path / "rig.toml"
    rig.write_text(tiny.rig.read_text().replace("spacing_mm = 0.5", "spacing_mm = 0.4"))
    with pytest.raises(
        InputError, match=r"rig\.virtual\.gel\.spacing_mm: 0\.5 in the folder, 0\.4 now"
    ):
        experiment.run(
            experiment.RunRequest(str(tiny.protocol), str(rig), out, seed=3), resume=True
        )
    assert files(out) == before
    # The frozen copy is the protocol, so it may be given instead of the original.
    experiment.run(
        experiment.RunRequest(str(out / "protocol.toml"), str(tiny.rig), out, seed=3), resume=True
    )
    assert_equal(tiny, out)


@pytest.mark.parametrize(
    ("file", "was", "now", "named"),
    [
        ("run.json", '"thickness_mm": 12.0', '"thickness_mm": 11.0', r"sensor\.skin\.thickness_mm"),
        ("run.json", '"numpy": "', '"numpy": "0.', r"versions\.numpy"),
        ("pattern.json", '"seed": ', '"seed": 1', r"pattern\.recipe\.seed"),
    ],
)
def test_another_sensor_pattern_or_version_is_refused(
    tiny: Bench, tmp_path: Path, file: str, was: str, now: str, named: str
) -> None:
    out = tmp_path / "r"
    cut_off(tiny, out, "sphere-8/p2")
    text = (out / file).read_text()
    assert was in text
    (out / file).write_text(text.replace(was, now))
    with pytest.raises(InputError, match=rf"cannot be resumed: {named}: "):
        resume(tiny, out)


def test_two_processes_never_write_one_run(tiny: Bench, tmp_path: Path) -> None:
    out = tmp_path / "r"
    cut_off(tiny, out, "sphere-8/p2")
    steps = plan.expand(plan.load(str(tiny.protocol))[0])
    first = RunWriter.resume(out, steps)
    with pytest.raises(InputError, match="another process is writing this run"):
        RunWriter.resume(out, steps)
    first.abandon()
    RunWriter.resume(out, steps).abandon()
