"""Serial ports and cameras of this computer, as a rig file names them; nothing is opened."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

SERIAL_BY_ID, SYSFS_VIDEO = Path("/dev/serial/by-id"), Path("/sys/class/video4linux")
DEV_FOLDER = Path("/dev")
# USB vendor ids of boards that run GRBL and of their serial chips; listed before others.
BOARD_MAKERS = {
    0x2341: "Arduino", 0x2A03: "Arduino", 0x1A86: "CH340", 0x0403: "FTDI", 0x10C4: "CP210x",
    0x0483: "STM32", 0x16C0: "Teensy", 0x2E8A: "Raspberry Pi Pico", 0x303A: "ESP32",
}  # fmt: skip


@dataclass(frozen=True)
class HostDevice:
    """A device of this computer. name: for a rig file; text: its own description."""

    name: str
    text: str = ""


def list_devices() -> dict[str, list[HostDevice]]:
    """List ports and cameras of this computer with their names for a rig file."""
    return {"ports": list_ports(), "cameras": list_cameras()}


def list_ports(by_id: Path = SERIAL_BY_ID) -> list[HostDevice]:
    """List USB serial ports, boards of known makers first, by stable names where possible."""
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
    """List V4L2 cameras by number, with stable names where possible.

    A camera's first node gives images; the others give metadata.
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
