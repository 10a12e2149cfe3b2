"""What a rig file can name on this computer: what is plugged in is found, nothing is opened."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

SERIAL_BY_ID, SYSFS_VIDEO = Path("/dev/serial/by-id"), Path("/sys/class/video4linux")
DEV_FOLDER = Path("/dev")
# Makers of the boards that GRBL runs on, and of their serial chips; others come after them.
BOARD_MAKERS = {
    0x2341: "Arduino", 0x2A03: "Arduino", 0x1A86: "CH340", 0x0403: "FTDI", 0x10C4: "CP210x",
    0x0483: "STM32", 0x16C0: "Teensy", 0x2E8A: "Raspberry Pi Pico", 0x303A: "ESP32",
}  # fmt: skip


@dataclass(frozen=True)
class HostDevice:
    """A device of this computer. name: as a rig file has it; text: what it says it is."""

    name: str
    text: str = ""


def list_devices() -> dict[str, list[HostDevice]]:
    """Ports and cameras of this computer, each with the name that a rig file has for it."""
    return {"ports": list_ports(), "cameras": list_cameras()}


def list_ports(by_id: Path = SERIAL_BY_ID) -> list[HostDevice]:
    """USB serial ports, boards of known makers first; by their lasting names where there are."""
    from serial.tools.list_ports import comports

    stable = _stable_names(by_id)
    ports = [port for port in comports() if port.vid is not None]
    ports.sort(key=lambda port: (port.vid not in BOARD_MAKERS, port.device))
    devices = []
    for port in ports:
        chip = BOARD_MAKERS.get(port.vid)
        text = " ".join(str(port.description or "serial port").split())
        text += f" ({chip})" if chip and chip not in text else ""
        devices.append(HostDevice(stable.get(Path(port.device).resolve(), port.device), text))
    return devices


def list_cameras(sysfs: Path = SYSFS_VIDEO, dev: Path = DEV_FOLDER) -> list[HostDevice]:
    """V4L2 cameras in order of their numbers, by their lasting names where there are.

    A camera's first node gives its images; those that follow give metadata.
    """
    stable = _stable_names(dev / "v4l" / "by-id")
    cameras = []
    nodes = (node for node in sysfs.glob("video*") if node.name[5:].isdecimal())
    for node in sorted(nodes, key=lambda node: int(node.name[5:])):
        if _read_text(node / "index") == "0":
            device = dev / node.name
            name = stable.get(device.resolve(), str(device))
            cameras.append(HostDevice(name, " ".join(_read_text(node / "name").split())))
    return cameras


def _stable_names(by_id: Path) -> dict[Path, str]:
    return {link.resolve(): str(link) for link in sorted(by_id.glob("*"))}


def _read_text(file: Path) -> str:
    try:
        return file.read_text().strip()
    except OSError:
        return ""
