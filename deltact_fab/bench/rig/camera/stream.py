"""A camera that runs by itself: read in a thread of its own, its losses counted.

What differs between a device, an address and a command is a `Feed`; what is the same is here.
"""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np

from deltact_fab.common import DeltactFabError, Image, SensorError

from ..interface import CameraFrame, Clock

QUEUE_DEPTH = 8
"""Images that wait to be taken. The oldest gives way, and counts as dropped."""
FIRST_IMAGE_S = 10.0
"""So long a camera may take for its first image: an address is found, a lens comes up."""
MIN_STALL_S = 0.5
STALL_PERIODS = 5.0
"""A camera that is silent for so many periods, and MIN_S, has stalled."""
FEED_WAIT_S = 0.05
"""A feed is waited for no longer at a time, so that `close` is heard."""
MAX_STAMP_OFFSET_S = 5.0
"""A stamp that is so far from the time of arrival is not of this computer's clock."""
NUMBER_MODULUS = 1 << 32
"""Devices count in 32 bits."""


@dataclass(frozen=True)
class FeedImage:
    """An image of a camera's feed. t_s: its stamp; number: of the sender's count, None without."""

    image: Image
    t_s: float
    number: int | None = None


class Feed(Protocol):
    """Where the images of a camera that runs by itself come from. Used by one thread."""

    name: str
    stamps: str
    """Who stamps an image: "driver", "sender", or "arrival" for the host when it has come."""
    check: str
    """What to look at when nothing comes."""

    def next(self, timeout_s: float) -> FeedImage | None:
        """The next image, None when none comes in time. Raises SensorError when none ever will."""

    def identity(self) -> dict[str, Any]:
        """What the record keeps of it."""

    def close(self) -> None:
        """Let go of it; no thread is in `next` any longer."""


