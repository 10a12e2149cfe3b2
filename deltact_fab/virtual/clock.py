"""Virtual time: it stands still unless someone lets it pass, so a run is repeatable."""

from __future__ import annotations

import math
from typing import Protocol

NS_PER_S = 1_000_000_000


class NsClock(Protocol):
    """What the simulated devices need of a clock: `VirtualClock` and `rig.clock.WallClock`."""

    def now_ns(self) -> int:
        """Nanoseconds since an arbitrary, fixed origin; never goes back."""


class VirtualClock:
    """Integer nanoseconds inside: differences are exact, whatever the time of day it started at."""

    def __init__(self, start_s: float = 0.0) -> None:
        self._now_ns = to_ns(start_s)

    def now_ns(self) -> int:
        """Virtual nanoseconds."""
        return self._now_ns

    def now_s(self) -> float:
        """Virtual seconds; `to_ns` gives back the exact nanoseconds up to 2**51 ns (26 days)."""
        return self._now_ns / NS_PER_S

    def sleep_s(self, seconds: float) -> None:
        """Let virtual time pass. Raises ValueError when negative or not finite."""
        if not (math.isfinite(seconds) and seconds >= 0):
            raise ValueError(f"cannot sleep {seconds} s: a finite time, not negative, is needed")
        self._now_ns += to_ns(seconds)

    def advance_to_ns(self, t_ns: int) -> None:
        """Move on to `t_ns`; a moment already past changes nothing."""
        self._now_ns = max(self._now_ns, t_ns)


def to_ns(seconds: float) -> int:
    """Seconds to the nearest nanosecond."""
    return round(seconds * NS_PER_S)
