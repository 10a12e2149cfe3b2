"""Images of a V4L2 device, with the driver's numbers and stamps; settings locked and read back.

Automatic control of a setting is switched off before it is set, or the driver refuses it.
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

from ...record.images import decode, prepare_jpeg
from ..interface import Clock
from ..tables import CameraConfig
from .stream import FeedImage, LostImage
from .v4l2 import FilledBuffer, V4l2Device

Bytes = NDArray[np.uint8]


def _raw_decoder(channels: int, conversion: int | None) -> Callable[[Bytes, int, int, int], Image]:
    """Return a decoder of raw lines of line_bytes bytes to an image (h, w, 3) BGR."""

    def decode_lines(data: Bytes, w: int, h: int, line_bytes: int) -> Image:
        if len(data) < h * line_bytes:
            raise ValueError(f"cut short, {len(data)} of {h * line_bytes} bytes")
        lines = data[: h * line_bytes].reshape(h, line_bytes)[:, : w * channels]
        image = lines.reshape(h, w, channels)
        if conversion is None:
            return image.copy()
        return np.asarray(cv2.cvtColor(np.ascontiguousarray(image), conversion), np.uint8)

    return decode_lines


def _decode_jpeg(data: Bytes, w: int, h: int, line_bytes: int) -> Image:
    return decode(data.tobytes(), "image.jpg")


# In the order of trial where the rig file names none: lossless formats first.
PIXEL_DECODERS = {
    "BGR3": _raw_decoder(3, None),
    "RGB3": _raw_decoder(3, cv2.COLOR_RGB2BGR),
    "YUYV": _raw_decoder(2, cv2.COLOR_YUV2BGR_YUYV),
    "UYVY": _raw_decoder(2, cv2.COLOR_YUV2BGR_UYVY),
    "GREY": _raw_decoder(1, cv2.COLOR_GRAY2BGR),
    "MJPG": _decode_jpeg,
    "JPEG": _decode_jpeg,
}


class DeviceFeed:
    """Implements Feed: a V4L2 device, set up by the rig file."""

    check = "its cable and power, and that nothing else uses it"
    stamps = "driver"

    def __init__(self, config: CameraConfig, clock: Clock) -> None:
        """Raises InputError for a device that cannot be opened or keeps other settings."""
        self.name = config.name
        self._clock = clock
        try:
            self._device = V4l2Device(self.name)
        except OSError as error:
            hint = "; add the user to the group 'video'" if error.errno == EACCES else ""
            raise InputError(
                f"camera.source: {self.name}: cannot be opened: {error.strerror}{hint}"
            ) from error
        try:
            self._set_up(config)
        except OSError as error:
            self._device.close()
            raise InputError(
                f"camera.source: {self.name}: cannot start: {error.strerror}; check {self.check}"
            ) from error
        except BaseException:
            self._device.close()
            raise

    def _set_up(self, config: CameraConfig) -> None:
        """Set pixel format and size, then the rate, then the controls."""
        device = self._device
        if not device.gives_images():
            raise InputError(f"camera.source: {self.name}: sends no images; use another node")
        asked_px = None
        if config.width_px is not None and config.height_px is not None:
            asked_px = (config.width_px, config.height_px)
        for wish in [config.fourcc] if config.fourcc is not None else PIXEL_DECODERS:
            fourcc, size_px, self._line_bytes = device.set_format(wish, asked_px)
            if fourcc == wish:
                break
        if config.fourcc not in (None, fourcc) or fourcc not in PIXEL_DECODERS:
            raise InputError(
                "camera.fourcc: requested "
                f"{config.fourcc or 'any of ' + ', '.join(PIXEL_DECODERS)}, the camera uses "
                f"{fourcc}; `v4l2-ctl --list-formats-ext` lists its formats"
            )
        if asked_px not in (None, size_px):
            raise InputError(
                f"camera.width_px: requested {config.width_px} x {config.height_px}, the camera "
                f"uses {size_px[0]} x {size_px[1]} px; sizes: `v4l2-ctl --list-formats-ext`"
            )
        self.rate_hz = device.set_rate(config.rate_hz)
        if config.rate_hz is not None and not _is_near(self.rate_hz, config.rate_hz):
            keeps = "a fixed rate; remove the key" if self.rate_hz is None else f"{self.rate_hz:g}"
            raise InputError(
                f"camera.rate_hz: requested {config.rate_hz:g}, the camera uses {keeps} at this "
                f"size in {fourcc}; MJPG is often faster than YUYV"
            )
        self._controls = {"fourcc": fourcc, "rate_hz": self.rate_hz, **apply_locks(device, config)}
        self._decode, self._size_px = PIXEL_DECODERS[fourcc], size_px
        if self._decode is _decode_jpeg:
            prepare_jpeg()
        device.start()

    def next(self, timeout_s: float) -> FeedImage | None:
        """Return the next image, see Feed."""
        try:
            with self._device.next_buffer(timeout_s) as buffer:
                arrived = None if buffer is None else self._decoded_image(buffer)
        except OSError as error:
            raise SensorError(
                f"camera {self.name}: disconnected: {error.strerror}; check {self.check}"
            ) from error
        if isinstance(arrived, LostImage):
            raise arrived  # after the buffer is given back
        return arrived

    def _decoded_image(self, buffer: FilledBuffer) -> FeedImage | LostImage:
        if buffer.damaged:
            return LostImage("damaged according to the driver")
        t_s = buffer.t_s
        if t_s is None:
            t_s, self.stamps = self._clock.now_s(), "arrival"
        data = np.frombuffer(buffer.data, np.uint8)
        try:
            image = self._decode(data, *self._size_px, self._line_bytes)
        except (ValueError, cv2.error) as error:  # damaged or cut short on its way
            return LostImage(str(error))
        finally:
            del data  # the buffer is about to be given back
        return FeedImage(image, t_s, buffer.number)

    def identity(self) -> dict[str, Any]:
        return {"kind": "v4l2", "controls": self._controls}

    def close(self) -> None:
        self._device.close()


def _is_near(actual: float | None, nominal: float) -> bool:
    return actual is not None and abs(actual - nominal) <= 0.01 * nominal


# include/uapi/linux/v4l2-controls.h (V4L2)
MANUAL_EXPOSURE = 1  # V4L2_EXPOSURE_MANUAL
CONTROL_IDS = {
    "auto_exposure": 0x009A_0901,  # V4L2_CID_EXPOSURE_AUTO
    "exposure": 0x009A_0902,  # V4L2_CID_EXPOSURE_ABSOLUTE, 0.1 ms
    "auto_gain": 0x0098_0912,
    "gain": 0x0098_0913,
    "auto_white_balance": 0x0098_090C,
    "white_balance_k": 0x0098_091A,  # V4L2_CID_WHITE_BALANCE_TEMPERATURE
    "autofocus": 0x009A_090C,
}
AUTOMATIC_SWITCHES = {
    "exposure": ("auto_exposure", MANUAL_EXPOSURE),
    "gain": ("auto_gain", 0),
    "white_balance_k": ("auto_white_balance", 0),
}
"""Automatic control of each setting, and its value for off."""


def apply_locks(device: V4l2Device, config: CameraConfig) -> dict[str, int | None]:
    """Apply the settings of the rig file; return the device's values, None for a missing control.

    Raises InputError, one line, for settings that the device did not accept.
    """
    requested = {key: getattr(config, key) for key in ("exposure", "gain", "white_balance_k")}
    requested["autofocus"] = None if config.autofocus is None else int(config.autofocus)
    for key, value in requested.items():
        if value is not None:
            _request_value(device, key, value)
    settings = {key: device.setting(control) for key, control in CONTROL_IDS.items()}
    refused = []
    for key, value in requested.items():
        setting = settings[key]
        automatic, off_value = AUTOMATIC_SWITCHES.get(key, (None, 0))
        holder = None if automatic is None else settings[automatic]
        if value is None or (setting is not None and setting.value == value):
            if value is not None and holder is not None and holder.value != off_value:
                refused.append(f"camera.{key}: automatic control stays on")
        elif setting is None:
            refused.append(f"camera.{key}: requested {value}, the camera has no such control")
        else:
            steps = f" in steps of {setting.step}" if setting.step > 1 else ""
            refused.append(
                f"camera.{key}: requested {value}, the camera uses {setting.value}; "
                f"range {setting.minimum} to {setting.maximum}{steps}"
            )
    if refused:
        raise InputError("; ".join(refused))
    return {key: None if s is None else s.value for key, s in settings.items()}


def _request_value(device: V4l2Device, key: str, value: int) -> None:
    """Set a value without checking; the caller reads it back."""
    automatic, off_value = AUTOMATIC_SWITCHES.get(key, (None, 0))
    if automatic is not None:
        with suppress(OSError):
            device.set(CONTROL_IDS[automatic], off_value)
    with suppress(OSError):
        device.set(CONTROL_IDS[key], value)
