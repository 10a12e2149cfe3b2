"""A simulated controller on a pseudo terminal, on the wall clock: a port like any other.

Bytes take no time on it, unlike those of `wire`; a host sees no other difference. Its fault is that
of a cable, pulled out and put back; the board's own are the controller's.
"""

from __future__ import annotations

import math
import os
import select
import tempfile
import threading
import time
import tty
from collections.abc import Callable
from contextlib import AbstractContextManager, suppress
from pathlib import Path

from deltact_fab.bench import Clock

from .clock import NS_PER_S
from .controller import GrblController

# By hand: polls with nothing to do, and for a host that opens the port; shorter ones cost CPU.
IDLE_POLL_MS, CLOSED_POLL_MS = 20, 2
READ_BYTES = 4096


class PtyCable(AbstractContextManager["PtyCable"]):
    """The cable between a host and one controller, served by a thread of its own.

    Whoever else uses the controller holds `lock`.
    """

    def __init__(
        self,
        controller: GrblController,
        clock: Clock,
        *,
        resets_on_open: bool = False,
        on_receive: Callable[[float, bytes], None] | None = None,
        on_open: Callable[[bool], None] | None = None,
    ) -> None:
        """clock: the controller's. resets_on_open: opening the port restarts the controller, as an
        Arduino does. heard: gets every piece of what the host sent, with the time it came
        (monotonic s). opened: gets True when a host opens the port, False when it closes it.
        """
        self.controller = controller
        self._clock = clock
        self.lock = threading.RLock()
        self._resets_on_open = resets_on_open
        self._on_receive = on_receive or (lambda t_s, data: None)
        self._on_open = on_open or (lambda is_open: None)
        self._folder = tempfile.TemporaryDirectory(prefix="deltact-fab-")
        self.port = str(Path(self._folder.name) / "stage")
        """What a host opens; the same after the cable was out."""
        self._master_fd: int | None = None
        self._open = False
        self._unsent = b""  # that the terminal could not take yet
        self._stop = threading.Event()
        self.plug()
        self._thread = threading.Thread(target=self._serve, name="pseudo terminal", daemon=True)
        self._thread.start()

    def __exit__(self, *error: object) -> None:
        self.close()

    def plug(self) -> None:
        """Put the cable back; what was said meanwhile is lost."""
        with self.lock:
            if self._master_fd is not None:
                return
            master_fd, slave_fd = os.openpty()
            tty.setraw(slave_fd)
            os.set_blocking(master_fd, False)
            fresh = f"{self.port}.new"
            os.symlink(os.ttyname(slave_fd), fresh)
            os.replace(fresh, self.port)
            os.close(slave_fd)  # or nobody could tell whether a host has it open
            self._master_fd = master_fd

    def unplug(self) -> None:
        """Pull the cable: reads and writes of the host fail, the controller's motion goes on."""
        with self.lock:
            if self._master_fd is not None:
                os.close(self._master_fd)
                os.unlink(self.port)
            self._master_fd, self._unsent = None, b""
            self._set_open(False)

    def close(self) -> None:
        """End the thread and the terminal; again does nothing."""
        self._stop.set()
        self._thread.join()
        self.unplug()
        self._folder.cleanup()

    # ---- the thread ---------------------------------------------------------------------------

    def _serve(self) -> None:
        while not self._stop.is_set():
            with self.lock:
                event_ns, now_ns = self.controller.next_event_ns(), self._clock.now_ns()
                master_fd = self._master_fd
            wait_ms = IDLE_POLL_MS if self._open else CLOSED_POLL_MS
            if event_ns is not None:
                wait_ms = min(wait_ms, max(math.ceil((event_ns - now_ns) * 1000 / NS_PER_S), 0))
            if master_fd is None or not self._ready(master_fd, wait_ms):
                time.sleep(CLOSED_POLL_MS / 1000)
            with self.lock:
                if self._master_fd is not None and self._master_fd == master_fd:
                    self._exchange(master_fd)
                else:
                    self.controller.take_output()

    def _ready(self, master_fd: int, wait_ms: int) -> bool:
        """Wait for bytes, at most so long; False when no host has the port open."""
        poll = select.poll()
        poll.register(master_fd, select.POLLIN)
        try:
            events = dict(poll.poll(wait_ms)).get(master_fd, 0)
        except OSError:  # pulled meanwhile
            return False
        is_open = not events & (select.POLLHUP | select.POLLNVAL)
        with self.lock:
            if self._master_fd == master_fd:
                self._set_open(is_open)
        return is_open

    def _set_open(self, is_open: bool) -> None:
        if is_open == self._open:
            return
        self._open = is_open
        if is_open:
            if self._resets_on_open:
                self.controller.hard_reset()
            self.controller.take_output()  # nobody heard what it said before
            self._unsent = b""
        self._on_open(is_open)

    def _exchange(self, master_fd: int) -> None:
        """Pass bytes from the host to the controller and its output back."""
        data = b""
        with suppress(OSError):  # none has come, or the host is gone
            data = os.read(master_fd, READ_BYTES)
        if data:
            self._on_receive(time.monotonic(), data)
            self.controller.write(data)
        output = self.controller.read_available()
        if not self._open:
            return
        self._unsent += output
        with suppress(OSError):
            while self._unsent:
                self._unsent = self._unsent[os.write(master_fd, self._unsent) :]
