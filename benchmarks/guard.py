"""From an excess force record on loopback to the stop byte on the wire, at full recording load.

    python -m benchmarks.guard [--trips 500] [--load jxl|png|none] [--rate 1000] [--hogs 8]

One process is the bench: the simulated Net F/T box on UDP and the simulated controller on a pseudo
terminal. The other is the host as in a run: the real stage in a jog and asked for its position ten
times a second, the real force client and guard in their process, and frames of 1280 x 720 at 60 a
second put into the run's own pipeline, which encodes, hashes, writes and commits them. Both stamp
with CLOCK_MONOTONIC: the box just before it sends the first record over the limit, the controller's
end of the cable as soon as it has read the byte.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import sqlite3
import struct
import subprocess
import sys
import tempfile
import threading
import time
from collections import deque
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

OVER_N = -10.0  # what the box then sends, on an axis whose limit is 5 N
QUIET_S = 5.0  # a stop byte that took so long never came
FRAME_RATE_HZ = 60.0
SETTINGS = {24: 1200, 25: 3000, 26: 5, 27: 0.2, 120: 500, 121: 500, 122: 500}
SETTINGS |= {110: 6000, 111: 6000, 112: 6000}


# ---- the bench, in a process of its own ---------------------------------------------------------


def serve(rate_hz: float) -> None:
    """Print the ports, then for every line "over" what became of it: ns of record and byte."""
    from deltact_fab.bench.rig.force.watchdog import raise_priority
    from deltact_fab.bench.rig.interface import WallClock
    from deltact_fab.bench.rig.tables import ForceConfig
    from deltact_fab.simulate.virtual.controller import GrblController
    from deltact_fab.simulate.virtual.pty import PtyCable
    from deltact_fab.simulate.virtual.served import NetFTServer

    over = threading.Event()
    stopped = threading.Event()
    sent_ns: list[int] = []
    heard_ns: list[int] = []

    def wrenches(t_ns: NDArray[np.int64]) -> NDArray[np.float64]:
        out = np.zeros((len(t_ns), 6))
        out[:, 2] = OVER_N if over.is_set() else -1.0
        return out

    def sent(record: bytes, at_ns: int) -> None:
        if not sent_ns and over.is_set() and struct.unpack(">i", record[20:24])[0] < -2_000_000:
            sent_ns.append(at_ns)

    def heard(at_s: float, data: bytes) -> None:
        if sent_ns and not heard_ns and (b"\x85" in data or b"\x18" in data):
            heard_ns.append(round(at_s * 1e9))
            stopped.set()

    raise_priority()  # it stands for hardware of its own
    clock = WallClock()
    grbl = GrblController(SETTINGS, clock, start_mm=(-1, -1, -1), boot_s=0.2)
    config = ForceConfig(rate_hz=rate_hz)
    with (
        NetFTServer(wrenches, config, on_send=sent) as box,
        PtyCable(grbl, clock, on_receive=heard) as board,
    ):
        ports = {"host": box.host, "rdt_port": box.rdt_port, "http_port": box.http_port}
        print(json.dumps({"stage": board.port, "netft": ports}), flush=True)
        for line in sys.stdin:
            if line.strip() == "over":
                sent_ns.clear()
                heard_ns.clear()
                stopped.clear()
                over.set()
                came = stopped.wait(QUIET_S)
                row = (sent_ns[0], heard_ns[0]) if came else None
                print(json.dumps(row), flush=True)
            else:
                over.clear()


@contextmanager
def bench(rate_hz: float) -> Iterator[tuple[dict[str, Any], subprocess.Popen[str]]]:
    """The other process and its ports."""
    command = [sys.executable, "-m", "benchmarks.guard", "--serve", "--rate", str(rate_hz)]
    with subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        try:
            yield json.loads(process.stdout.readline()), process
        finally:
            process.kill()


# ---- the host -----------------------------------------------------------------------------------


class Recording:
    """Frames at FRAME_RATE_HZ into the run's pipeline. kept, dropped: how many."""

    def __init__(self, folder: Path, image_format: str) -> None:
        from deltact_fab.bench.record.journal import WriterThreads

        (folder / "images").mkdir()
        self._folder = folder
        self._format = image_format
        self._db = sqlite3.connect(folder / "load.sqlite", check_same_thread=False)
        self._db.execute("PRAGMA journal_mode=WAL")
        self._db.execute("PRAGMA synchronous=FULL")
        self._db.execute("CREATE TABLE frames (id INTEGER, sha256 TEXT)")
        self.failures: list[Exception] = []
        self._pipeline = WriterThreads(folder, self._db, self.failures.append)
        rng = np.random.default_rng(0)
        patches = rng.integers(0, 256, (72, 128, 3)).repeat(10, 0).repeat(10, 1)
        noisy = [patches + rng.normal(0, 2, patches.shape) for _ in range(4)]
        self._images = [np.clip(image, 0, 255).astype(np.uint8) for image in noisy]
        self.kept = self.dropped = 0
        self._done = threading.Event()
        self._thread = threading.Thread(target=self._film, name="camera")
        self._thread.start()

    def _film(self) -> None:
        begun_s = time.monotonic()
        k = 0
        while not self._done.wait(max(begun_s + k / FRAME_RATE_HZ - time.monotonic(), 0)):
            # A copy, as a camera's driver makes one; the disk holds the last few hundred.
            image = self._images[k % 4].copy()
            file = self._folder / "images" / f"{k % 300}.{self._format}"
            row: list[tuple[str, dict[str, Any]]] = [("frames", {"id": k})]
            if self._pipeline.put_image(row, file, image, wait=False):
                self.kept += 1
            else:
                self.dropped += 1
            k += 1

    def close(self) -> None:
        """End it."""
        self._done.set()
        self._thread.join()
        self._pipeline.close()
        self._db.close()


