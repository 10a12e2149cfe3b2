"""The lockstep wire: a serial port whose other end is a simulated controller.

A `Port` opens a `SerialLink` in place of a device, so the real host runs unchanged. Virtual time
moves only while the host sleeps or exchanges bytes: a byte takes 10 bits at the baud rate, what the
controller says travels while the host does other things, and a read with nothing to come lasts its
time-out or until the controller next speaks. No threads.
"""

from __future__ import annotations

import math
from collections import deque
from typing import Literal

import serial

from deltact_fab.common import to_ns

from .clock import NS_PER_S, VirtualClock
from .controller import GrblController

_BITS_PER_BYTE = 10  # definition of 8N1
WireExchange = tuple[int, Literal["host", "controller"], bytes]


class SerialLink:
    """The cable between a host and one controller, read and written as a pyserial port is.

    resets_on_open: opening the port restarts the controller, as an Arduino does. trace: a list that
    gets every exchange as (virtual ns, who, bytes). timeout: of a read, virtual seconds.
    """

    def __init__(
        self,
        controller: GrblController,
        clock: VirtualClock,
        *,
        baud: int = 115200,
        resets_on_open: bool = True,
        trace: list[WireExchange] | None = None,
    ) -> None:
        self.controller = controller
        self._clock = clock
        self._baud = baud
        self.timeout: float | None = None
        self._resets_on_open = resets_on_open
        self._trace = trace
        self._arriving: deque[tuple[int, int]] = deque()  # when each byte is through, and it
        self._free_ns = clock.now_ns()
        self._out_ns: tuple[float, float] = (0, 0)  # the cable is out from then till then

    def __str__(self) -> str:
        return "simulated"

    def unplug(self, for_s: float = math.inf, at_s: float | None = None) -> None:
        """Pull the cable: the host's reads and writes fail, the controller's motion goes on.

        What is said until it is back is lost. at_s: at a time of the clock that is to come.
        """
        from_ns = self._clock.now_ns() if at_s is None else to_ns(at_s)
        self._out_ns = (from_ns, from_ns + for_s * NS_PER_S)

    def plug(self) -> None:
        self._out_ns = (0, 0)
        self.discard()

    def open_link(self, timeout: float | None) -> SerialLink:
        """The host opens the port: an Arduino restarts, other boards do not notice."""
        self.timeout = timeout
        self._require_cable()
        self.discard()
        if self._resets_on_open:
            self.controller.hard_reset()
        return self

    def close(self) -> None:
        """The controller goes on."""

    def discard(self) -> None:
        """Drop received bytes that were not read."""
        self.controller.take_output()
        self._arriving.clear()

    def write(self, data: bytes) -> None:
        """Host to controller; returns when the last bit is through."""
        self._require_cable()
        self._clock.advance_to_ns(self._clock.now_ns() + self._duration_ns(len(data)))
        if self._trace is not None:
            self._trace.append((self._clock.now_ns(), "host", data))
        self.controller.write(data)

    @property
    def in_waiting(self) -> int:
        """Bytes that have arrived and can be read without any wait."""
        self._require_cable()
        self._collect()
        now_ns = self._clock.now_ns()
        return sum(through_ns <= now_ns for through_ns, _ in self._arriving)

    def read_until(self, end: bytes = b"\n") -> bytes:
        """Read up to the byte `end`, or less at the time-out."""
        return self.read(1 << 30, end)

    def read(self, size: int = 1, until: bytes = b"") -> bytes:
        """Up to `size` bytes, ended by the byte `until` if given, or less at the time-out.

        Raises SerialException when it would wait for ever.
        """
        self._require_cable()
        deadline = None if self.timeout is None else self._clock.now_ns() + to_ns(self.timeout)
        got = bytearray()
        over = False
        while len(got) < size and not over:
            self._collect()
            if not self._arriving:
                over = self._wait_for_speech(deadline)
            through_ns = 0
            while self._arriving and len(got) < size and not over:
                next_ns = self._arriving[0][0]
                if deadline is not None and next_ns > max(deadline, self._clock.now_ns()):
                    through_ns, over = deadline, True
                else:
                    through_ns, byte = self._arriving.popleft()
                    got.append(byte)
                    over = until == bytes((byte,))
            self._clock.advance_to_ns(through_ns)
        if got and self._trace is not None:
            self._trace.append((self._clock.now_ns(), "controller", bytes(got)))
        return bytes(got)

    def _wait_for_speech(self, deadline: int | None) -> bool:
        """Let time pass to the controller's next event or the deadline; True at the deadline."""
        event = self.controller.next_event_ns()
        if event is None and deadline is None:
            raise serial.SerialException("nothing will ever come")
        if deadline is not None and (event is None or event > deadline):
            self._clock.advance_to_ns(deadline)
            return True
        assert event is not None
        self._clock.advance_to_ns(event)
        return False

    def _collect(self) -> None:
        """Put output of the controller on the wire, byte after byte."""
        for t_ns, data in self.controller.take_output():
            if not self._out_ns[0] <= t_ns < self._out_ns[1]:
                start = max(t_ns, self._free_ns)
                ends = (start + self._duration_ns(k + 1) for k in range(len(data)))
                self._arriving.extend(zip(ends, data, strict=True))
                self._free_ns = start + self._duration_ns(len(data))

    def _duration_ns(self, n: int) -> int:
        return n * _BITS_PER_BYTE * NS_PER_S // self._baud

    def _require_cable(self) -> None:
        if self._out_ns[0] <= self._clock.now_ns() < self._out_ns[1]:
            raise serial.SerialException("device disconnected")
