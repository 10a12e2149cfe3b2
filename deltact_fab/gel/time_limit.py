"""A limit of wall time on what is solved inside it; the solvers' loops check it."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar

from ..errors import TimeLimit

_END_S: ContextVar[float] = ContextVar("end_s", default=math.inf)


@contextmanager
def within(seconds: float) -> Iterator[None]:
    """`check` raises after this many seconds, or where an enclosing limit ends."""
    token = _END_S.set(min(_END_S.get(), time.perf_counter() + seconds))
    try:
        yield
    finally:
        _END_S.reset(token)


def check() -> None:
    """Raises TimeLimit past the end of the limit that this runs in, if any."""
    if time.perf_counter() > _END_S.get():
        raise TimeLimit("the limit of time was reached")
