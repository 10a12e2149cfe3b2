"""A simulated controller on a pseudo terminal, on the wall clock: a port like any other."""

from __future__ import annotations

import os
import select
import threading
import time
import tty
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from deltact_fab.rig.clock import WallClock
from deltact_fab.virtual.controller import GrblController

# Homed within a second or so.
QUICK = {24: 1200, 25: 1200, 26: 5, 27: 0.2, 120: 2000, 121: 2000, 122: 2000}


class Board:
    """port: what a host opens. heard: every piece of what it sent, with the time it came (s)."""

    def __init__(self, grbl: GrblController, port: str) -> None:
        self.grbl = grbl
        self.port = port
        self.heard: list[tuple[float, bytes]] = []
        self.lock = threading.Lock()  # the controller is no more than one thread's at a time

    def hears(self, what: bytes, within_s: float = 30.0) -> float:
        """Wait for these bytes; when they came (monotonic s)."""
        return await_(lambda: next((t for t, data in self.heard if what in data), None), within_s)

    def at_mm(self) -> tuple[float, float, float]:
        """Where the carriage is now."""
        with self.lock:
            return self.grbl.position_mm()

    def state(self) -> str:
        """What the controller is doing now."""
        with self.lock:
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
    ours, theirs = os.openpty()
    tty.setraw(theirs)
    grbl = GrblController(
        {**QUICK, **(settings or {})}, WallClock(), start_mm=(-1, -1, -1), boot_s=0.3
    )
    it = Board(grbl, os.ttyname(theirs))
    done = threading.Event()

    def pump() -> None:
        while not done.is_set():
            ready = select.select([ours], [], [], 0.002)[0]
            with it.lock:
                if ready:
                    data = os.read(ours, 4096)
                    it.heard.append((time.monotonic(), data))
                    grbl.write(data)
                if said := grbl.read_available():
                    os.write(ours, said)

    thread = threading.Thread(target=pump)
    thread.start()
    try:
        yield it
    finally:
        done.set()
        thread.join()
        os.close(ours)
        os.close(theirs)
