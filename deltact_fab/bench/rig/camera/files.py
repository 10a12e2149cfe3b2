"""Images from files, none of which is dropped, and from a network address."""

from __future__ import annotations

import os
import re
import time
from collections.abc import Generator, Sequence
from pathlib import Path
from typing import Any, ClassVar

import cv2
import numpy as np

from deltact_fab.common import Image, InputError, RunFailed, SensorError, disk_errors

from ...record.folder import read_file
from ...record.images import decode, prepare_jpeg
from ..interface import Clock
from .stream import FeedImage, LostImage

# By hand: longer limits report a dead source later, shorter ones lose a slow one.
DEFAULT_RATE_HZ = 30.0  # of images without times
URL_OPEN_MS = 10_000
URL_READ_MS = 2_000
FOLDER_POLL_S = 0.05
TIFF_STEADY_S = 0.5  # without growth a TIFF, which has no end mark, is complete


class ImageFolder:
    """The images of a folder in natural order of their names."""

    SUFFIXES: ClassVar = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff")
    kind = "folder"
    rate_hz = DEFAULT_RATE_HZ

    def __init__(self, folder: Path) -> None:
        """Raises InputError for a folder without images."""
        self.name = str(folder)
        self._files = sorted(
            (p for p in folder.iterdir() if p.suffix.lower() in self.SUFFIXES), key=_natural_key
        )
        if not self._files:
            raise InputError(f"{folder}: no image in this folder ({', '.join(self.SUFFIXES)})")

    def read(self) -> Generator[Image | None, None, None]:
        """Each image (h, w, 3) BGR uint8 in order; raises RunFailed.

        None stands for a damaged image of a video, whose time passes.
        """
        for file in self._files:
            yield self.load(file)

    def close(self) -> None:
        """Do nothing: no file is held open."""

    @staticmethod
    def load(file: Path) -> Image:
        """Read an image file (h, w, 3) BGR uint8. Raises RunFailed, also for a damaged image."""
        with disk_errors(file, "read"):
            data = _read_regular(file)
        try:
            return decode(data, str(file))
        except ValueError as error:
            raise RunFailed(f"{file}: {error}") from error


def _read_regular(file: Path) -> bytes:
    target = file.resolve()  # a folder that a user names may hold links
    return read_file(target.parent, target.name)


def _natural_key(path: Path) -> list[tuple[int, str]]:
    """Sort key of a path: its name, with numbers compared by value."""
    return [(int(p), "") if p.isdigit() else (-1, p) for p in re.split(r"(\d+)", path.name)]


class FollowedFolder(ImageFolder):
    """The images of a folder that is being written, each once it is complete, in natural order.

    An incomplete image is waited for before those that follow it. Ends when no byte came for
    silence_s.
    """

    def __init__(self, folder: Path, silence_s: float) -> None:
        self.name = str(folder)
        self._folder, self._silence_s = folder, silence_s

    def read(self) -> Generator[Image | None, None, None]:
        """Yield images, see ImageFolder. Raises RunFailed, also for one that stays incomplete."""
        processed, size, grown_s = set[str](), 0, time.monotonic()
        while True:
            incomplete = None
            for file in self._new_files(processed):
                try:
                    data = _read_regular(file)
                except FileNotFoundError:  # renamed meanwhile: a temporary name
                    continue
                if len(data) != size:
                    size, grown_s = len(data), time.monotonic()
                if not _is_complete(file, data, time.monotonic() - grown_s):
                    incomplete = file
                    break
                processed.add(file.name)
                yield self.load(file)
                size, grown_s = 0, time.monotonic()
            if time.monotonic() - grown_s > self._silence_s:
                if incomplete is None:
                    return
                raise RunFailed(
                    f"{incomplete}: incomplete image, and no data for {self._silence_s:g} s"
                )
            time.sleep(FOLDER_POLL_S)

    def _new_files(self, processed: set[str]) -> list[Path]:
        try:
            entries = [p for p in self._folder.iterdir() if p.name not in processed]
        except OSError as error:
            raise RunFailed(f"{self.name}: cannot be read: {error.strerror}") from error
        images = (p for p in entries if p.suffix.lower() in self.SUFFIXES and p.name[0] != ".")
        return sorted(images, key=_natural_key)


