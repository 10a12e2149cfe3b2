"""A second signal in mid-move, to a process of its own: it stops at once.

The first is sent to a run, in test_bench.
"""

from __future__ import annotations

import os
import signal
import time
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
def test_the_second_signal_resets_in_the_lift_and_ends_with_one_line() -> None:
    with board() as it:
        with started("-c", HOST, it.port, stdout=PIPE, stderr=PIPE) as host:
            it.hears(DOWN)
            time.sleep(0.3)
            host.send_signal(signal.SIGTERM)
            it.hears(b"\x85")
            it.hears(UP)
            time.sleep(0.1)
            assert it.state() == "Jog"
            host.send_signal(signal.SIGHUP)
            it.hears(b"\x18")
            out, err = host.communicate(timeout=30)
        assert it.state() == "Alarm"
        stopped_mm = it.at_mm()
        time.sleep(0.2)
        assert it.at_mm() == stopped_mm
        assert stopped_mm[2] < -2.5  # short of the lift's end
    assert host.returncode == 130
    assert out == ""
    assert len(err.splitlines()) == 1
    assert err.startswith("deltact-fab: stopped at once by a second signal")
