"""One thread drives, others ask and stop: real threads, a real terminal, on the wall clock."""

from __future__ import annotations

import itertools
import os
import signal
import termios
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from subprocess import PIPE

import pytest
from board import Board, board
from called import started

from deltact_fab.bench.rig.interface import WallClock
from deltact_fab.bench.rig.stage.grbl import GrblStage
from deltact_fab.common.errors import StageError
from deltact_fab.sensor.optics.camera import StageFrame

pytestmark = [
    pytest.mark.skipif(not hasattr(os, "openpty"), reason="needs pseudo terminals"),
    pytest.mark.usefixtures("no_boot_loader"),
]

END_MM = (-100.0, -1.0, -1.0)  # some 5 s away


@contextmanager
def homed(settings: dict[int, float] | None = None) -> Iterator[tuple[Board, GrblStage]]:
    with board(settings) as it:
        stage = GrblStage(it.port, WallClock(), StageFrame((0.0, 0.0, 0.0)))
        stage.connect()
        stage.home()
        try:
            yield it, stage
        finally:
            stage.close()


class Other(threading.Thread):
    """Does something in a thread of its own and keeps what it raised."""

    def __init__(self, what: Callable[[], object], after_s: float = 0.0) -> None:
        super().__init__()
        self.what = what
        self.after_s = after_s
        self.raised: BaseException | None = None
        self.start()

    def run(self) -> None:
        try:
            time.sleep(self.after_s)
            self.what()
        except BaseException as why:
            self.raised = why

    def ended(self) -> str:
        self.join(30)
        assert not self.is_alive()
        return str(self.raised or "")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("how", "says"),
    [("stop", "short of"), ("abort", "reset while moving|the controller was reset")],
)
def test_other_thread_can_end_move(how: str, says: str) -> None:
    with homed() as (it, stage):
        stage.start_move(END_MM, 1200.0)
        other = Other(getattr(stage, how), after_s=0.3)
        with pytest.raises(StageError, match=says):
            stage.wait()
        assert other.ended() == ""
        assert -60 < it.at_mm()[0] < -1
        if how == "abort":
            stage.home()
            assert it.at_mm() == (-0.2, -0.2, -0.2)
        else:
            stage.start_move((-1.0, -1.0, -1.0), 1200.0)  # the position was kept
            assert stage.wait().machine_mm == (-1.0, -1.0, -1.0)


@pytest.mark.parametrize("how", ["stop", pytest.param("abort", marks=pytest.mark.slow)])
def test_other_thread_can_end_homing(how: str) -> None:
    with homed({25: 300.0}) as (it, stage):
        stage.start_move((-15.0, -15.0, -15.0), 1200.0)
        stage.wait()
        driver = Other(stage.home)
        it.hears(b"$H", 30)
        while it.state() != "Home":
            time.sleep(0.005)
        getattr(stage, how)()
        assert "ALARM:6 (reset while homing)" in driver.ended()
        assert it.at_mm()[2] < -1
        assert b"\x85" not in b"".join(data for _, data in it.heard)
        it.grbl.settings[25] = 1200
        stage.home()  # another thread may take over
        assert it.at_mm() == (-0.2, -0.2, -0.2)


def test_cancel_while_driver_waits_for_answer() -> None:
    """The line is on its way, nothing was answered yet, and 0x85 does nothing."""
    with homed() as (it, stage):
        command = stage._c.talk.command

        def slowly(line: str, limit_s: float = 1.0) -> list[str]:
            assert Other(stage.cancel).ended() == ""  # before the controller has the line
            return command(line, limit_s)

        stage._c.talk.command = slowly  # type: ignore[method-assign]
        stage.start_move(END_MM, 1200.0)
        with pytest.raises(StageError, match="short of"):
            stage.wait()
        assert it.at_mm()[0] > -20


def test_cancel_before_line_prevents_sending() -> None:
    with homed() as (it, stage):
        drain = stage._c.talk.drain

        def cancelled() -> None:
            drain()
            stage.cancel()

        stage._c.talk.drain = cancelled  # type: ignore[method-assign]
        with pytest.raises(StageError, match="stopped before it moved"):
            stage.start_move(END_MM, 1200.0)
        assert not any(b"$J=" in data for _, data in it.heard)


@pytest.mark.slow
def test_many_pollers_never_mix_their_answers() -> None:
    """No 'multiple access on port': one exchange at a time."""
    with homed() as (it, stage):
        done = threading.Event()
        seen: list[list[tuple[int, tuple[float, float, float]]]] = [[], [], []]

        def ask(mine: list[tuple[int, tuple[float, float, float]]]) -> None:
            while not done.is_set():
                mine.append(stage.timed_position())

        others = [Other(lambda mine=mine: ask(mine)) for mine in seen]  # type: ignore[misc]
        for x in (-8.0, -1.0, -5.0):
            stage.start_move((x, -1.0, -1.0), 1200.0)
            stage.wait()
        stage.start_move(END_MM, 1200.0)
        time.sleep(0.1)
        stage.stop()  # the driver's own, whoever asked last: it waits for rest
        assert it.state() == "Idle"
        done.set()
        assert [other.ended() for other in others] == ["", "", ""]
        for mine in seen:
            assert len(mine) > 3
            assert all(a < b for (a, _), (b, _) in itertools.pairwise(mine))


def test_second_host_is_refused() -> None:
    with homed() as (it, stage):
        sent = len(it.heard)
        with pytest.raises(StageError, match="another program uses this stage; end it first"):
            GrblStage(it.port, WallClock(), StageFrame((0.0, 0.0, 0.0))).connect()
        assert len(it.heard) == sent  # it wrote nothing
        assert stage.homed


def test_closing_port_leaves_dtr_high() -> None:
    """Its fall and rise at the next opening would restart an Arduino, and lose the count."""
    with board() as it:
        held = os.open(it.port, os.O_RDWR | os.O_NOCTTY)
        try:
            flags = termios.tcgetattr(held)
            flags[2] |= termios.HUPCL
            termios.tcsetattr(held, termios.TCSANOW, flags)
            stage = GrblStage(it.port, WallClock(), StageFrame((0.0, 0.0, 0.0)))
            stage.connect()
            stage.close()
            assert not termios.tcgetattr(held)[2] & termios.HUPCL
        finally:
            os.close(held)


DOWN, UP = b"$J=", b"Z-2.0000"  # in the first line of the press, in that of the lift
HOST = """
import sys
from deltact_fab.sensor import StageFrame
from deltact_fab.bench.rig.interface import WallClock
from deltact_fab.bench.rig.stage.grbl import GrblStage
from deltact_fab.bench.rig.run.loop import interruptible

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
def test_second_signal_in_lift_resets_once() -> None:
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
    assert err.startswith("deltact-fab: stopped immediately by a second signal")
