"""Virtual time that is brought up to the wall clock, so that what it steps is stepped in order."""

from __future__ import annotations

import time

from ..clock import VirtualClock


class LiveClock(VirtualClock):
    """Stands still between two calls of `catch_up`; its origin is that of `time.monotonic`."""

    def __init__(self) -> None:
        super().__init__()
        self.catch_up()

    def catch_up(self) -> None:
        """Let the time pass that has passed."""
        self.advance_to_ns(time.monotonic_ns())
