"""Virtual time: it stands still unless someone lets it pass, so a run is repeatable."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from deltact_fab.common import to_ns

NS_PER_S = to_ns(1)


class Ticks:
    """Moments 1, 2, 3... periods after a start, whole nanoseconds each, until they are cancelled.

    call gets those of one passage of time together, in order, as an (n,) array of ns.
    """

    def __init__(
        self, start_ns: int, rate_hz: float, call: Callable[[NDArray[np.int64]], None]
    ) -> None:
        self._start_ns = start_ns
        self._period_ns = NS_PER_S / rate_hz
        self._call = call
        self._emitted = 0
        self.next_ns = self._start_ns + round(self._period_ns)
        self.cancelled = False

    def cancel(self) -> None:
        self.cancelled = True

    def run(self, until_ns: int) -> None:
        """Call with all that are left up to and at until_ns; at least one is."""
        last = int((until_ns - self._start_ns) / self._period_ns) + 2
        k = np.arange(self._emitted + 1, last + 1)
        t_ns = self._start_ns + np.rint(k * self._period_ns).astype(np.int64)
        t_ns = t_ns[t_ns <= until_ns]
        self._emitted += len(t_ns)
        self.next_ns = self._start_ns + round((self._emitted + 1) * self._period_ns)
        self._call(t_ns)


class VirtualClock:
    """Integer nanoseconds inside: differences are exact, whatever the time of day it started at.

    It is also the one scheduler: whoever lets time pass, by a sleep or by bytes on a wire, has the
    ticks of all simulated devices done that fall into that time, in the order of their times.
    """

    def __init__(self, start_s: float = 0.0) -> None:
        self._now_ns = to_ns(start_s)
        self._ticks: list[Ticks] = []
        self._passing = False

    def now_ns(self) -> int:
        return self._now_ns

    def now_s(self) -> float:
        """Virtual seconds; `to_ns` gives back the exact nanoseconds up to 2**51 ns (26 days)."""
        return self._now_ns / NS_PER_S

    def sleep_s(self, seconds: float) -> None:
        """Let virtual time pass. Raises ValueError when negative or not finite."""
        if not (math.isfinite(seconds) and seconds >= 0):
            raise ValueError(f"cannot sleep {seconds} s: a finite time, not negative, is needed")
        self.advance_to_ns(self._now_ns + to_ns(seconds))

    def schedule(self, rate_hz: float, call: Callable[[NDArray[np.int64]], None]) -> Ticks:
        """Call at this rate from now on, first one period from now.

        Ticks that no other device's tick parts come in one call: in between nobody acts, so that
        the past is decided. The clock shows the end of that time already. What is called must not
        let time pass.
        """
        ticks = Ticks(self._now_ns, rate_hz, call)
        self._ticks.append(ticks)
        return ticks

    def advance_to_ns(self, t_ns: int) -> None:
        """Move on to `t_ns`; a moment already past changes nothing.

        Raises RuntimeError from inside of a tick, and whatever a tick raises; the clock is at t_ns
        then, and the ticks that are still due come with the next advance.
        """
        if t_ns <= self._now_ns:
            return
        if self._passing:
            raise RuntimeError("what the clock calls cannot let time pass")
        self._now_ns = t_ns
        self._passing = True
        try:
            while due := self._due():
                due[0].run(due[1].next_ns if len(due) > 1 else t_ns)
        finally:
            self._passing = False

    def _due(self) -> list[Ticks]:
        """Whose ticks are due, by the time of their next."""
        self._ticks = [ticks for ticks in self._ticks if not ticks.cancelled]
        due = [ticks for ticks in self._ticks if ticks.next_ns <= self._now_ns]
        return sorted(due, key=lambda ticks: ticks.next_ns)
