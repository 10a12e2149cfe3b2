"""Images from a program's standard output, as for the camera port of a Jetson."""

from __future__ import annotations

import fcntl
import os
import select
import signal
import struct
import subprocess
import time
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from deltact_fab.common import InputError, SensorError

from ..interface import Clock
from .stream import FeedImage

STAMP_HEADER = struct.Struct("<qII")  # monotonic nanoseconds, number, unused
# By hand: a small pipe costs reads per image, a long tail memory, a long wait delays `close`.
PIPE_BYTES = 1 << 20  # largest that Linux allows an ordinary process
STDERR_TAIL_BYTES = 4096  # kept for the error message
TERMINATE_S = 2.0  # from SIGTERM to SIGKILL


class CommandFeed:
    """Implements Feed: a child process in its own group, read image by image."""

    check = "the command and its camera"

    def __init__(
        self,
        command: Sequence[str],
        size_px: tuple[int, int],
        clock: Clock,
        folder: Path,
        stamped: bool = False,
    ) -> None:
        """folder: working directory. Raises InputError for a program that cannot be started."""
        self.name = command[0]
        self.stamps = "sender" if stamped else "arrival"
        self._command = list(command)
        self._clock = clock
        self._shape = (size_px[1], size_px[0], 3)
        self._header_bytes = STAMP_HEADER.size if stamped else 0
        self._stderr_tail = b""
        try:
            # A group of its own: Ctrl-C is the run's to answer, not the camera's.
            self._child = subprocess.Popen(
                command,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                bufsize=0,
                cwd=folder,
                start_new_session=True,
            )
        except OSError as error:
            raise InputError(
                f"camera.command: {command[0]}: cannot be started: {error.strerror}"
            ) from error
        assert self._child.stdout is not None
        assert self._child.stderr is not None
        self._out, self._err = self._child.stdout, self._child.stderr
        _enlarge_pipe(self._out.fileno())
        self._poll = select.poll()
        self._poll.register(self._out, select.POLLIN)
        self._poll.register(self._err, select.POLLIN)
        self._new_buffer()

    def next(self, timeout_s: float) -> FeedImage | None:
        """Return the next image, see Feed; a partial image is kept for the next call."""
        until_s = time.monotonic() + timeout_s
        while self._unfilled:
            left_s = until_s - time.monotonic()
            if left_s <= 0:
                return None
            self._read_output(left_s)
        t_s, number = self._clock.now_s(), None
        if self._header_bytes:
            t_ns, number, _ = STAMP_HEADER.unpack_from(self._bytes.data)
            t_s = t_ns / 1e9
        image = self._bytes[self._header_bytes :].reshape(self._shape)
        self._new_buffer()
        return FeedImage(image, t_s, number)

    def identity(self) -> dict[str, Any]:
        return {"kind": "command", "command": self._command}

    def close(self) -> None:
        """End the child and its children; idempotent."""
        if self._out.closed:
            return
        if self._child.poll() is None:
            self._signal(signal.SIGTERM)
            self._exit_status(TERMINATE_S)
        self._signal(signal.SIGKILL)  # what it started may outlive it
        self._child.wait()
        self._out.close()
        self._err.close()

    def _new_buffer(self) -> None:
        """Allocate the buffer of the next image; it is never reused."""
        self._bytes = np.empty(self._header_bytes + int(np.prod(self._shape)), np.uint8)
        self._unfilled = self._bytes.data

    def _read_output(self, timeout_s: float) -> None:
        """Read available output. Raises SensorError at its end."""
        for fd, _ in self._poll.poll(timeout_s * 1e3):
            if fd == self._err.fileno():
                text = self._err.read(STDERR_TAIL_BYTES)
                if not text:
                    self._poll.unregister(fd)
                self._stderr_tail = (self._stderr_tail + (text or b""))[-STDERR_TAIL_BYTES:]
                continue
            n = os.readv(fd, [self._unfilled])
            if n == 0:
                raise SensorError(self._end_reason())
            self._unfilled = self._unfilled[n:]

    def _end_reason(self) -> str:
        """Message for the end of the output."""
        status = self._exit_status(TERMINATE_S)
        if status is None:
            ending = "closed its output"
        else:
            ending = f"ended by signal {-status}" if status < 0 else f"ended with status {status}"
        os.set_blocking(self._err.fileno(), False)
        self._stderr_tail += self._err.read() or b""
        lines = self._stderr_tail.decode(errors="replace").split("\n")
        messages = [line.strip() for line in lines if line.strip()]
        last = f"; stderr: {messages[-1]}" if messages else "; no message on stderr"
        return f"camera {self.name}: the command {ending}{last}"

    def _exit_status(self, timeout_s: float) -> int | None:
        """Return the exit status of the child, -n for signal n; None while it runs."""
        with suppress(subprocess.TimeoutExpired):
            return self._child.wait(timeout_s)
        return None

    def _signal(self, number: int) -> None:
        with suppress(ProcessLookupError, PermissionError):
            os.killpg(self._child.pid, number)


def _enlarge_pipe(fd: int) -> None:
    """Enlarge the pipe if possible."""
    with suppress(OSError, AttributeError):  # Linux alone can
        fcntl.fcntl(fd, fcntl.F_SETPIPE_SZ, PIPE_BYTES)
