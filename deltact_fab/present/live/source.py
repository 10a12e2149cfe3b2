"""Whatever delivers images, and what it knows of the sensor that it shows."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from deltact_fab.bench import CameraFrame, ImageSource, raw_size_px
from deltact_fab.common import InputError, RunFailed
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
    model: SensorModel
    frames: Callable[[bool], Iterator[CameraFrame]]
    live: bool = False
    close: Callable[[], None] = lambda: None


def images(source: Source, rest_only: bool = False) -> Iterator[CameraFrame]:
    """The frames of an opened source, at least one, all of the size that its camera makes.

    Of the size of the first, where no one knows the camera. Raises InputError, one line, for
    another size; else as the source does.
    """
    camera = source.model.projection
    size_px = None if camera is None else raw_size_px(camera)
    origin = f"camera {'of the design' if source.model.nominal else 'that was calibrated'} makes"
    k = -1
    for k, frame in enumerate(source.frames(rest_only)):
        h, w = frame.image.shape[:2]
        if size_px is None:
            size_px, origin = (w, h), "first image has"
        if (w, h) != size_px:
            raise InputError(
                f"{source.name}: image {k} has {w} x {h} px; the {origin} "
                f"{size_px[0]} x {size_px[1]} px"
            )
        yield frame
    if k < 0:
        raise RunFailed(f"{source.name}: ended before its first image")


def camera_source(config: CameraConfig, folder: Path, model: SensorModel | None = None) -> Source:
    """A camera that runs by itself, and does not know what touches the face.

    Raises InputError for one that cannot be opened; frames: SensorError when it stalls or is gone.
    """
    from deltact_fab.bench import WallClock, open_camera

    camera = open_camera(config, folder, WallClock())

    def frames(_: bool) -> Iterator[CameraFrame]:
        camera.begin("live")
        while True:
            yield camera.capture()

    return Source(config.name, model or SensorModel(), frames, live=True, close=camera.close)


def file_source(images: ImageSource, model: SensorModel | None = None) -> Source:
    """Images from the disk; times as the file has them."""

    def frames(_: bool) -> Iterator[CameraFrame]:
        for k, image in enumerate(images.read()):
            yield CameraFrame(image, k / images.rate_hz, k)

    return Source(images.name, model or SensorModel(), frames, close=images.close)
