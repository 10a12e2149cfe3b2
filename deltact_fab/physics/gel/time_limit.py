"""A limit of CPU time on what is solved inside it; the solvers' loops check it.

It is the time of the thread that solves: what other programs take does not count, nor do the
threads that the linear solver starts, which spin while they wait and so cost a third more for the
same answer.
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
    """`check` raises after this many seconds, or where an enclosing limit ends."""
    token = _END_S.set(min(_END_S.get(), time.thread_time() + seconds))
    try:
        yield
    finally:
        _END_S.reset(token)


def remaining_s() -> float:
    """Of the limit that this runs in; infinite where there is none."""
    return _END_S.get() - time.thread_time()


def check(needed_s: float = 0.0) -> None:
    """Raises TimeLimit where less is left: what would not end in time is not begun."""
    if remaining_s() < needed_s:
        raise TimeLimit("the limit of time was reached")
