"""A thread that runs before others: what stops the stage waits for no encoder."""

from __future__ import annotations

import os
import threading
from contextlib import suppress

REALTIME = 10  # of 1 to 99: over every ordinary thread, under those of the system
NICE = -10


def run_first() -> str:
    """Put the calling thread first, as far as the system lets this user; "" where it does not.

    On Linux, with the right to (`ulimit -r`, `ulimit -e`, or root). Threads that it starts from
    then on, as a receiver in a library, come first as well.
    """
    if hasattr(os, "sched_setscheduler"):
        with suppress(OSError):
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(REALTIME))
            return "real time"
        with suppress(OSError):
            os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), NICE)
            return f"nice {NICE}"
    return ""
