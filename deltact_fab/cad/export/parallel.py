"""Tasks to processes: the same answers in the same order, however they were scheduled."""

from __future__ import annotations

import contextlib
import os
import signal
import sys
import threading
import types
from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING, Any, TypeVar

from ...errors import RunFailed

if TYPE_CHECKING:
    from concurrent.futures import Future, ProcessPoolExecutor

T = TypeVar("T")
R = TypeVar("R")


def processors() -> int:
    """Processors that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def run(
    function: Callable[[T], R],
    tasks: Sequence[T],
    jobs: int,
    done: Callable[[int, R], None],
) -> None:
    """Call function on every task and `done(index, answer)` here, as the answers come.

    With jobs > 1 in that many fresh processes, which import what they need; function, tasks and
    answers are pickled. The error of the first task that fails, in the order of the tasks, is
    raised. When a process dies, RunFailed; on every way out none is left behind. What is defined
    in the caller's own script is not known to them.
    """
    if jobs <= 1 or len(tasks) <= 1:
        for index, task in enumerate(tasks):
            done(index, function(task))
        return
    # Not at the top: an export that comes from the cache needs none of it.
    import multiprocessing
    from concurrent.futures import ProcessPoolExecutor
    from concurrent.futures.process import BrokenProcessPool

    context = multiprocessing.get_context("spawn")
    pool = ProcessPoolExecutor(min(jobs, len(tasks)), context, _leave_signals_to_parent)
    try:
        with _interrupts_held(), _main_hidden():
            waiting = {pool.submit(function, task): index for index, task in enumerate(tasks)}
        _collect(waiting, done)
    except BrokenProcessPool as why:
        raise RunFailed(
            "a worker process died (out of memory, or killed): fewer jobs need less memory"
        ) from why
    finally:
        _end(pool)


def _collect(waiting: dict[Future[R], int], done: Callable[[int, R], None]) -> None:
    """Answers as they come; after a failure only of the tasks before it, which may fail too."""
    from concurrent.futures import as_completed
    from concurrent.futures.process import BrokenProcessPool

    failed: dict[int, Exception] = {}
    for future in as_completed(waiting):
        index = waiting[future]
        if future.cancelled() or any(index > other for other in failed):
            continue
        try:
            answer = future.result()
        except BrokenProcessPool:
            raise
        except Exception as why:
            failed[index] = why
            for other, place in waiting.items():
                if place > index:
                    other.cancel()
            continue
        if not failed:
            done(index, answer)
    if failed:
        raise failed[min(failed)]


def _end(pool: ProcessPoolExecutor) -> None:
    """End the workers at once: an idle one has nothing to lose, a busy one nothing to give."""
    # After an orderly end the pool has forgotten its processes.
    workers: dict[int, Any] = dict(getattr(pool, "_processes", None) or {})
    for worker in workers.values():
        worker.terminate()
    pool.shutdown(wait=True, cancel_futures=True)
    for worker in workers.values():
        worker.join(5)
        if worker.is_alive():
            worker.kill()
            worker.join()


def _leave_signals_to_parent() -> None:
    """In a worker: Ctrl-C is the parent's to answer, and no worker outlives it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    import multiprocessing

    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


@contextlib.contextmanager
def _interrupts_held() -> Iterator[None]:
    """Ctrl-C waits, and never reaches the processes started inside: they inherit that."""
    from multiprocessing import resource_tracker

    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    # Its start would let the signal through again.
    resource_tracker.ensure_running()
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextlib.contextmanager
def _main_hidden() -> Iterator[None]:
    """Processes started inside do not import the caller's script.

    They need nothing of it, and one without `if __name__ == "__main__":` would run again in each.
    """
    main = sys.modules["__main__"]
    sys.modules["__main__"] = types.ModuleType("__main__")
    try:
        yield
    finally:
        sys.modules["__main__"] = main
