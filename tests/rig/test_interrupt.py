"""Signals in mid-move, in processes of their own: the first lifts, the second stops at once."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from subprocess import PIPE

import pytest
from board import board
from called import started

pytestmark = pytest.mark.skipif(not hasattr(os, "openpty"), reason="needs pseudo terminals")

DOWN, UP = b"$J=", b"Z-2.0000"  # in the first line of the press, in that of the lift
HOST = """
import sys
from deltact_fab.optics import StageFrame
from deltact_fab.rig.clock import WallClock
from deltact_fab.rig.stage.grbl import GrblStage
from deltact_fab.rig.run.interrupt import interruptible

stage = GrblStage(sys.argv[1], WallClock(), StageFrame((0.0, 0.0, 0.0)))
with interruptible(stage.abort):
    stage.connect()
    stage.home()
    stage.start_move((-1.0, -1.0, -19.0), 1000.0)
    try:
        stage.wait()
    except KeyboardInterrupt:
        stage.stop()
        x, y, _ = stage.position_mm()
        stage.start_move((x, y, -2.0), 20.0)
        stage.wait()
        print("lifted", flush=True)
        sys.exit(1)
"""


@pytest.mark.slow
@pytest.mark.parametrize(
    ("first", "second"),
    [(signal.SIGINT, signal.SIGINT), (signal.SIGTERM, signal.SIGHUP)],
)
def test_the_second_signal_resets_in_the_lift_and_ends_with_one_line(
    first: signal.Signals, second: signal.Signals
) -> None:
    with board() as it:
        with started("-c", HOST, it.port, stdout=PIPE, stderr=PIPE) as host:
            it.hears(DOWN)
            time.sleep(0.3)
            host.send_signal(first)
            it.hears(b"\x85")
            it.hears(UP)
            time.sleep(0.1)
            assert it.state() == "Jog"
            sent_s = time.monotonic()
            host.send_signal(second)
            came_s = it.hears(b"\x18")
            out, err = host.communicate(timeout=30)
        assert it.state() == "Alarm"
        stopped_mm = it.at_mm()
        time.sleep(0.2)
        assert it.at_mm() == stopped_mm
        assert stopped_mm[2] < -2.5  # short of the lift's end
    # Not asserted: how long the machine lets either process wait is not ours.
    print(f"0x18 came {1000 * (came_s - sent_s):.1f} ms after the signal")
    assert host.returncode == 130
    assert out == ""
    assert len(err.splitlines()) == 1
    assert err.startswith("deltact-fab: stopped at once by a second signal")


@pytest.mark.slow
def test_the_first_signal_stops_and_lets_the_lift_go_on() -> None:
    with board() as it:
        fast = HOST.replace("20.0)", "1000.0)")
        with started("-c", fast, it.port, stdout=PIPE, stderr=PIPE) as host:
            it.hears(DOWN)
            time.sleep(0.3)
            host.send_signal(signal.SIGTERM)
            out, err = host.communicate(timeout=30)
        assert (host.returncode, out, err) == (1, "lifted\n", "")
        assert not any(b"\x18" in data for _, data in it.heard)
        assert it.at_mm()[2] == -2.0


# A run in lockstep whose operator interrupts it in its first press, and again in the lift.
RUN = """
import os, signal
from deltact_fab.cli.main import entry
from deltact_fab.rig.stage.grbl import GrblStage
from deltact_fab.virtual import wire

start_move, send = GrblStage.start_move, wire.SerialLink.write
pressed = False

def interrupted(self, target_mm, feed_mm_min):
    global pressed
    planned_s = start_move(self, target_mm, feed_mm_min)
    if pressed or target_mm[2] < 0:
        pressed = True
        os.kill(os.getpid(), signal.SIGINT)
    return planned_s

def watched(self, data):
    send(self, data)
    if data == bytes([0x18]):
        print(self.controller.state, flush=True)

GrblStage.start_move, wire.SerialLink.write = interrupted, watched
entry()
"""


@pytest.mark.slow
def test_a_run_that_is_interrupted_in_its_lift(mini: tuple[Path, Path], tmp_path: Path) -> None:
    short = tmp_path / "short.toml"
    text = mini[0].read_text().replace('"sphere:10", "4dots"', '"sphere:6"')
    short.write_text(text.replace("depths_mm = [1.0]", "depths_mm = [0.4]"))
    done = subprocess.run(
        [
            sys.executable, "-c", RUN,
            "run", str(short), "--rig", str(mini[1]), "--out", str(tmp_path / "r"),
        ],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 130
    assert done.stdout == "Alarm\n"
    # A run that takes over 5 s on loaded cores tells how far it is.
    told = [line for line in done.stderr.splitlines() if not line.startswith("run: ")]
    assert len(told) == 1
    assert told[0].startswith("deltact-fab: stopped at once by a second signal")
    assert (tmp_path / "r" / "journal.sqlite").exists()
