"""A thread that steps one stream over and over, and does what it is asked in between."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable
from concurrent.futures import CancelledError, Future

from ...errors import SensorError


class Loop:
    """The only thread that touches its device, so that no driver needs a lock.

    failed: called from it with the reason when a step fails; it rests then, until it is asked to go
    on.
    """

    def __init__(
        self,
        name: str,
        step: Callable[[], None],
        failed: Callable[[BaseException], None],
    ) -> None:
        self.name = name
        self._step = step
        self._failed = failed
        self._changed = threading.Condition()
        self._asked: deque[tuple[Callable[[], None], Future[None]]] = deque()
        self._going = self._ending = False
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._thread.start()

    def ask(self, what: Callable[[], None], limit_s: float, going: bool | None = None) -> None:
        """Have it done between two steps; going: whether steps go on after that.

        Raises whatever it raises, and SensorError when it takes longer than limit_s.
        """
        done: Future[None] = Future()

        def both() -> None:
            what()
            if going is not None:
                self._going = going

        with self._changed:
            if self._ending:
                raise SensorError(f"{self.name}: it has ended")
            self._asked.append((both, done))
            self._changed.notify_all()
        try:
            done.result(limit_s)
        except (TimeoutError, CancelledError) as why:
            done.cancel()
            raise SensorError(f"{self.name}: no answer within {limit_s:g} s") from why

    def end(self, limit_s: float) -> bool:
        """End it after the step under way; False when that takes longer than limit_s."""
        with self._changed:
            self._ending = True
            self._changed.notify_all()
        self._thread.join(limit_s)
        return not self._thread.is_alive()

    def _run(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._asked or self._going or self._ending)
                if self._ending:
                    break
                asked = self._asked.popleft() if self._asked else None
            if asked is not None:
                _answer(*asked)
                continue
            try:
                self._step()
            except BaseException as why:
                self._going = False
                self._failed(why)

        while self._asked:
            self._asked.popleft()[1].cancel()


def _answer(what: Callable[[], None], done: Future[None]) -> None:
    if not done.set_running_or_notify_cancel():
        return
    try:
        what()
        done.set_result(None)
    except BaseException as why:
        done.set_exception(why)
