"""Settings of a V4L2 device, set and read back, so that it does not follow the light.

The automatic of a setting is switched off before it is set, or the driver refuses it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import cv2

from ...errors import InputError
from .config import CameraConfig

if TYPE_CHECKING:
    from .opencv import Capture

# include/uapi/linux/v4l2-controls.h: V4L2_EXPOSURE_MANUAL; automatic is 3 with UVC
MANUAL = 1.0
NOT_THERE = -1.0
"""What OpenCV gives for a setting that a device has not."""
CONTROLS = {
    "auto_exposure": cv2.CAP_PROP_AUTO_EXPOSURE,
    "exposure": cv2.CAP_PROP_EXPOSURE,
    "gain": cv2.CAP_PROP_GAIN,
    "auto_white_balance": cv2.CAP_PROP_AUTO_WB,
    "white_balance_k": cv2.CAP_PROP_WB_TEMPERATURE,
    "autofocus": cv2.CAP_PROP_AUTOFOCUS,
}


def locked(capture: Capture, config: CameraConfig) -> dict[str, float | str | None]:
    """Set all that the rig file asks for; what the device keeps of each, None for what it has not.

    Raises InputError, one line, for what it keeps otherwise.
    """
    refused = [line for line in (_format(capture, config), *_controls(capture, config)) if line]
    if refused:
        raise InputError("; ".join(refused))
    kept: dict[str, float | str | None] = {
        "fourcc": _letters(capture.get(cv2.CAP_PROP_FOURCC)),
        "rate_hz": capture.get(cv2.CAP_PROP_FPS),
    }
    for name, key in CONTROLS.items():
        value = capture.get(key)
        kept[name] = None if value == NOT_THERE else value
    return kept


def _format(capture: Capture, config: CameraConfig) -> str:
    """Size, coding and rate, in this order: each resets what comes after it."""
    if config.fourcc is not None:
        capture.set(cv2.CAP_PROP_FOURCC, cv2.VideoWriter.fourcc(*config.fourcc))
        found = _letters(capture.get(cv2.CAP_PROP_FOURCC))
        if found != config.fourcc:
            return f"camera.fourcc: asked {config.fourcc}, the camera keeps {found}"
    if config.width_px is not None and config.height_px is not None:
        capture.set(cv2.CAP_PROP_FRAME_WIDTH, config.width_px)
        capture.set(cv2.CAP_PROP_FRAME_HEIGHT, config.height_px)
        w, h = (capture.get(k) for k in (cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT))
        if (w, h) != (config.width_px, config.height_px):
            return (
                f"camera.width_px: asked {config.width_px} x {config.height_px}, the camera keeps "
                f"{w:.0f} x {h:.0f} px; `v4l2-ctl --list-formats-ext` names its sizes"
            )
    if config.rate_hz is not None:
        capture.set(cv2.CAP_PROP_FPS, config.rate_hz)
        found_hz = capture.get(cv2.CAP_PROP_FPS)
        if abs(found_hz - config.rate_hz) > 0.01 * config.rate_hz:
            return (
                f"camera.rate_hz: asked {config.rate_hz:g}, the camera keeps {found_hz:g} at this "
                "size and coding; MJPG is often faster than YUYV"
            )
    return ""


def _controls(capture: Capture, config: CameraConfig) -> list[str]:
    """Why the device does not keep what it was asked for, a line each."""
    lines = []
    if config.exposure is not None:
        lines += _kept(capture, "exposure", "auto_exposure", MANUAL, config.exposure)
    if config.gain is not None:
        lines += _kept(capture, "gain", None, 0, config.gain)
    if config.white_balance_k is not None:
        lines += _kept(capture, "white_balance_k", "auto_white_balance", 0, config.white_balance_k)
    if config.autofocus is not None:
        lines += _kept(capture, "autofocus", None, 0, int(config.autofocus))
    return lines


def _kept(
    capture: Capture, name: str, automatic: str | None, off: float, value: float
) -> list[str]:
    if automatic is not None:
        capture.set(CONTROLS[automatic], off)
        if capture.get(CONTROLS[automatic]) not in (off, NOT_THERE):
            return [f"camera.{name}: the camera does not let its automatic be switched off"]
    capture.set(CONTROLS[name], value)
    found = capture.get(CONTROLS[name])
    if found == value:
        return []
    keeps = (
        "the camera has no such setting" if found == NOT_THERE else f"the camera keeps {found:g}"
    )
    return [f"camera.{name}: asked {value:g}, {keeps}; `v4l2-ctl -L` names its steps and limits"]


def _letters(code: float) -> str:
    return int(code).to_bytes(4, "little").decode("ascii", errors="replace")
