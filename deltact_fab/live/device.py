"""A camera of this computer."""

from __future__ import annotations

import time
from collections.abc import Iterator

import cv2
import numpy as np

from ..errors import InputError, SensorError
from ..rig.interface import Frame
from .source import NOTHING


class Device:
    """A camera that OpenCV can open. Times are those at which an image was handed over."""

    live = True
    known = NOTHING

    def __init__(
        self, number: int | str, size_px: tuple[int, int] | None = None, backend: int = cv2.CAP_V4L2
    ) -> None:
        """number: N of /dev/videoN, or the device file. size_px: what to ask the camera for.

        Raises InputError for a camera that cannot be opened.
        """
        self.name = f"/dev/video{number}" if isinstance(number, int) else number
        self._capture = quietly_opened(number, backend)
        if not self._capture.isOpened():
            raise InputError(f"{self.name}: no camera that can be opened; is it there, or in use?")
        if size_px is not None:
            self._capture.set(cv2.CAP_PROP_FRAME_WIDTH, size_px[0])
            self._capture.set(cv2.CAP_PROP_FRAME_HEIGHT, size_px[1])
        self._capture.set(cv2.CAP_PROP_BUFFERSIZE, 1)  # an older image is of no use

    def frames(self) -> Iterator[Frame]:
        """As Source. Raises SensorError when the camera gives no more."""
        while self._capture.grab():
            t_s = time.monotonic()
            done, image = self._capture.retrieve()
            if done:
                yield Frame(np.asarray(image, np.uint8), t_s)
        raise SensorError(f"{self.name}: the camera gives no more images")

    def close(self) -> None:
        """Let go of the camera."""
        self._capture.release()


def quietly_opened(name: int | str, backend: int = cv2.CAP_ANY) -> cv2.VideoCapture:
    """What OpenCV makes of a name, without its own words on stderr where that is nothing."""
    level = cv2.utils.logging.getLogLevel()
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
    try:
        return cv2.VideoCapture(name, backend)
    finally:
        cv2.utils.logging.setLogLevel(level)