class StreamCamera:
    """A `Camera` over a feed of images: each capture is the next image after the last.

    A consumer that takes every image gets every image; one that is slow loses the oldest, and they
    are counted in `CameraFrame.dropped` with those that the device lost: by its own numbers where
    it counts, else by gaps between stamps at the nominal rate. Images that equal the one before
    them byte by byte are left out and counted, for no sensor without a fault is free of noise.
    """

    def __init__(
        self,
        feed: Feed,
        clock: Clock,
        *,
        size_px: tuple[int, int] | None = None,
        rate_hz: float | None = None,
        latency_s: float = 0.0,
    ) -> None:
        """size_px: width and height that every image has to have; None: those of the first.

        rate_hz: nominal, to tell losses from gaps and how long silence may last; None: neither.
        """
        self.name = feed.name
        self._feed = feed
        self._clock = clock
        self._size_px = size_px
        self._rate_hz = rate_hz
        self._latency_s = latency_s
        self.timeout_s = max(MIN_STALL_S, STALL_PERIODS / rate_hz if rate_hz else 0.0)
        self._has_come = threading.Condition()
        self._waiting: deque[CameraFrame] = deque()
        self._failure: Exception | None = None
        self._closing = threading.Event()
        self._not_before_s = -np.inf
        self._last: FeedImage | None = None
        self._dropped = self._repeated = 0  # since the last image that was put to wait
        self._repeats = 0  # repeats
        self._counts = {"images": 0, "dropped": 0, "repeated": 0, "stale": 0}
        self._thread = threading.Thread(target=self._run, name=f"camera {feed.name}", daemon=True)
        self._thread.start()

    def begin(self, stream: str) -> None:
        """Images exposed before now are left out, wherever they wait."""
        with self._has_come:
            self._not_before_s = self._clock.now_s()
            self._counts["stale"] += len(self._waiting)
            self._waiting.clear()
            self._dropped = self._repeated = 0

    def capture(self) -> CameraFrame:
        """The next image; raises SensorError, one line, when the camera has stalled or is gone."""
        with self._has_come:
            patience_s = self.timeout_s if self._last is not None else FIRST_IMAGE_S
            began_s, row = time.monotonic(), self._repeats
            while not self._waiting:
                if self._failure is not None:
                    raise SensorError(str(self._failure)) from self._failure
                left_s = began_s + patience_s - time.monotonic()
                if left_s <= 0:
                    raise SensorError(self._silence_text(patience_s, self._repeats - row))
                self._has_come.wait(left_s)
            frame = self._waiting.popleft()
            self._counts["images"] += 1
            self._counts["dropped"] += frame.dropped
            self._counts["repeated"] += frame.repeated
            return frame

    def end(self, frames: Mapping[str, float]) -> None:
        """Nothing is kept of a stream."""

    def identity(self) -> dict[str, Any]:
        numbers = self._last is not None and self._last.number is not None
        summary = {
            "name": self.name,
            **self._feed.identity(),
            "size_px": None if self._size_px is None else list(self._size_px),
            "rate_hz": self._rate_hz,
            "latency_ms": self._latency_s * 1e3,
            "stamped_by": self._feed.stamps,
            "losses_by": "numbers" if numbers else "gaps at the nominal rate, inferred",
        }
        if not numbers and self._rate_hz is None:
            summary["losses_by"] = "no rate is known: only those of the host are counted"
        with self._has_come:
            return {**summary, "counts": dict(self._counts)}

    def close(self) -> None:
        """Stop reading and let go of the camera; again does nothing."""
        self._closing.set()
        with self._has_come:
            self._failure = self._failure or SensorError(f"camera {self.name}: was closed")
            self._waiting.clear()
            self._has_come.notify_all()
        self._thread.join()
        self._feed.close()

    def _run(self) -> None:
        """The thread: every image as soon as it comes."""
        try:
            while not self._closing.is_set():
                arrived = self._feed.next(FEED_WAIT_S)
                if arrived is not None:
                    self._take(arrived)
        except Exception as error:
            text = error if isinstance(error, DeltactFabError) else f"camera {self.name}: {error}"
            with self._has_come:
                self._failure = SensorError(str(text))
                self._has_come.notify_all()

    def _take(self, arrived: FeedImage) -> None:
        """Judge one image and put it where `capture` takes it. Raises SensorError."""
        self._require_match(arrived)
        previous = self._last
        n_lost, same = self._count_lost(previous, arrived)
        same = same or (previous is not None and _equal(previous.image, arrived.image))
        with self._has_come:
            self._last = arrived
            t_s = arrived.t_s - self._latency_s
            if t_s < self._not_before_s:
                self._counts["stale"] += 1
                return
            self._dropped += n_lost
            self._repeats = self._repeats + 1 if same else 0
            if same:
                self._repeated += 1
                return
            self._enqueue(
                CameraFrame(arrived.image, t_s, arrived.number, self._dropped, self._repeated)
            )
            self._dropped = self._repeated = 0

    def _enqueue(self, frame: CameraFrame) -> None:
        self._waiting.append(frame)
        if len(self._waiting) > QUEUE_DEPTH:
            dropped = self._waiting.popleft()
            oldest = self._waiting[0]
            self._waiting[0] = replace(
                oldest,
                dropped=oldest.dropped + dropped.dropped + 1,
                repeated=oldest.repeated + dropped.repeated,
            )
        self._has_come.notify_all()

    def _require_match(self, arrived: FeedImage) -> None:
        """Refuse another size and another clock."""
        h, w = arrived.image.shape[:2]
        if self._size_px is None:
            self._size_px = (w, h)
        if (w, h) != self._size_px:
            raise SensorError(
                f"camera {self.name}: an image of {w} x {h} px; {self._size_px[0]} x "
                f"{self._size_px[1]} px were asked for"
            )
        offset_s = arrived.t_s - self._clock.now_s()
        if abs(offset_s) > MAX_STAMP_OFFSET_S:
            raise SensorError(
                f"camera {self.name}: its stamps are {offset_s:+.0f} s off this computer's "
                "monotonic clock; stamp with CLOCK_MONOTONIC of this computer"
            )

    def _count_lost(self, previous: FeedImage | None, current: FeedImage) -> tuple[int, bool]:
        """Images that are missing between two, and whether both are the same by number."""
        if previous is None:
            return 0, False
        if previous.number is not None and current.number is not None:
            steps = (current.number - previous.number) % NUMBER_MODULUS
            if steps >= NUMBER_MODULUS // 2:
                raise SensorError(
                    f"camera {self.name}: image {current.number} after {previous.number}: its "
                    "count went back: it was restarted"
                )
            return max(steps - 1, 0), steps == 0
        if self._rate_hz is None:
            return 0, False
        return max(round((current.t_s - previous.t_s) * self._rate_hz) - 1, 0), False

    def _silence_text(self, waited_s: float, repeats: int) -> str:
        problem = f"stalled, no image within {waited_s:.1f} s"
        if repeats:
            repetition = f"the same image over and over, {repeats + 1} times in {waited_s:.1f} s"
            problem = f"{repetition}; the camera hangs: restart it"
        elif self._last is None:
            problem = f"no first image within {waited_s:.0f} s"
        return f"camera {self.name}: {problem}; check {self._feed.check}"


def _equal(a: Image, b: Image) -> bool:
    """Byte by byte; a few rows tell most images apart, and the whole takes 2 ms."""
    return np.array_equal(a[::64], b[::64]) and np.array_equal(a, b)
