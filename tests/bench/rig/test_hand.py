"""A bench driven key by key: a real host, a board on a terminal, a box and its guard on sockets."""

from __future__ import annotations

import os
import tty
from collections.abc import Callable, Iterator
from contextlib import ExitStack

import numpy as np
import pytest
from board import Board, board

from deltact_fab.app.cli import keys
from deltact_fab.bench.rig.force.watchdog import open_guarded
from deltact_fab.bench.rig.interface import WallClock
from deltact_fab.bench.rig.stage.grbl import GrblStage
from deltact_fab.bench.rig.tables import ForceConfig, GuardConfig, NetFTConfig
from deltact_fab.bench.rig.tool.hand import HandSession
from deltact_fab.sensor.optics.camera import StageFrame
from deltact_fab.simulate.virtual.served import NetFTServer

pytestmark = [
    pytest.mark.skipif(not hasattr(os, "openpty"), reason="needs pseudo terminals"),
    pytest.mark.usefixtures("no_boot_loader"),
]


class Hand:
    """Keys in order, each a name or something to do; what was told, what was shown."""

    def __init__(self, held: ExitStack, guarded: bool) -> None:
        self.board: Board = held.enter_context(board())
        self.stage = GrblStage(self.board.port, WallClock(), StageFrame((-30.0, -30.0, -20.0)))
        held.callback(self.stage.close)
        self.push_n = 0.0
        self.told: list[str] = []
        self.shown: list[str] = []
        self.force = self.guard = None
        if guarded:
            box = held.enter_context(NetFTServer(self._wrench))
            net = NetFTConfig(
                host=box.host, rdt_port=box.rdt_port, http_port=box.http_port, silent_s=1
            )
            limits = GuardConfig(force_n=5.0)
            self.force = self.guard = open_guarded(ForceConfig(netft=net), limits, self.stage)
            held.callback(self.force.close)

    def _wrench(self, t_ns: np.ndarray) -> np.ndarray:  # type: ignore[type-arg]
        return np.tile([0.0, 0.0, self.push_n, 0.0, 0.0, 0.0], (len(t_ns), 1))

    def home(self) -> str:
        self.stage.home()
        return "homed"

    def drive(self, *script: str | Callable[[], None]) -> None:
        left = list(script)

        def key(wait_s: float) -> str:
            if wait_s == 0.0:  # in a move
                return ""
            while left and not isinstance(left[0], str):
                left.pop(0)()  # type: ignore[operator]
            return str(left.pop(0)) if left else "q"

        self.stage.connect()
        others = {"h": self.home}
        HandSession(
            self.stage, self.force, self.guard, key, self.told.append, self.shown.append,
            actions=others,
        ).run()  # fmt: skip


@pytest.fixture
def held() -> Iterator[ExitStack]:
    with ExitStack() as held:
        yield held


def test_one_session_homes_moves_sets_origin(held: ExitStack) -> None:
    hand = Hand(held, guarded=False)
    hand.drive("right", "o", "h", "right", "2", "page down", "3", "left", "left", "o", "d", "q")
    assert "the position is unknown: home first" in " ".join(hand.told)
    assert "home first: h" in hand.told
    assert "homed" in hand.told
    origin = next(line for line in hand.told if line.startswith("origin_machine_mm"))
    assert origin.startswith("origin_machine_mm = [-2.200, -0.200, -0.300]")
    assert hand.stage.position_mm() == pytest.approx((0.0, 0.0, 0.0), abs=2e-3)
    assert "give --into-gel" in hand.told[-1]
    assert any("no force sensor, no guard" in line for line in hand.shown)


def test_guard_stops_lifts_and_continues(held: ExitStack) -> None:
    hand = Hand(held, guarded=True)

    def push(force_n: float) -> Callable[[], None]:
        return lambda: setattr(hand, "push_n", force_n)

    hand.drive("h", "4", "d", push(-6.0), "d", push(0.0), "x", "3", "d", "q")
    told = " ".join(hand.told)
    assert "over the guard's 5 N; lifting; q quits" in told
    assert "the tip may be in the gel: force 6.0 N, 5.00 mm higher, it has not fallen" in told
    assert any("F +0.00 +0.00 +0.00 N" in line for line in hand.shown)
    z_mm = hand.stage.position_mm()[2]
    assert -1 < z_mm < 15, "one whole step down, a part of one, up by 5, down by 1"
    assert hand.guard is not None
    assert not hand.guard.tripped


def test_keys_have_names(monkeypatch: pytest.MonkeyPatch, held: ExitStack) -> None:
    ours, theirs = os.openpty()
    held.callback(os.close, ours)
    tty.setraw(ours)
    with open(theirs) as terminal:
        monkeypatch.setattr("sys.stdin", terminal)
        with keys.read_keys() as key:
            for typed, name in ((b"\x1b[A", "up"), (b"\x1b[6~", "page down"), (b"q", "q")):
                os.write(ours, typed)
                assert key(2.0) == name
            assert key(0.0) == ""
            with keys.line_mode():
                os.write(ours, b"clear\n")
                assert terminal.readline() == "clear\n"
