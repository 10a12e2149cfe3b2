"""Images of an address on the network, as OpenCV's FFmpeg delivers them."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import Any

import cv2
import numpy as np

from ...errors import InputError, SensorError
from ..interface import Clock
from .stream import ArrivedImage

OPEN_MS = 10_000
READ_MS = 2_000


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
        self.rate_hz = self._capture.get(cv2.CAP_PROP_FPS) or None

    def next(self, timeout_s: float) -> ArrivedImage | None:
        """As Feed, but that it waits for READ_MS at most."""
        if not self._capture.grab():
            raise SensorError(f"camera {self.name}: gives no more images; check {self.check}")
        t_s = self._clock.now_s()
        done, image = self._capture.retrieve()
        if not done:
            raise SensorError(f"camera {self.name}: an image that cannot be decoded")
        return ArrivedImage(np.asarray(image, np.uint8), t_s)

    def identity(self) -> dict[str, Any]:
        return {"kind": "url"}

    def close(self) -> None:
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
