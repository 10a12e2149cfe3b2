"""Some faults of a rehearsal at the wall clock: a real terminal, UDP, a camera's process."""

from __future__ import annotations

import math
import os
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from wall_bench import WallBench, wall_bench

from deltact_fab import record
from deltact_fab.errors import StageError
from deltact_fab.rig.run.live import Live

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not hasattr(os, "openpty"), reason="needs pseudo terminals"),
]


def unplugged(bench: WallBench) -> None:
    bench.board.terminal.unplug()


def silent(bench: WallBench) -> None:
    with bench.board.terminal.lock:
        bench.board.grbl.fault("silence")


def false_alarm(bench: WallBench) -> None:
    with bench.board.terminal.lock:
        bench.board.grbl._say("ALARM:3")


def opened(bench: WallBench) -> None:
    with bench.board.terminal.lock:
        bench.board.grbl.fault("door")


@pytest.mark.parametrize(
    ("strike", "says"),
    [
        (unplugged, "the link is lost"),
        (silent, "no answer to"),
        (false_alarm, "ALARM:3"),
        (opened, "Door"),
    ],
)
def test_a_fault_in_a_press_has_its_name_and_the_run_is_resumed_whole(
    tmp_path: Path, strike: Callable[[WallBench], None], says: str
) -> None:
    struck: list[float] = []
    with wall_bench(tmp_path, silent_s=5.0) as bench:

        def once(live: Live) -> None:
            if live.step.endswith("p2/d1.00/press") and not struck:
                struck.append(time.monotonic())
                strike(bench)

        with pytest.raises(StageError, match=says):
            bench.run(bench.writer(), live=once)
        told_s = time.monotonic() - struck[0]
        time.sleep(2.0)  # a jog that no byte can reach has run to its end
        rest_mm = bench.board.at_mm()
        time.sleep(0.3)
        assert math.dist(rest_mm, bench.board.at_mm()) == 0
    print(f"{says}: told {told_s:.2f} s after the fault")
    kept = set(record.open(tmp_path / "r").frames()["frame_id"])
    assert {i for i in kept if "/p1/" in i}
    with wall_bench(tmp_path, silent_s=5.0) as bench:
        writer = bench.writer()
        assert "sphere-6/p1" in writer.kept
        bench.run(writer)
    run = record.open(tmp_path / "r")
    assert [*run.steps()["step_id"]] == [step.id for step in bench.steps]
    frames = run.frames()
    assert frames["frame_id"].is_unique
    assert {i for i in kept if "/p1/" in i} <= set(frames["frame_id"])
