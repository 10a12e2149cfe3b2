"""ATI Net F/T: a stream of numbered records in, samples on the host's clock out.

What is here is the same for the box on the network (`rdt.RdtLink`) and for the simulated one
in virtual time (`simulate.virtual.netft.LockstepLink`): which records are readings, what is missing
between them, and when each was taken.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from typing import Any, ClassVar, Protocol

import numpy as np
from numpy.typing import NDArray

from deltact_fab.common import Note, Point, SensorError, to_ns

from ..interface import Clock, ForceSamples

DatagramArrivals = NDArray[Any]
SENSOR_SILENT_S = 0.05  # a sensor that says nothing for so long has failed
LATE_NS = 20_000_000  # a record so much later than its number says is told of
MAX_CLOCK_DRIFT = 2e-4  # the box's clock and the host's differ by less: two quartzes of 100 ppm
NOTE_PERIOD_NS = 1_000_000_000  # a box that repeats every record must not fill the journal
NOTE_TEXTS = {
    "gap": "{n} force samples are missing",
    "late": "{n} force samples came late, by up to {worst:.0f} ms",
    "duplicate": "{n} force records came twice",
    "order": "{n} force records came after younger ones and were left out",
    "garbage": "{n} pieces of garbage came instead of force records",
    "overrun": "{n} force records were thrown away unread: the host was too slow",
    "saturation": "{n} force samples are saturated",
    "error": "{n} force records carried the error bit: no readings",
    "behind": "{n} times the newest force sample was old when it was looked at, by up to "
    "{worst:.0f} ms",
    "silence": "no force sample came in time, {n} times",
}


@dataclass(frozen=True)
class NetFTSettings:
    """Settings of a box that its records are read by; rate_hz: of the RDT stream."""

    counts_per_n: float
    counts_per_nmm: float
    rate_hz: float
    serial: str
    about: tuple[tuple[str, str], ...] = ()
    """More that the record keeps of the box: name and value."""
    range_n: Point | None = None
    range_nmm: Point | None = None
    """Rated maximum of the transducer, where the box tells it."""


class BoxLink(Protocol):
    """The way to a box. Raises SensorError where the box cannot be reached."""

    def settings(self) -> NetFTSettings: ...
    def bias(self) -> None:
        """Let what the sensor feels now be zero in every record that `receive` gives later."""

    def start(self) -> None:
        """Let records come, from number 1 on."""

    def stop(self) -> None:
        """Let none come; those under way are dropped."""

    def receive(self, timeout_s: float) -> DatagramArrivals:
        """(n,) NetFTSensor.RECORD: all that came; waits for one, empty after the time-out."""

    def pop_losses(self) -> dict[str, int]:
        """What did not become a record since the last call: counts by a name of `TEXTS`."""

    def close(self) -> None: ...


class NetFTSensor:
    """A `ForceSensor` over the link to a Net F/T box.

    A sample's time is its number in the stream at the box's rate, tied to the host's clock by the
    earliest to arrive, as far as the clocks may drift. So a record that comes late has the time
    at which it was taken; that it came late is told in the notes.
    """

    RECORD: ClassVar[np.dtype[Any]] = np.dtype(
        [("at_ns", "i8"), ("rdt", "u4"), ("status", "u4"), ("counts", "i4", 6)]
    )
    """As it came: at_ns of the host's clock, its number in the stream, status word, counts."""
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
        self._fault = ""  # what the box said of itself; nothing more is read of this stream
        self.tally = NoteCounts()
        self.stop()  # whatever the box did for whoever asked before

    def begin(self, stream: str) -> None:
        self._link.bias()
        self.start()

    def start(self) -> None:
        self._sequence, self._zero_ns, self._fault = 0, None, ""
        self._link.start()

    def read(self) -> ForceSamples:
        """All samples since the last read, at least one; waits for the next to come.

        Raises SensorError when no new one comes within the time-out, for a fault of the box (after
        the samples before it), and when more are missing in a row than come within the time-out.
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
        tally = self.tally
        tally.add("gap", n_lost)
        tally.add("late", int(late.sum()), float(late_ns.max()) / 1e6)
        tally.add("saturation", int(saturated.sum()))
        for name, n in self._link.pop_losses().items():
            tally.add(name, n)
        return ForceSamples(
            t_ns,
            fresh["counts"].astype(np.int32),
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
        """What came and is younger than all before it, at least one record."""
        if self._fault:
            raise SensorError(self._fault)
        deadline_ns = self._clock.now_ns() + to_ns(self._timeout_s)
        stale = 0
        while True:
            left_ns = deadline_ns - self._clock.now_ns()  # below 0: this host was late, not the box
            came = self._link.receive(max(left_ns, 0) / 1e9)
            if len(came):
                sequence = came["rdt"].astype(np.int64)
                # Where a stream starts is the box's affair.
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
        hint = f"; {stale} old ones came: does another program use the box?" if stale else ""
        raise SensorError(
            f"force sensor: no sample within {self._timeout_s * 1000:.0f} ms{hint}; check power, "
            "cable and address"
        )

    def _count_lost(self, sequence: NDArray[np.int64]) -> int:
        """How many records are missing before and between these."""
        previous = self._sequence or int(sequence[0]) - 1
        steps = np.diff(sequence, prepend=previous)
        self._sequence = int(sequence[-1])
        gap = int(steps.max()) - 1
        if gap > self._timeout_s * self._settings.rate_hz:
            raise SensorError(f"force sensor: {gap} samples in a row were lost; check the network")
        return int(steps.sum()) - len(steps)

    def _times(
        self, sequence: NDArray[np.int64], at_ns: NDArray[np.int64]
    ) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Host times (n,) ns at which records were taken, and how much later each came."""
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
        # A tie found to be earlier than thought lets no sample come before the one before it.
        t_ns = np.maximum(t_ns, self._last_ns + 1 + np.arange(len(t_ns)))
        self._last_ns = int(t_ns[-1])
        return t_ns, late_ns


class NoteCounts:
    """Counts by name, each of `TEXTS`. total: since the sensor was opened."""

    def __init__(self) -> None:
        self.total: Counter[str] = Counter()
        self._pending: Counter[str] = Counter()
        self._worst: dict[str, float] = {}
        self._noted_ns: dict[str, int] = {}

    def add(self, name: str, n: int, worst: float = 0.0) -> None:
        """Something of that name happened n times; 0 is nothing."""
        if n > 0:
            self.total[name] += n
            self._pending[name] += n
            self._worst[name] = max(worst, self._worst.get(name, 0.0))

    def pop_notes(self, now_ns: int) -> tuple[Note, ...]:
        """A note for each name that was not told within the last second."""
        notes = []
        for name in [*self._pending]:
            if now_ns - self._noted_ns.get(name, now_ns - NOTE_PERIOD_NS) >= NOTE_PERIOD_NS:
                n, worst = self._pending.pop(name), self._worst.pop(name)
                notes.append(Note(name, NOTE_TEXTS[name].format(n=n, worst=worst)))
                self._noted_ns[name] = now_ns
        return tuple(notes)
