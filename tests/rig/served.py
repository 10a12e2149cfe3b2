"""A board on a pseudo terminal: the simulated controller, served by a process of its own.

As a script: prints the terminal's path, restarts as an Arduino does when a host opens it, ends when
its standard input does, and prints what it saw. `powered` starts and ends it for a test.
"""

from __future__ import annotations

import json
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

# Fast enough for tests at the wall clock.
QUICK = {
    24: 1200, 25: 3000, 26: 5, 27: 0.2, 110: 6000, 111: 6000, 112: 6000,
    120: 2000, 121: 2000, 122: 2000,
}  # fmt: skip


class Board:
    """The process; `port` is what a host opens, `saw` is there once it is off."""

    def __init__(self, process: subprocess.Popen[str], port: str) -> None:
        self._process = process
        self.port = port
        self.saw: dict[str, Any] = {}

    def off(self) -> None:
        """End the process and read what it saw."""
        if not self.saw:
            told, _ = self._process.communicate(timeout=20)
            self.saw = json.loads(told)


@contextmanager
def powered(reboot_at_jog: int | None = None) -> Iterator[Board]:
    """A board that runs while the block does. reboot_at_jog: a brown-out at that jog, once."""
    process = subprocess.Popen(
        [sys.executable, __file__, json.dumps(reboot_at_jog)],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
    )  # fmt: skip
    try:
        assert process.stdout is not None
        board = Board(process, process.stdout.readline().strip())
        yield board
        board.off()
    finally:
        process.kill()
        process.wait()
        for pipe in (process.stdin, process.stdout):
            if pipe is not None:
                pipe.close()


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


def _serve(reboot_at_jog: int | None) -> None:
    from deltact_fab.rig.clock import WallClock
    from deltact_fab.virtual.controller import GrblController
    from deltact_fab.virtual.pty import PtyCable

    clock = WallClock()
    grbl = GrblController(QUICK, clock, start_mm=(-1, -1, -1), boot_s=0.2)
    links, jogs, line = [], 0, b""

    def heard(t_s: float, data: bytes) -> None:
        nonlocal jogs, line
        *lines, line = (line + data).split(b"\n")
        for whole in lines:
            begins = b"$J=" in whole and grbl.state == "Idle"  # the rest of a move follows it
            jogs += begins
            if begins and jogs == reboot_at_jog:
                grbl.fault("reboot")

    def opened(is_open: bool) -> None:
        links.append("opened" if is_open else "closed")

    with PtyCable(grbl, clock, resets_on_open=True, heard=heard, opened=opened) as terminal:
        print(terminal.port, flush=True)
        sys.stdin.read()
        time.sleep(0.05)  # for a host that has only just closed it
    ends = [z for segment in grbl.segments for z in (segment.start_mm[2], segment.end_mm[2])]
    saw = {"links": links, "jogs": jogs, "lowest_mm": min(ends, default=None)}
    print(json.dumps(saw))


if __name__ == "__main__":
    _serve(json.loads(sys.argv[1]))
