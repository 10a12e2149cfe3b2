"""Decision between two presses if a run ends: made while stage and guard are watched."""

from __future__ import annotations

import os
import signal
import sqlite3
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import closing
from pathlib import Path

import pytest
from wall_bench import WallBench, wall_bench

from deltact_fab.bench.record.run import open_run
from deltact_fab.bench.rig.run.runner import RunProgress
from deltact_fab.common.errors import InputError, SensorError, StageError, Stopped

pytestmark = [
    pytest.mark.skipif(not hasattr(os, "openpty"), reason="needs pseudo terminals"),
    pytest.mark.slow,
]


def texts(folder: Path) -> list[str]:
    """Decisions in the journal of a run that has no plan on the disk."""
    with closing(sqlite3.connect(folder / "r" / "journal.sqlite")) as db:
        query = "SELECT text FROM events WHERE kind = 'decision' ORDER BY seq"
        return [text for (text,) in db.execute(query)]


def test_decision_ends_run_between_presses(tmp_path: Path) -> None:
    asked: list[Sequence[str]] = []
    shown: list[str] = []
    in_thread: list[bool] = []

    def decide(presses: Sequence[str]) -> tuple[bool, str]:
        asked.append(tuple(presses))
        in_thread.append(threading.current_thread() is not threading.main_thread())
        if not presses:
            return False, ""
        time.sleep(1.0)
        return True, f"after {len(presses)}"

    def live(progress: RunProgress) -> None:
        shown.append(progress.step)

    with wall_bench(tmp_path, camera=False) as bench:
        writer = bench.writer()
        bench.run(writer, decide=decide, live=live)
        assert bench.board.at_mm()[2] >= -17.0 - 0.01  # clearance_mm above the face
    # Before the rig is open, before its first indenter and press, and after the first press.
    assert asked[-1] == ("sphere-6/p1",)
    assert set(asked[:-1]) == {()}
    assert in_thread == [False] + [True] * (len(asked) - 1)
    assert writer.skipped == ("sphere-6/p2",)
    assert texts(tmp_path) == ["after 1"]
    assert "paused: estimate after 1 presses" in shown
    assert set(open_run(tmp_path / "r").steps()["press"]) == {"sphere-6/change", "sphere-6/p1"}


def board_silent(bench: WallBench) -> None:
    with bench.board.terminal.lock:
        bench.board.grbl.fault("silence")


@pytest.mark.parametrize(
    ("strike", "error", "says"),
    [
        (lambda bench: os.kill(os.getpid(), signal.SIGINT), Stopped, "the tip was lifted"),
        (board_silent, StageError, "no answer"),
        (lambda bench: setattr(bench.server.faults, "frozen", True), SensorError,
         "the FT sequence stands"),
    ],
)  # fmt: skip
def test_fault_while_deciding_ends_run(
    strike: Callable[[WallBench], None], error: type[Exception], says: str, tmp_path: Path
) -> None:
    done = threading.Event()
    with wall_bench(tmp_path, camera=False) as bench:

        def decide(presses: Sequence[str]) -> tuple[bool, str]:
            if presses:
                strike(bench)
                done.wait(60.0)
            return False, ""

        since_s = time.monotonic()
        with pytest.raises(error, match=says):
            bench.run(bench.writer(), decide=decide)
        assert time.monotonic() - since_s < 50  # nobody waits for the decision
        done.set()
    assert texts(tmp_path) == []
    with wall_bench(tmp_path, camera=False) as bench:
        bench.run(bench.writer(), decide=lambda presses: (False, f"after {len(presses)}"))
    assert [*open_run(tmp_path / "r").steps()["step_id"]] == [step.id for step in bench.steps]
    assert texts(tmp_path)[-1] == "after 2"


def test_failed_decision_keeps_presses(tmp_path: Path) -> None:
    def decide(presses: Sequence[str]) -> tuple[bool, str]:
        if presses:
            raise InputError("no pattern")
        return False, ""

    with wall_bench(tmp_path, camera=False) as bench:
        with pytest.raises(InputError, match=r"no pattern \(the tip"):
            bench.run(bench.writer(), decide=decide)
        writer = bench.writer()
        assert "sphere-6/p1" in writer.kept_presses
        writer.abandon()
