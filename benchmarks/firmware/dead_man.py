"""How far a tip goes on in a press at 60 mm/min whose host, cable or answers are lost.

The host is a process of its own, the cable a relay between two sockets; depth is by the steps that
the firmware made where they are in a file, else by its reports, for which the relay asks too.
"""

from __future__ import annotations

import os
import re
import select
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from operator import itemgetter

import numpy as np
import serial

from deltact_fab.common import StageError

from .board import Board
from .press import ABOVE_MM, DEEP_MM, FACE_MM, FEED_MM_MIN

REPORT = re.compile(rb"<.*MPos:[^,]*,[^,]*,(-?[\d.]+)")
REPORT_S = 0.02  # by hand: at 60 mm/min a report is 0.02 mm old then; a busy line answers no faster
PRESS_S = (ABOVE_MM - DEEP_MM) / FEED_MM_MIN * 60
MOMENTS = 50
TRIES = 5
FAULTS = {
    "host killed (kill -9)": MOMENTS,
    "cable out": MOMENTS,
    "one ok of the press lost": MOMENTS,
    "ok of the retract lost": 5,
    "controller silent from then on": 5,
}


class Relay:
    """Between a host on a socket and a board; where the tip is, by its steps or its reports."""

    def __init__(self, board: Board, url: str) -> None:
        self._carriage = board
        self.by_steps = board.height_mm() is not None
        self._report = 0.0, 0.0  # when it came (s), depth (mm)
        self._board = serial.serial_for_url(url, 115200)
        self._listening = socket.create_server(("127.0.0.1", 0))
        self.url = f"socket://127.0.0.1:{self._listening.getsockname()[1]}"
        self.lose = b""  # the next line that begins so
        self.mute = self.pulled = False  # pulled: the host sees the cable gone, the board nothing
        self._over = self._host_asks = False
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def close(self) -> None:
        self._over = True
        self._thread.join(2)
        self._board.close()

    def depth(self) -> tuple[float, float]:
        """When (s), and how far the tip was below the face (mm)."""
        z_mm = self._carriage.height_mm() if self.by_steps else None
        return self._report if z_mm is None else (time.monotonic(), FACE_MM - z_mm)

    def _run(self) -> None:
        board, said, asked_s = self._board.fileno(), b"", 0.0
        hosts = [self._listening]  # the one that is awaited, is there, or none
        with self._listening, suppress(OSError):  # the board has ended
            while not self._over:
                if self.pulled and hosts:
                    hosts.pop().close()
                if not self.by_steps and time.monotonic() > asked_s + REPORT_S:
                    asked_s = time.monotonic()
                    os.write(board, b"?")
                for wire in select.select([board, *hosts], [], [], 0.005)[0]:
                    if wire is self._listening:
                        hosts = [wire.accept()[0]]
                    elif wire is board:
                        *lines, said = (said + os.read(board, 4096)).split(b"\n")
                        for line in filter(self._passes, lines):
                            with suppress(OSError, IndexError):  # no host is there
                                hosts[0].sendall(line + b"\n")
                    else:
                        data = b""
                        with suppress(OSError):
                            data = wire.recv(4096)
                        self._host_asks |= b"?" in data
                        os.write(board, data)
                        if not data:
                            hosts.pop().close()

    def _passes(self, line: bytes) -> bool:
        """False for a line that the host does not get: lost, or an answer to the relay."""
        if report := REPORT.search(line):
            self._report = time.monotonic(), FACE_MM - float(report[1])
            if not self.by_steps and not self._host_asks:
                return False
            self._host_asks = False
        if self.lose and line.startswith(self.lose):
            self.lose = b""
            return False
        return not self.mute


@contextmanager
def pressing(
    board: Board, url: str, comes_to: str, *how: str
) -> Iterator[tuple[Relay, subprocess.Popen[str]]]:
    """A host that has just said so; one that was stopped before is begun again."""
    for _ in range(TRIES):
        relay = Relay(board, url)
        words = [sys.executable, "-m", "benchmarks.firmware.press", relay.url, *how]
        with subprocess.Popen(words, stdout=subprocess.PIPE, text=True) as host:
            assert host.stdout is not None
            if any(line == f"{comes_to}\n" for line in host.stdout):
                try:
                    yield relay, host
                finally:
                    host.kill()
                    relay.close()
                return
        relay.close()
    raise StageError(f"no host came to its {comes_to}")


