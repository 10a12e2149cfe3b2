"""Threads and signals of a run: one stream stepped over and over by a thread that does what it is
asked in between; the guard armed by one where there is no run; the signals that end a run, the
first in good order, the second at once."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import CancelledError, Future
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from queue import Empty, SimpleQueue
from types import FrameType

from deltact_fab.common import DeltactFabError, SensorError, Stopped

from ..interface import Clock, ForceSensor, Guard, Stage
from .streams import ForceStream

STOP_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
_LAST_WORDS = (
    b"deltact-fab: stopped at once by a second signal: the controller was reset and its position "
    b"is lost; the tip may be in the gel\n"
)
_SHOW_CURSOR = b"\x1b[?25h\n"  # a progress bar hides it
SENSOR_LOOP_NAME = "force sensor"
LOOP_ANSWER_S = 10.0
LOOP_END_S = 5.0


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
        os._exit(Stopped.exit_code)

    heeded = [n for n in STOP_SIGNALS if signal.getsignal(n) is not signal.SIG_IGN]
    previous = {n: signal.signal(n, interrupt) for n in heeded}
    try:
        yield
    finally:
        for number, handler in previous.items():
            signal.signal(number, handler)


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
        self._requests: SimpleQueue[tuple[Callable[[], None], Future[None]]] = SimpleQueue()
        self._stepping = self._ending = False
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._thread.start()

    def ask(self, action: Callable[[], None], limit_s: float, going: bool | None = None) -> None:
        """Have it done between two steps; going: whether steps go on after that.

        Raises whatever it raises, and SensorError when it takes longer than limit_s.
        """
        future: Future[None] = Future()

        def perform() -> None:
            action()
            if going is not None:
                self._stepping = going

        if self._ending:
            raise SensorError(f"{self.name}: it has ended")
        self._requests.put((perform, future))
        try:
            future.result(limit_s)
        except (TimeoutError, CancelledError) as error:
            future.cancel()
            raise SensorError(f"{self.name}: no answer within {limit_s:g} s") from error

    def end(self, limit_s: float) -> bool:
        """End it after the step under way; False when that takes longer than limit_s."""
        self._ending = True
        self._requests.put((lambda: None, Future()))  # wakes one that rests
        self._thread.join(limit_s)
        return not self._thread.is_alive()

    def _run(self) -> None:
        while not self._ending:
            try:
                action, future = self._requests.get(block=not self._stepping)
            except Empty:
                try:
                    self._step()
                except BaseException as error:
                    self._stepping = False
                    self._failed(error)
                continue
            if self._ending or not future.set_running_or_notify_cancel():
                future.cancel()
                continue
            try:
                action()
                future.set_result(None)
            except BaseException as error:
                future.set_exception(error)


@dataclass(frozen=True)
class Watch:
    """What is felt meanwhile. stream: None where nothing watches. trouble: why it was stopped."""

    stream: ForceStream | None = None
    errors: list[BaseException] = field(default_factory=list)


@contextmanager
def watch_force(
    stage: Stage, clock: Clock, force: ForceSensor | None, guard: Guard | None
) -> Iterator[Watch]:
    """The guard sees every sample until the block ends, as in a run; nothing is kept of them.

    The sensor is the thread's for so long, and stopped after that. Without a sensor or a guard
    nothing watches. Raises SensorError, the stage stopped, beyond a limit or for a lost sensor.
    """
    if force is None or guard is None:
        yield Watch()
        return
    stream = ForceStream(force, guard, lambda name, text: None)
    stream.keeping = False
    watch = Watch(stream)
    errors = watch.errors

    def failed(error: BaseException) -> None:
        stage.cancel()
        errors.append(error)

    loop = Loop(SENSOR_LOOP_NAME, stream.step, failed)
    try:
        loop.ask(force.start, LOOP_ANSWER_S, going=True)
        try:
            yield watch
        except DeltactFabError as stopped_by:
            if errors:  # what stopped it, rather than what that came to
                raise errors[0] from stopped_by
            raise
        if errors:
            raise errors[0]
    finally:
        with suppress(DeltactFabError):
            loop.ask(force.stop, LOOP_ANSWER_S, going=False)
        loop.end(LOOP_END_S)
