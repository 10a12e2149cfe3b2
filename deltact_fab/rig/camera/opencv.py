"""Images of V4L2 devices and of network addresses, as OpenCV delivers them.

A V4L2 device is waited for with `poll`, for OpenCV's own `grab` waits ten seconds. Its driver's
stamp of a buffer, of the kernel's monotonic clock, is what OpenCV gives as CAP_PROP_POS_MSEC
(modules/videoio/src/cap_v4l.cpp, getProperty); the buffer's number it does not give.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import Any, Protocol

import cv2
import numpy as np

from ...errors import InputError, SensorError
from ..interface import Clock, Image
from .config import CameraConfig
from .locks import locked
from .stream import OTHER_CLOCK_S, Arrived

OPEN_MS = 10_000
READ_MS = 2_000


class Capture(Protocol):
    """What is used of cv2.VideoCapture."""

    def get(self, key: int) -> float: ...
    def set(self, key: int, value: float) -> bool: ...
    def grab(self) -> bool: ...
    def retrieve(self) -> tuple[bool, Any]: ...
    def release(self) -> None: ...


class DeviceFeed:
    """Implements Feed: a V4L2 device, set up as the rig file has it."""

    check = "its cable and power, and that nothing else uses it"

    def __init__(self, config: CameraConfig, clock: Clock, capture: Any = None) -> None:
        """capture: an open cv2.VideoCapture in place of the source's.

        Raises InputError for a device that cannot be opened or keeps other settings.
        """
        self.name = config.name
        self._clock = clock
        source = config.source
        assert source is not None, "the configuration is that of a device"
        self._capture = quietly_opened(source, cv2.CAP_V4L2) if capture is None else capture
        if not self._capture.isOpened():
            raise InputError(
                f"camera.source: {self.name}: no camera that can be opened; is it there, or in use?"
            )
        try:
            self._controls = locked(self._capture, config)
        except InputError:
            self._capture.release()
            raise
        self.rate_hz = _positive(self._capture.get(cv2.CAP_PROP_FPS))
        self.stamps = "driver"

    def next(self, timeout_s: float) -> Arrived | None:
        """As Feed."""
        done, _ = cv2.VideoCapture.waitAny([self._capture], int(timeout_s * 1e9))
        if not done:
            return None
        now_s = self._clock.now_s()
        t_s = self._capture.get(cv2.CAP_PROP_POS_MSEC) / 1e3
        if abs(t_s - now_s) > OTHER_CLOCK_S:  # a driver that stamps by another clock, or not
            t_s, self.stamps = now_s, "arrival"
        return Arrived(_retrieved(self._capture, self.name), t_s)

    def identity(self) -> dict[str, Any]:
        """What the device keeps of what it was asked for."""
        return {"kind": "v4l2", "controls": self._controls}

    def close(self) -> None:
        """Let go of the device."""
        self._capture.release()


class UrlFeed:
    """Implements Feed: a stream on the network."""

    check = "its address, the network, and that the camera is on"
    stamps = "arrival"

    def __init__(self, url: str, clock: Clock) -> None:
        """Raises InputError for an address that gives no images."""
        self.name = url
        self._clock = clock
        options = [
            cv2.CAP_PROP_OPEN_TIMEOUT_MSEC, OPEN_MS, cv2.CAP_PROP_READ_TIMEOUT_MSEC, READ_MS,
        ]  # fmt: skip
        self._capture = quietly_opened(url, cv2.CAP_FFMPEG, options)
        if not self._capture.isOpened():
            raise InputError(f"camera.source: {url}: no stream of images; check {self.check}")
        self.rate_hz = _positive(self._capture.get(cv2.CAP_PROP_FPS))

    def next(self, timeout_s: float) -> Arrived | None:
        """As Feed, but that it waits for READ_MS at most."""
        if not self._capture.grab():
            raise SensorError(f"camera {self.name}: gives no more images; check {self.check}")
        t_s = self._clock.now_s()
        return Arrived(_retrieved(self._capture, self.name), t_s)

    def identity(self) -> dict[str, Any]:
        """The address."""
        return {"kind": "url"}

    def close(self) -> None:
        """Let go of the address."""
        self._capture.release()


def quietly_opened(
    name: int | str, backend: int = cv2.CAP_ANY, options: Sequence[int] = ()
) -> cv2.VideoCapture:
    """What OpenCV makes of a name, without its own words on stderr where that is nothing."""
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")  # and FFmpeg's
    level = cv2.utils.logging.getLogLevel()
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
    try:
        return cv2.VideoCapture(name, backend, list(options))
    finally:
        cv2.utils.logging.setLogLevel(level)


def _retrieved(capture: Capture, name: str) -> Image:
    done, image = capture.retrieve()
    if not done:
        raise SensorError(f"camera {name}: an image that cannot be decoded")
    return np.asarray(image, np.uint8)


def _positive(value: float) -> float | None:
    return value if value > 0 else None
