"""What is wrong with a rig's camera, and how to put it right: it is opened and looked through."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ...errors import InputError, SensorError
from ..clock import WallClock
from ..interface import BenchFinding, Camera, CameraFrame
from .config import CameraConfig
from .files import EndOfImages
from .model import calibrated, raw_size_px
from .open import open_camera

LOOK_S = 2.0
SLOW = 0.95
"""Of the nominal rate; below, something holds the camera back."""
BRIGHT = 0.01
"""Share of an image that may be at the end of its scale."""
DARK = 16
_SLOW_DEVICE = "a shorter exposure, another fourcc or a faster port would help"
_SLOW_SENDER = "what sends them is slow, or this computer is busy"
HOLDS = {"exposure": "auto_exposure", "gain": None, "white_balance_k": "auto_white_balance"}


def probe(config: CameraConfig, folder: Path, seconds: float = LOOK_S) -> Iterator[BenchFinding]:
    """Open the camera of a rig file, look through it for so long, and judge what comes.

    folder: of the rig file. Raises nothing that a camera can cause: it is a finding.
    """
    yield _model(config, folder)
    try:
        with closing(open_camera(config, folder, WallClock())) as camera:
            seen = _seen(camera, seconds)
            told = camera.identity()
    except (InputError, SensorError) as why:
        yield BenchFinding(False, str(why), warns=isinstance(why, EndOfImages))
        return
    yield from _images(seen, told, config)
    yield from _locks(config, told)


class _Seen(NamedTuple):
    """What came; an image for all of them, or they would fill the memory."""

    last: CameraFrame
    hz: float
    dropped: int
    repeated: int


def _seen(camera: Camera, seconds: float) -> _Seen:
    """At least two images. The first of a stream tells nothing of what was lost before it."""
    camera.begin("probe")
    first_s = camera.capture().t_s
    n = dropped = repeated = 0
    until_s = time.monotonic() + seconds
    while n == 0 or time.monotonic() < until_s:
        last = camera.capture()
        n += 1
        dropped += last.dropped
        repeated += last.repeated
    took_s = last.t_s - first_s
    return _Seen(last, n / took_s if took_s > 0 else 0.0, dropped, repeated)


def _model(config: CameraConfig, folder: Path) -> BenchFinding:
    if config.model is None:
        return BenchFinding(
            False,
            "camera.model: not calibrated, nothing can be tracked; `deltact-fab calibrate lens` "
            "makes the file",
            warns=True,
        )
    path = folder / config.model
    try:
        size_px = raw_size_px(calibrated(path))
    except InputError as why:
        return BenchFinding(False, str(why))
    asked = (config.width_px, config.height_px)
    if config.width_px is not None and asked != size_px:
        return BenchFinding(False, f"camera.model: of images of {size_px[0]} x {size_px[1]} px")
    return BenchFinding(True, f"calibrated: {path}")


def _images(seen: _Seen, told: dict[str, Any], config: CameraConfig) -> Iterator[BenchFinding]:
    image = seen.last.image
    h, w = image.shape[:2]
    stamped = told["stamped_by"]
    after = f", {config.latency_ms:g} ms after its exposure" if stamped == "arrival" else ""
    yield BenchFinding(True, f"images of {w} x {h} px, stamped by {stamped}{after}")
    nominal = told["rate_hz"]
    slow = nominal is not None and seen.hz < SLOW * nominal
    asked = "" if nominal is None else f" of {nominal:g}"
    why = f"; {_SLOW_DEVICE if config.is_device else _SLOW_SENDER}" if slow else ""
    yield BenchFinding(not slow, f"{seen.hz:.1f} images a second{asked}{why}")
    lost = seen.dropped or seen.repeated
    yield BenchFinding(not lost, f"{seen.dropped} lost, {seen.repeated} repeated")
    bright = float(np.mean(image == 255))
    if bright > BRIGHT:
        text = f"{bright:.0%} of the image is over-exposed; less light or a shorter exposure"
        yield BenchFinding(False, text)
    elif image.mean() < DARK:
        yield BenchFinding(False, "the image is dark; is the light on, the lens uncovered?")


def _locks(config: CameraConfig, told: dict[str, Any]) -> Iterator[BenchFinding]:
    """Of a V4L2 device: what it would change by itself."""
    controls: dict[str, Any] = told.get("controls", {})
    for key, automatic in HOLDS.items() if controls else ():
        has = controls[key]
        if getattr(config, key) is not None:
            yield BenchFinding(True, f"{key} locked at {has:g}")
        elif has is not None and (automatic is None or controls[automatic] is not None):
            text = f"camera.{key}: not locked; `{key} = {has:.0f}` keeps what it has"
            yield BenchFinding(False, text)
