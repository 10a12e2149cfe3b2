"""How many frames a second the writer of a run keeps up with, and whom it keeps from running.

`python -m benchmarks.recording [--frames N] [--size WxH] [--folder DIR] [--format png,jxl]`

Through the real `RunWriter`, onto the disk of DIR. For each format:

- as fast as it takes them: frames/s of wall time, and CPU time of all threads for a frame. A busy
  machine spoils the first and not the second: two idle cores hold 2000 / (CPU ms) frames/s.
- at 30 and 60 frames/s, none of them waiting for room: how many are dropped; and by how much a
  thread that wants to run every 5 ms, as the one that moves the stage, comes late meanwhile.
"""

from __future__ import annotations

import argparse
import json
import os
import tempfile
import threading
import time
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from deltact_fab.bench.protocols.plan import Step
from deltact_fab.bench.record.writer import RunWriter

PERIOD_S = 0.005
RATES_HZ = (30.0, 60.0)
IDLE_S = 3.0  # of the same thread with nothing written, for comparison
DIFFERENT = 8  # images, in turn


def images(width_px: int, height_px: int) -> list[NDArray[np.uint8]]:
    """Random patches of 10 px in eight colours, blurred as a lens does, and noise of 2 levels."""
    import cv2

    rng = np.random.default_rng(0)
    colours = rng.integers(40, 220, (8, 3))
    patches = rng.integers(0, 8, (height_px // 10 + 1, width_px // 10 + 1))
    sheet = np.kron(colours[patches], np.ones((10, 10, 1)))[:height_px, :width_px]
    blurred = cv2.GaussianBlur(sheet.astype(np.float32), (0, 0), 1.5)
    shape = (height_px, width_px, 3)
    return [
        np.clip(np.rint(blurred + rng.normal(0, 2, shape)), 0, 255).astype(np.uint8)
        for _ in range(DIFFERENT)
    ]


class Late:
    """A thread that wants to run every PERIOD_S; by how much it came late (ms)."""

    def __init__(self) -> None:
        self.ms: list[float] = []
        self._done = threading.Event()
        self._thread = threading.Thread(target=self._run)

    def __enter__(self) -> Late:
        self._thread.start()
        return self

    def __exit__(self, *why: object) -> None:
        self._done.set()
        self._thread.join()

    def _run(self) -> None:
        while not self._done.is_set():
            before_s = time.monotonic()
            time.sleep(PERIOD_S)
            self.ms.append((time.monotonic() - before_s - PERIOD_S) * 1e3)

    def figures(self) -> dict[str, float]:
        """Median, 99th percentile and worst, ms."""
        p50, p99 = np.percentile(self.ms, [50, 99])
        return {"median_ms": float(p50), "p99_ms": float(p99), "worst_ms": max(self.ms)}


def measured(
    folder: Path, suffix: str, frames: int, seen: list[NDArray[np.uint8]], rate_hz: float | None
) -> dict[str, float | int | str]:
    """One writer, `frames` frames; rate_hz: None is as fast as it takes them."""
    step = Step("a/p1/press", "a/p1", "sphere:10", "press", (0.0, 0.0, -1.0), 30.0, frames)
    meta = {"simulated": False, "camera": None, "rig": {"camera": {"format": suffix}}}
    writer = RunWriter.create(folder, meta, b"", {"dots_mm": [], "dot_diameter_mm": 0.0}, [step])
    writer.load_encoder()
    dropped = 0
    with Late() as late:
        cpu_s, start_s = time.process_time(), time.monotonic()
        for k in range(1, frames + 1):
            if rate_hz is not None:
                time.sleep(max(start_s + k / rate_hz - time.monotonic(), 0.0))
            image = seen[k % len(seen)].copy()  # a camera's image is its own
            kept = writer.frame(step, k, image, k / 60, k / 60, k / 60, wait=rate_hz is None)
            dropped += kept is None
        given_s = time.monotonic() - start_s
        writer.flush()
        took_s, cpu_s = time.monotonic() - start_s, time.process_time() - cpu_s
    writer.close({})
    size = sum(path.stat().st_size for path in (folder / "images").iterdir())
    kept_frames = frames - dropped
    return {
        "format": suffix,
        "asked_hz": rate_hz or 0.0,
        "frames": frames,
        "dropped": dropped,
        "frames_per_s": kept_frames / took_s,
        "queue_s": took_s - given_s,
        "cpu_ms_a_frame": cpu_s * 1e3 / max(kept_frames, 1),
        "mb_a_frame": size / 1e6 / max(kept_frames, 1),
        **late.figures(),
    }


def main() -> None:
    """Measure and print a line of JSON each."""
    ask = argparse.ArgumentParser(description=__doc__)
    ask.add_argument("--frames", type=int, default=240)
    ask.add_argument("--size", default="1280x720")
    ask.add_argument("--format", default="png,jxl")
    ask.add_argument("--folder", type=Path, help="Where to write; a temporary folder without it.")
    given = ask.parse_args()
    width_px, height_px = map(int, given.size.split("x"))
    seen = images(width_px, height_px)
    with Late() as idle:
        time.sleep(IDLE_S)
    machine = {"cores": os.cpu_count(), "load": os.getloadavg(), "idle": idle.figures()}
    print(json.dumps(machine))
    with tempfile.TemporaryDirectory(dir=given.folder) as folder:
        for suffix in given.format.split(","):
            for rate_hz in (None, *RATES_HZ):
                out = Path(folder) / f"{suffix}-{rate_hz or 0:.0f}"
                row = measured(out, suffix, given.frames, seen, rate_hz)
                told = {k: round(v, 2) if isinstance(v, float) else v for k, v in row.items()}
                print(json.dumps(told), flush=True)


if __name__ == "__main__":
    main()
