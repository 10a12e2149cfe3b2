"""A board on a pseudo terminal in this process, on the wall clock."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import pytest

from deltact_fab.rig.clock import WallClock
from deltact_fab.rig.stage.exchange import Talk
from deltact_fab.virtual.controller import GrblController
from deltact_fab.virtual.pty import PtyCable

# A board that does not restart on opening says nothing then, and 2.5 s are left for a boot loader.
BANNER_S = 0.2
# Homed within a second or so.
QUICK = {24: 1200, 25: 1200, 26: 5, 27: 0.2, 120: 2000, 121: 2000, 122: 2000}


class Board:
    """port: what a host opens. heard: every piece of what it sent, with the time it came (s)."""

    def __init__(self, settings: dict[int, float] | None) -> None:
        clock = WallClock()
        self.grbl = GrblController(
            {**QUICK, **(settings or {})}, clock, start_mm=(-1, -1, -1), boot_s=0.3
        )
        self.heard: list[tuple[float, bytes]] = []
        self.terminal = PtyCable(
            self.grbl, clock, heard=lambda t_s, data: self.heard.append((t_s, data))
        )
        self.port = self.terminal.port

    def hears(self, what: bytes, within_s: float = 30.0) -> float:
        """Wait for these bytes; when they came (monotonic s)."""
        return await_(lambda: next((t for t, data in self.heard if what in data), None), within_s)

    def at_mm(self) -> tuple[float, float, float]:
        """Where the carriage is now."""
        with self.terminal.lock:
            return self.grbl.position_mm()

    def state(self) -> str:
        """What the controller is doing now."""
        with self.terminal.lock:
            return self.grbl.state


def await_(what: Callable[[], float | None], within_s: float = 30.0) -> float:
    """Poll until there is something; it."""
    deadline = time.monotonic() + within_s
    while time.monotonic() < deadline:
        if (found := what()) is not None:
            return found
        time.sleep(0.002)
    raise AssertionError(f"waited {within_s} s for nothing")


@contextmanager
def board(settings: dict[int, float] | None = None) -> Iterator[Board]:
    """A board that does not restart on opening, plugged in for as long as the context lasts."""
    it = Board(settings)
    with pytest.MonkeyPatch.context() as patch, it.terminal:
        patch.setattr(Talk.banner, "__defaults__", (BANNER_S,))
        yield it
