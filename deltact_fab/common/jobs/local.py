"""Local process pool: workers share the cores, ignore Ctrl-C, end with the caller, do not import
its script, and a dying worker affects only its own job.
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

Result = TypeVar("Result")

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
"""Attempts at a job whose process dies; by hand: a third rarely helps when memory runs out."""
_share: int | None = None


def processors() -> int:
    """Number of processors that this process may use; in a worker, its share."""
    if _share is not None:
        return _share
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


class Local(ThreadPoolExecutor):
    """Executor with one thread per worker process; each runs one job after the other.

    Leaving the `with` block ends all processes. Each process has its own pool, because a shared
    pool breaks as a whole when one process dies. Processes start with their first job and import
    what it needs; names of the caller's own script are not available.
    """

    def __init__(self, workers: int, threads: int | None = None) -> None:
        """threads: per process, by default its share of the processors."""
        from multiprocessing import resource_tracker

        super().__init__(workers, "deltact-fab-job", _block_interrupts)
        self.workers = workers
        self.threads = threads or max(1, processors() // workers)
        self._per_thread = threading.local()
        self._pools: list[ProcessPoolExecutor] = []
        self._starting = threading.Lock()
        self._closed = False
        # Start it first: its start would unblock the signals that the threads block.
        resource_tracker.ensure_running()

    def submit(self, fn: Callable[..., Result], /, *args: Any, **kwargs: Any) -> Future[Result]:
        """Like Executor.submit; a job whose process dies is retried, JOB_ATTEMPTS in all."""
        return super().submit(self._run_in_process, fn, *args, **kwargs)

    def _run_in_process(self, fn: Callable[..., Result], *args: Any, **kwargs: Any) -> Result:
        from concurrent.futures.process import BrokenProcessPool

        # Unpickled within the job, so unpicklable arguments fail like any other job.
        packed = pickle.dumps((fn, args, kwargs))
        for _ in range(JOB_ATTEMPTS):
            try:
                answer: Result = self._process(packed).result()
                return answer
            except BrokenProcessPool:
                if self._closed:
                    raise CancelledError from None
        raise RunFailed("worker process died twice (out of memory, or killed); run fewer jobs")

    def _process(self, packed: bytes) -> Future[Any]:
        """Submit a job to this thread's process, starting one if needed."""
        from concurrent.futures.process import BrokenProcessPool

        if (pool := getattr(self._per_thread, "pool", None)) is not None:
            # A process that died idle does not count as an attempt.
            with contextlib.suppress(BrokenProcessPool):
                return pool.submit(_work, packed)
        with self._starting:
            if self._closed:
                raise CancelledError
            self._per_thread.pool, future = _start_process(packed, self.threads)
            self._pools.append(self._per_thread.pool)
        return future

    def __exit__(self, *_: object) -> None:
        # Terminate at once: results of running jobs are not needed.
        with self._starting:
            self._closed = True
        self.shutdown(wait=False, cancel_futures=True)
        for pool in self._pools:
            _terminate(pool)
        self.shutdown(wait=True)


def _start_process(packed: bytes, threads: int) -> tuple[ProcessPoolExecutor, Future[Any]]:
    """Create a pool of one process with its first job, which starts it."""
    import multiprocessing
    from concurrent.futures import ProcessPoolExecutor

    pool = ProcessPoolExecutor(1, multiprocessing.get_context("spawn"), _init_worker, (threads,))
    with _hide_main():
        return pool, pool.submit(_work, packed)


def _terminate(pool: ProcessPoolExecutor) -> None:
    # After an orderly shutdown the pool has no list of processes.
    workers: dict[int, Any] = dict(getattr(pool, "_processes", None) or {})
    for worker in workers.values():
        worker.terminate()
    pool.shutdown(wait=True, cancel_futures=True)
    for worker in workers.values():
        worker.join(5)
        if worker.is_alive():
            worker.kill()
            worker.join()


def _block_interrupts() -> None:
    """Block SIGINT in a thread; processes that it starts inherit this."""
    if hasattr(signal, "pthread_sigmask"):
        signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})


@contextlib.contextmanager
def _hide_main() -> Iterator[None]:
    """Keep processes started within from importing the caller's script.

    A script without `if __name__ == "__main__":` would run again in each.
    """
    main = sys.modules["__main__"]
    sys.modules["__main__"] = types.ModuleType("__main__")
    try:
        yield
    finally:
        sys.modules["__main__"] = main


# -- in the process --------------------------------------------------------------------------------


def _init_worker(threads: int) -> None:
    """Initialise a worker: ignore Ctrl-C, end with the parent, share the cores."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    set_processor_share(threads)
    # Before any library is loaded; values set by the user stay.
    for name in THREAD_VARIABLES:
        os.environ.setdefault(name, str(threads))
    threading.Thread(target=_end_with_parent, daemon=True).start()


def set_processor_share(threads: int) -> None:
    """Set the number of processors that this worker and its jobs may use."""
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
