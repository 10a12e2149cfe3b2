"""Homing by hand has the guard armed, as homing of a run has."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass

import numpy as np
import pytest
from board import Board, board

from deltact_fab.errors import SensorError
from deltact_fab.optics import StageFrame
from deltact_fab.rig.clock import WallClock
from deltact_fab.rig.force.config import ForceConfig, GuardConfig, NetFTConfig
from deltact_fab.rig.force.guard import ForceGuard, GuardLimits
from deltact_fab.rig.force.open import open_force
from deltact_fab.rig.interface import ForceSensor
from deltact_fab.rig.stage.grbl import GrblStage
from deltact_fab.rig.tool.homing import home_safely
from deltact_fab.virtual.netft_server import NetFTServer

pytestmark = [
    pytest.mark.skipif(not hasattr(os, "openpty"), reason="needs pseudo terminals"),
    pytest.mark.usefixtures("no_boot_loader"),
]


@dataclass
class Bench:
    board: Board
    server: NetFTServer
    stage: GrblStage
    force: ForceSensor
    guard: ForceGuard
    push_n: list[float]

    def home(self) -> str:
        """Connect and home."""
        self.stage.connect()
        return home_safely(
            self.stage, self.stage.clock, self.force, None, tip_is_clear=True, guard=self.guard
        )


@contextmanager
def bench() -> Iterator[Bench]:
    push_n = [0.0]
    with ExitStack() as held:
        it = held.enter_context(board({25: 60.0}))  # a slow search
        config = ForceConfig(rate_hz=500.0)
        server = held.enter_context(
            NetFTServer(lambda t_ns: np.outer(np.ones(len(t_ns)), [0, 0, push_n[0], 0, 0, 0]))
        )
        clock = WallClock()
        stage = GrblStage(it.port, clock, StageFrame((-30.0, -30.0, -20.0)))
        held.callback(stage.close)
        net = NetFTConfig(
            host="127.0.0.1", rdt_port=server.rdt_port, http_port=server.http_port, silent_s=1
        )
        # The box is in this process: on a busy machine it may be kept from running for a while.
        force = open_force(config.model_copy(update={"netft": net}), clock)
        held.callback(force.close)
        limits = GuardLimits.of(GuardConfig(force_n=5.0), config)
        yield Bench(it, server, stage, force, ForceGuard(stage, limits, clock, 2.0), push_n)


def push(it: Bench) -> None:
    it.push_n[0] = -9.0


def fall_silent(it: Bench) -> None:
    it.server.faults.silent = True


@pytest.mark.slow
@pytest.mark.parametrize(
    ("what", "words"), [(push, "Fz = -9.00 N, over the guard"), (fall_silent, "no sample within")]
)
def test_a_force_while_homing_stops_it(what: Callable[[Bench], None], words: str) -> None:
    with bench() as it:

        def later() -> None:
            it.board.hears(b"$H")
            time.sleep(0.3)
            what(it)

        other = threading.Thread(target=later)
        other.start()
        with pytest.raises(SensorError, match=words):
            it.home()
        other.join()
        it.board.hears(b"\x18")
        at_mm = it.board.at_mm()
        time.sleep(0.3)
        assert it.board.at_mm() == at_mm
    assert "force sensor" not in {t.name for t in threading.enumerate()}


def test_where_nothing_pushes_it_homes_and_the_sensor_rests() -> None:
    with bench() as it:
        it.board.grbl.settings[25] = 1200.0
        assert "operator's word" in it.home()
        assert it.stage.homed
        it.force.start()  # left stopped, and ready for whoever feels next
        assert len(it.force.read().t_ns)
    assert "force sensor" not in {t.name for t in threading.enumerate()}
