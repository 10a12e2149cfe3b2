"""Somebody else's host, pygrbl-streamer, drives the simulated controller over a real terminal."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Callable, Iterator
from typing import Any

import pytest

from deltact_fab.errors import StageError
from deltact_fab.optics import StageFrame
from deltact_fab.rig.clock import WallClock
from deltact_fab.rig.stage.grbl import GrblStage
from deltact_fab.virtual.controller import GrblController
from deltact_fab.virtual.pty import PtyCable

streamer = pytest.importorskip("pygrbl_streamer")
pytestmark = pytest.mark.skipif(not hasattr(os, "openpty"), reason="needs pseudo terminals")

QUICK = {24: 1200, 25: 1200, 26: 5, 27: 0.2, 120: 2000, 121: 2000, 122: 2000}


class Host:
    """The third-party host, connected, and all that it heard."""

    def __init__(self, terminal: PtyCable) -> None:
        self.terminal = terminal
        self.alarms: list[str] = []
        self.errors: list[str] = []
        self.it: Any = streamer.GrblStreamer(terminal.port, auto_unlock=False)
        self.it.alarm_callback = self.alarms.append
        self.it.error_callback = self.errors.append
        self.it.connect()

    def at_mm(self) -> tuple[float, float, float]:
        with self.terminal.lock:
            return self.terminal.controller.position_mm()


@pytest.fixture
def host() -> Iterator[Host]:
    clock = WallClock()
    grbl = GrblController(QUICK, clock, start_mm=(-1, -1, -1), boot_s=0.05)
    with PtyCable(grbl, clock) as terminal:
        time.sleep(0.1)
        found = Host(terminal)
        try:
            yield found
        finally:
            found.it.disconnect()


def until(what: Callable[[], object], within_s: float = 20.0) -> None:
    deadline = time.monotonic() + within_s
    while not what():
        assert time.monotonic() < deadline, f"waited {within_s} s for nothing"
        time.sleep(0.01)


def at_rest(host: Host) -> bool:
    before_mm = host.at_mm()
    time.sleep(0.05)
    return host.at_mm() == before_mm


@pytest.mark.slow
def test_a_job_is_homed_streamed_and_done(host: Host) -> None:
    assert not host.it.command("G1X-2F600")  # locked, as it was switched on
    assert host.it.home(wait_idle=True)
    assert host.at_mm() == (-0.2, -0.2, -0.2)
    square = [(-2.0, -2.0), (-4.0, -2.0), (-4.0, -4.0), (-2.0, -4.0)] * 6  # more than a buffer full
    job = ["(a job)", "G21 G90", *(f"G1 X{x} Y{y} F1500" for x, y in square), "G4 P0.1"]
    assert host.it.stream(job, completion_timeout=60, ack_timeout=10)
    assert host.at_mm() == pytest.approx((-2.0, -4.0, -0.2))
    assert host.it.command("$J=G91 X-1 Y1 F1500")
    host.it.realtime(b"?")
    until(lambda: host.it.last_status.get("state") in ("Jog", "Idle"))
    assert host.it.sync() is streamer.State.IDLE
    until(lambda: host.at_mm() == pytest.approx((-3.0, -3.0, -0.2)))
    assert (host.errors, host.alarms) == (["error:9"], [])


@pytest.mark.slow
def test_errors_holds_and_alarms_are_as_that_host_expects_them(host: Host) -> None:
    assert host.it.home(wait_idle=True)
    assert not host.it.stream(["G1X-2F600", "G7", "G1X-3"], stop_on_error=True, ack_timeout=10)
    until(lambda: host.errors == ["error:20"])
    until(lambda: host.terminal.controller.state == "Idle")
    assert host.it.reset(unlock=False)  # at rest: the position is kept

    job = threading.Thread(
        target=lambda: host.it.stream(["G1X-60F1500"], completion_timeout=60, ack_timeout=10)
    )
    job.start()
    until(lambda: host.at_mm()[0] < -1)
    host.it.pause()
    until(lambda: host.terminal.controller.state == "Hold")
    until(lambda: at_rest(host))  # it brakes first
    held_mm = host.at_mm()
    time.sleep(0.3)
    assert host.at_mm() == held_mm
    host.it.resume()
    until(lambda: host.at_mm()[0] < held_mm[0] - 0.5)
    host.it.stop()
    job.join()
    stopped_mm = host.at_mm()
    assert -60 < stopped_mm[0] < held_mm[0]

    host.it.write_line("G1X5F600")  # past the soft limit
    until(lambda: host.alarms)
    assert host.alarms[0].startswith("ALARM:2")
    assert host.at_mm() == stopped_mm


@pytest.mark.slow
def test_our_host_is_refused_while_that_one_has_the_port(host: Host) -> None:
    ours = GrblStage(host.terminal.port, WallClock(), StageFrame((0.0, 0.0, 0.0)))
    with pytest.raises(StageError, match="another program drives this stage; end it first"):
        ours.connect()
    assert host.it.home(wait_idle=True)
