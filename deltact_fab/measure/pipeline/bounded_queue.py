"""A bounded row of things from one thread to the next."""

from __future__ import annotations

from collections import deque
from threading import Condition
from time import monotonic
from typing import Generic, TypeVar

T = TypeVar("T")


class Closed(Exception):
    """Nothing more can be put on, or nothing more will come."""


class Belt(Generic[T]):
    """First in, first out. size: what it holds, None for any number. fell: how many fell off."""

    def __init__(self, size: int | None = None) -> None:
        self._size, self._items, self._open = size, deque[T](), True
        self.fell = 0
        self._changed = Condition()

    def put(self, item: T, instead: bool = False) -> None:
        """Put one on, when there is room; instead: at once, and what waits longest falls off.

        Raises Closed.
        """
        with self._changed:
            while self._open and not instead and len(self._items) == self._size:
                self._changed.wait()
            if not self._open:
                raise Closed
            if len(self._items) == self._size:
                self._items.popleft()
                self.fell += 1
            self._items.append(item)
            self._changed.notify_all()

    def get(self, timeout_s: float | None = None) -> T:
        """The next one. Raises Closed when none will come, TimeoutError when none came in time."""
        until_s = None if timeout_s is None else monotonic() + timeout_s
        with self._changed:
            while not self._items:
                if not self._open:
                    raise Closed
                left_s = None if until_s is None else until_s - monotonic()
                if left_s is not None and left_s <= 0:
                    raise TimeoutError
                self._changed.wait(left_s)
            item = self._items.popleft()
            self._changed.notify_all()
            return item

    def close(self) -> None:
        """Nothing more is put on; what is on it can still be taken."""
        with self._changed:
            self._open = False
            self._changed.notify_all()
