"""The wall clock, for rigs made of real parts."""

from __future__ import annotations

import time


class WallClock:
    """Monotonic wall time. One instance is shared by host, runner, camera and force sensor."""

    def now_ns(self) -> int:
        return time.monotonic_ns()

    def now_s(self) -> float:
        return self.now_ns() / 1e9

    def sleep_s(self, seconds: float) -> None:
        time.sleep(seconds)
