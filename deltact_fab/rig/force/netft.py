"""ATI Net F/T client: a stream of raw data transfer records in, samples with times out.

A record is 36 bytes, big-endian: three sequence and status words, then six signed counts (Net F/T
manual, RDT protocol). The client is the same on the wire and on the simulated box.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from ...errors import SensorError
from ..interface import Clock, ForceSamples

RECORD = np.dtype([("rdt", ">u4"), ("ft", ">u4"), ("status", ">u4"), ("counts", ">i4", 6)])
COMMAND = struct.Struct(">HHI")
HEADER = 0x1234
STOP, STREAM, BIAS = 0x0000, 0x0002, 0x0042
SATURATED = 1 << 17  # status word, bit 17: a gauge or a force is out of range
ERROR = 1 << 31  # status word, bit 31: any error of the unit
QUIET_S = 0.005  # records that were under way when the box was told to stop come within
DRIFT = 2e-4  # the box's clock and the host's differ by less: two quartzes of 100 ppm


@dataclass(frozen=True)
class NetFTSettings:
    """From the box's configuration page `/netftapi2.xml`; rate_hz: of the RDT stream."""

    counts_per_n: float
    counts_per_nmm: float
    rate_hz: float
    serial: str


class Transport(Protocol):
    """Datagrams to and from the box."""

    def settings(self) -> NetFTSettings: ...
    def send(self, command: bytes) -> None: ...
    def receive(self, timeout_s: float) -> bytes:
        """The next datagram, empty when none comes within the time-out (0: has come already)."""

    def close(self) -> None: ...


class NetFTSensor:
    """Implements rig.interface.ForceSensor over a Net F/T transport.

    A sample's time is its number in the stream at the box's rate, tied to the host's clock by those
    samples that the host waited for: by the earliest to arrive, as far as the clocks may drift.
    """

    def __init__(self, transport: Transport, clock: Clock, timeout_s: float = 0.05):
        self._transport = transport
        self._clock = clock
        self._timeout_s = timeout_s
        self._settings = transport.settings()
        s = self._settings
        self._per_unit = np.repeat([s.counts_per_n, s.counts_per_nmm], 3)
        self._sequence = 0  # of the last record, 0 at the start of a stream
        self._zero_ns: int | None = None  # when record 0 of the stream would have come
        self._heard_ns = self._last_ns = 0
        self.stop()  # whatever the box did for whoever asked before

    def begin(self, stream: str) -> None:
        """Bias in software on the box, with nothing touching, and start."""
        self._command(BIAS)
        self.start()

    def start(self) -> None:
        """Start the stream, from the first record on."""
        self._sequence, self._zero_ns = 0, None
        self._command(STREAM)

    def read(self) -> ForceSamples:
        """All samples since the last read, and the next to come.

        Raises SensorError when none comes within the time-out, for a fault of the box, and when
        records are missing for longer than the time-out or come out of order.
        """
        datagrams = []
        while data := self._transport.receive(0.0):
            datagrams.append(data)
        datagrams.append(self._transport.receive(self._timeout_s))
        now_ns = round(self._clock.now_s() * 1e9)
        if not datagrams[-1]:
            raise SensorError(
                f"force sensor: no sample within {self._timeout_s * 1000:.0f} ms; check power, "
                "cable and address"
            )
        for data in datagrams:
            if len(data) != RECORD.itemsize:
                raise SensorError(
                    f"force sensor: a record of {len(data)} bytes, {RECORD.itemsize} expected"
                )
        records = np.frombuffer(b"".join(datagrams), RECORD)
        sequence = records["rdt"].astype(np.int64)
        lost = self._lost(sequence)
        status = records["status"]
        saturated = status & SATURATED != 0
        faults = status[(status & ERROR != 0) & ~saturated]
        if len(faults):
            raise SensorError(f"force sensor: fault, status word 0x{faults[0]:08x}")
        return ForceSamples(
            self._times(sequence, now_ns),
            records["counts"].astype(np.int32),
            self._per_unit,
            saturated,
            lost,
        )

    def stop(self) -> None:
        """End the stream; what was not read is dropped."""
        self._command(STOP)
        while self._transport.receive(QUIET_S):
            pass

    def identity(self) -> dict[str, Any]:
        """Serial number, rate and scaling of the box."""
        s = self._settings
        return {
            "kind": "netft",
            "serial": s.serial,
            "rate_hz": s.rate_hz,
            "counts_per_n": s.counts_per_n,
            "counts_per_nmm": s.counts_per_nmm,
        }

    def close(self) -> None:
        """Stop streaming."""
        self._command(STOP)
        self._transport.close()

    def _command(self, word: int) -> None:
        self._transport.send(COMMAND.pack(HEADER, word, 0))

    def _lost(self, sequence: NDArray[np.int64]) -> int:
        """How many records are missing before and between these."""
        before = self._sequence
        if before == 0:
            before = int(sequence[0]) - 1  # where a stream starts is the box's affair
        steps = np.diff(sequence, prepend=before)
        if steps.min() < 1:
            k = int(np.argmin(steps))
            raise SensorError(
                f"force sensor: stale sample {sequence[k]} after {sequence[k] - steps[k]}"
            )
        self._sequence = int(sequence[-1])
        most = int(steps.max()) - 1
        if most > self._timeout_s * self._settings.rate_hz:
            raise SensorError(f"force sensor: {most} samples in a row were lost; check the network")
        return int(steps.sum()) - len(steps)

    def _times(self, sequence: NDArray[np.int64], now_ns: int) -> NDArray[np.int64]:
        """Host times (n,) ns of records, the last of which came just now."""
        at = np.rint(sequence * (1e9 / self._settings.rate_hz)).astype(np.int64)
        zero_ns = now_ns - int(at[-1])
        if self._zero_ns is None:
            self._zero_ns, self._last_ns = zero_ns, 0
        else:
            drift_ns = round(DRIFT * (now_ns - self._heard_ns))
            self._zero_ns = min(zero_ns, self._zero_ns + drift_ns)
        self._heard_ns = now_ns
        t_ns = np.maximum(self._zero_ns + at, self._last_ns)
        self._last_ns = int(t_ns[-1])
        return t_ns
