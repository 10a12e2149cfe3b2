"""What a rig file can name on this computer: what is plugged in is found, nothing is opened."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

BY_ID = Path("/dev/serial/by-id")
# Makers of the boards that GRBL runs on, and of their serial chips; others come after them.
BOARDS = {
    0x2341: "Arduino", 0x2A03: "Arduino", 0x1A86: "CH340", 0x0403: "FTDI", 0x10C4: "CP210x",
    0x0483: "STM32", 0x16C0: "Teensy", 0x2E8A: "Raspberry Pi Pico", 0x303A: "ESP32",
}  # fmt: skip


@dataclass(frozen=True)
class FoundDevice:
    """Something that was found. name: as a rig file has it; text: what it says it is."""

    name: str
    text: str = ""


def ports(by_id: Path = BY_ID) -> list[FoundDevice]:
    """USB serial ports, boards of known makers first; by their lasting names where there are."""
    from serial.tools import list_ports

    lasting = {link.resolve(): str(link) for link in sorted(by_id.glob("*"))}
    found = [port for port in list_ports.comports() if port.vid is not None]
    found.sort(key=lambda port: (port.vid not in BOARDS, port.device))
    devices = []
    for port in found:
        chip = BOARDS.get(port.vid)
        text = " ".join(str(port.description or "serial port").split())
        text += f" ({chip})" if chip and chip not in text else ""
        devices.append(FoundDevice(lasting.get(Path(port.device).resolve(), port.device), text))
    return devices


def cameras() -> list[FoundDevice]:
    """V4L2 cameras; none where there is no V4L2."""
    try:
        from .camera.find import cameras as found
    except ImportError:  # not on this system
        return []
    return [FoundDevice(camera.device, " ".join(camera.name.split())) for camera in found()]
