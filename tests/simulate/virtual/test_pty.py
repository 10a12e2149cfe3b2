"""The simulated controller on a pseudo terminal: the real host on it, and the faults of a cable."""

from __future__ import annotations

import os
import time

import pytest

from deltact_fab.bench.rig.interface import WallClock
from deltact_fab.bench.rig.stage.grbl import GrblStage
from deltact_fab.sensor.optics.camera import StageFrame
from deltact_fab.simulate.virtual.controller import GrblController
from deltact_fab.simulate.virtual.pty import PtyCable

pytestmark = [
    pytest.mark.skipif(not hasattr(os, "openpty"), reason="needs pseudo terminals"),
    pytest.mark.usefixtures("no_boot_loader"),
]
QUICK = {24: 1200, 25: 3000, 26: 5, 27: 0.2, 120: 2000, 121: 2000, 122: 2000}


def powered(resets_on_open: bool = False, opened: list[bool] | None = None) -> PtyCable:
    clock = WallClock()
    grbl = GrblController(QUICK, clock, start_mm=(-1, -1, -1), boot_s=0.1)
    note = None if opened is None else opened.append
    return PtyCable(grbl, clock, resets_on_open=resets_on_open, on_open=note)


def host(terminal: PtyCable) -> GrblStage:
    return GrblStage(terminal.port, WallClock(), StageFrame((0.0, 0.0, 0.0)))


def test_real_host_moves_the_stage() -> None:
    opened: list[bool] = []
    with powered(resets_on_open=True, opened=opened) as terminal:
        stage = host(terminal)
        stage.connect()
        stage.home()
        stage.start_move((-5.0, -5.0, -5.0), 600.0)
        stage.wait()
        assert terminal.controller.position_mm() == pytest.approx((-5, -5, -5), abs=2e-3)
        stage.close()
        for _ in range(500):
            if opened == [True, False]:
                break
            time.sleep(0.01)
    assert opened == [True, False]
