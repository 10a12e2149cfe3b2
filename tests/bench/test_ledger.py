"""Ledger of sensors: one line per kind and run, whoever writes it and however often."""

from __future__ import annotations

import json
import os
import shutil
import sqlite3
import subprocess
import sys
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import pytest
from called import called
from short_run import ShortRun

from deltact_fab.bench.record import ledger
from deltact_fab.bench.record.ledger import SensorLedger
from deltact_fab.bench.record.run import Run, open_run
from deltact_fab.common.reading import read_toml

FILE = Path("sensors/A1.toml")


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> ShortRun:
    short = ShortRun(tmp_path_factory.mktemp("short"))
    short.protocol.write_text(short.protocol.read_text() + 'serial = "A1"\n')
    assert short.finished.is_dir()  # recorded where there is no ledger
    assert not (short.folder / "sensors").exists()
    return short


@pytest.fixture
def lab(made: ShortRun, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> ShortRun:
    monkeypatch.chdir(tmp_path)
    FILE.parent.mkdir()
    return made


def listed() -> dict[str, Any]:
    (row,) = json.loads(called("rig", "sensors", "--json").stdout)
    return row


def _add_many(folder: str, first: int) -> None:
    os.chdir(folder)
    for number in range(first, first + 40):
        assert SensorLedger.add_event("lens", serial="A1", id=str(number // 2)) == []


def test_two_processes_lose_no_event(lab: ShortRun, tmp_path: Path) -> None:
    """Each adds 20 events twice, half of them those of the other."""
    with ProcessPoolExecutor(2, get_context("spawn")) as pool:
        list(pool.map(_add_many, [str(tmp_path)] * 2, [0, 20]))
    assert {*read_toml(FILE)["events"]} == {f"lens {number}" for number in range(30)}


def test_killed_and_resumed_run_counts_once(lab: ShortRun, tmp_path: Path) -> None:
    """Killed in its third press, resumed twice, copied elsewhere: four presses."""
    script = (
        "import os, sys; from called import called; from deltact_fab.bench import RunWriter\n"
        "step = RunWriter.step\n"
        "def killing(self, one, *args, **more):\n"
        "    if one.press.endswith('p1') and one.indenter == 'sphere:8' and one.kind == 'press':\n"
        "        self.flush(); os.kill(os.getpid(), 9)\n"
        "    step(self, one, *args, **more)\n"
        "RunWriter.step = killing; called(*sys.argv[1:])\n"
    )
    words = lab.words(Path("r"))
    done = subprocess.run([sys.executable, "-c", script, *words], env={
        **os.environ,
        "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}, check=False)  # fmt: skip
    assert done.returncode == -9
    assert next(iter(read_toml(FILE)["events"].values()))["presses"] == 0
    assert (listed()["presses"], listed()["simulated"]) == (2, True)  # from the record itself
    for _ in range(2):
        assert called(*words, "--resume").returncode == 0
    shutil.copytree("r", "copy")
    SensorLedger.add_event("run", ["copy"])
    assert [row["presses"] for row in read_toml(FILE)["events"].values()] == [4]
    for folder in ("r", "copy"):
        shutil.rmtree(folder)
    assert listed()["presses"] == 4
    assert listed()["last_run"].startswith("tiny-")


@pytest.mark.parametrize(
    ("text", "report"),
    [
        ("gel_batch = ", "sensors/A1.toml: not valid TOML: Invalid value"),
        ('gel_bach = "B7"', "sensors/A1.toml: gel_bach: unknown key; did you mean 'gel_batch'?"),
        ("cure_h = 2000", "sensors/A1.toml: cure_h: 2000; expected 0 <= cure_h <= 1000"),
        ('[events]\n"ran x" = {date = ""}', "sensors/A1.toml: events.ran x: "),
        ('[events]\n"run x" = {date = ""}\n[rest]\n', "events: must be the last table, headed by"),
        ('note = """\n[events]\n"""\n[events]', "events: must be the last table, headed by"),
    ],
)
def test_damaged_file_is_one_line(lab: ShortRun, text: str, report: str) -> None:
    FILE.write_text(text)
    (line,) = SensorLedger.add_event("run", [lab.finished])
    assert line.startswith("ledger: ")
    assert report in line
    assert FILE.read_text() == text
    assert called("rig", "sensors").returncode == 0
    assert listed()["serial"] == "A1"
    assert report in listed()["fault"]


def test_unwritable_folder_stops_nothing(lab: ShortRun, monkeypatch: Any) -> None:
    """Not even for the superuser: a file stands where the lock would be, and one holds the lock."""
    Path("sensors/.lock").mkdir()
    done = called(*lab.words(lab.finished, "--resume"))
    assert (done.returncode, done.stderr.count("\n")) == (0, 1)
    assert "ledger: sensors: cannot be written: Is a directory; nothing was added" in done.stderr
    Path("sensors/.lock").rmdir()
    monkeypatch.setattr(ledger, "LOCK_WAIT_S", 0.05)
    with SensorLedger.locked():
        (line,) = SensorLedger.add_event("run", [lab.finished])
    assert "locked by another process for 0.05 s" in line


def test_what_a_lab_wrote_is_kept(lab: ShortRun, tmp_path: Path) -> None:
    """Comments too; another design is reported."""
    FILE.write_text('# mine\ngel_batch = "B7"\r\n')
    assert SensorLedger.add_event("run", [lab.finished]) == []
    text = FILE.read_bytes()
    assert b'# mine\ngel_batch = "B7"' in text
    for number, change in enumerate(({}, {"air": True}, {"serial": None}, {"thickness_mm": 7.0})):
        copy = shutil.copytree(lab.finished, tmp_path / f"r{number}")
        meta = json.loads((copy / "run.json").read_text())
        meta |= {"air": change.get("air", False)}
        meta["sensor"]["skin"] |= {k: v for k, v in change.items() if k == "thickness_mm"}
        meta["protocol"]["specimen"] |= {k: v for k, v in change.items() if k == "serial"}
        (copy / "run.json").write_text(json.dumps(meta))
        lines = SensorLedger.add_event("force", [copy])
        assert ["this run has" in line for line in lines] == [True] * ("thickness_mm" in change)


def test_real_presses_do_not_include_simulated(lab: ShortRun, tmp_path: Path) -> None:
    SensorLedger.add_event("run", [lab.finished])
    assert (listed()["presses"], listed()["simulated"]) == (4, True)
    copy = shutil.copytree(lab.finished, tmp_path / "real")
    meta = json.loads((copy / "run.json").read_text())
    (copy / "run.json").write_text(json.dumps(meta | {"simulated": False}))
    with sqlite3.connect(copy / "journal.sqlite") as db:
        db.execute("UPDATE events SET wall_s = wall_s + 86400")
        db.execute("DELETE FROM steps WHERE press LIKE 'sphere-8/p2'")
    db.close()
    SensorLedger.add_event("run", [copy])
    assert (listed()["presses"], listed()["simulated"]) == (3, False)
    rows = {row["run"]: row for row in Run.list_runs(tmp_path)}
    (row,) = rows.values()
    assert (row["complete"], row["planned"], row["simulated"]) == (3, 4, False)
    assert open_run(copy).id in listed()["last_run"]
