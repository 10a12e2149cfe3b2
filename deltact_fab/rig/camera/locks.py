"""Settings of a V4L2 device, set and read back, so that it does not follow the light.

The automatic of a setting is switched off before it is set, or the driver refuses it.
"""

from __future__ import annotations

from contextlib import suppress

from ...errors import InputError
from .config import CameraConfig
from .v4l2 import V4l2Device

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
