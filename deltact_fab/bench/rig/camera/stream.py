"""A free-running camera: read in a thread of its own, its losses counted.

A `Feed` covers the differences between a device, an address and a command.
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

from ..interface import CameraFrame, Clock, require_past

# Decision 0030; by hand: a deeper queue holds older images, longer limits report a stall later.
QUEUE_DEPTH = 8  # images; the oldest is dropped, and counted
FIRST_IMAGE_S = 10.0  # for the first image: name resolution, warm-up
MIN_STALL_S = 0.5
STALL_PERIODS = 5.0  # without an image, and at least MIN_STALL_S: stalled
FEED_WAIT_S = 0.05  # longest wait in a feed, which delays `close`
MAX_STAMP_AGE_S = 5.0  # a stamp that is older on arrival is of another clock
LAG_WINDOW_S, MIN_LAG_IMAGES = 1.0, 5  # whose least age is the lag of a stream
MIN_LAG_S = 0.25  # and STALL_PERIODS: a lag that a camera which keeps up does not have
MAX_LOST_IMAGES = 30  # in a row: the camera is unusable
NUMBER_MODULUS = 1 << 32  # format of V4L2 and of the header: 32 bits


@dataclass(frozen=True)
class FeedImage:
    """An image of a feed. t_s: its stamp; number: the sender's count, None without."""

    image: Image
    t_s: float
    number: int | None = None


class LostImage(Exception):
    """An image that came damaged or of another size; its text is the reason."""


class Feed(Protocol):
    """Source of images of a free-running camera, used by one thread."""

    name: str
    stamps: str
    """Origin of the stamps: "driver", "sender", or "arrival" at the host."""
    check: str
    """Things to check when no image comes."""

    def next(self, timeout_s: float) -> FeedImage | None:
        """Return the next image, None at the timeout.

        Raises LostImage for a damaged one, SensorError at the end of the feed.
        """

    def identity(self) -> dict[str, Any]:
        """Return the data for the record."""

    def close(self) -> None:
        """Release the device; no thread is in `next` any more."""


