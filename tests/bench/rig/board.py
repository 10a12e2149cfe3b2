"""A board on a pseudo terminal in this process, on the wall clock."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from deltact_fab.bench.rig.interface import WallClock
from deltact_fab.bench.rig.stage.exchange import Talk
from deltact_fab.simulate.virtual.controller import GrblController
from deltact_fab.simulate.virtual.pty import PtyCable

# A board that does not restart on opening says nothing then, and 2.5 s are left for a boot loader.
BANNER_S = 0.2
# Homed within a second or so.
QUICK = {24: 1200, 25: 1200, 26: 5, 27: 0.2, 120: 2000, 121: 2000, 122: 2000}


class Board:
    """port: what a host opens. heard: every piece of what it sent, with the time it came (s).

    arduino: it restarts when a host opens it. links: "opened" and "closed" by hosts.
    jogs: those from rest.
    """

    def __init__(self, settings: dict[int, float] | None, arduino: bool = False) -> None:
        clock = WallClock()
        feeds = dict.fromkeys((110, 111, 112), 6000) if arduino else {}
        self.grbl = GrblController(
            {**QUICK, **feeds, **(settings or {})}, clock, start_mm=(-1, -1, -1), boot_s=0.3
        )
        self.heard: list[tuple[float, bytes]] = []
        self.links: list[str] = []
        self.jogs, self._line = 0, b""
        self.terminal = PtyCable(
            self.grbl, clock, resets_on_open=arduino, on_receive=self._hear,
            on_open=lambda is_open: self.links.append("opened" if is_open else "closed"),
        )  # fmt: skip
        self.port = self.terminal.port

    def _hear(self, t_s: float, data: bytes) -> None:
        self.heard.append((t_s, data))
        *lines, self._line = (self._line + data).split(b"\n")
        for whole in lines:
            begins = b"$J=" in whole and self.grbl.state == "Idle"  # the rest of a move follows it
            self.jogs += begins

    def hears(self, what: bytes, within_s: float = 30.0) -> float:
        """Wait for these bytes; when they came (monotonic s)."""
        return await_(lambda: next((t for t, data in self.heard if what in data), None), within_s)

    def at_mm(self) -> tuple[float, float, float]:
        """Where the carriage is now."""
        with self.terminal.lock:
            return self.grbl.position_mm()

    def lowest_mm(self) -> float:
        """Lowest height of the carriage so far."""
        with self.terminal.lock:
            return min(z for s in self.grbl.segments for z in (s.start_mm[2], s.end_mm[2]))

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
def board(settings: dict[int, float] | None = None, arduino: bool = False) -> Iterator[Board]:
    """A board that is plugged in for as long as the context lasts."""
    it = Board(settings, arduino)
    with pytest.MonkeyPatch.context() as patch, it.terminal:
        if not arduino:
            patch.setattr(Talk.banner, "__defaults__", (BANNER_S,))
        yield it
        if arduino:
            time.sleep(0.05)  # for a host that has only just closed it


def rig_file(folder: Path, port: str) -> Path:
    """A rig of kind `grbl` on that port."""
    path = folder / "bench.toml"
    path.write_text(
        f"""
kind = "grbl"
[stage]
port = "{port}"
origin_machine_mm = [-60.0, -60.0, -40.0]
travel_mm = [120.0, 120.0, 60.0]
max_feed_mm_min = [6000.0, 6000.0, 6000.0]
acceleration_mm_s2 = [2000.0, 2000.0, 2000.0]
"""
    )
    return path
