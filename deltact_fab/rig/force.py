"""ATI Net F/T client: raw data transfer records in, newtons in the sensor frame out.

The record is 36 bytes, big-endian: three sequence and status words, then six signed counts
(Net F/T manual, RDT protocol). The client is the same on the wire and on the simulated box.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from ..errors import SensorError
from .interface import Clock, ForceReading

RECORD = struct.Struct(">IIIiiiiii")
COMMAND = struct.Struct(">HHI")
HEADER = 0x1234
STOP, STREAM, BIAS = 0x0000, 0x0002, 0x0042
SATURATED = 1 << 17  # status word, bit 17: a gauge or a force is out of range
ERROR = 1 << 31  # status word, bit 31: any error of the unit


@dataclass(frozen=True)
class NetFTSettings:
    """From the box's configuration page `/netftapi2.xml`."""

    counts_per_n: float
    counts_per_nmm: float
    serial: str


class Transport(Protocol):
    """Datagrams to and from the box."""

    def settings(self) -> NetFTSettings: ...
    def send(self, command: bytes) -> None: ...
    def receive(self, timeout_s: float) -> bytes:
        """The next datagram, empty when none comes within the time-out."""

    def close(self) -> None: ...


class NetFTSensor:
    """Implements rig.interface.ForceSensor over a Net F/T transport."""

    def __init__(self, transport: Transport, clock: Clock, timeout_s: float = 0.05):
        self._transport = transport
        self._clock = clock
        self._timeout_s = timeout_s
        self._settings = transport.settings()
        self._last_sequence = 0

    def begin(self, stream: str) -> None:
        """Bias in software on the box, with nothing touching."""
        self._transport.send(COMMAND.pack(HEADER, BIAS, 0))
        self.read()

    def read(self) -> ForceReading:
        """Ask for one sample and convert it. Raises SensorError when silent, stale or faulted."""
        self._transport.send(COMMAND.pack(HEADER, STREAM, 1))
        data = self._transport.receive(self._timeout_s)
        if not data:
            raise SensorError(
                f"force sensor: no sample within {self._timeout_s * 1000:.0f} ms; check power, "
                "cable and address"
            )
        if len(data) != RECORD.size:
            raise SensorError(
                f"force sensor: a record of {len(data)} bytes, {RECORD.size} expected"
            )
        sequence, _, status, *counts = RECORD.unpack(data)
        if sequence <= self._last_sequence:
            raise SensorError(f"force sensor: stale sample {sequence} after {self._last_sequence}")
        self._last_sequence = sequence
        saturated = bool(status & SATURATED)
        if status & ERROR and not saturated:
            raise SensorError(f"force sensor: fault, status word 0x{status:08x}")
        values = np.asarray(counts, float)
        fx, fy, fz = (float(v) for v in values[:3] / self._settings.counts_per_n)
        tx, ty, tz = (float(v) for v in values[3:] / self._settings.counts_per_nmm)
        return ForceReading((fx, fy, fz), (tx, ty, tz), self._clock.now_s(), saturated)

    def identity(self) -> dict[str, Any]:
        """Serial number and scaling of the box."""
        s = self._settings
        return {
            "kind": "netft",
            "serial": s.serial,
            "counts_per_n": s.counts_per_n,
            "counts_per_nmm": s.counts_per_nmm,
        }

    def close(self) -> None:
        """Stop streaming."""
        self._transport.send(COMMAND.pack(HEADER, STOP, 0))
        self._transport.close()
