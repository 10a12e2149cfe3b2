"""Monitors and pauses: a value out of its limits, or none, pauses a run between two presses, which
keeps its homing and its data."""

from __future__ import annotations

import os
import re
import signal
import sqlite3
import sys
import threading
import time
from collections.abc import Callable
from contextlib import closing, suppress
from pathlib import Path
from typing import Any

import pytest
from called import called
from rig_text import VIRTUAL_STAGE
from scale_on_pty import scale
from wall_bench import WallBench, wall_bench

from deltact_fab.bench.record.journal import read_press_rows
from deltact_fab.bench.record.run import open_run
from deltact_fab.bench.rig.config import load_rig
from deltact_fab.bench.rig.monitor import Monitor
from deltact_fab.bench.rig.run.runner import RunProgress
from deltact_fab.bench.rig.tables import MonitorConfig
from deltact_fab.common.errors import InputError, SensorError, StageError, Stopped

pytestmark = pytest.mark.skipif(not hasattr(os, "openpty"), reason="needs pseudo terminals")
# Writes the text of a file, line by line.
PROGRAM = """
import sys, time
while True:
    print(open(sys.argv[1]).read().strip(), flush=True)
    time.sleep(0.02)
"""
PROTOCOL = """
name = "felt"
indenters = ["sphere:6"]
positions_mm = [[0.0, 0.0], [1.0, 0.0]]
depths_mm = [0.3]
channels = ["force"]
[capture]
settle_s = 0.1
"""


def table(**keys: Any) -> MonitorConfig:
    shown = {"name": "temperature", "unit": "degC", "max": 26.0, "silent_s": 5.0, "period_s": 0.0}
    return MonitorConfig(**{**shown, **keys})


def stepped(monitor: Monitor, until: Callable[[Monitor], object]) -> None:
    deadline_s = time.monotonic() + 20.0
    while not until(monitor):
        assert time.monotonic() < deadline_s, monitor.problem()
        monitor.step()


@pytest.mark.parametrize(
    ("code", "keys", "problem"),
    [
        ("print('x'); print(23.5); time.sleep(9)", {}, ""),
        ("print(27.5); time.sleep(9)", {}, "temperature = 27.5 degC, above max = 26"),
        ("print('-3'); time.sleep(9)", {"min": 20.0}, "temperature = -3 degC, below min = 20"),
        ("print(23); print('n/a'); time.sleep(9)", {}, "re: the last line was 'n/a': no number"),
        ("print(23); print('2 3'); time.sleep(9)", {}, "re: the last line was '2 3': 2 numbers"),
        ("print(23); print('T 23'); time.sleep(9)", {}, "re: the last line was 'T 23': its words"),
        ("print('T 23'); time.sleep(9)", {"silent_s": 0.3}, "within 0.3 s: the last line was 'T"),
        ("print(23, flush=True); time.sleep(9)", {"silent_s": 0.1}, "no reading within 0.1 s$"),
        ("print(23); sys.exit('no bus')", {}, "ended with status 1; stderr: no bus"),
    ],
)  # fmt: skip
def test_problem_of_a_monitor(
    code: str, keys: dict[str, Any], problem: str, tmp_path: Path
) -> None:
    text = f"import sys, time\nsys.stdout.reconfigure(line_buffering=True)\n{code}"
    for required in (True, False):
        command = (sys.executable, "-c", text)
        monitor = Monitor(table(command=command, required=required, **keys), tmp_path)
        notes: list[str] = []
        with closing(monitor):
            monitor.start(True, notes.append)
            assert monitor.awaited
            stepped(monitor, Monitor.problem if problem else lambda it: it.take(0))
            monitor.step()
        pauses = problem and (required or " = " in problem)
        assert monitor.pause_reason() == (monitor.problem() if pauses else "")
        assert bool(problem) == len(notes) == bool(monitor.problem())  # said once
        assert re.search(problem, monitor.problem())


