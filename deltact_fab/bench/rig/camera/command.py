"""Images from a program's standard output, as of the camera port of a Jetson."""

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

HEADER = struct.Struct("<qII")  # monotonic nanoseconds, number, nothing
PIPE_BYTES = 1 << 20
"""As much as Linux lets a process have: the fewer reads an image."""
LAST_WORDS_BYTES = 4096
END_S = 2.0
"""A program that is told to end and does not within this is killed."""


class CommandFeed:
    """Implements Feed: a child process in a group of its own, and its images read whole."""

    check = "the command and its camera"

    def __init__(
        self,
        command: Sequence[str],
        size_px: tuple[int, int],
        clock: Clock,
        folder: Path,
        stamped: bool = False,
    ) -> None:
        """folder: in which it runs. Raises InputError for a program that cannot be started."""
        self.name = command[0]
        self.stamps = "sender" if stamped else "arrival"
        self._command = list(command)
        self._clock = clock
        self._shape = (size_px[1], size_px[0], 3)
        self._before = HEADER.size if stamped else 0
        self._said = b""
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
        except OSError as why:
            raise InputError(
                f"camera.command: {command[0]}: cannot be started: {why.strerror}"
            ) from why
        assert self._child.stdout is not None
        assert self._child.stderr is not None
        self._out, self._err = self._child.stdout, self._child.stderr
        _widen(self._out.fileno())
        self._poll = select.poll()
        self._poll.register(self._out, select.POLLIN)
        self._poll.register(self._err, select.POLLIN)
        self._start()

    def next(self, timeout_s: float) -> FeedImage | None:
        """As Feed; what has come of an image is kept for the next call."""
        until_s = time.monotonic() + timeout_s
        while self._left:
            left_s = until_s - time.monotonic()
            if left_s <= 0:
                return None
            self._more(left_s)
        t_s, number = self._clock.now_s(), None
        if self._before:
            t_ns, number, _ = HEADER.unpack_from(self._bytes.data)
            t_s = t_ns / 1e9
        image = self._bytes[self._before :].reshape(self._shape)
        self._start()
        return FeedImage(image, t_s, number)

    def identity(self) -> dict[str, Any]:
        return {"kind": "command", "command": self._command}

    def close(self) -> None:
        """End the child and all that it started; again does nothing."""
        if self._out.closed:
            return
        if self._child.poll() is None:
            self._signal(signal.SIGTERM)
            self._status(END_S)
        self._signal(signal.SIGKILL)  # what it started may outlive it
        self._child.wait()
        self._out.close()
        self._err.close()

    def _start(self) -> None:
        """Room for the next image, which is its own: nobody else writes to it later."""
        self._bytes = np.empty(self._before + int(np.prod(self._shape)), np.uint8)
        self._left = self._bytes.data

    def _more(self, timeout_s: float) -> None:
        """Read what has come. Raises SensorError at the end."""
        for fd, _ in self._poll.poll(timeout_s * 1e3):
            if fd == self._err.fileno():
                said = self._err.read(LAST_WORDS_BYTES)
                if not said:
                    self._poll.unregister(fd)
                self._said = (self._said + (said or b""))[-LAST_WORDS_BYTES:]
                continue
            n = os.readv(fd, [self._left])
            if n == 0:
                raise SensorError(self._end())
            self._left = self._left[n:]

    def _end(self) -> str:
        """Why there are no more images."""
        status = self._status(END_S)
        if status is None:
            how = "closed its output"
        else:
            how = f"ended by signal {-status}" if status < 0 else f"ended with status {status}"
        os.set_blocking(self._err.fileno(), False)
        self._said += self._err.read() or b""
        lines = self._said.decode(errors="replace").split("\n")
        said = [line.strip() for line in lines if line.strip()]
        last = f"; its last words: {said[-1]}" if said else "; it said nothing on stderr"
        return f"camera {self.name}: the command {how}{last}"

    def _status(self, timeout_s: float) -> int | None:
        """How the child ended, -n by signal n; None while it runs."""
        with suppress(subprocess.TimeoutExpired):
            return self._child.wait(timeout_s)
        return None

    def _signal(self, number: int) -> None:
        with suppress(ProcessLookupError, PermissionError):
            os.killpg(self._child.pid, number)


def _widen(fd: int) -> None:
    """Ask for a larger pipe; a smaller one serves too."""
    with suppress(OSError, AttributeError):  # Linux alone can
        fcntl.fcntl(fd, fcntl.F_SETPIPE_SZ, PIPE_BYTES)
