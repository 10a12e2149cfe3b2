"""The cameras that this computer has."""

from __future__ import annotations

import fcntl
import os
import struct
from dataclasses import dataclass
from pathlib import Path

SYSFS = Path("/sys/class/video4linux")
DEV = Path("/dev")
# include/uapi/linux/videodev2.h: VIDIOC_QUERYCAP, _IOR('V', 0, struct v4l2_capability)
CAPABILITY = struct.Struct("16s32s32sIII12x")  # driver, card, bus, version, all, of this node
QUERYCAP = 2 << 30 | CAPABILITY.size << 16 | ord("V") << 8
CAN_CAPTURE = 0x0000_0001  # V4L2_CAP_VIDEO_CAPTURE
TELLS_NODE = 0x8000_0000  # V4L2_CAP_DEVICE_CAPS


@dataclass(frozen=True)
class FoundCamera:
    """A node that gives images. device: as a rig file names it, by serial number where one can."""

    device: str
    name: str


def cameras(sysfs: Path = SYSFS, dev: Path = DEV) -> list[FoundCamera]:
    """Every V4L2 device that captures, in order of its number; none is an answer.

    A node that may not be opened is asked by its place: a USB camera's first one gives the images.
    """
    stable = {}
    for link in sorted((dev / "v4l" / "by-id").glob("*")):
        stable[link.resolve()] = str(link)
    found = []
    for node in sorted(sysfs.glob("video*"), key=_number):
        device = dev / node.name
        if _captures(device, node):
            found.append(
                FoundCamera(stable.get(device.resolve(), str(device)), _said(node, "name"))
            )
    return found


def _captures(device: Path, node: Path) -> bool:
    """Whether a node gives images: metadata, outputs and codecs are nodes too."""
    try:
        fd = os.open(device, os.O_RDWR | os.O_NONBLOCK)
    except OSError:
        return _said(node, "index") == "0"
    try:
        told = CAPABILITY.unpack(fcntl.ioctl(fd, QUERYCAP, bytes(CAPABILITY.size)))
    except OSError:
        return False
    finally:
        os.close(fd)
    *_, whole, of_node = told
    return bool((of_node if whole & TELLS_NODE else whole) & CAN_CAPTURE)


def _said(node: Path, what: str) -> str:
    try:
        return (node / what).read_text().strip()
    except OSError:
        return ""


def _number(node: Path) -> int:
    digits = node.name.removeprefix("video")
    return int(digits) if digits.isdecimal() else -1
