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

import numpy as np
import pytest
from called import called
from short_run import ShortRun

from deltact_fab.bench.record import ledger
from deltact_fab.bench.record.ledger import SensorLedger
from deltact_fab.bench.record.run import open_run
from deltact_fab.common.reading import read_toml
from deltact_fab.estimate.measure.sensor_id import SensorModel
from deltact_fab.present.live.acceptance import Acceptance
from deltact_fab.sensor import Pinhole, SensorDimensions

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


@pytest.mark.slow
def test_two_processes_lose_no_event(lab: ShortRun, tmp_path: Path) -> None:
    """Each adds 20 events twice, half of them those of the other."""
    with ProcessPoolExecutor(2, get_context("spawn")) as pool:
        list(pool.map(_add_many, [str(tmp_path)] * 2, [0, 20]))
    assert {*read_toml(FILE)["events"]} == {f"lens {number}" for number in range(30)}


@pytest.mark.slow
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


def changed(run: Path, out: Path, changes: dict[str, dict[str, Any]]) -> Path:
    """A copy of a run, begun a day later, with other values in tables of run.json."""
    shutil.copytree(run, out)
    meta = json.loads((out / "run.json").read_text())
    for table, values in changes.items():
        part = meta
        for name in filter(None, table.split(".")):
            part = part[name]
        part |= values
    (out / "run.json").write_text(json.dumps(meta))
    with sqlite3.connect(out / "journal.sqlite") as db:
        db.execute("UPDATE events SET wall_s = wall_s + 86400")
    db.close()
    return out


@pytest.mark.parametrize(
    ("changes", "events", "report"),
    [
        ({}, 2, ""),
        ({"": {"air": True}}, 1, ""),
        ({"protocol.specimen": {"serial": None}}, 1, ""),
        ({"protocol.specimen": {"serial": "A/1"}}, 1, "'A/1': use letters, digits, '.'"),
        ({"sensor.skin": {"thickness_mm": 7.0}}, 2, "sensors/A1.toml: design: '"),
    ],
)
def test_a_second_run(
    lab: ShortRun, tmp_path: Path, changes: dict[str, Any], events: int, report: str
) -> None:
    """One line for another design; what a lab wrote is kept, the comment too."""
    FILE.write_text('# mine\ngel_batch = "B7"\r\n')
    assert SensorLedger.add_event("run", [lab.finished]) == []
    lines = SensorLedger.add_event("run", [changed(lab.finished, tmp_path / "r", changes)])
    assert len(lines) == bool(report)
    assert report in "".join(lines)
    assert len(read_toml(FILE)["events"]) == events
    assert '# mine\ngel_batch = "B7"' in FILE.read_text()
    assert listed()["presses"] == 4 * events


def test_acceptance_reports_another_design(lab: ShortRun) -> None:
    FILE.write_text('design = "x"\ndesign_digest = "0"\n')
    view = SensorModel(Pinhole.from_sensor(SensorDimensions()), serial="A1")
    accepted = Acceptance(str(lab.finished), 1, (), None, np.zeros((8, 8, 3), np.uint8))
    (line,) = accepted.save(view, 0, FILE)
    assert line.startswith("sensors/A1.toml: design: 'x' with digest 0; this run has")


def test_simulated_presses_do_not_count(lab: ShortRun, tmp_path: Path) -> None:
    SensorLedger.add_event("run", [lab.finished])
    real = changed(lab.finished, tmp_path / "real", {"": {"simulated": False}})
    with sqlite3.connect(real / "journal.sqlite") as db:
        db.execute("DELETE FROM steps WHERE press = 'sphere-8/p2'")
    db.close()
    SensorLedger.add_event("run", [real])
    assert (listed()["presses"], listed()["simulated"]) == (3, False)
    assert listed()["last_run"] == open_run(real).id
    shutil.copytree(real, "broken")
    Path("broken/run.json").write_text("{")
    done = called("record", "list", "--json")
    assert done.returncode == 0
    broken, row = json.loads(done.stdout)
    assert broken["fault"].startswith("broken/run.json: not valid JSON")
    assert (row["complete"], row["planned"], row["simulated"], row["serial"]) == (3, 4, False, "A1")
    assert "broken/run.json: not valid JSON" in called("record", "list").stdout


def test_settings_of_controller_are_hidden(lab: ShortRun) -> None:
    shown, whole = (called("record", "show", lab.finished, *more).stdout
                    for more in ((), ("--settings",)))  # fmt: skip
    assert ("settings.$" in shown, "--settings shows them" in shown) == (False, True)
    assert "devices.stage.settings.$110" in whole
