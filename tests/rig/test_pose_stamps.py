"""A position's time: when the controller read it, not when the host came to hear of it."""

from __future__ import annotations

import math

import pytest

from deltact_fab.optics import StageFrame
from deltact_fab.rig.stage.grbl import GrblStage
from deltact_fab.virtual import wire
from deltact_fab.virtual.clock import VirtualClock
from deltact_fab.virtual.controller import GrblController

FRAME = StageFrame((-60.0, -50.0, -40.0), angle_deg=30.0, tilt_deg=(0.5, -1.0))
ROUNDING_MM = 0.002  # half a step and half a digit of the report, on three axes


@pytest.mark.parametrize("baud", [9600, 115200, 1_000_000])
def test_in_motion_it_is_where_the_carriage_was_then(baud: int) -> None:
    clock = VirtualClock(1234.5)
    grbl = GrblController(None, clock)
    link = wire.SerialLink(grbl, clock, baud=baud)
    stage = GrblStage(link, clock, FRAME, baud=baud)
    stage.connect()
    stage.home()
    stage.start_move((0.0, 0.0, 5.0), 1200.0)
    before_ns = 0
    for _ in range(30):
        clock.sleep_s(0.0713)
        t_ns, position_mm = stage.located()
        assert before_ns < t_ns < clock.now_ns()
        before_ns = t_ns
        truth_mm = FRAME.to_sensor_mm(grbl.position_mm(t_ns / 1e9))
        assert math.dist(position_mm, truth_mm) < ROUNDING_MM
    assert stage.identity()["pose_within_s"] < 1e-6  # nothing else is on the wire
    stage.stop()