def trial(board: Board, url: str, fault: str, after_s: float) -> tuple[float, float, str]:
    """How much deeper the tip went (mm), how soon it was above the face (s), the last line."""
    comes_to = "retract" if "retract" in fault else "press"
    with pressing(board, url, comes_to) as (relay, host):
        assert host.stdout is not None
        time.sleep(after_s + (0.05 if comes_to == "press" else 0.0))
        if "killed" in fault:
            host.kill()
        relay.pulled, relay.mute = "cable" in fault, "silent" in fault
        relay.lose = b"ok" * ("lost" in fault)
        begun_s, from_mm = time.monotonic(), relay.depth()[1]
        deepest_mm, above_s, rest_s, last_mm = from_mm, np.inf, begun_s, from_mm
        while host.poll() is None or time.monotonic() - rest_s < 0.5:
            time.sleep(0.005)
            if (now_mm := relay.depth()[1]) != last_mm:
                rest_s, last_mm = time.monotonic(), now_mm
            deepest_mm = max(deepest_mm, now_mm)
            if now_mm < 0 and np.isinf(above_s) and from_mm > 0:
                above_s = time.monotonic() - begun_s
        said = [line.removeprefix("end ").strip() for line in host.stdout if line[:3] == "end"]
    return deepest_mm - from_mm, above_s if from_mm > 0 else 0.0, (said or [""])[-1]


def steadiness(board: Board, url: str, how: str) -> tuple[float, float, float]:
    """Without a fault: longer than planned (s), speed (mm/min), most off a steady one (mm)."""
    with pressing(board, url, "press", how) as (relay, host):
        assert host.stdout is not None
        begun_s = time.monotonic()
        seen: dict[float, float] = {}
        while time.monotonic() < begun_s + PRESS_S - 0.2:
            t_s, depth_mm = relay.depth()
            if t_s > begun_s + 0.2:
                seen[t_s - begun_s] = depth_mm
            time.sleep(0.002)
        took, _, longer_s = host.stdout.readline().strip().partition(" ")
        if took != "took":
            raise StageError(f"a press without a fault: {longer_s}")
        host.stdout.read()
    times_s, z_mm = np.array(list(seen.items())).T
    line = np.polyfit(times_s, z_mm, 1)
    off_mm = np.abs(z_mm - np.polyval(line, times_s)).max()
    return float(longer_s), 60 * float(line[0]), float(off_mm)


def rows(board: Board, moments: int) -> Iterator[tuple[str, str]]:
    """Each fault, and the worst that came of it."""
    by = "" if board.height_mm() is not None else "; by its own report"
    n = min(5, moments)
    with board.powered() as url:
        for how in ("in pieces", "whole") if n else ():
            steady = [steadiness(board, url, how) for _ in range(n)]
            longer_s, feed, off_mm = max(steady, key=itemgetter(2))
            text = f"{feed:.2f} mm/min, {off_mm:.4f} mm off a steady line, {longer_s:.3f} s over"
            yield f"a press sent {how}, {n} times", f"{text} its plan{by}"
        for fault, most in FAULTS.items() if n else ():
            n, of_s = min(most, moments), 0.0 if "retract" in fault else PRESS_S
            got = [trial(board, url, fault, of_s * (k + 0.5) / n) for k in range(n)]
            deeper_mm, above_s, last = zip(*got, strict=True)
            ends = sorted({words.partition(":")[0] or "none" for words in last})
            up = f"above the face after {max(above_s):.1f} s at worst"
            up = up if np.isfinite(max(above_s)) else "it stays in the gel"
            yield (
                f"{fault}, {n} moments of a press at {FEED_MM_MIN:g} mm/min",
                f"{'WRONG: ' * (max(deeper_mm) > 0.25)}{max(deeper_mm):.3f} mm deeper at worst "
                f"(median {np.median(deeper_mm):.3f}); {up}; the host's last word: "
                f"{', '.join(ends)}{by}",
            )
