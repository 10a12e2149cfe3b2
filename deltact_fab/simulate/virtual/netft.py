"""Faults of a simulated Net F/T box and its network, switched on by a test.

A record is 36 bytes, big-endian: three sequence and status words, then six signed counts (Net F/T
manual, RDT protocol). `served` puts the box on sockets, `LockstepLink` is the way to it in
virtual time.
"""

from __future__ import annotations

import struct
import zlib
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from deltact_fab.bench import ForceConfig, NetFTSensor
from deltact_fab.common import DeltactFabError, to_ns

from .clock import Ticks, VirtualClock


class Datagram(NamedTuple):
    """One that leaves the box. at_ns: when it is there."""

    at_ns: int
    payload: bytes


@dataclass
class BoxFaults:
    """Set any field at any time; the records taken from then on have it."""

    silent: bool = False
    """Records are taken and numbered, and none is sent."""
    late_s: float = 0.0
    """The network holds every datagram for so long; they stay in order."""
    error: bool = False
    """The error bit with zeros for readings, as a box does whose transducer is gone."""
    saturated: bool = False
    """As if a gauge were out of range."""
    drop_every: int = 0
    """Of so many records one does not come; 0: all do."""
    frozen: bool = False
    """Records go on with the last measurement and its number."""
    stuck: bool = False
    """Records go on with the last readings."""
    _last_ns: int = field(default=0, repr=False)
    _last: NDArray[Any] | None = field(default=None, repr=False)

    def datagrams(self, t_ns: NDArray[np.int64], records: NDArray[Any]) -> list[Datagram]:
        """Records (n,) taken at t_ns as they arrive."""
        if self.error or self.saturated:
            records["status"] = NetFTSensor.ERROR | (NetFTSensor.SATURATED if self.saturated else 0)
        if self.error:
            records["counts"] = 0
        if (self.frozen or self.stuck) and self._last is not None:
            for name in ("counts", "ft") if self.frozen else ("counts",):
                records[name] = self._last[name]
        else:
            self._last = records[-1:].copy()
        if self.silent:
            return []
        size, data = records.dtype.itemsize, records.tobytes()
        late_ns = to_ns(self.late_s)
        out = []
        for k, (at_ns, number) in enumerate(
            zip(t_ns.tolist(), records["rdt"].tolist(), strict=True)
        ):
            self._last_ns = max(at_ns + late_ns, self._last_ns)
            record = data[k * size : (k + 1) * size]
            out += [Datagram(self._last_ns, payload) for payload in self.payloads(number, record)]
        return out

    def payloads(self, number: int, record: bytes) -> list[bytes]:
        """Payloads that leave the box for one record."""
        return [] if self.drop_every and number % self.drop_every == 0 else [record]


BOX_RECORD = np.dtype([("rdt", ">u4"), ("ft", ">u4"), ("status", ">u4"), ("counts", ">i4", 6)])
RDT_COMMAND = struct.Struct(">HHI")
# Net F/T manual, RDT protocol.
COMMAND_HEADER = 0x1234
STOP_COMMAND, STREAM_COMMAND, BIAS_COMMAND = 0x0000, 0x0002, 0x0042
STOP_DRAIN_S = 0.005  # by hand: records under way at the stop command arrive within
# Net F/T datasheet, usual calibrations.
MAX_COUNTS_PER_N, MAX_COUNTS_PER_NMM = 1_000_000.0, 100_000.0
MAX_RANGE_COUNTS = 1e9  # record format: holds twice that, so that a sample less its bias fits
Wrenches = Callable[[NDArray[np.int64]], NDArray[np.float64]]


