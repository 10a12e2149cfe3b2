"""Images of a V4L2 device, with the driver's numbers and stamps; settings locked and read back.

The automatic of a setting is switched off before it is set, or the driver refuses it.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from errno import EACCES
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from deltact_fab.common import Image, InputError, SensorError

from ..interface import Clock
from ..tables import CameraConfig
from .stream import FeedImage
from .v4l2 import FilledBuffer, V4l2Device

Bytes = NDArray[np.uint8]


def _pixels(channels: int, conversion: int | None) -> Callable[[Bytes, int, int, int], Image]:
    """How lines of line_bytes bytes become an image (h, w, 3) BGR."""

    def decoded(data: Bytes, w: int, h: int, line_bytes: int) -> Image:
        lines = data[: h * line_bytes].reshape(h, line_bytes)[:, : w * channels]
        image = lines.reshape(h, w, channels)
        if conversion is None:
            return image.copy()
        return np.asarray(cv2.cvtColor(np.ascontiguousarray(image), conversion), np.uint8)

    return decoded


def _jpeg(data: Bytes, w: int, h: int, line_bytes: int) -> Image:
    image = cv2.imdecode(data, cv2.IMREAD_COLOR)
    if image is None:
        raise ValueError("no JPEG")
    return np.asarray(image, np.uint8)


# In the order in which they are tried where the rig file names none: without losses first.
CODINGS = {
    "BGR3": _pixels(3, None),
    "RGB3": _pixels(3, cv2.COLOR_RGB2BGR),
    "YUYV": _pixels(2, cv2.COLOR_YUV2BGR_YUYV),
    "UYVY": _pixels(2, cv2.COLOR_YUV2BGR_UYVY),
    "GREY": _pixels(1, cv2.COLOR_GRAY2BGR),
    "MJPG": _jpeg,
    "JPEG": _jpeg,
}


class DeviceFeed:
    """Implements Feed: a V4L2 device, set up as the rig file has it."""

    check = "its cable and power, and that nothing else uses it"
    stamps = "driver"

    def __init__(self, config: CameraConfig, clock: Clock) -> None:
        """Raises InputError for a device that cannot be opened or keeps other settings."""
        self.name = config.name
        self._clock = clock
        try:
            self._device = V4l2Device(self.name)
        except OSError as why:
            hint = "; who uses it belongs to the group 'video'" if why.errno == EACCES else ""
            raise InputError(
                f"camera.source: {self.name}: no camera that can be opened: {why.strerror}{hint}"
            ) from why
        try:
            self._set_up(config)
        except OSError as why:
            self._device.close()
            raise InputError(
                f"camera.source: {self.name}: refuses to start: {why.strerror}; check {self.check}"
            ) from why
        except BaseException:
            self._device.close()
            raise

    def _set_up(self, config: CameraConfig) -> None:
        """Coding and size, the rate that goes with them, then the settings."""
        device = self._device
        if not device.captures():
            raise InputError(f"camera.source: {self.name}: gives no images; name another node")
        asked_px = None
        if config.width_px is not None and config.height_px is not None:
            asked_px = (config.width_px, config.height_px)
        for wish in [config.fourcc] if config.fourcc is not None else CODINGS:
            fourcc, size_px, self._line_bytes = device.shape(wish, asked_px)
            if fourcc == wish:
                break
        if config.fourcc not in (None, fourcc) or fourcc not in CODINGS:
            raise InputError(
                f"camera.fourcc: asked {config.fourcc or 'any of ' + ', '.join(CODINGS)}, the "
                f"camera keeps {fourcc}; `v4l2-ctl --list-formats-ext` names its codings"
            )
        if asked_px not in (None, size_px):
            raise InputError(
                f"camera.width_px: asked {config.width_px} x {config.height_px}, the camera keeps "
                f"{size_px[0]} x {size_px[1]} px; `v4l2-ctl --list-formats-ext` names its sizes"
            )
        self.rate_hz = device.rate(config.rate_hz)
        if config.rate_hz is not None and not _near(self.rate_hz, config.rate_hz):
            keeps = "its own, remove the key" if self.rate_hz is None else f"{self.rate_hz:g}"
            raise InputError(
                f"camera.rate_hz: asked {config.rate_hz:g}, the camera keeps {keeps} at this size "
                f"in {fourcc}; MJPG is often faster than YUYV"
            )
        self._controls = {"fourcc": fourcc, "rate_hz": self.rate_hz, **locked(device, config)}
        self._decode, self._size_px = CODINGS[fourcc], size_px
        device.start()

    def next(self, timeout_s: float) -> FeedImage | None:
        """As Feed. A damaged image is left out; the numbers tell that it is missing."""
        try:
            with self._device.filled(timeout_s) as buffer:
                return None if buffer is None or buffer.damaged else self._arrived(buffer)
        except OSError as why:
            raise SensorError(
                f"camera {self.name}: is gone: {why.strerror}; check {self.check}"
            ) from why

    def _arrived(self, buffer: FilledBuffer) -> FeedImage | None:
        t_s = buffer.t_s
        if t_s is None:
            t_s, self.stamps = self._clock.now_s(), "arrival"
        data = np.frombuffer(buffer.data, np.uint8)
        try:
            image = self._decode(data, *self._size_px, self._line_bytes)
        except (ValueError, cv2.error):  # cut short on its way
            return None
        finally:
            del data  # the buffer is about to be given back
        return FeedImage(image, t_s, buffer.number)

    def identity(self) -> dict[str, Any]:
        return {"kind": "v4l2", "controls": self._controls}

    def close(self) -> None:
        self._device.close()


def _near(found: float | None, asked: float) -> bool:
    return found is not None and abs(found - asked) <= 0.01 * asked


# include/uapi/linux/v4l2-controls.h
MANUAL = 1  # V4L2_EXPOSURE_MANUAL
CONTROLS = {
    "auto_exposure": 0x009A_0901,  # V4L2_CID_EXPOSURE_AUTO
    "exposure": 0x009A_0902,  # V4L2_CID_EXPOSURE_ABSOLUTE, 0.1 ms
    "auto_gain": 0x0098_0912,
    "gain": 0x0098_0913,
    "auto_white_balance": 0x0098_090C,
    "white_balance_k": 0x0098_091A,  # V4L2_CID_WHITE_BALANCE_TEMPERATURE
    "autofocus": 0x009A_090C,
}
AUTOMATIC = {
    "exposure": ("auto_exposure", MANUAL),
    "gain": ("auto_gain", 0),
    "white_balance_k": ("auto_white_balance", 0),
}
"""What has to be switched off, and by which value."""


def locked(device: V4l2Device, config: CameraConfig) -> dict[str, int | None]:
    """Lock all that the rig file asks for; then what the device has of each, None for nothing.

    Raises InputError, one line, for all that it keeps otherwise.
    """
    asked = {key: getattr(config, key) for key in ("exposure", "gain", "white_balance_k")}
    asked["autofocus"] = None if config.autofocus is None else int(config.autofocus)
    for key, value in asked.items():
        if value is not None:
            _ask(device, key, value)
    found = {key: device.setting(control) for key, control in CONTROLS.items()}
    refused = []
    for key, value in asked.items():
        setting = found[key]
        automatic, off = AUTOMATIC.get(key, (None, 0))
        holder = None if automatic is None else found[automatic]
        if value is None or (setting is not None and setting.value == value):
            if value is not None and holder is not None and holder.value != off:
                refused.append(f"camera.{key}: the camera keeps its automatic on")
        elif setting is None:
            refused.append(f"camera.{key}: asked {value}, the camera has no such setting")
        else:
            steps = f" in steps of {setting.step}" if setting.step > 1 else ""
            refused.append(
                f"camera.{key}: asked {value}, the camera keeps {setting.value}; it takes "
                f"{setting.least} to {setting.most}{steps}"
            )
    if refused:
        raise InputError("; ".join(refused))
    return {key: None if s is None else s.value for key, s in found.items()}


def _ask(device: V4l2Device, key: str, value: int) -> None:
    """Whether it was taken is read back afterwards."""
    automatic, off = AUTOMATIC.get(key, (None, 0))
    if automatic is not None:
        with suppress(OSError):
            device.set(CONTROLS[automatic], off)
    with suppress(OSError):
        device.set(CONTROLS[key], value)