def _is_complete(file: Path, data: bytes, steady_s: float) -> bool:
    """True if a file has the end mark of its format. steady_s: time since it last grew."""
    kind = file.suffix.lower()
    if kind == ".png":
        return data.endswith(b"IEND\xaeB`\x82")
    if kind in (".jpg", ".jpeg"):
        return data.rstrip(b"\0").endswith(b"\xff\xd9")
    if kind == ".bmp":
        return len(data) > 6 and 0 < int.from_bytes(data[2:6], "little") <= len(data)
    return len(data) > 0 and steady_s > TIFF_STEADY_S


class Video:
    """A video file."""

    kind = "video"

    def __init__(self, file: Path) -> None:
        """Raises InputError for a file that is not a video."""
        self.name = str(file)
        self._capture = open_quietly(str(file))
        if not self._capture.isOpened():
            raise InputError(f"{file}: not a video that can be read")
        self.rate_hz = self._capture.get(cv2.CAP_PROP_FPS) or DEFAULT_RATE_HZ
        self._are_jpeg = are_jpeg(self._capture)

    def read(self) -> Generator[Image | None, None, None]:
        """Yield images, see ImageFolder. Raises RunFailed for a video without any."""
        fault: object = "contains no image"
        n_whole = 0
        while self._capture.grab():
            try:
                image = retrieve(self._capture, self._are_jpeg)
            except ValueError as error:
                image, fault = None, error
            n_whole += image is not None
            yield image
        if not n_whole:
            raise RunFailed(f"{self.name}: {fault}")

    def close(self) -> None:
        self._capture.release()


ImageSource = ImageFolder | Video
"""A sequence of images of one size."""


def open_images(path: Path, silence_s: float | None = None) -> ImageSource:
    """Open a folder of images or a video. Raises InputError, one line.

    silence_s: follow a folder that is being written, until no byte came for so long.
    """
    if silence_s is not None:
        return FollowedFolder(path, silence_s)
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
            cv2.CAP_PROP_OPEN_TIMEOUT_MSEC, URL_OPEN_MS, cv2.CAP_PROP_READ_TIMEOUT_MSEC, URL_READ_MS
        ]  # fmt: skip
        self._capture = open_quietly(url, cv2.CAP_FFMPEG, options)
        if not self._capture.isOpened():
            raise InputError(f"camera.source: {url}: no image stream; check {self.check}")
        self.rate_hz = self._capture.get(cv2.CAP_PROP_FPS) or None
        self._are_jpeg = are_jpeg(self._capture)

    def next(self, timeout_s: float) -> FeedImage | None:
        """Return the next image, see Feed; waits up to URL_READ_MS."""
        if not self._capture.grab():
            raise SensorError(f"camera {self.name}: stream ended; check {self.check}")
        t_s = self._clock.now_s()
        try:
            return FeedImage(retrieve(self._capture, self._are_jpeg), t_s)
        except ValueError as error:
            raise LostImage(str(error)) from error

    def identity(self) -> dict[str, Any]:
        return {"kind": "url"}

    def close(self) -> None:
        self._capture.release()


def are_jpeg(capture: cv2.VideoCapture) -> bool:
    """True if the images are JPEG: `retrieve` then gets their data, as FFmpeg conceals damage.

    That of other codings, as H.264, stays concealed: OpenCV does not report it.
    """
    code = int(capture.get(cv2.CAP_PROP_FOURCC)).to_bytes(4, "little")
    if code.upper() not in (b"MJPG", b"JPEG") or not capture.set(cv2.CAP_PROP_FORMAT, -1):
        return False
    prepare_jpeg()
    return True


def retrieve(capture: cv2.VideoCapture, are_jpeg: bool) -> Image:
    """Decode the image that was grabbed, (h, w, 3) BGR. Raises ValueError for a damaged one."""
    ok, image = capture.retrieve()
    if not ok:
        raise ValueError("cannot be decoded")
    return decode(image.tobytes(), "image.jpg") if are_jpeg else np.asarray(image, np.uint8)


def open_quietly(
    name: int | str, backend: int = cv2.CAP_ANY, options: Sequence[int] = ()
) -> cv2.VideoCapture:
    """Open a video or stream with OpenCV, without its messages on stderr."""
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")  # FFmpeg's messages
    level = cv2.utils.logging.getLogLevel()
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
    try:
        return cv2.VideoCapture(name, backend, list(options))
    finally:
        cv2.utils.logging.setLogLevel(level)