@pytest.mark.slow
def test_serial_source_is_opened_again(tmp_path: Path) -> None:
    link, notes = tmp_path / "port", list[str]()
    monitor = Monitor(table(port=str(link)), tmp_path)
    with closing(monitor):
        for lost in (False, True):
            with scale() as it:
                it.line = lambda k: "T = 23.5 C\r\n"
                link.unlink(missing_ok=True)
                link.symlink_to(it.port)
                if not lost:
                    monitor.start(True, notes.append)
                stepped(monitor, lambda it: not it.awaited and not it.problem())
                assert monitor.text == "temperature = 23.5 degC"
            stepped(monitor, Monitor.pause_reason)
    assert len(notes) == 1  # not once more within NOTE_AGAIN_S


@pytest.mark.parametrize(
    ("keys", "says"),
    [
        ('name = "a"', "exactly one of command and port is needed"),
        ('name = "a"\ncommand = ["x"]\nport = "p"', "exactly one of command and port is needed"),
        ('name = "A b"\nport = "p"', "name: "),
        ('name = "a"\nport = "p"\nmin = 3\nmax = 2', r"min: must be below max = 2 \(got 3\)"),
        ('name = "a"\nport = "p"\n[[monitor]]\nname = "a"\nport = "q"', r"its own \(got a, a\)"),
    ],
)
def test_faulty_monitor_is_refused(keys: str, says: str, tmp_path: Path) -> None:
    (tmp_path / "rig.toml").write_text(f"{VIRTUAL_STAGE}[[monitor]]\n{keys}\n")
    with pytest.raises(InputError, match=rf"rig.toml: monitor.*{says}"):
        load_rig(str(tmp_path / "rig.toml"))


def test_source_that_cannot_be_opened(tmp_path: Path) -> None:
    monitor = Monitor(table(command=("no-such-program",)), tmp_path)
    with pytest.raises(InputError, match=r"monitor.temperature.command: no-such-program: cannot"):
        monitor.start(True, str)
    port = str(tmp_path / "none")
    with pytest.raises(SensorError, match="none: cannot open the monitor's port"):
        Monitor(table(port=port), tmp_path).start(True, str)
    optional = Monitor(table(port=port, required=False), tmp_path)
    optional.start(True, str)
    assert "cannot open" in optional.problem()
    assert not optional.pause_reason()


def event(folder: Path, kind: str, n: int = 1) -> bool:
    """True if the run's journal has n events of a kind."""
    with suppress(sqlite3.Error), closing(sqlite3.connect(folder / "journal.sqlite")) as db:
        query = "SELECT count(*) FROM events WHERE kind = ?"
        return bool(db.execute(query, (kind,)).fetchone()[0] >= n)
    return False


