"""pyserial's handler of `simgrbl://NAME` URLs (found by its module name; see wire.py)."""

from __future__ import annotations

from typing import Any

from serial.serialutil import LF, PortNotOpenError, SerialBase, SerialException, to_bytes

from . import wire


class Serial(SerialBase):
    """A serial port in virtual time. Time-outs count virtual seconds."""

    is_open: bool

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        self._link: wire.SerialLink | None = None
        super().__init__(*args, **kwargs)

    def open(self) -> None:
        """Open the port. Raises SerialException when it is open or names no live controller."""
        if self.is_open:
            raise SerialException("port is already open")
        link = wire.find(str(self._port))
        link.opened()
        self._link = link
        self.is_open = True

    def close(self) -> None:
        """Close the port; the controller goes on."""
        self._link = None
        self.is_open = False

    @property
    def in_waiting(self) -> int:
        """Bytes that can be read without any wait."""
        return self._open_link().waiting()

    def read(self, size: int = 1) -> bytes:
        """Up to `size` bytes, less at the time-out."""
        return self._open_link().receive(size, self._timeout)

    def read_until(self, expected: bytes = LF, size: int | None = None) -> bytes:
        """As pyserial's; ends of one byte are found without a call for every byte."""
        if len(expected) != 1:
            return bytes(super().read_until(expected, size))
        return self._open_link().receive(size or 1 << 30, self._timeout, expected)

    def write(self, data: bytes) -> int:
        """Send all of `data`."""
        payload = bytes(to_bytes(data))
        self._open_link().send(payload)
        return len(payload)

    def flush(self) -> None:
        """Nothing waits: `write` returns when the last bit is through."""

    def reset_input_buffer(self) -> None:
        """Forget what has arrived."""
        self._open_link().discard()

    def reset_output_buffer(self) -> None:
        """Nothing waits."""

    def _open_link(self) -> wire.SerialLink:
        if self._link is None:
            raise PortNotOpenError
        return self._link

    def _reconfigure_port(self) -> None:
        """There is nothing to set: the cable's baud rate is the board's."""

    def _update_dtr_state(self) -> None:
        """The reset that DTR causes is the cable's business, on opening."""

    def _update_rts_state(self) -> None:
        """Not wired."""
