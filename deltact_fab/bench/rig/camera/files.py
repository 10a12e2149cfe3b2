"""Images from the disk, of which every one counts, and those that come from an address."""

from __future__ import annotations

import os
import re
from collections.abc import Generator, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from deltact_fab.common import Image, InputError, RunFailed, SensorError, disk_errors

from ..interface import Clock
from .stream import ArrivedImage

IMAGE_NAMES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff")
ASSUMED_HZ = 30.0
"""Of images that come without times."""
OPEN_MS = 10_000
READ_MS = 2_000


class ImageFolder:
    """The images of a folder in order of their names, numbers by size."""

    kind = "folder"
    rate_hz = ASSUMED_HZ

    def __init__(self, folder: Path) -> None:
        """Raises InputError for a folder without images."""
        self.name = str(folder)
        self._files = sorted(
            (p for p in folder.iterdir() if p.suffix.lower() in IMAGE_NAMES), key=sort_by_number
        )
        if not self._files:
            raise InputError(f"{folder}: no image in this folder ({', '.join(IMAGE_NAMES)})")

    def read(self) -> Generator[Image, None, None]:
        """Each image (h, w, 3) BGR uint8 in order. Raises RunFailed."""
        for file in self._files:
            with disk_errors(file, "read"):
                data = file.read_bytes()
            yield decode_image(file, data)

    def close(self) -> None:
        """Nothing is held open."""


def decode_image(file: Path, data: bytes) -> Image:
    """An image file's bytes as (h, w, 3) BGR uint8. Raises RunFailed."""
    coded = np.frombuffer(data, np.uint8)
    image = cv2.imdecode(coded, cv2.IMREAD_COLOR) if coded.size else None
    if image is None:
        raise RunFailed(f"{file}: does not decode as an image")
    return np.asarray(image, np.uint8)


def sort_by_number(path: Path) -> list[tuple[int, str]]:
    """What paths are sorted by: their names, numbers in them by size."""
    return [(int(p), "") if p.isdigit() else (-1, p) for p in re.split(r"(\d+)", path.name)]


class Video:
    """A video file."""

    kind = "video"

    def __init__(self, file: Path) -> None:
        """Raises InputError for a file that is no video."""
        self.name = str(file)
        self._capture = quietly_opened(str(file))
        if not self._capture.isOpened():
            raise InputError(f"{file}: not a video that can be read")
        self.rate_hz = self._capture.get(cv2.CAP_PROP_FPS) or ASSUMED_HZ

    def read(self) -> Generator[Image, None, None]:
        k = 0
        while True:
            done, image = self._capture.read()
            if not done:
                break
            yield np.asarray(image, np.uint8)
            k += 1
        if k == 0:
            raise RunFailed(f"{self.name}: holds no image")

    def close(self) -> None:
        self._capture.release()


ImageSource = ImageFolder | Video
"""Images of one size, one after another."""


def list_images(path: Path) -> ImageSource:
    """Of a folder or a video. Raises InputError, one line."""
    if not path.exists():
        raise InputError(f"{path}: no such file or folder")
    return ImageFolder(path) if path.is_dir() else Video(path)


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
