"""A program whose standard output is read, in a process group of its own."""

from __future__ import annotations

import os
import select
import signal
import subprocess
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

from deltact_fab.common import InputError, SensorError

# By hand: a long tail costs memory, a long wait delays `close`.
STDERR_TAIL_BYTES = 4096  # kept for the error message
TERMINATE_S = 2.0  # from SIGTERM to SIGKILL


class ChildProgram:
    """A running command. owner: begins its messages. key: of the rig file, with the command."""

    def __init__(self, owner: str, key: str, command: Sequence[str], folder: Path) -> None:
        """folder: working directory. Raises InputError for a program that cannot be started."""
        self._owner = owner
        self._stderr_tail = b""
        try:
            # A group of its own: Ctrl-C is the run's to answer, not the program's.
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
            raise InputError(f"{key}: {command[0]}: cannot be started: {error.strerror}") from error
        assert self._child.stdout is not None
        assert self._child.stderr is not None
        self._out, self._err = self._child.stdout, self._child.stderr
        self._poll = select.poll()
        self._poll.register(self._out, select.POLLIN)
        self._poll.register(self._err, select.POLLIN)

    def receive(self, buffer: memoryview, timeout_s: float) -> int:
        """Read output into a buffer, and keep messages meanwhile; return the number of bytes.

        0 if none come in time. Raises SensorError at its end.
        """
        ready = [fd for fd, _ in self._poll.poll(timeout_s * 1e3)]
        if self._err.fileno() in ready:
            text = self._err.read(STDERR_TAIL_BYTES)
            if not text:
                self._poll.unregister(self._err)
            self._stderr_tail = (self._stderr_tail + (text or b""))[-STDERR_TAIL_BYTES:]
        if self._out.fileno() not in ready:
            return 0
        if not (n := os.readv(self._out.fileno(), [buffer])):
            raise self._end_error()
        return n

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

    def _end_error(self) -> SensorError:
        """Error for the end of the output."""
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
        return SensorError(f"{self._owner}: the command {ending}{last}")

    def _exit_status(self, timeout_s: float) -> int | None:
        """Return the exit status of the child, -n for signal n; None while it runs."""
        with suppress(subprocess.TimeoutExpired):
            return self._child.wait(timeout_s)
        return None

    def _signal(self, number: int) -> None:
        with suppress(ProcessLookupError, PermissionError):
            os.killpg(self._child.pid, number)
