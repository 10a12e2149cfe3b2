"""The camera of a bench on the wall clock: stamped raw images into a named pipe."""

from __future__ import annotations

import errno
import math
import os
import threading
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path

import numpy as np

from ...errors import DeltactFabError
from ...optics import Fisheye
from ...rig.camera.command import HEADER
from ..devices import Seen, write_truth
from ..picture import FrameRenderer
from ..scene import LatticeCrop, Observation
from .scene import LiveScene

LOOK_S = 0.02
STALE_NS = 3_000_000_000  # to draw, on a computer with better things to do; beyond it is no news
SAME_NS = 1000  # two stamps that are one but for their way through a float


class LiveCamera:
    """Draws images at the rate it is given, or as fast as it can, while they are being read.

    look: the surface and the time (ns, monotonic) at which it is so. What an image shows is that
    moment, however long it took to draw.
    """

    def __init__(
        self,
        picture: FrameRenderer,
        look: Callable[[], tuple[int, Observation]],
        fifo: Path,
        rate_hz: float,
        seed: int,
    ) -> None:
        self._picture, self._look = picture, look
        self._fifo = fifo
        self._period_s = 1 / rate_hz
        self._seed = seed
        self._number = 0
        self._lock = threading.Lock()
        self._drawn: dict[int, Seen] = {}
        self.seconds = 0.0
        """Spent drawing."""
        self._since_s = math.inf
        os.mkfifo(fifo)
        self._thread = threading.Thread(target=self._run, name="camera", daemon=True)
        self._thread.start()

    @property
    def drawn(self) -> int:
        """Images so far."""
        return self._number

    @property
    def seen_s(self) -> float:
        """Since when someone reads, in seconds."""
        return max(time.monotonic() - self._since_s, 0.0)

    def begin(self) -> None:
        """A press begins: images of the one before are no longer asked for."""
        with self._lock:
            self._drawn.clear()

    def keep(
        self,
        folder: Path,
        press: str,
        frames: Mapping[str, float],
        scene: LiveScene,
        crop: LatticeCrop,
        lens: Fisheye | None,
    ) -> None:
        """Write the truth of these frames, ids and times (s). Raises RunFailed, KeyError."""
        with self._lock:
            stamps = np.fromiter(self._drawn, np.int64)
            seen = list(self._drawn.values())
        found = []
        for frame_id, t_s in frames.items():
            off_ns = np.abs(stamps - round(t_s * 1e9))
            k = int(np.argmin(off_ns)) if len(off_ns) else -1
            if k < 0 or off_ns[k] > SAME_NS:
                raise KeyError(f"{frame_id}: no image of that time was drawn")
            found.append(seen[k])
        write_truth(folder, press, list(frames), found, scene, crop.lattice, lens)

    def _run(self) -> None:
        while True:
            pipe = self._opened()
            with suppress(BrokenPipeError):
                self._stream(pipe)
            os.close(pipe)

    def _opened(self) -> int:
        """Wait for a reader."""
        while True:
            try:
                pipe = os.open(self._fifo, os.O_WRONLY | os.O_NONBLOCK)
            except OSError as why:
                if why.errno != errno.ENXIO:
                    raise
                time.sleep(LOOK_S)
                continue
            os.set_blocking(pipe, True)
            return pipe

    def _stream(self, pipe: int) -> None:
        self._since_s = due_s = time.monotonic()
        while True:
            time.sleep(max(due_s - time.monotonic(), 0.0))
            due_s = max(due_s + self._period_s, time.monotonic())
            rng = np.random.default_rng(np.random.SeedSequence([self._seed, 4, self._number]))
            try:
                t_ns, seen = self._look()
                started = time.thread_time()
                image = self._picture.render(seen.displacement_mm(), rng)
            except DeltactFabError:
                continue  # no view of it can be drawn: it is an image less
            self.seconds += time.thread_time() - started
            if time.monotonic_ns() - t_ns > STALE_NS:
                self._number += 1  # lost, and by its number the host knows it
                continue
            with self._lock:
                self._drawn[t_ns] = (seen.a.index, seen.b.index, seen.fraction)
            parts = [memoryview(HEADER.pack(t_ns, self._number, 0)), image.reshape(-1).data]
            self._number += 1
            for part in parts:
                while part:
                    part = part[os.write(pipe, part) :]
