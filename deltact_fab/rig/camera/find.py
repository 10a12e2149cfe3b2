"""The cameras that this computer has."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from .v4l2 import V4l2Device

SYSFS = Path("/sys/class/video4linux")
DEV = Path("/dev")


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
    """Whether a node gives images."""
    try:
        opened = V4l2Device(str(device))
    except OSError:
        return _said(node, "index") == "0"
    try:
        return opened.captures()
    except OSError:
        return False
    finally:
        opened.close()


def _said(node: Path, what: str) -> str:
    try:
        return (node / what).read_text().strip()
    except OSError:
        return ""


def _number(node: Path) -> int:
    digits = node.name.removeprefix("video")
    return int(digits) if digits.isdecimal() else -1
