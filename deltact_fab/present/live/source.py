"""Sources of images, with the model of the sensor that they show."""

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
    """Raw images of one sensor, with times of one clock.

    model: what is known of the sensor. frames: yields images (h, w, 3) BGR uint8 in order of time,
    the first at rest; with True only those at rest, as far as the source knows. It raises
    InputError or a RunFailed that names the source. live: images keep coming: only the newest
    counts, and times are of `time.monotonic`; else every image counts. close: releases device or
    file when no frames are read; repeated calls do nothing.
    """

    name: str
    model: SensorModel
    frames: Callable[[bool], Iterator[CameraFrame]]
    live: bool = False
    close: Callable[[], None] = lambda: None


def images(source: Source, rest_only: bool = False) -> Iterator[CameraFrame]:
    """Yield the frames of an opened source, at least one, all of its camera's size.

    With an unknown camera, of the size of the first. Raises InputError, one line, for another
    size, and the source's errors.
    """
    camera = source.model.projection
    size_px = None if camera is None else raw_size_px(camera)
    origin = f"{'design' if source.model.nominal else 'calibrated'} camera has"
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
    """Open a free-running camera.

    Raises InputError if it cannot be opened; frames: SensorError when it stalls or disconnects.
    """
    from deltact_fab.bench import WallClock, open_camera

    camera = open_camera(config, folder, WallClock())

    def frames(_: bool) -> Iterator[CameraFrame]:
        camera.begin("live")
        while True:
            yield camera.capture()

    return Source(config.name, model or SensorModel(), frames, live=True, close=camera.close)


def file_source(images: ImageSource, model: SensorModel | None = None) -> Source:
    """Open images on disk, with the file's times."""

    def frames(_: bool) -> Iterator[CameraFrame]:
        n_lost = 0
        for k, image in enumerate(images.read()):
            if image is None:
                n_lost += 1
            else:
                yield CameraFrame(image, k / images.rate_hz, k, n_lost)
                n_lost = 0

    return Source(images.name, model or SensorModel(), frames, close=images.close)
