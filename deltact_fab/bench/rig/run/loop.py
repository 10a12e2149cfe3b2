"""Threads and signals of a run: a thread that steps one stream and runs requests in between; such a
thread as force guard outside of a run; and signals, of which the first ends a run in good order and
the second at once."""

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

from ..interface import ForceSensor, Guard, Stage
from .streams import ForceStream

STOP_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
PAUSE_SIGNALS = (signal.SIGTSTP, signal.SIGUSR1)  # the first of Ctrl-Z
_LAST_WORDS = (
    b"deltact-fab: stopped immediately by a second signal: the controller was reset, its position "
    b"is lost, and the tip may be in the gel\n"
)
_SHOW_CURSOR = b"\x1b[?25h\n"  # a progress bar hides it
SENSOR_LOOP_NAME = "force sensor"
# By hand: longer limits report a hung thread later.
LOOP_ANSWER_S = 10.0  # long enough to reopen a camera or tare
LOOP_END_S = 5.0


@contextmanager
def interruptible(
    abort: Callable[[], None], pause: Callable[[], None] = lambda: None
) -> Iterator[None]:
    """Ctrl-C, SIGTERM and SIGHUP raise KeyboardInterrupt; the second calls `abort` and exits.

    Ctrl-Z and SIGUSR1 call `pause`, in the handler: they stop no process with its tip in the gel.

    abort: called in the signal handler; it may only write to the stage. Then the process ends with
    one line and exit code 130, without cleanup: data must be on the disk already. Signals ignored
    by the parent (nohup) stay ignored. Does nothing outside of the main thread, which alone may
    handle signals.
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
        write_from_handler(_SHOW_CURSOR, _LAST_WORDS)
        os._exit(Stopped.exit_code)

    heeded = [n for n in STOP_SIGNALS if signal.getsignal(n) is not signal.SIG_IGN]
    previous = {n: signal.signal(n, interrupt) for n in heeded}
    previous |= {n: signal.signal(n, lambda *_: pause()) for n in PAUSE_SIGNALS}
    try:
        yield
    finally:
        for number, handler in previous.items():
            signal.signal(number, handler)


def write_from_handler(control: bytes, line: bytes) -> None:
    """Write a line to stderr at once, on a terminal after control bytes; never raise."""
    with suppress(OSError):
        os.write(2, (control if os.isatty(2) else b"") + line)


class Loop:
    """The only thread that uses its device, so that no driver needs a lock.

    failed: called by it with the error of a step; then it pauses until a request with `going`.
    """

    def __init__(
        self, name: str, step: Callable[[], None], failed: Callable[[BaseException], None]
    ) -> None:
        self.name = name
        self._step = step
        self._failed = failed
        self._requests: SimpleQueue[tuple[Callable[[], None], Future[None]]] = SimpleQueue()
        self._stepping = self._ending = False
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._thread.start()

    def ask(self, action: Callable[[], None], limit_s: float, going: bool | None = None) -> None:
        """Run an action between two steps; going: start or pause the steps afterwards.

        Raises the action's error, and SensorError when it takes longer than limit_s.
        """
        future: Future[None] = Future()

        def perform() -> None:
            action()
            if going is not None:
                self._stepping = going

        if self._ending:
            raise SensorError(f"{self.name}: the thread has ended")
        self._requests.put((perform, future))
        try:
            future.result(limit_s)
        except (TimeoutError, CancelledError) as error:
            future.cancel()
            raise SensorError(f"{self.name}: no answer within {limit_s:g} s") from error

    def end(self, limit_s: float) -> bool:
        """End it after the present step; False when that takes longer than limit_s."""
        self._ending = True
        self._requests.put((lambda: None, Future()))  # wakes a paused thread
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
    """Force guard of a block. stream: None without a guard. errors: reasons of a stop."""

    stream: ForceStream | None = None
    errors: list[BaseException] = field(default_factory=list)


@contextmanager
def watch_force(stage: Stage, force: ForceSensor | None, guard: Guard | None) -> Iterator[Watch]:
    """Pass every sample to the guard until the block ends, as in a run, without recording.

    A thread uses the sensor meanwhile, and stops it at the end. Without a sensor or a guard the
    block is unguarded. Raises SensorError, the stage stopped, beyond a limit or for a lost sensor.
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
            if errors:  # the cause, rather than its consequence
                raise errors[0] from stopped_by
            raise
        if errors:
            raise errors[0]
    finally:
        with suppress(DeltactFabError):
            loop.ask(force.stop, LOOP_ANSWER_S, going=False)
        loop.end(LOOP_END_S)
