"""Feed hold and safety door: a move in them is an error, the position is kept, nothing resumes."""

from __future__ import annotations

import math

import hosted
import pytest
from hosted import MACHINE_MM, TARGET_MM

from deltact_fab.common.errors import StageError


class Bench(hosted.Bench):
    def __init__(self) -> None:
        super().__init__(resets_on_open=False)
        self.homed(2.0)

    def said(self) -> str:
        """What the controller answers to `?` now."""
        self.grbl.take_output()
        self.grbl.write(b"?")
        return self.grbl.read_available().decode()

    def goes_on(self) -> None:
        """To the target from where it is, without homing."""
        self.stage.start_move(TARGET_MM, 600.0)
        assert self.stage.wait().machine_mm == MACHINE_MM
        assert self.grbl.position_mm() == pytest.approx(MACHINE_MM, abs=1e-9)
        assert self.sent().count(b"$H\n") == 1
        assert b"~" not in b"".join(self.sent())


def test_door_opens_during_a_move() -> None:
    bench = Bench()
    bench.moving()
    bench.grbl.fault("door")
    with pytest.raises(StageError, match=r"Door:1 \(the safety door is open\) during a move to"):
        bench.stage.wait()
    stopped_mm = bench.grbl.position_mm()
    assert math.dist(stopped_mm, MACHINE_MM) > 40
    for attempt in (bench.stage.stop, lambda: bench.stage.start_move(TARGET_MM, 600.0)):
        with pytest.raises(StageError, match="the safety door is open: close it"):
            attempt()
    with pytest.raises(StageError, match="the safety door is open: close it"):
        bench.stage.home()
    assert bench.grbl.position_mm() == stopped_mm


@pytest.mark.parametrize("mended_by", ["stop", "move"])
def test_closed_door_keeps_the_position(mended_by: str) -> None:
    bench = Bench()
    bench.moving()
    bench.grbl.fault("door")
    with pytest.raises(StageError, match="Door:1"):
        bench.stage.wait()
    stopped_mm = bench.grbl.position_mm()
    bench.grbl.fault("door closes")
    if mended_by == "stop":
        bench.stage.stop()
        bench.clock.sleep_s(5)
        assert bench.grbl.position_mm() == stopped_mm  # nothing was resumed
        at_mm = bench.stage.position_mm()
        assert at_mm == pytest.approx(
            [a - b for a, b in zip(stopped_mm, (-60, -50, -40), strict=True)], abs=2e-3
        )
    bench.goes_on()


def test_a_door_between_two_moves() -> None:
    """The line waits in the controller's buffer, and is forgotten by the reset."""
    bench = Bench()
    bench.grbl.fault("door")
    with pytest.raises(
        StageError, match=r"Door:1 \(the safety door is open\): no move was started"
    ):
        bench.stage.start_move(TARGET_MM, 600.0)
    bench.grbl.fault("door closes")
    bench.stage.stop()
    bench.grbl.write(b"~")
    bench.clock.sleep_s(30)
    assert bench.grbl.position_mm() == (-1.0, -1.0, -1.0)
    bench.goes_on()


def test_a_door_that_opens_while_homing() -> None:
    bench = Bench()
    bench.grbl.fault("door", at_s=bench.clock.now_s() + 0.5)
    with pytest.raises(StageError, match=r"ALARM:7 \(door opened while homing\)"):
        bench.stage.home()
    bench.grbl.fault("door closes")
    bench.stage.home()
    assert bench.grbl.position_mm() == (-1.0, -1.0, -1.0)


def test_hold_ends_a_jog() -> None:
    bench = Bench()
    bench.moving()
    bench.grbl.fault("hold")
    with pytest.raises(StageError, match="short of"):
        bench.stage.wait()
    bench.clock.sleep_s(1)
    bench.grbl.fault("hold")
    assert bench.said().startswith("<Hold:0|")
    bench.stage.stop()
    assert bench.said().startswith("<Idle|")
    bench.goes_on()


@pytest.mark.parametrize("kind", ["hold", "door"])
def test_connecting_and_homing_where_it_waits(kind: str) -> None:
    bench = Bench()
    bench.stage.close()
    bench.grbl.fault(kind)  # type: ignore[arg-type]
    if kind == "door":
        with pytest.raises(StageError, match="the safety door is open: close it"):
            bench.stage.connect()
        bench.grbl.fault("door closes")
    bench.stage.connect()
    assert bench.grbl.state == "Idle"
    bench.grbl.fault("hold")
    bench.stage.home()
    bench.stage.start_move(TARGET_MM, 600.0)
    assert bench.stage.wait().machine_mm == MACHINE_MM


def test_reset_marks_the_position_lost() -> None:
    bench = Bench()
    bench.grbl.fault("hold")

    def rebooted(data: bytes, write=bench.grbl.write) -> None:  # type: ignore[no-untyped-def]
        if data == b"\x18":
            bench.grbl.fault("reboot")
            return
        write(data)

    bench.grbl.write = rebooted  # type: ignore[method-assign]
    with pytest.raises(StageError, match=r"position (is|was) lost"):
        bench.stage.stop()
    with pytest.raises(StageError, match="no motion after a fault"):
        bench.stage.start_move(TARGET_MM, 600.0)