def test_pause_in_lockstep_changes_no_data(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    (tmp_path / "p.toml").write_text(PROTOCOL)
    (tmp_path / "plain.toml").write_text(VIRTUAL_STAGE)
    program = f'["{sys.executable}", "t.py", "value"]'
    (tmp_path / "rig.toml").write_text(
        f'{VIRTUAL_STAGE}[[monitor]]\nname = "light"\ncommand = {program}\nmax = 26\nmin = 20\n'
    )
    (tmp_path / "t.py").write_text(PROGRAM)
    value = tmp_path / "value"
    value.write_text("19")

    def act() -> None:
        """End the pause of the limit, then make and end one by Ctrl-Z, which stops no process."""
        for kind, n, deed in (
            ("paused", 1, lambda: os.kill(os.getpid(), signal.SIGTSTP)),
            ("paused", 2, lambda: value.write_text("21")),
            ("monitor", 1, lambda: os.kill(os.getpid(), signal.SIGTSTP)),
        ):
            while not event(tmp_path / "a", kind, n):
                time.sleep(0.01)
            deed()

    acting = threading.Thread(target=act, daemon=True)
    acting.start()
    run = ["run", "p.toml", "--rig", "rig.toml", "--out"]
    done = called(*run, "a", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    acting.join()
    for reason in (
        "light = 19, below min = 20\n",
        "by the operator; Ctrl-Z or SIGUSR1 continues\n",
    ):
        assert f"paused: before sphere-6/change: {reason}" in caplog.text
    assert (
        called("run", "p.toml", "--rig", "plain.toml", "--out", "b", cwd=tmp_path).returncode == 0
    )
    assert read_press_rows(tmp_path / "a") == read_press_rows(tmp_path / "b")
    a, b = (open_run(tmp_path / name) for name in "ab")
    assert a.steps().drop(columns="wall_s").equals(b.steps().drop(columns="wall_s"))
    assert a.monitors()[["press", "monitor", "value", "t_press_s"]].to_numpy().tolist() == [
        ["sphere-6/p1", "light", 21.0, 0.0], ["sphere-6/p2", "light", 21.0, 0.0],
    ]  # fmt: skip
    assert b.monitors().empty
    assert "monitor" not in b.meta["rig"]
    for name in "ab":
        called("record", "export", name, "--format", "csv", "--out", f"{name}-csv", cwd=tmp_path)
    assert (tmp_path / "a-csv" / "monitors.csv").read_text().count("light,,21.0") == 2
    assert not (tmp_path / "b-csv" / "monitors.csv").exists()
    (tmp_path / "a" / "summary.json").unlink()  # its limits may change for the rest of a run
    (tmp_path / "rig.toml").write_text((tmp_path / "rig.toml").read_text() + "required = false\n")
    assert called(*run, "a", "--resume", cwd=tmp_path).returncode == 0


class Acts:
    """Deeds at moments of a run: once in a step, or in a pause."""

    def __init__(self, *acts: tuple[str, Callable[[], Any]]) -> None:
        self.acts = list(acts)
        self.left_s: list[float | None] = []

    def __call__(self, live: RunProgress) -> None:
        if live.step.startswith("paused"):
            self.left_s.append(live.left_s)
        if self.acts and self.acts[0][0] in live.step:
            self.acts.pop(0)[1]()


@pytest.mark.slow
def test_pause_keeps_home_and_data(tmp_path: Path) -> None:
    value, mounted = tmp_path / "value", list[str]()
    value.write_text("23")
    command = (sys.executable, "-c", PROGRAM, str(value))
    with wall_bench(tmp_path, camera=False) as bench:
        bench.devices.monitors = (Monitor(table(command=command), tmp_path),)
        bench.devices.change_indenter = mounted.append
        acts = Acts(
            ("p1/d1.00/press", lambda: value.write_text("27")),
            ("paused: temperature = 27 degC, above max = 26", lambda: value.write_text("24")),
        )
        bench.run(bench.writer(), live=acts)
        assert not acts.acts
        assert sum(b"$H" in data for _, data in bench.board.heard) == 1
    assert mounted == ["sphere:6"]
    run = open_run(tmp_path / "r")
    kinds = [k for k in run.events()["kind"] if k in ("begun", "complete", "paused", "continued")]
    assert kinds == ["begun", "complete", "paused", "continued", "begun", "complete"]
    assert [*run.steps()["step_id"]] == [step.id for step in bench.steps]
    values = run.monitors("sphere-6/p2")
    assert values["value"].iloc[0] == 27  # of the pause before its tare
    assert values["t_press_s"].iloc[0] < 0
    assert set(acts.left_s) == {None}


def board_silent(bench: WallBench) -> None:
    with bench.board.terminal.lock:
        bench.board.grbl.fault("silence")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("strike", "error", "says"),
    [
        (lambda bench: os.kill(os.getpid(), signal.SIGINT), Stopped,
         "by the operator in sphere-6/p2/rest; the tip was lifted"),
        (board_silent, StageError, "no answer"),
        (lambda bench: setattr(bench.server.faults, "frozen", True), SensorError,
         "the FT sequence stands"),
    ],
)  # fmt: skip
def test_fault_in_pause_ends_run(
    strike: Callable[[WallBench], None], error: type[Exception], says: str, tmp_path: Path
) -> None:
    with wall_bench(tmp_path, camera=False) as bench:
        acts = Acts(
            ("p1/d1.00/press", lambda: os.kill(os.getpid(), signal.SIGUSR1)),
            ("paused: by the operator", lambda: strike(bench)),
        )
        with pytest.raises(error, match=says):
            bench.run(bench.writer(), live=acts)
    assert event(tmp_path / "r", "paused")
    assert not event(tmp_path / "r", "continued")
    if error is Stopped:
        with wall_bench(tmp_path, camera=False) as bench:
            bench.run(bench.writer())
        steps = open_run(tmp_path / "r").steps()
        assert [*steps["step_id"]] == [step.id for step in bench.steps]
