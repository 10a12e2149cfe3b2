"""Processes of this machine that behave: they share the cores, leave Ctrl-C to the caller, end with
it, do not run its script again, and one that dies takes no other's job with it.
"""

from __future__ import annotations

import contextlib
import os
import pickle
import signal
import sys
import threading
import types
from collections.abc import Callable, Iterator
from concurrent.futures import CancelledError, Future, ThreadPoolExecutor
from typing import TYPE_CHECKING, Any, TypeVar

from ..errors import RunFailed

if TYPE_CHECKING:
    from concurrent.futures import ProcessPoolExecutor

R = TypeVar("R")

THREAD_VARIABLES = (
    "OMP_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "MKL_NUM_THREADS",
    "NUMEXPR_NUM_THREADS",
    "NUMBA_NUM_THREADS",
    "VECLIB_MAXIMUM_THREADS",
    "OPENCV_FOR_THREADS_NUM",
)
JOB_ATTEMPTS = 2
"""A job is begun at most so often, when its process dies under it."""
_share: int | None = None


def processors() -> int:
    """Processors that this process may use: in a worker its share of them."""
    if _share is not None:
        return _share
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


class Local(ThreadPoolExecutor):
    """A thread for each process, that gives it one job after the other.

    On every way out of a `with` block none is left behind. A pool of one process each, because a
    pool of several breaks as a whole when one of them dies. Processes start when there is a job for
    them and import what it needs. What is defined in the caller's own script is not known to them.
    """

    def __init__(self, workers: int, threads: int | None = None) -> None:
        """threads: of each process, by default its share of the processors."""
        from multiprocessing import resource_tracker

        super().__init__(workers, "deltact-fab-job", _hold_interrupts)
        self.workers = workers
        self.threads = threads or max(1, processors() // workers)
        self._per_thread = threading.local()
        self._pools: list[ProcessPoolExecutor] = []
        self._starting = threading.Lock()
        self._closed = False
        # Its start would let signals through to the threads that hold them.
        resource_tracker.ensure_running()

    def submit(self, fn: Callable[..., R], /, *args: Any, **kwargs: Any) -> Future[R]:
        """As every Executor's; a job whose process dies is begun again, TRIES times in all."""
        return super().submit(self._give, fn, *args, **kwargs)

    def _give(self, fn: Callable[..., R], *args: Any, **kwargs: Any) -> R:
        from concurrent.futures.process import BrokenProcessPool

        # Here, and unpacked by the job: what cannot be unpacked fails like any other job.
        packed = pickle.dumps((fn, args, kwargs))
        for _ in range(JOB_ATTEMPTS):
            try:
                answer: R = self._process(packed).result()
                return answer
            except BrokenProcessPool:
                if self._closed:
                    raise CancelledError from None
        raise RunFailed(
            "its process died twice (out of memory, or killed): fewer jobs at a time need less "
            "memory"
        )

    def _process(self, packed: bytes) -> Future[Any]:
        """A job given to this thread's process, which is started where there is none."""
        from concurrent.futures.process import BrokenProcessPool

        if (pool := getattr(self._per_thread, "pool", None)) is not None:
            # One that died while it had nothing to do has not tried.
            with contextlib.suppress(BrokenProcessPool):
                return pool.submit(_work, packed)
        with self._starting:
            if self._closed:
                raise CancelledError
            self._per_thread.pool, future = _start(packed, self.threads)
            self._pools.append(self._per_thread.pool)
        return future

    def __exit__(self, *_: object) -> None:
        # At once: an idle worker has nothing to lose, a busy one nothing to give.
        with self._starting:
            self._closed = True
        self.shutdown(wait=False, cancel_futures=True)
        for pool in self._pools:
            _end(pool)
        self.shutdown(wait=True)


def _start(packed: bytes, threads: int) -> tuple[ProcessPoolExecutor, Future[Any]]:
    """A process, with its first job: it starts when it has one."""
    import multiprocessing
    from concurrent.futures import ProcessPoolExecutor

    pool = ProcessPoolExecutor(1, multiprocessing.get_context("spawn"), _begin, (threads,))
    with _main_hidden():
        return pool, pool.submit(_work, packed)


def _end(pool: ProcessPoolExecutor) -> None:
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


def _hold_interrupts() -> None:
    """In a thread: Ctrl-C never reaches the processes that it starts, they inherit that."""
    if hasattr(signal, "pthread_sigmask"):
        signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})


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


# -- in the process --------------------------------------------------------------------------------


def _begin(threads: int) -> None:
    """Ctrl-C is the parent's to answer, no worker outlives it, and the cores are shared."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    take_share(threads)
    # Before any library is loaded; who has set one means it.
    for name in THREAD_VARIABLES:
        os.environ.setdefault(name, str(threads))
    threading.Thread(target=_end_with_parent, daemon=True).start()


def take_share(threads: int) -> None:
    """This process is one of several workers: what its jobs start shares that many processors."""
    global _share
    _share = threads


def _end_with_parent() -> None:
    import multiprocessing

    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def _work(packed: bytes) -> Any:
    function, args, kwargs = pickle.loads(packed)
    return function(*args, **kwargs)
