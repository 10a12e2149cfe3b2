"""A serial port to a controller: lines in, bytes out, and a cable that may be pulled.

One thread at a time reads; any may write.
"""

from __future__ import annotations

import errno
import re
from collections.abc import Callable
from contextlib import suppress
from typing import Any, Protocol, TypeVar

import serial

from deltact_fab.common import InputError, StageError, to_ns

from ..interface import Clock

IoResult = TypeVar("IoResult")

# By hand: longer limits report a lost link later, shorter ones give a loose cable no chance.
READ_SLICE_S = 0.05  # one read; a longer wait takes several
WRITE_LIMIT_S = 1.0
REOPEN_LIMIT_S = 1.0  # decision 0073
REOPEN_PERIOD_S = 0.1
STOP_REPEAT_S = 0.02  # between a stop byte and its repetition


class LinkLost(Exception):
    """The port is lost or was never open."""


class Cable(Protocol):
    """Connection to a simulated controller."""

    def open_link(self, timeout: float) -> Any:
        """Open as a pyserial port."""


def _decode(raw: bytes) -> str:
    """Return the text of a line; each run of other than printable ASCII becomes U+FFFD."""
    return re.sub(r"[^ -~]+", "\ufffd", raw.strip().decode("latin-1"))


class Port:
    """url: a serial device, a pyserial URL or a cable. Times are ns of the clock."""

    def __init__(self, url: str | Cable, clock: Clock, baud: int) -> None:
        self.url = url
        self.baud = baud
        self._clock = clock
        self._port: Any = None
        self._partial = b""
        self._tell: Callable[[int | None], None] | None = None

    @property
    def is_open(self) -> bool:
        return self._port is not None

    def open(self) -> None:
        """Open the port for this process alone.

        Raises InputError for an unknown kind of URL, StageError otherwise.
        """
        self._partial = b""
        try:
            if isinstance(self.url, str):
                options: dict[str, Any] = {"timeout": READ_SLICE_S, "write_timeout": WRITE_LIMIT_S}
                options |= {} if "://" in self.url else {"exclusive": True}
                self._port = serial.serial_for_url(self.url, baudrate=self.baud, **options)
            else:
                self._port = self.url.open_link(READ_SLICE_S)
        except ValueError as error:
            raise InputError(f"{self.url}: not a serial port: {error}") from error
        except OSError as error:
            if error.errno in (errno.EAGAIN, errno.EBUSY) or "exclusively lock" in str(error):
                raise StageError(
                    f"{self.url}: cannot be opened: another program uses this stage; end it first"
                ) from error
            raise StageError(f"{self.url}: cannot be opened: {error}") from error
        self._keep_dtr()
        self.share(self._tell)

    def share(self, tell: Callable[[int | None], None] | None) -> None:
        """Pass the file descriptor to `tell` on every opening, None before closing."""
        self._tell = tell
        if tell is not None and self.is_open:
            tell(self._port.fileno())

    def _keep_dtr(self) -> None:
        """Keep DTR high when the port is closed, since its edge restarts an Arduino.

        Else every command would lose the position of the last homing. The first opening after
        plugging in restarts it anyway.
        """
        with suppress(Exception):  # not a terminal
            import termios

            flags = termios.tcgetattr(self._port.fileno())
            flags[2] &= ~termios.HUPCL
            termios.tcsetattr(self._port.fileno(), termios.TCSANOW, flags)

    def close(self) -> None:
        port, self._port = self._port, None
        if port is not None:
            if self._tell is not None:
                self._tell(None)
            with suppress(OSError):
                port.close()

    def write(self, data: bytes) -> None:
        self._io(lambda: self._port.write(data))

    def write_at_once(self, data: bytes) -> None:
        """Write from any thread or signal handler, ignoring errors."""
        with suppress(Exception):
            self._port.write(data)

    def line(self, deadline_ns: int) -> str | None:
        """Return the next non-empty line, None at the deadline (a partial line is kept).

        Raises LinkLost.
        """
        while True:
            self._partial += self._io(lambda: self._port.read_until(b"\n"))
            if self._partial.endswith(b"\n"):
                raw, self._partial = self._partial, b""
                if text := _decode(raw):
                    return text
            elif self.now_ns() >= deadline_ns:
                return None

    def received_lines(self) -> list[str]:
        """Return unread complete lines without waiting. Raises LinkLost."""
        if not self.waiting:
            return []
        data = self._io(lambda: self._port.read(self._port.in_waiting))
        *complete, self._partial = (self._partial + data).split(b"\n")
        return list(filter(None, map(_decode, complete)))

    @property
    def unfinished(self) -> str:
        """Text of a line that is not complete."""
        return _decode(self._partial)

    @property
    def waiting(self) -> bool:
        """True if there are unread bytes. Raises LinkLost."""
        return bool(self._io(lambda: self._port.in_waiting))

    def write_stop(self, stop: bytes) -> bool:
        """Write a stop byte twice, reopening a lost port; return True if it was written.

        Reopening may restart an Arduino, which stops a move as well.
        """
        deadline = self.deadline_ns(REOPEN_LIMIT_S)
        while True:
            with suppress(Exception):  # a lost terminal raises errors of its own
                if self._port is None:
                    self.open()
                self._port.write(stop)
                self._clock.sleep_s(STOP_REPEAT_S)
                self._port.write(stop)
                return True
            self.close()
            if self.now_ns() >= deadline:
                return False
            self._clock.sleep_s(REOPEN_PERIOD_S)

    def now_ns(self) -> int:
        return self._clock.now_ns()

    def deadline_ns(self, seconds: float) -> int:
        return self.now_ns() + to_ns(seconds)

    def on_wire_ns(self, n: int) -> int:
        return n * 10 * 1_000_000_000 // self.baud

    def _io(self, operation: Callable[[], IoResult]) -> IoResult:
        if self._port is None:
            raise LinkLost("not connected")
        try:
            return operation()
        except (OSError, TypeError, AttributeError) as error:  # the last two: closed meanwhile
            raise LinkLost(f"the link is lost ({error})") from error
