"""What a job says while it runs, heard by whoever waits for it, wherever it runs."""

from __future__ import annotations

import contextlib
import sys
import threading
import uuid
from collections.abc import Callable, Iterator
from contextvars import ContextVar
from typing import Any

Word = tuple[str, int, Any]
"""Of whom it is, the job's index, and what is said: plain data."""

TOPIC = "deltact-fab"

_job: ContextVar[tuple[str, int] | None] = ContextVar("job", default=None)
_heard: dict[str, Callable[[int, Any], None]] = {}
_outlet: Callable[[Word], None] | None = None
_one_at_a_time = threading.Lock()


def tell(word: Any) -> None:
    """From inside a job: say how far it is, as plain data; heard by no one, it costs nothing."""
    job = _job.get()
    if job is None:
        return
    if job[0] in _heard:
        hear((*job, word))
    elif _outlet is not None:
        with _one_at_a_time, contextlib.suppress(OSError):  # the other end is gone
            _outlet((*job, word))
    elif "distributed" in sys.modules:
        from distributed import get_worker

        with contextlib.suppress(ValueError):  # no worker: nobody listens
            get_worker().log_event(TOPIC, [*job, word])


def hear(word: Word) -> None:
    """Hand on what was said; who no longer listens misses it."""
    whose, index, said = word
    if (listener := _heard.get(whose)) is not None:
        listener(index, said)


def speak_through(outlet: Callable[[Word], None]) -> None:
    """In a worker process: the way to the process that waits."""
    global _outlet
    _outlet = outlet


@contextlib.contextmanager
def listening(told: Callable[[int, Any], None] | None) -> Iterator[str]:
    """What jobs under the yielded name say goes to told, on any thread."""
    name = uuid.uuid4().hex
    if told is not None:
        _heard[name] = told
    try:
        yield name
    finally:
        _heard.pop(name, None)


@contextlib.contextmanager
def speaking(name: str, index: int) -> Iterator[None]:
    """What is said inside is said by a job."""
    before = _job.set((name, index))
    try:
        yield
    finally:
        _job.reset(before)
