"""A serial link whose bytes are under way for a while, in virtual time, as over Bluetooth."""

from __future__ import annotations

import random
from collections import deque
from collections.abc import Callable

from deltact_fab.common.units import to_ns
from deltact_fab.simulate.virtual.clock import VirtualClock
from deltact_fab.simulate.virtual.controller import GrblController
from deltact_fab.simulate.virtual.wire import SerialLink


class EventClock(VirtualClock):
    """A virtual clock that stops at events on its way."""

    def __init__(self) -> None:
        super().__init__()
        self.events: deque[tuple[int, Callable[[], None]]] = deque()

    def advance_to_ns(self, t_ns: int) -> None:
        while self.events and self.events[0][0] <= t_ns:
            at_ns, call = self.events.popleft()
            super().advance_to_ns(at_ns)
            call()
        super().advance_to_ns(t_ns)


class SlowLink(SerialLink):
    """Every piece takes delay_s within jitter_s each way; the order is kept."""

    def __init__(
        self, controller: GrblController, clock: EventClock, delay_s: float, jitter_s: float = 0.0
    ) -> None:
        super().__init__(controller, clock)
        self._events = clock.events
        self._delay_s, self._jitter_s = delay_s, jitter_s
        self._draw = random.Random(1)

    def write(self, data: bytes) -> None:
        last_ns = self._events[-1][0] if self._events else 0
        at_ns = max(self._clock.now_ns() + self._delay_ns(), last_ns)
        self._events.append((at_ns, lambda: self.controller.write(data)))

    def discard(self) -> None:
        super().discard()
        self._events.clear()

    def _wait_for_speech(self, deadline: int | None) -> bool:
        if self._events and (deadline is None or self._events[0][0] <= deadline):
            self._clock.advance_to_ns(self._events[0][0])
            return False
        return super()._wait_for_speech(deadline)

    def _collect(self) -> None:
        for t_ns, data in self.controller.take_output():
            start_ns = max(t_ns + self._delay_ns(), self._free_ns)
            ends = (start_ns + self._duration_ns(k + 1) for k in range(len(data)))
            self._arriving.extend(zip(ends, data, strict=True))
            self._free_ns = start_ns + self._duration_ns(len(data))

    def _delay_ns(self) -> int:
        return to_ns(self._delay_s + self._jitter_s * self._draw.uniform(-1, 1))