class StreamCamera:
    """A `Camera` over a feed of images: each capture is the next image after the last.

    A slow consumer loses the oldest images. `CameraFrame.dropped` counts these, damaged ones, and
    those that the device lost: by its own numbers if it counts, else by gaps between stamps at the
    nominal rate. Images identical byte by byte to the previous one are skipped and counted, because
    a working sensor has noise.
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
        """size_px: required width and height; None: those of the first image.

        rate_hz: nominal, to infer losses and detect a stall; None: no losses inferred.
        """
        self.name = feed.name
        self._feed = feed
        self._clock = clock
        self._size_px = size_px
        self._rate_hz = rate_hz
        self._latency_s = latency_s
        periods_s = STALL_PERIODS / rate_hz if rate_hz else 0.0
        self.timeout_s = max(MIN_STALL_S, periods_s) + latency_s
        self._max_lag_s = min(max(MIN_LAG_S, periods_s), MAX_STAMP_AGE_S)
        self._ages_s: list[float] = []  # of the images on arrival, since _ages_from_s
        self._ages_from_s = self._lag_s = 0.0
        self._has_come = threading.Condition()
        self._waiting: deque[CameraFrame] = deque()
        self._failure: Exception | None = None
        self._closing = threading.Event()
        self._not_before_s = -np.inf
        self._last: FeedImage | None = None
        self._dropped = self._repeated = 0  # since the last image that was put to wait
        self._repeats = 0  # repeats
        self._lost, self._loss = 0, ""  # since the last image that was not lost, and the reason
        self._counts = {"images": 0, "dropped": 0, "damaged": 0, "repeated": 0, "stale": 0}
        self._thread = threading.Thread(target=self._run, name=f"camera {feed.name}", daemon=True)
        self._thread.start()

    def begin(self, stream: str) -> None:
        """Discard images exposed before now."""
        with self._has_come:
            self._not_before_s = self._clock.now_s()
            self._counts["stale"] += len(self._waiting)
            self._waiting.clear()
            self._dropped = self._repeated = 0

    def capture(self) -> CameraFrame:
        """Return the next image; raises SensorError, one line, for a stalled or lost camera."""
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
        """Do nothing: no data of a stream is held."""

    def identity(self) -> dict[str, Any]:
        numbers = self._last is not None and self._last.number is not None
        summary = {
            "name": self.name,
            **self._feed.identity(),
            "size_px": None if self._size_px is None else list(self._size_px),
            "rate_hz": self._rate_hz,
            "latency_ms": self._latency_s * 1e3,
            "stamped_by": self._feed.stamps,
            "lag_ms": round(self._lag_s * 1e3),
            "losses_by": "numbers" if numbers else "gaps at the nominal rate, inferred",
        }
        if not numbers and self._rate_hz is None:
            summary["losses_by"] = "host only: the rate is unknown"
        with self._has_come:
            return {**summary, "counts": dict(self._counts)}

    def close(self) -> None:
        """Stop reading and release the camera; idempotent."""
        self._closing.set()
        with self._has_come:
            self._failure = self._failure or SensorError(f"camera {self.name}: was closed")
            self._waiting.clear()
            self._has_come.notify_all()
        self._thread.join()
        self._feed.close()

    def _run(self) -> None:
        """Thread: accept every image as it arrives."""
        try:
            while not self._closing.is_set():
                try:
                    arrived = self._feed.next(FEED_WAIT_S)
                    if arrived is not None:
                        self._take(arrived)
                except LostImage as loss:
                    self._count_damaged(str(loss))
        except Exception as error:
            text = error if isinstance(error, DeltactFabError) else f"camera {self.name}: {error}"
            with self._has_come:
                self._failure = SensorError(str(text))
                self._has_come.notify_all()

    def _count_damaged(self, reason: str) -> None:
        """Count an image that was lost. Raises SensorError for MAX_LOST_IMAGES in a row."""
        with self._has_come:
            self._lost, self._loss = self._lost + 1, reason
            self._counts["damaged"] += 1
        if self._lost >= MAX_LOST_IMAGES:
            text = f"{self._lost} images in a row lost: {reason}"
            raise SensorError(f"camera {self.name}: {text}; check {self._feed.check}")

    def _take(self, arrived: FeedImage) -> None:
        """Check one image and queue it for `capture`. Raises SensorError, LostImage."""
        self._require_match(arrived)
        previous = self._last
        n_lost, same = self._count_lost(previous, arrived)
        n_lost, self._lost = max(n_lost, self._lost), 0
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
        """Raise LostImage for another image size, SensorError for another clock."""
        h, w = arrived.image.shape[:2]
        if self._size_px is None:
            self._size_px = (w, h)
        if (w, h) != self._size_px:
            expected = f"{self._size_px[0]} x {self._size_px[1]} px expected"
            raise LostImage(f"{w} x {h} px; {expected}")
        now_s = self._clock.now_s()
        require_past(f"camera {self.name}", arrived.t_s, now_s)
        if now_s - arrived.t_s > MAX_STAMP_AGE_S:
            raise SensorError(self._lag_text(now_s - arrived.t_s))
        self._ages_s.append(now_s - arrived.t_s)
        self._ages_from_s = self._ages_from_s or now_s
        if now_s - self._ages_from_s >= LAG_WINDOW_S and len(self._ages_s) >= MIN_LAG_IMAGES:
            self._lag_s, self._ages_s, self._ages_from_s = min(self._ages_s), [], now_s
            if self._lag_s > self._max_lag_s:
                raise SensorError(self._lag_text(self._lag_s))

    def _lag_text(self, lag_s: float) -> str:
        return (
            f"camera {self.name}: images arrive {lag_s:.2f} s after their stamps, more than "
            f"{self._max_lag_s:g} s: the clock of its {self._feed.stamps} is behind "
            "CLOCK_MONOTONIC of this computer, or images queue up on their way"
        )

    def _count_lost(self, previous: FeedImage | None, current: FeedImage) -> tuple[int, bool]:
        """Number of images missing between two, and True if both have the same number."""
        if previous is None:
            return 0, False
        if previous.number is not None and current.number is not None:
            steps = (current.number - previous.number) % NUMBER_MODULUS
            if steps >= NUMBER_MODULUS // 2:
                raise SensorError(
                    f"camera {self.name}: image {current.number} after {previous.number}: it "
                    "restarted its numbering"
                )
            return max(steps - 1, 0), steps == 0
        if self._rate_hz is None:
            return 0, False
        return max(round((current.t_s - previous.t_s) * self._rate_hz) - 1, 0), False

    def _silence_text(self, waited_s: float, repeats: int) -> str:
        if (lag_s := min(self._ages_s, default=0.0)) > self._max_lag_s:
            return self._lag_text(lag_s)
        problem = f"stalled: no image within {waited_s:.1f} s"
        if repeats:
            repetition = f"the same image {repeats + 1} times in {waited_s:.1f} s"
            problem = f"{repetition}; the camera hangs; restart it"
        elif self._last is None:
            problem = f"no first image within {waited_s:.0f} s"
        if self._lost:
            problem += f", {self._lost} lost: {self._loss}"
        return f"camera {self.name}: {problem}; check {self._feed.check}"


def _equal(a: Image, b: Image) -> bool:
    """Compare byte by byte, a few rows first (measured: 2 ms for a whole image)."""
    return np.array_equal(a[::64], b[::64]) and np.array_equal(a, b)
