"""ATI Net F/T: from a stream of numbered records to samples on the host's clock.

Common to the box on the network (`rdt.RdtLink`) and the simulated one in virtual time
(`simulate.virtual.netft.LockstepLink`): valid records, gaps, and times.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from typing import Any, ClassVar, Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

from deltact_fab.common import Note, Point, SensorError, to_ns

from ..interface import Clock, ForceSamples
from .standstill import STILL_NS, STILL_RECORDS, Standstill

DatagramArrivals = NDArray[Any]
# By hand: lower limits report a busy host as a fault, more notes fill the journal.
MAX_EQUAL_SEQUENCES = 5  # records from one cycle of the box, at its full rate
SENSOR_SILENT_S = 0.05  # without a record the sensor has failed; decision 0031
LATE_NS = 20_000_000  # a record later than its number implies by this is noted
MAX_CLOCK_DRIFT = 2e-4  # of box against host: two quartzes of 100 ppm
NOTE_PERIOD_NS = 1_000_000_000  # between two notes of one kind
NOTE_TEXTS = {
    "gap": "{n} force samples missing",
    "late": "{n} force samples late, by up to {worst:.0f} ms",
    "duplicate": "{n} duplicate force records",
    "order": "{n} force records out of order, discarded",
    "garbage": "{n} datagrams or lines that are not force records",
    "overrun": "{n} force records lost unread: the host was too slow",
    "saturation": "{n} force samples saturated",
    "error": "{n} force records with the error bit, discarded",
    "behind": "guard behind the force stream {n} times, by up to {worst:.0f} ms",
    "silence": "no force sample in time, {n} times",
}


@dataclass(frozen=True)
class NetFTSettings:
    """Settings of a box needed to read its records; rate_hz: of the RDT stream."""

    counts_per_n: float
    counts_per_nmm: float
    rate_hz: float
    serial: str
    about: tuple[tuple[str, str], ...] = ()
    """Other data of the box for the record: name and value."""
    range_n: Point | None = None
    range_nmm: Point | None = None
    """Rated maximum of the transducer, if the box reports it."""


class BoxLink(Protocol):
    """Connection to a box. Raises SensorError if the box cannot be reached."""

    def settings(self) -> NetFTSettings: ...
    def bias(self) -> None:
        """Make the present load the zero of all records received later."""

    def start(self) -> None:
        """Start the stream, from record number 1."""

    def stop(self) -> None:
        """Stop the stream; records in transit are dropped."""

    def receive(self, timeout_s: float) -> DatagramArrivals:
        """Return records (n,) of NetFTSensor.RECORD; waits for one, empty at the timeout."""

    def pop_losses(self) -> dict[str, int]:
        """Return losses since the last call: counts by a name of `NOTE_TEXTS`."""

    def close(self) -> None: ...


class NetFTSensor:
    """A `ForceSensor` over the link to a Net F/T box.

    A sample's time is its number over the box's rate, tied to the host's clock by the earliest
    arrivals within the drift of the clocks. So a late record keeps the time of its measurement;
    the delay is noted.
    """

    Settings: TypeAlias = NetFTSettings
    RECORD: ClassVar[np.dtype[Any]] = np.dtype(
        [("at_ns", "i8"), ("rdt", "u4"), ("ft", "u4"), ("status", "u4"), ("counts", "i4", 6)]
    )
    """Received record: at_ns of the host's clock, number in the stream, number of the box's
    measurement, status word, counts."""
    SATURATED: ClassVar = 1 << 17
    """Bit 17 of the status word: a gauge or a force is out of range."""
    ERROR: ClassVar = 1 << 31
    """Bit 31 of the status word: any error of the unit."""

    def __init__(self, link: BoxLink, clock: Clock, timeout_s: float = SENSOR_SILENT_S):
        self._link = link
        self._clock = clock
        self._timeout_s = timeout_s
        self._settings = link.settings()
        s = self._settings
        self._per_unit = np.repeat([s.counts_per_n, s.counts_per_nmm], 3)
        self._sequence = 0  # of the last record, 0 at the start of a stream
        self._zero_ns: int | None = None  # when record 0 of the stream would have come
        self._heard_ns = self._last_ns = 0
        self._fault = ""  # reported by the box; the stream is not read any more
        self.tally = NoteCounts()
        self.stop()  # ends a stream that another program started

    def begin(self, stream: str) -> None:
        self._link.bias()
        self.start()

    def start(self) -> None:
        self._sequence, self._zero_ns, self._fault = 0, None, ""
        self._ft = np.empty(0, np.uint32)  # of the last records
        limit_ns = max(STILL_NS, STILL_RECORDS * 1e9 / self._settings.rate_hz)
        self._standstill = Standstill(limit_ns)
        self._link.start()

    def read(self) -> ForceSamples:
        """Return samples since the last read, at least one; waits for the next.

        Raises SensorError when none comes within the timeout, for a fault of the box (after the
        samples before it), for a gap longer than the timeout, and for readings that stand still.
        """
        fresh = self._receive_new()
        status = fresh["status"]
        saturated = status & self.SATURATED != 0
        faulty = (status & self.ERROR != 0) & ~saturated
        if faulty.any():
            first = int(faulty.argmax())
            self.tally.add("error", int(faulty.sum()))
            self._fault = f"force sensor: fault, status word 0x{status[first]:08x}"
            if first == 0:
                raise SensorError(self._fault)
            fresh, saturated = fresh[:first], saturated[:first]
        sequence = fresh["rdt"].astype(np.int64)
        n_lost = self._count_lost(sequence)
        t_ns, late_ns = self._times(sequence, fresh["at_ns"])
        late = late_ns > LATE_NS
        self._check_measurements(fresh["ft"])
        counts = fresh["counts"].astype(np.int32)
        self._standstill.check(t_ns, counts, saturated)
        tally = self.tally
        tally.add("gap", n_lost)
        tally.add("late", int(late.sum()), float(late_ns.max()) / 1e6)
        tally.add("saturation", int(saturated.sum()))
        for name, n in self._link.pop_losses().items():
            tally.add(name, n)
        return ForceSamples(
            t_ns,
            counts,
            self._per_unit,
            saturated,
            n_lost,
            int(late.sum()),
            tally.pop_notes(self._clock.now_ns()),
        )

    def stop(self) -> None:
        self._link.stop()

    def identity(self) -> dict[str, Any]:
        s = self._settings
        return {
            "kind": "netft",
            "serial": s.serial,
            "rate_hz": s.rate_hz,
            "counts_per_n": s.counts_per_n,
            "counts_per_nmm": s.counts_per_nmm,
            **dict(s.about),
        }

    def close(self) -> None:
        self._link.close()

    def _receive_new(self) -> DatagramArrivals:
        """Receive at least one record newer than all before it."""
        if self._fault:
            raise SensorError(self._fault)
        deadline_ns = self._clock.now_ns() + to_ns(self._timeout_s)
        stale = 0
        while True:
            left_ns = deadline_ns - self._clock.now_ns()  # below 0: the host was late, not the box
            came = self._link.receive(max(left_ns, 0) / 1e9)
            if len(came):
                sequence = came["rdt"].astype(np.int64)
                # The box chooses the first number.
                previous = self._sequence or int(sequence[0]) - 1
                top = np.maximum.accumulate(np.concatenate([[previous], sequence]))[:-1]
                fresh = came[sequence > top]
                self.tally.add("duplicate", int((sequence == top).sum()))
                self.tally.add("order", int((sequence < top).sum()))
                if len(fresh):
                    return fresh
                stale += len(came)
            if left_ns <= 0:
                break
        self.tally.add("silence", 1)
        hint = f"; {stale} old ones: does another program use the box?" if stale else ""
        raise SensorError(
            f"force sensor: no sample within {self._timeout_s * 1000:.0f} ms{hint}; check power, "
            "cable and address"
        )

    def _count_lost(self, sequence: NDArray[np.int64]) -> int:
        """Number of records missing before and between these."""
        previous = self._sequence or int(sequence[0]) - 1
        steps = np.diff(sequence, prepend=previous)
        self._sequence = int(sequence[-1])
        gap = int(steps.max()) - 1
        if gap > self._timeout_s * self._settings.rate_hz:
            raise SensorError(f"force sensor: {gap} samples lost in a row; check the network")
        return int(steps.sum()) - len(steps)

    def _check_measurements(self, ft: NDArray[np.uint32]) -> None:
        """Raise SensorError for records that repeat one measurement."""
        self._ft = ft = np.concatenate((self._ft, ft))
        if (ft[MAX_EQUAL_SEQUENCES:] == ft[:-MAX_EQUAL_SEQUENCES]).any():
            raise SensorError(
                f"force sensor: the readings do not change: the FT sequence stands at {ft[-1]} "
                "while records come; restart the box"
            )
        self._ft = ft[-MAX_EQUAL_SEQUENCES:]

    def _times(
        self, sequence: NDArray[np.int64], at_ns: NDArray[np.int64]
    ) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Host times (n,) ns of the measurements, and the delay of each arrival."""
        after_ns = np.rint(sequence * (1e9 / self._settings.rate_hz)).astype(np.int64)
        zero_ns = int((at_ns - after_ns).min())
        if self._zero_ns is None:
            self._zero_ns, self._last_ns = zero_ns, 0
        else:
            drift_ns = round(MAX_CLOCK_DRIFT * (int(at_ns[-1]) - self._heard_ns))
            self._zero_ns = min(zero_ns, self._zero_ns + drift_ns)
        self._heard_ns = int(at_ns[-1])
        t_ns = self._zero_ns + after_ns
        late_ns = at_ns - t_ns
        # A corrected offset must not reverse the order of samples.
        t_ns = np.maximum(t_ns, self._last_ns + 1 + np.arange(len(t_ns)))
        self._last_ns = int(t_ns[-1])
        return t_ns, late_ns


class NoteCounts:
    """Counts by a name of `NOTE_TEXTS`. total: since the sensor was opened."""

    def __init__(self) -> None:
        self.total: Counter[str] = Counter()
        self._pending: Counter[str] = Counter()
        self._worst: dict[str, float] = {}
        self._noted_ns: dict[str, int] = {}

    def add(self, name: str, n: int, worst: float = 0.0) -> None:
        """Count n events of a name, with the worst delay in ms."""
        if n > 0:
            self.total[name] += n
            self._pending[name] += n
            self._worst[name] = max(worst, self._worst.get(name, 0.0))

    def pop_notes(self, now_ns: int) -> tuple[Note, ...]:
        """Return a note for each name not noted within NOTE_PERIOD_NS."""
        notes = []
        for name in [*self._pending]:
            if now_ns - self._noted_ns.get(name, now_ns - NOTE_PERIOD_NS) >= NOTE_PERIOD_NS:
                n, worst = self._pending.pop(name), self._worst.pop(name)
                notes.append(Note(name, NOTE_TEXTS[name].format(n=n, worst=worst)))
                self._noted_ns[name] = now_ns
        return tuple(notes)
