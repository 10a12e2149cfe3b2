"""`rig simulate`: a rig file's devices on real wires, and the commands that take a real rig."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from called import called

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not hasattr(os, "openpty"), reason="needs pseudo terminals"),
]


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """The rig file of a bench that is served by a process of its own."""
    folder = tmp_path_factory.mktemp("served")
    program = [sys.executable, "-m", "deltact_fab", "rig", "simulate", "virtual", "--out", "bench"]
    with subprocess.Popen(program, cwd=folder, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert "simulated devices, until Ctrl-C" in process.stdout.readline()
        yield folder / "bench" / "rig.toml"
        process.send_signal(signal.SIGINT)
        assert process.wait(20) == 0


def test_check_of_served_bench_passes(bench: Path) -> None:
    done = called("rig", "check", str(bench), "--seconds", "0.5", cwd=bench.parent)
    wrong = [line for line in done.stdout.splitlines() if line.startswith("FAIL")]
    # The program that draws the images shares two cores with other tests.
    assert [line for line in wrong if "images per s" not in line] == []
    assert done.returncode == bool(wrong)
    assert "transducer simulated" in done.stdout


def test_homing_twice_raises_no_alarm(bench: Path) -> None:
    for how in ("position lost; force sensor reads", "position known: lifted"):
        done = called("rig", "home", str(bench), "--yes", cwd=bench.parent)
        assert done.returncode == 0, done.stderr
        assert how in done.stdout
        assert "machine -1.000, -1.000, -1.000" in done.stdout


def test_run_states_that_devices_are_simulated(bench: Path) -> None:
    done = called("run", "first-moves", "--rig", str(bench), "--air", "--unattended",
                  "--out", "run", cwd=bench.parent)  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert "(simulated)" in done.stdout
    checked = called("record", "check", "run", cwd=bench.parent)
    assert checked.returncode == 0, checked.stdout
