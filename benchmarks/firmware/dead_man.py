"""How far a tip goes on in a press at 60 mm/min whose host, cable or answers are lost.

The host is a process of its own, the cable a relay between two sockets; depth is the carriage's, by
the steps that the firmware made.
"""

from __future__ import annotations

import select
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from operator import itemgetter
from pathlib import Path

import numpy as np

from .press import ABOVE_MM, DEEP_MM, FACE_MM, FEED_MM_MIN

STEPS_MM = 800
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
    """Between a host and a board on a socket."""

    def __init__(self, port: int) -> None:
        self._board = socket.create_connection(("127.0.0.1", port))
        self._listening = socket.create_server(("127.0.0.1", 0))
        self.url = f"socket://127.0.0.1:{self._listening.getsockname()[1]}"
        self.lose = b""  # the next line that begins so
        self.mute = False
        self._out = False
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def pull(self) -> None:
        """The cable is out: the host sees it gone, the board nothing."""
        self._out = True

    def close(self) -> None:
        """Of a trial that is over."""
        self._out = True
        self._thread.join(2)
        self._board.close()

    def _run(self) -> None:
        with self._listening:
            while not select.select([self._listening], [], [], 0.02)[0]:
                if self._out:
                    return
            host, _ = self._listening.accept()
        said = b""
        with host:
            while not self._out:
                for wire in select.select([host, self._board], [], [], 0.005)[0]:
                    data = b""
                    with suppress(OSError):
                        data = wire.recv(4096)
                    if not data:
                        return
                    if wire is host:
                        self._board.sendall(data)
                        continue
                    *lines, said = (said + data).split(b"\n")
                    for line in lines:
                        if self.lose and line.startswith(self.lose):
                            self.lose = b""
                        elif not self.mute:
                            with suppress(OSError):
                                host.sendall(line + b"\n")


def depth_mm(folder: Path) -> float:
    """Of the tip below the face."""
    return float(FACE_MM - np.fromfile(folder / "carriage", np.int32)[2] / STEPS_MM)


@contextmanager
def pressing(port: int, comes_to: str, *how: str) -> Iterator[tuple[Relay, subprocess.Popen[str]]]:
    """A host that has just said so; one that was stopped before is begun again."""
    for _ in range(TRIES):
        relay = Relay(port)
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
    raise SystemExit(f"no host came to its {comes_to}")


def trial(folder: Path, port: int, fault: str, after_s: float) -> tuple[float, float, str]:
    """How much deeper the tip went (mm), how soon it was above the face (s), the last line."""
    comes_to = "retract" if "retract" in fault else "press"
    with pressing(port, comes_to) as (relay, host):
        assert host.stdout is not None
        time.sleep(after_s + (0.05 if comes_to == "press" else 0.0))
        if "killed" in fault:
            host.kill()
        elif "cable" in fault:
            relay.pull()
        elif "lost" in fault:
            relay.lose = b"ok"
        else:
            relay.mute = True
        begun_s, from_mm = time.monotonic(), depth_mm(folder)
        deepest_mm, above_s, rest_s, last_mm = from_mm, np.inf, begun_s, from_mm
        while host.poll() is None or time.monotonic() - rest_s < 0.5:
            time.sleep(0.005)
            if (now_mm := depth_mm(folder)) != last_mm:
                rest_s, last_mm = time.monotonic(), now_mm
            deepest_mm = max(deepest_mm, now_mm)
            if now_mm < 0 and np.isinf(above_s) and from_mm > 0:
                above_s = time.monotonic() - begun_s
        said = [line.removeprefix("end ").strip() for line in host.stdout if line[:3] == "end"]
    if from_mm <= 0:
        above_s = 0.0
    return deepest_mm - from_mm, above_s, said[-1] if said else ""


def steadiness(folder: Path, port: int, how: str) -> tuple[float, float, float]:
    """Without a fault: longer than planned (s), speed (mm/min), most off a steady one (mm)."""
    with pressing(port, "press", how) as (_, host):
        assert host.stdout is not None
        begun_s = time.monotonic()
        seen: list[tuple[float, float]] = []
        while (at_s := time.monotonic() - begun_s) < PRESS_S - 0.2:
            if at_s > 0.2:
                seen.append((at_s, depth_mm(folder)))
            time.sleep(0.002)
        longer_s = float(host.stdout.readline().split()[1])
        host.stdout.read()
    t_s, z_mm = np.array(seen).T
    line = np.polyfit(t_s, z_mm, 1)
    return longer_s, 60 * float(line[0]), float(np.abs(z_mm - np.polyval(line, t_s)).max())


def rows(folder: Path, port: int) -> Iterator[tuple[str, str]]:
    """Each fault, and the worst that came of it."""
    for how in ("pieces", "whole"):
        steady = [steadiness(folder, port, how) for _ in range(5)]
        longer_s, feed, off_mm = max(steady, key=itemgetter(2))
        yield (
            f"a press sent {how}, five times" if how == "whole" else "a press sent in pieces, five",
            f"{feed:.2f} mm/min, {off_mm:.4f} mm off a steady line, {longer_s:.3f} s over its plan",
        )
    for fault, n in FAULTS.items():
        of_s = 0.0 if "retract" in fault else PRESS_S
        got = [trial(folder, port, fault, of_s * (k + 0.5) / n) for k in range(n)]
        deeper_mm, above_s, last = zip(*got, strict=True)
        ends = sorted({words.partition(":")[0] for words in last})
        yield (
            f"{fault}, {n} moments of a press at {FEED_MM_MIN:g} mm/min",
            f"{'WRONG: ' if max(deeper_mm) > 0.25 else ''}{max(deeper_mm):.3f} mm deeper at worst "
            f"(median {np.median(deeper_mm):.3f}); above the face after {max(above_s):.1f} s at "
            f"worst; the host's last word: {', '.join(ends) or 'none'}",
        )
