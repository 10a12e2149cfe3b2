"""CPU time limit for everything solved inside it, checked by the solvers' loops.

It counts the solving thread only: not other programs, nor the threads of the linear solver, which
spin while they wait and so cost a third more for the same answer.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar

from deltact_fab.common import TimeLimit

_END_S: ContextVar[float] = ContextVar("end_s", default=math.inf)


@contextmanager
def within(seconds: float) -> Iterator[None]:
    """Limit CPU time: `check` raises after so many seconds, or at the end of an outer limit."""
    token = _END_S.set(min(_END_S.get(), time.thread_time() + seconds))
    try:
        yield
    finally:
        _END_S.reset(token)


def remaining_s() -> float:
    """Remaining CPU time of the enclosing limit; infinite without one."""
    return _END_S.get() - time.thread_time()


def check(needed_s: float = 0.0) -> None:
    """Raise TimeLimit where less than needed_s remains."""
    if remaining_s() < needed_s:
        raise TimeLimit("CPU time limit reached")
