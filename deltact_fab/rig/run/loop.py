"""A thread that steps one stream over and over, and does what it is asked in between; the guard
armed by one where there is no run."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from concurrent.futures import CancelledError, Future
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from queue import Empty, SimpleQueue

from ...errors import DeltactFabError, SensorError
from ..interface import Clock, ForceSensor, Guard, Stage
from .streams import ForceStream


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
        self._asked: SimpleQueue[tuple[Callable[[], None], Future[None]]] = SimpleQueue()
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

        if self._ending:
            raise SensorError(f"{self.name}: it has ended")
        self._asked.put((both, done))
        try:
            done.result(limit_s)
        except (TimeoutError, CancelledError) as why:
            done.cancel()
            raise SensorError(f"{self.name}: no answer within {limit_s:g} s") from why

    def end(self, limit_s: float) -> bool:
        """End it after the step under way; False when that takes longer than limit_s."""
        self._ending = True
        self._asked.put((lambda: None, Future()))  # wakes one that rests
        self._thread.join(limit_s)
        return not self._thread.is_alive()

    def _run(self) -> None:
        while not self._ending:
            try:
                what, done = self._asked.get(block=not self._going)
            except Empty:
                try:
                    self._step()
                except BaseException as why:
                    self._going = False
                    self._failed(why)
                continue
            if self._ending or not done.set_running_or_notify_cancel():
                done.cancel()
                continue
            try:
                what()
                done.set_result(None)
            except BaseException as why:
                done.set_exception(why)


NAME = "force sensor"
ANSWER_S = 10.0
END_S = 5.0


@dataclass(frozen=True)
class Watch:
    """What is felt meanwhile. stream: None where nothing watches. trouble: why it was stopped."""

    stream: ForceStream | None = None
    trouble: list[BaseException] = field(default_factory=list)


@contextmanager
def watched(
    stage: Stage, clock: Clock, force: ForceSensor | None, guard: Guard | None
) -> Iterator[Watch]:
    """The guard sees every sample until the block ends, as in a run; nothing is kept of them.

    The sensor is the thread's for so long, and stopped after that. Without a sensor or a guard
    nothing watches. Raises SensorError, the stage stopped, beyond a limit or for a lost sensor.
    """
    if force is None or guard is None:
        yield Watch()
        return
    stream = ForceStream(force, guard, clock, lambda name, text: None)
    stream.keeping = False
    watch = Watch(stream)
    trouble = watch.trouble

    def failed(why: BaseException) -> None:
        stage.cancel()
        trouble.append(why)

    loop = Loop(NAME, stream.step, failed)
    try:
        loop.ask(force.start, ANSWER_S, going=True)
        try:
            yield watch
        except DeltactFabError as why:
            if trouble:  # what stopped it, rather than what that came to
                raise trouble[0] from why
            raise
        if trouble:
            raise trouble[0]
    finally:
        with suppress(DeltactFabError):
            loop.ask(force.stop, ANSWER_S, going=False)
        loop.end(END_S)
