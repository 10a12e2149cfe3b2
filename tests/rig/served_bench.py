"""A board and a force box that are served by a process of their own.

As a script: prints its ports, does what it is told line by line, prints what it saw at the end of
its input. `bench_served` starts and ends it for a test.
"""

from __future__ import annotations

import json
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

# Fast enough for tests at the wall clock.
QUICK = {24: 1200, 25: 1200, 26: 5, 27: 0.2, 120: 2000, 121: 2000, 122: 2000}


class ServedBench:
    """ports: `stage`, `rdt_port`, `http_port`. saw: once it is off."""

    def __init__(self, process: subprocess.Popen[str]) -> None:
        self._process = process
        assert process.stdout is not None
        self.ports: dict[str, Any] = json.loads(process.stdout.readline())
        self.saw: dict[str, Any] = {}

    def silence(self) -> None:
        """The box goes on and sends nothing any more."""
        assert self._process.stdin is not None
        self._process.stdin.write("silent\n")
        self._process.stdin.flush()

    def off(self) -> None:
        """End the process and read what it saw."""
        told, _ = self._process.communicate(timeout=20)
        self.saw = json.loads(told)


@contextmanager
def bench_served() -> Iterator[ServedBench]:
    """It runs while the block does."""
    process = subprocess.Popen(
        [sys.executable, __file__], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    try:
        bench = ServedBench(process)
        yield bench
        bench.off()
    finally:
        process.kill()
        process.wait()
        for pipe in (process.stdin, process.stdout):
            if pipe is not None:
                pipe.close()


def _serve() -> None:
    from deltact_fab.rig.clock import WallClock
    from deltact_fab.rig.force.config import ForceConfig
    from deltact_fab.rig.force.watchdog import run_first
    from deltact_fab.virtual.controller import GrblController
    from deltact_fab.virtual.netft_server import NetFTServer
    from deltact_fab.virtual.pty import PtyCable

    run_first()  # it stands for hardware of its own
    clock = WallClock()
    grbl = GrblController(QUICK, clock, start_mm=(-1, -1, -1), boot_s=0.2)
    heard: list[tuple[float, bytes]] = []
    silent_s = 0.0
    with (
        NetFTServer(lambda t_ns: np.zeros((len(t_ns), 6)), ForceConfig()) as box,
        PtyCable(grbl, clock, heard=lambda t_s, data: heard.append((t_s, data))) as board,
    ):
        ports = {"stage": board.port, "rdt_port": box.rdt_port, "http_port": box.http_port}
        print(json.dumps(ports), flush=True)
        for _ in sys.stdin:
            silent_s = time.monotonic()
            box.faults.silent = True
        with board.lock:
            at_mm = grbl.position_mm()
    stops = [t - silent_s for t, data in heard if silent_s and t > silent_s and b"\x85" in data]
    print(json.dumps({"stopped_after_s": stops[0] if stops else None, "at_mm": at_mm}))


if __name__ == "__main__":
    _serve()
