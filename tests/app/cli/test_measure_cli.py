"""`deltact-fab measure`, as a shell and a program meet it."""

from __future__ import annotations

import json
import signal
import socket
import subprocess
import sys
from pathlib import Path

import pytest
from called import started

from deltact_fab.bench.record.run import open_run

COMMAND = [sys.executable, "-m", "deltact_fab.app.cli.main", "measure"]


@pytest.mark.slow
def test_jsonl_line_per_image(mini_run: Path) -> None:
    done = subprocess.run(
        [*COMMAND, str(mini_run), "--jsonl"], capture_output=True, text=True, check=True
    )
    rows = [json.loads(line) for line in done.stdout.splitlines()]
    frames = open_run(mini_run).frames()
    assert [row["frame"] for row in rows] == list(range(len(frames)))
    assert [row["t_s"] for row in rows] == pytest.approx(frames["t_s"], abs=1e-6)
    assert {row["simulated"] for row in rows} == {"simulated, seed 3"}
    assert all(row["trusted"] and 0.9 < row["cover"] <= 1 for row in rows)
    assert {row["force_n"] for row in rows} == {None}  # nothing calibrates it, nothing is made up


@pytest.mark.slow
def test_ctrl_c_exits_130_complete_lines(mini_run: Path) -> None:
    # Without a pipe's buffer of results in front of us: it is measuring when it is interrupted.
    words = [*COMMAND[1:], str(mini_run), "--jsonl", "--hz", "2"]
    with started(*words, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as going:
        assert going.stdout is not None
        first = going.stdout.readline()
        going.send_signal(signal.SIGINT)
        rest, said = going.communicate(timeout=60)
    assert going.returncode == 130
    assert said == ""
    rows = [json.loads(line) for line in (first + rest).splitlines()]
    assert [row["frame"] for row in rows] == list(range(len(rows)))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("asked", "told"),
    [
        ([], "Missing argument 'SOURCE'"),
        (["{run}", "--show", "forc"], "did you mean"),
        (["{run}", "--show", "force"], "needs a force calibration"),
        (["{run}", "--calibration", "{run}/protocol.toml"], "not a calibration"),
        (["{run}", "--calibration", "{run}/none.toml"], "no such file"),
        (["{run}", "--camera", "{run}/none.toml"], "none.toml"),
        (["{run}", "--view", "--port", "99999"], "0<=x<=65535"),
        (["{run}", "--view", "--port", "{taken}"], "in use; omit --port for a free one"),
    ],
)
def test_unmeasurable_source_is_one_line(asked: list[str], told: str, mini_run: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as other:
        names = {"run": mini_run, "taken": other.getsockname()[1]}
        done = subprocess.run(
            [*COMMAND, *(word.format(**names) for word in asked)], capture_output=True, text=True
        )
    assert done.returncode == 2
    assert told in done.stderr
    assert done.stderr.count("\n") == 1
