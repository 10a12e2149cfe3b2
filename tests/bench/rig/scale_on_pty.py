"""A scale on a pseudo terminal, written to by a thread as a scale does."""

from __future__ import annotations

import itertools
import os
import threading
import tty
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from deltact_fab.bench.rig.force.watchdog import open_force
from deltact_fab.bench.rig.interface import ForceSensor, WallClock
from deltact_fab.bench.rig.tables import ForceConfig, SerialScaleConfig


class Scale:
    """port: what a host opens. line: what it writes, every period; None: nothing."""

    def __init__(self, ours: int, port: str) -> None:
        self.ours = ours
        self.port = port
        self.line: Callable[[int], str | None] = lambda k: f"{k % 3 * 0.01 + 1:.2f}\r\n"
        self.done = threading.Event()
        self.period_s = 0.005

    def write(self) -> None:
        """The scale's own thread."""
        for k in itertools.count():
            if self.done.wait(self.period_s):
                return
            line = self.line(k)
            if line is not None:
                os.write(self.ours, line.encode())

    def opened(self, **own: Any) -> ForceSensor:
        """The driver on this scale."""
        return open_force(self.config(**own), WallClock())

    def config(self, **own: Any) -> ForceConfig:
        """Table of the rig file for this scale."""
        return ForceConfig(serial=SerialScaleConfig(port=self.port, silent_s=0.5, **own))


@contextmanager
def scale() -> Iterator[Scale]:
    ours, theirs = os.openpty()
    tty.setraw(theirs)
    it = Scale(ours, os.ttyname(theirs))
    thread = threading.Thread(target=it.write)
    thread.start()
    try:
        yield it
    finally:
        it.done.set()
        thread.join()
        for end in (it.ours, theirs):
            if end >= 0:
                os.close(end)
