"""A rig's camera: its calibrated view, and the open device to record or photograph with.

Real and simulated cameras use the calibrated lens only.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import closing
from os.path import isfile
from pathlib import Path
from typing import Any

import numpy as np

from deltact_fab.common import InputError, Note, make_folder, write_whole
from deltact_fab.sensor import CameraModel, Fisheye, Rectified, SensorDimensions, load_camera

from ...record.images import encode_png
from ..interface import Camera, Clock, WallClock
from ..tables import CameraConfig, CameraFile
from .stream import Feed, StreamCamera

MIN_NOTED_ALIASING = 0.005  # share of the view; by hand: less is not reported


def calibrated_camera(path: Path, source: str = "camera.model") -> CameraModel:
    """Load the camera of a camera file; source: its key, for messages. Raises InputError."""
    if not isfile(path):
        raise InputError(f"{source}: {path}: no such file; `deltact-fab calibrate lens` writes one")
    return load_camera(path)[0]


def load_view(
    config: CameraConfig | CameraFile, sensor: SensorDimensions, source: Path
) -> CameraModel | None:
    """Load the camera model that trackers use; None without a calibration.

    A fisheye is rectified at the design's scale. source: path of the rig file. Raises InputError
    for a camera file that is missing or for images of another size.
    """
    if config.model is None:
        return None
    path = source.parent / config.model
    camera = calibrated_camera(path, f"{source}: camera.model")
    if isinstance(config, CameraConfig) and config.width_px is not None:
        calibrated, configured = raw_size_px(camera), (config.width_px, config.height_px)
        if calibrated != configured:
            w, h = configured
            raise InputError(
                f"{source}: camera.width_px, height_px: {w} x {h} px, and {path} is "
                f"for images of {calibrated[0]} x {calibrated[1]} px"
            )
    return Rectified.from_sensor(sensor, camera) if isinstance(camera, Fisheye) else camera


def raw_size_px(camera: CameraModel) -> tuple[int, int]:
    """Width and height of a camera's raw images."""
    raw: Any = getattr(camera, "lens", camera)
    return raw.width_px, raw.height_px


def view_notes(view: CameraModel | None, patch_mm: float | None) -> Iterator[Note]:
    """Notes on the images of a run.

    view: None if not calibrated. patch_mm: side of the pattern's patches, None without.
    """
    if view is None:
        text = (
            "camera not calibrated: images are recorded but cannot be tracked; `deltact-fab "
            "calibrate lens` writes the file for [camera] model"
        )
        yield Note("camera", text, warns=True)
    if not isinstance(view, Rectified):
        return
    w, h = view.width_px, view.height_px
    scales = view.raw_mm_per_px(np.array([[w / 2, h / 2], [0, 0], [w, 0], [0, h], [w, h]]))
    middle, corner = scales[0].min(), scales[1:].max()
    text = f"pixel scale: {middle:.3f} mm at the centre, {corner:.3f} mm in the corners"
    yield Note("pixel scale", text)
    aliased = 0.0 if patch_mm is None else view.aliased_share(patch_mm)
    if aliased >= MIN_NOTED_ALIASING:
        text = (
            f"patches of {patch_mm:g} mm alias over {aliased:.0%} of the view: less than "
            f"{view.min_patch_px:g} pixels per patch there"
        )
        yield Note("aliasing", text, warns=True)
    yield Note("raw images", "images are stored raw and rectified on reading")


def open_camera(config: CameraConfig, folder: Path, clock: Clock) -> Camera:
    """Open the camera of a rig file; a free-running one is read from now on.

    folder: of the rig file, base of relative paths. clock: of all devices; must count from the
    origin of `time.monotonic` for a camera that stamps its images itself.

    Raises InputError, one line, for a camera that is missing or keeps other settings.
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
    """Set a missing image size to that of the calibration. Raises InputError."""
    if config.model is None or config.width_px is not None:
        return config

    w, h = raw_size_px(calibrated_camera(folder / config.model))
    return config.model_copy(update={"width_px": w, "height_px": h})


def take_photograph(
    config: CameraConfig,
    folder: Path,
    out: Path,
    count: int,
    prompt: Callable[[int], None] = lambda number: None,
) -> list[Path]:
    """Write raw images out/contact/1.png to count.png and return the files.

    folder: of the rig file. prompt: called with the number of an image before its exposure.
    Raises InputError for an `out` that exists already or a camera that cannot be opened, and
    SensorError when it gives no images.
    """
    if out.exists() and not (out.is_dir() and not any(out.iterdir())):
        raise InputError(f"{out}: already exists; name a new folder")
    files = []
    with closing(open_camera(config, folder, WallClock())) as camera:
        camera.capture()  # running, with the settings of the rig file
        make_folder(out, "contact")
        for number in range(1, count + 1):
            prompt(number)
            camera.begin("photograph")
            file = out / "contact" / f"{number}.png"
            write_whole(file, encode_png(camera.capture().image))
            files.append(file)
    return files