def measure(
    trips: int, load: str, rate_hz: float = 1000.0, silent_s: float = 0.05, seed: int = 0
) -> dict[str, Any]:
    """Milliseconds (n,) of each trip, in all and to the guard's decision, and the load.

    silent_s: see `NetFTConfig`.
    """
    from deltact_fab.bench.rig.force.watchdog import open_guarded
    from deltact_fab.bench.rig.interface import ForceSamples, WallClock
    from deltact_fab.bench.rig.stage.grbl import GrblStage
    from deltact_fab.bench.rig.tables import ForceConfig, GuardConfig, NetFTConfig
    from deltact_fab.sensor.optics.camera import StageFrame

    clock, draw = WallClock(), random.Random(seed)
    whole, decided = [], []
    with ExitStack() as open_:
        ports, process = open_.enter_context(bench(rate_hz))
        assert process.stdin is not None
        assert process.stdout is not None
        stage = GrblStage(ports["stage"], clock, StageFrame((-60.0, -60.0, -40.0)))
        open_.callback(stage.close)
        stage.connect()
        stage.home()
        config = ForceConfig(
            netft=NetFTConfig(**ports["netft"], silent_s=silent_s), rate_hz=rate_hz
        )
        force = guard = open_guarded(config, GuardConfig(force_n=5.0), stage)
        open_.callback(force.close)
        done = threading.Event()
        felt_n = [0.0]
        kept: deque[ForceSamples] = deque(maxlen=1000)

        def feel() -> None:
            """As the force thread of a run, which the first trip would end."""
            force.start()
            up.set()
            while not done.is_set():
                samples = force.read()
                kept.append(samples)
                felt_n[0] = float(samples.force_n[-1, 2])

        recording = None
        if load != "none":
            folder = open_.enter_context(tempfile.TemporaryDirectory(prefix="guard-"))
            recording = Recording(Path(folder), load)
            open_.callback(recording.close)
        up = threading.Event()
        feeling = threading.Thread(target=feel, name="force")
        feeling.start()
        open_.callback(feeling.join)
        open_.callback(done.set)
        up.wait(QUIET_S)
        begun_s = time.monotonic()
        for k in range(trips):
            stage.start_move((55.0 if k % 2 else -55.0, 0.0, 0.0), 3000)
            until_s = time.monotonic() + 0.05 + 0.15 * draw.random()
            while time.monotonic() < until_s:  # as a run does while it waits
                stage.position_mm()
                stage.listen(min(0.1, max(until_s - time.monotonic(), 0)))
            process.stdin.write("over\n")
            process.stdin.flush()
            row = json.loads(process.stdout.readline())
            if row is None:
                raise SystemExit(f"trip {k}: no stop byte within {QUIET_S:g} s")
            while (trip := guard.trip) is None:  # the byte goes out before the words for it
                time.sleep(0.001)
            whole.append((row[1] - row[0]) / 1e6)
            decided.append((trip.byte_ns - row[0]) / 1e6)
            process.stdin.write("clear\n")
            process.stdin.flush()
            stage.stop()
            while felt_n[0] < -5:
                time.sleep(0.001)
            guard.rearm()
        took_s = time.monotonic() - begun_s
        frames: dict[str, Any] = {"guard": force.identity()["guard"]}
        if recording is not None:
            frames["kept_hz"] = round(recording.kept / took_s, 1)
            frames["dropped_hz"] = round(recording.dropped / took_s, 1)
            frames["failures"] = [str(why) for why in recording.failures]
    return {"whole_ms": whole, "decided_ms": decided, "took_s": round(took_s, 1), **frames}


def row(found: dict[str, Any]) -> str:
    """The figures on one line."""
    parts = []
    for name in ("whole_ms", "decided_ms"):
        p50, p99 = np.percentile(found[name], [50, 99])
        parts.append(f"{name} p50 {p50:.2f} p99 {p99:.2f} worst {max(found[name]):.2f}")
    rest = {k: v for k, v in found.items() if not k.endswith("_ms")}
    return f"{len(found['whole_ms'])} trips: {'; '.join(parts)}; {rest}"


def main() -> None:
    """The command."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--serve", action="store_true", help=argparse.SUPPRESS)
    options.add_argument("--trips", type=int, default=500)
    options.add_argument("--load", choices=("jxl", "png", "none"), default="jxl")
    options.add_argument("--rate", type=float, default=1000.0, help="of the force records, Hz")
    options.add_argument("--hogs", type=int, default=0, help="busy processes beside it")
    asked = options.parse_args()
    if asked.serve:
        serve(asked.rate)
    else:
        hogs = [subprocess.Popen([sys.executable, "-c", "while 1: 0"]) for _ in range(asked.hogs)]
        try:
            print(row(measure(asked.trips, asked.load, asked.rate, 10.0)), os.getloadavg())
        finally:
            for hog in hogs:
                hog.kill()


if __name__ == "__main__":
    main()
