"""Whatever delivers images, and what it knows of the sensor that it shows."""

from __future__ import annotations

import time
from collections.abc import Callable, Generator, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from deltact_fab.bench import (
    IMAGE_NAMES,
    CameraFrame,
    ImageFolder,
    ImageSource,
    decode_image,
    raw_size_px,
    sort_by_number,
)
from deltact_fab.common import Image, InputError, RunFailed, disk_errors
from deltact_fab.estimate import SensorModel

if TYPE_CHECKING:
    from deltact_fab.bench import CameraConfig


@dataclass
class Source:
    """Images of one sensor, raw as its camera gives them, with times of one clock.

    frames: images (h, w, 3) BGR uint8 in order of time, the first at rest; with True only those of
    a face that nothing touches, as far as the source can tell. It raises InputError or a kind of
    RunFailed that names the source. live: images come whether they are taken or not: the newest
    counts, and times are those of `time.monotonic`; else every image counts. close: lets go of
    device or file, once no frames are read; again does nothing.
    """

    name: str
    known: SensorModel
    frames: Callable[[bool], Iterator[CameraFrame]]
    live: bool = False
    close: Callable[[], None] = lambda: None


def images(source: Source, rest_only: bool = False) -> Iterator[CameraFrame]:
    """The frames of an opened source, at least one, all of the size that its camera makes.

    Of the size of the first, where no one knows the camera. Raises InputError, one line, for
    another size; else as the source does.
    """
    camera = source.known.projection
    wanted = None if camera is None else raw_size_px(camera)
    whose = f"camera {'of the design' if source.known.nominal else 'that was calibrated'} makes"
    k = -1
    for k, frame in enumerate(source.frames(rest_only)):
        h, w = frame.image.shape[:2]
        if wanted is None:
            wanted, whose = (w, h), "first image has"
        if (w, h) != wanted:
            raise InputError(
                f"{source.name}: image {k} has {w} x {h} px; the {whose} "
                f"{wanted[0]} x {wanted[1]} px"
            )
        yield frame
    if k < 0:
        raise RunFailed(f"{source.name}: ended before its first image")


def camera_source(config: CameraConfig, folder: Path, known: SensorModel | None = None) -> Source:
    """A camera that runs by itself, and does not know what touches the face.

    Raises InputError for one that cannot be opened; frames: SensorError when it stalls or is gone.
    """
    from deltact_fab.bench import WallClock, open_camera

    camera = open_camera(config, folder, WallClock())

    def frames(_: bool) -> Iterator[CameraFrame]:
        camera.begin("live")
        while True:
            yield camera.capture()

    return Source(config.name, known or SensorModel(), frames, live=True, close=camera.close)


def file_source(images: ImageSource, known: SensorModel | None = None) -> Source:
    """Images from the disk; times as the file has them."""

    def frames(_: bool) -> Iterator[CameraFrame]:
        for k, image in enumerate(images.read()):
            yield CameraFrame(image, k / images.rate_hz, k)

    return Source(images.name, known or SensorModel(), frames, close=images.close)


POLL_S = 0.05
STEADY_S = 0.5  # so long a TIFF must not grow: nothing in it says where it ends


class FollowedFolder(ImageFolder):
    """Every image of a folder once it is whole, those that wait in the order of their numbers.

    One that is not whole is waited for, and so are those that follow it. It ends when no byte came
    for silence_s.
    """

    def __init__(self, folder: Path, silence_s: float) -> None:
        self.name = str(folder)
        self._folder, self._silence_s = folder, silence_s

    def read(self) -> Generator[Image, None, None]:
        """As Folder. Raises RunFailed, also for an image that never becomes whole."""
        taken, size, heard_s = set[str](), 0, time.monotonic()
        while True:
            waits = None
            for file in self._new(taken):
                try:
                    data = file.read_bytes()
                except FileNotFoundError:  # it has another name now: this was not its own
                    continue
                if len(data) != size:
                    size, heard_s = len(data), time.monotonic()
                if not _whole(file, data, time.monotonic() - heard_s):
                    waits = file
                    break
                taken.add(file.name)
                yield decode_image(file, data)
                size, heard_s = 0, time.monotonic()
            if time.monotonic() - heard_s > self._silence_s:
                if waits is None:
                    return
                raise RunFailed(
                    f"{waits}: not a whole image, and nothing came for {self._silence_s:g} s"
                )
            time.sleep(POLL_S)

    def _new(self, taken: set[str]) -> list[Path]:
        with disk_errors(self._folder, "read"):
            there = [p for p in self._folder.iterdir() if p.name not in taken]
        images = (p for p in there if p.suffix.lower() in IMAGE_NAMES and p.name[0] != ".")
        return sorted(images, key=sort_by_number)


def _whole(file: Path, data: bytes, steady_s: float) -> bool:
    """Whether a file is written to its end, which its format tells. steady_s: it did not grow."""
    kind = file.suffix.lower()
    if kind == ".png":
        return data.endswith(b"IEND\xaeB`\x82")
    if kind in (".jpg", ".jpeg"):
        return data.rstrip(b"\0").endswith(b"\xff\xd9")
    if kind == ".bmp":
        return len(data) > 6 and 0 < int.from_bytes(data[2:6], "little") <= len(data)
    return len(data) > 0 and steady_s > STEADY_S
