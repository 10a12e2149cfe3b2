"""The bench's camera, the real client above it, and what goes wrong with it or the force box."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...aliases import Image
from ...errors import SensorError
from ...rig.camera.stream import ArrivedImage, StreamCamera
from ...rig.interface import CameraFrame
from ...virtual.clock import VirtualClock
from ...virtual.netft import BoxFaults, Datagram
from ...virtual.seeds import stream_number

Place = Callable[[], tuple[float, float, float]]


class WatchedFaults(BoxFaults):
    """Notes when the first record was taken that tells of something wrong, or does not come."""

    limit_counts = math.inf
    first_bad_ns = 0

    def datagrams(self, t_ns: NDArray[np.int64], records: NDArray[Any]) -> list[Datagram]:
        """As a box's faults make them."""
        wrong = self.silent or self.error or self.saturated or self.late_s or self.drop_every
        bad = np.abs(records["counts"][:, :3]).max(axis=1) > self.limit_counts
        if (wrong or bad.any()) and not self.first_bad_ns:
            self.first_bad_ns = int(t_ns[0 if wrong else bad.argmax()])
        return super().datagrams(t_ns, records)


class BenchFeed:
    """A feed of 32 x 24 pixels: an image depends on the press, its number there and the tip.

    It gives an image when it is told to, which makes a camera's thread repeatable.
    """

    name = "bench"
    stamps = "sender"
    check = "its cable"

    def __init__(self, clock: VirtualClock, tip_mm: Place) -> None:
        self._clock = clock
        self._tip_mm = tip_mm
        self._told = threading.Semaphore(0)
        self._press, self._k = "", 0
        self._last: Image | None = None
        self.hangs = False

    def press(self, name: str) -> None:
        """Another press begins."""
        self._press, self._k = name, 0

    def tell(self, hangs: bool = False) -> None:
        """One image; hangs: from now on the last one, over and over."""
        self.hangs = hangs
        self._told.release()

    def next(self, timeout_s: float) -> ArrivedImage | None:
        """As rig.camera.stream.Feed."""
        if not self.hangs and not self._told.acquire(timeout=timeout_s):
            return None
        if self.hangs and self._last is not None:
            threading.Event().wait(0.01)
            return ArrivedImage(self._last, self._clock.now_s())
        self._k += 1
        seed = [stream_number(self._press), self._k]
        image = np.random.default_rng(seed).integers(0, 200, (24, 32, 3), np.uint8)
        image[0, :3, 0] = [round(200 + 20 * p) % 256 for p in self._tip_mm()]
        self._last = image
        return ArrivedImage(image, self._clock.now_s())

    def identity(self) -> dict[str, Any]:
        """As Feed."""
        return {"kind": "bench"}

    def close(self) -> None:
        """As Feed."""


class BenchCamera(StreamCamera):
    """The real camera on that feed, which gives an image as soon as one is asked for.

    faults: "stalled", "hung": from that time on (s) no image comes, or the same one over and over.
    """

    first_bad_ns = 0

    def __init__(self, clock: VirtualClock, tip_mm: Place, faults: Mapping[str, float]) -> None:
        self.feed, self.clock, self.faults = BenchFeed(clock, tip_mm), clock, faults
        super().__init__(self.feed, clock)
        self.feed.tell()
        super().capture()  # it is up: the first image may take longer than all others

    def begin(self, stream: str) -> None:
        """Of a press."""
        self.feed.press(stream)
        super().begin(stream)

    def capture(self) -> CameraFrame:
        """The next image. What the camera waits in vain on the wall clock passes on the bench's."""
        now_s = self.clock.now_s()
        stalled, hung = (self.faults.get(k, math.inf) <= now_s for k in ("stalled", "hung"))
        if (stalled or hung) and not self.first_bad_ns:
            self.first_bad_ns = self.clock.now_ns()
        if not stalled:
            self.feed.tell(hung)
        try:
            return super().capture()
        except SensorError:
            self.clock.sleep_s(self.timeout_s)
            raise
