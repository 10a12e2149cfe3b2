"""Signals that end a run: the first in good order, the second at once."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from types import FrameType

from ...errors import INTERRUPTED

SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
_LAST_WORDS = (
    b"deltact-fab: stopped at once by a second signal: the controller was reset and its position "
    b"is lost; the tip may be in the gel\n"
)
_SHOW_CURSOR = b"\x1b[?25h\n"  # a progress bar hides it


@contextmanager
def interruptible(abort: Callable[[], None]) -> Iterator[None]:
    """Ctrl-C, SIGTERM and SIGHUP raise KeyboardInterrupt; the second calls `abort` and exits.

    abort: called in the signal handler, amid whatever goes on; it may write to the stage and no
    more. After it the process ends with one line and exit code 130, and nothing is cleaned up: what
    must not be lost has to be on the disk already. What the parent told us to ignore stays ignored
    (nohup). Only the main thread may handle signals; in another nothing is changed.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    first = True

    def interrupt(number: int, frame: FrameType | None) -> None:
        nonlocal first
        if first:
            first = False
            raise KeyboardInterrupt
        abort()
        with suppress(OSError):
            os.write(2, (_SHOW_CURSOR if os.isatty(2) else b"") + _LAST_WORDS)
        os._exit(INTERRUPTED)

    heeded = [n for n in SIGNALS if signal.getsignal(n) is not signal.SIG_IGN]
    before = {n: signal.signal(n, interrupt) for n in heeded}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
