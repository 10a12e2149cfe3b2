"""The wall clock, for rigs made of real parts."""

from __future__ import annotations

import time


class WallClock:
    """Monotonic wall time. One instance is shared by host, runner, camera and force sensor."""

    def now_ns(self) -> int:
        """Nanoseconds since an arbitrary, fixed origin; never goes back."""
        return time.monotonic_ns()

    def now_s(self) -> float:
        """Seconds since the same origin."""
        return self.now_ns() / 1e9

    def sleep_s(self, seconds: float) -> None:
        """Let `seconds` of wall time pass. Raises ValueError when negative."""
        time.sleep(seconds)
