"""From a rig file's [camera] to a camera, and photographs by it, to calibrate it."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import closing
from pathlib import Path

from ...errors import InputError
from ...files import making, write_whole
from ...record import encode_png
from ..interface import Camera, Clock, WallClock
from ..tables import CameraConfig
from .stream import Feed, StreamCamera


def open_camera(config: CameraConfig, folder: Path, clock: Clock) -> Camera:
    """The camera that a rig file describes, opened, and reading if it runs by itself.

    folder: of the rig file, from which relative paths count. clock: of all devices; its origin has
    to be that of `time.monotonic` for a camera that stamps its images itself.

    Raises InputError, one line, for a camera that is not there or keeps other settings.
    """
    config = _with_size(config, folder)
    size_px = None
    if config.width_px is not None and config.height_px is not None:
        size_px = (config.width_px, config.height_px)
    rate_hz = config.rate_hz
    feed: Feed
    if config.command is not None:
        from .command import CommandFeed

        assert size_px is not None, "the configuration of a command has a size"
        feed = CommandFeed(config.command, size_px, clock, folder, config.stamped)
    elif config.is_device:
        from .device import DeviceFeed

        feed = device = DeviceFeed(config, clock)
        rate_hz = rate_hz or device.rate_hz
    else:
        from .files import UrlFeed

        feed = url = UrlFeed(str(config.source), clock)
        rate_hz = rate_hz or url.rate_hz
    return StreamCamera(
        feed, clock, size_px=size_px, rate_hz=rate_hz, latency_s=config.latency_ms / 1e3
    )


def _with_size(config: CameraConfig, folder: Path) -> CameraConfig:
    """A camera without a size is asked for that of its calibration. Raises InputError."""
    if config.model is None or config.width_px is not None:
        return config
    from .model import calibrated, raw_size_px

    w, h = raw_size_px(calibrated(folder / config.model))
    return config.model_copy(update={"width_px": w, "height_px": h})


def photograph(
    config: CameraConfig,
    folder: Path,
    out: Path,
    count: int,
    before: Callable[[int], None] = lambda number: None,
) -> list[Path]:
    """Write out/contact/1.png and on, raw as the camera gives them, and return the files.

    folder: of the rig file. before: called with the number of an image; it is exposed afterwards.
    Raises InputError for an `out` that is there already or a camera that cannot be opened, and
    SensorError when that gives no images.
    """
    if out.exists() and not (out.is_dir() and not any(out.iterdir())):
        raise InputError(f"{out}: is there already; name a new folder")
    files = []
    with closing(open_camera(config, folder, WallClock())) as camera:
        camera.capture()  # it runs, and has the settings of the rig file
        with making(out):
            (out / "contact").mkdir(parents=True, exist_ok=True)
        for number in range(1, count + 1):
            before(number)
            camera.begin("photograph")
            file = out / "contact" / f"{number}.png"
            write_whole(file, encode_png(camera.capture().image))
            files.append(file)
    return files