class NetFTBox:
    """Streams records made from the scene's wrench, noise and range.

    wrenches: forces (N) and torques (N mm) on the sensor (n, 6) at times (n,) ns up to now.
    noise_n: standard deviation of a sample. faults: what it does wrong, changed at any time.
    The bias is software bias, as the real box does it: it is subtracted from the gauges.
    """

    def __init__(
        self,
        config: ForceConfig,
        clock: VirtualClock,
        seed: int,
        wrenches: Wrenches,
        noise_n: float = 0.0,
    ) -> None:
        self._rate_hz = config.rate_hz
        self._noise_n = noise_n
        self.limits = np.array([*config.range_n, *config.range_nmm])
        counts_per_n = min(MAX_COUNTS_PER_N, MAX_RANGE_COUNTS / max(config.range_n))
        counts_per_nmm = min(MAX_COUNTS_PER_NMM, MAX_RANGE_COUNTS / max(config.range_nmm))
        self._per_unit = np.repeat([counts_per_n, counts_per_nmm], 3)
        self._clock = clock
        self._seed = seed
        self._wrenches = wrenches
        self.faults = BoxFaults()
        self._bias = np.zeros(6)
        self._rng = np.random.default_rng(np.random.SeedSequence([seed, 0]))
        self._ticks: Ticks | None = None
        self._remaining: int | None = None  # of the records asked for; None: without end
        self._sent_count = 0  # of the stream under way
        self._sample_count = 0  # since power-on
        self._out: deque[Datagram] = deque()
        self._trouble: DeltactFabError | None = None

    def reseed(self, stream: str) -> None:
        """Restart the noise for a press, so that a press repeated alone gives the same samples."""
        # Not `hash`: the number is the same in every process.
        sequence = np.random.SeedSequence([self._seed, 1, zlib.crc32(stream.encode())])
        self._rng = np.random.default_rng(sequence)

    def settings(self) -> NetFTSensor.Settings:
        """Settings as on the box's configuration page."""
        counts_per_n, counts_per_nmm = self._per_unit[[0, 3]].tolist()
        return NetFTSensor.Settings(counts_per_n, counts_per_nmm, self._rate_hz, "simulated")

    def send(self, command: bytes) -> None:
        """Take one command datagram; unknown ones are ignored, as on the wire."""
        if len(command) != RDT_COMMAND.size:
            return
        header, word, count = RDT_COMMAND.unpack(command)
        if header != COMMAND_HEADER:
            return
        if word == BIAS_COMMAND:
            gauges = self._gauges(np.array([self._clock.now_ns()]))[0]
            self._bias = np.clip(gauges, -self.limits, self.limits)
        elif word == STREAM_COMMAND:
            self._stop()
            self._sent_count, self._remaining = 0, count or None
            self._ticks = self._clock.schedule(self._rate_hz, self._sample)
        elif word == STOP_COMMAND:
            self._stop()

    def receive(self, timeout_s: float) -> Datagram | None:
        """The next datagram, or None once the time-out has passed in virtual time.

        Raises what the scene raised when it was asked for a sample, after those before it.
        """
        deadline_ns = self._clock.now_ns() + to_ns(timeout_s)
        while (data := self.pop_due()) is None and self._trouble is None:
            if self._clock.now_ns() >= deadline_ns:
                return None
            self._clock.advance_to_ns(min(deadline_ns, self.next_ns(deadline_ns)))
        trouble = self._trouble
        if data is None and trouble is not None:
            self._trouble = None
            raise trouble
        return data

    def pop_due(self) -> Datagram | None:
        if self._out and self._out[0].at_ns <= self._clock.now_ns():
            return self._out.popleft()
        return None

    def next_ns(self, otherwise_ns: int) -> int:
        """When the next datagram may be there, if the box streams."""
        if self._out:
            return self._out[0].at_ns
        return otherwise_ns if self._ticks is None else self._ticks.next_ns

    def close(self) -> None:
        self._stop()
        self._out.clear()

    def _stop(self) -> None:
        if self._ticks is not None:
            self._ticks.cancel()
        self._ticks = None

    def _sample(self, t_ns: NDArray[np.int64]) -> None:
        """The clock's ticks: a record each."""
        if self._remaining is not None:
            t_ns = t_ns[: self._remaining]
            self._remaining -= len(t_ns)
        try:
            gauges = self._gauges(t_ns)
        except DeltactFabError as error:
            # It is no fault of whoever lets time pass just now, but of who reads the sensor.
            self._trouble = error
            self._stop()
            return
        limits = self.limits
        values = np.clip(gauges, -limits, limits) - self._bias
        records = np.zeros(len(t_ns), BOX_RECORD)
        k = np.arange(1, len(t_ns) + 1)
        records["rdt"], records["ft"] = self._sent_count + k, self._sample_count + k
        over = (np.abs(gauges) > limits).any(axis=1)
        records["status"] = np.where(over, NetFTSensor.SATURATED | NetFTSensor.ERROR, 0)
        records["counts"] = np.rint(values * self._per_unit)
        if self._noise_n * self._per_unit[0] < 1:  # the last bit of a transducer never rests
            records["counts"][:, 5] += records["ft"] & 1
        self._sent_count += len(t_ns)
        self._sample_count += len(t_ns)
        self._out += self.faults.datagrams(t_ns, records)
        if self._remaining == 0:
            self._stop()

    def _gauges(self, t_ns: NDArray[np.int64]) -> NDArray[np.float64]:
        noise_nmm = self._noise_n * 10.0  # a 10 mm arm
        scale = np.repeat([self._noise_n, noise_nmm], 3)
        noise = self._rng.standard_normal((len(t_ns), 6))
        return np.asarray(self._wrenches(t_ns) + scale * noise, float)


class LockstepLink:
    """Implements rig.force.netft.BoxLink: datagrams to and from a box in virtual time."""

    def __init__(self, box: NetFTBox) -> None:
        self._box = box

    def settings(self) -> NetFTSensor.Settings:
        return self._box.settings()

    def bias(self) -> None:
        """Tare: subtract the present load from all further records."""
        self._command(BIAS_COMMAND)

    def start(self) -> None:
        self._command(STREAM_COMMAND)

    def stop(self) -> None:
        self._command(STOP_COMMAND)
        while self._box.receive(STOP_DRAIN_S) is not None:
            pass

    def receive(self, timeout_s: float) -> NDArray[Any]:
        """All that is there, and the next to come."""
        came = []
        while (data := self._box.receive(0.0)) is not None:
            came.append(data)
        if (data := self._box.receive(timeout_s)) is not None:
            came.append(data)
        arrivals = np.zeros(len(came), NetFTSensor.RECORD)
        records = np.frombuffer(b"".join(data.payload for data in came), BOX_RECORD)
        arrivals["at_ns"] = [data.at_ns for data in came]
        for name in ("rdt", "ft", "status", "counts"):
            arrivals[name] = records[name]
        return arrivals

    def pop_losses(self) -> dict[str, int]:
        return {}

    def close(self) -> None:
        self._command(STOP_COMMAND)
        self._box.close()

    def _command(self, word: int) -> None:
        self._box.send(RDT_COMMAND.pack(COMMAND_HEADER, word, 0))
