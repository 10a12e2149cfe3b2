"""What is wrong with a rig's camera, and how to put it right: it is opened and looked through."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np

from ...errors import InputError, SensorError
from ..interface import Camera, DeviceRow, WallClock
from .config import CameraConfig
from .model import calibrated, raw_size_px
from .open import open_camera

SLOW = 0.95
"""Of the nominal rate; below, something holds the camera back."""
BRIGHT = 0.01
"""Share of an image that may be at the end of its scale."""
DARK = 16
SLOW_DEVICE = "a shorter exposure, another fourcc or a faster port would help"
SLOW_SENDER = "what sends them is slow, or this computer is busy"
HOLDS = {"exposure": "auto_exposure", "gain": None, "white_balance_k": "auto_white_balance"}


def probe(config: CameraConfig, folder: Path, seconds: float) -> Iterator[DeviceRow]:
    """Open the camera of a rig file, look through it for so long, and judge what comes.

    folder: of the rig file. Raises nothing that a camera can cause: that is a row.
    """
    yield _model(config, folder)
    try:
        with closing(open_camera(config, folder, WallClock())) as camera:
            rows = list(_images(camera, config, seconds))
            told = camera.identity()
    except (InputError, SensorError) as why:
        yield _row(False, str(why))
        return
    yield from rows
    yield from _locks(config, told)


def _row(passed: bool, text: str, otherwise: str = "FAIL") -> DeviceRow:
    return DeviceRow("camera", "pass" if passed else otherwise, text)


def _model(config: CameraConfig, folder: Path) -> DeviceRow:
    if config.model is None:
        return _row(
            False,
            "camera.model: not calibrated, nothing can be tracked; `deltact-fab calibrate lens` "
            "makes the file",
            "WARN",
        )
    path = folder / config.model
    try:
        size_px = raw_size_px(calibrated(path))
    except InputError as why:
        return _row(False, str(why))
    asked = (config.width_px, config.height_px)
    if config.width_px is not None and asked != size_px:
        return _row(False, f"camera.model: of images of {size_px[0]} x {size_px[1]} px")
    return _row(True, f"calibrated: {path}")


def _images(camera: Camera, config: CameraConfig, seconds: float) -> Iterator[DeviceRow]:
    """What at least two images tell. The first says nothing of what was lost before it."""
    camera.begin("probe")
    first_s = camera.capture().t_s
    n = dropped = repeated = 0
    until_s = time.monotonic() + seconds
    while n == 0 or time.monotonic() < until_s:
        last = camera.capture()
        n += 1
        dropped += last.dropped
        repeated += last.repeated
    image, took_s, told = last.image, last.t_s - first_s, camera.identity()
    h, w = image.shape[:2]
    stamped = told["stamped_by"]
    after = f", {config.latency_ms:g} ms after its exposure" if stamped == "arrival" else ""
    yield _row(True, f"images of {w} x {h} px, stamped by {stamped}{after}")
    nominal, hz = told["rate_hz"], n / took_s if took_s > 0 else 0.0
    slow = nominal is not None and hz < SLOW * nominal
    asked = "" if nominal is None else f" of {nominal:g}"
    why = f"; {SLOW_DEVICE if config.is_device else SLOW_SENDER}" if slow else ""
    yield _row(not slow, f"{hz:.1f} images a second{asked}{why}")
    yield _row(not (dropped or repeated), f"{dropped} lost, {repeated} repeated")
    bright = float(np.mean(image == 255))
    if bright > BRIGHT:
        text = f"{bright:.0%} of the image is over-exposed; less light or a shorter exposure"
        yield _row(False, text)
    elif image.mean() < DARK:
        yield _row(False, "the image is dark; is the light on, the lens uncovered?")


def _locks(config: CameraConfig, told: dict[str, Any]) -> Iterator[DeviceRow]:
    """Of a V4L2 device: what it would change by itself."""
    controls: dict[str, Any] = told.get("controls", {})
    for key, automatic in HOLDS.items() if controls else ():
        has = controls[key]
        if getattr(config, key) is not None:
            yield _row(True, f"{key} locked at {has:g}")
        elif has is not None and (automatic is None or controls[automatic] is not None):
            yield _row(False, f"camera.{key}: not locked; `{key} = {has:.0f}` keeps what it has")
