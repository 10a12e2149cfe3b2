"""Jobs given to an executor, and what came of them."""

from __future__ import annotations

import queue
from collections.abc import Callable, Sequence
from concurrent.futures import CancelledError, Executor, Future
from typing import TypeVar

from ..aliases import Progress
from ..errors import RunFailed
from .local import Local, processors

_QUEUE_POLL_S = 1.0  # where a blocked wait does not let Ctrl-C in

J = TypeVar("J")
R = TypeVar("R")


class CannotGoOn(RunFailed):
    """Not a job failed but what they run on: no other job of it will come through."""


JobCallback = Callable[[int, R | None, Exception | None], None]
"""Takes the index of a job that ended, and its value or its error."""


def count_workers(executor: Executor | None = None) -> int:
    """Count the jobs that an executor runs at a time; None: processes of this machine."""
    return processors() if executor is None else int(getattr(executor, "workers", 1))


def run_each(
    work: Callable[[J], R],
    jobs: Sequence[J],
    names: Sequence[str],
    executor: Executor | None = None,
    progress: Progress | None = None,
    *,
    on_result: Callable[[int, R], None] = lambda index, result: None,
    workers: int | None = None,
) -> list[R]:
    """Run jobs and return their results in order; arguments as of `run_jobs`.

    names: of the jobs, for progress, which hears of each when it is done; arrived hears of each
    result as it comes. The error of the first job that fails, in the order of the jobs however they
    were scheduled, is raised once all before it have ended; those behind it are cancelled.
    """
    results: dict[int, R] = {}
    failed: dict[int, Exception] = {}

    def collect(index: int, value: R | None, error: Exception | None) -> None:
        if error is not None:
            failed[index] = error
        elif not failed:
            results[index] = value  # type: ignore[assignment]
            on_result(index, results[index])
            if progress is not None:
                progress(len(results), len(jobs), names[index])

    run_jobs(work, jobs, collect, executor, workers=workers, until_failure=True)
    if failed:
        raise failed[min(failed)]
    return [results[index] for index in range(len(jobs))]


def run_jobs(
    work: Callable[[J], R],
    jobs: Sequence[J],
    on_end: JobCallback[R],
    executor: Executor | None = None,
    *,
    workers: int | None = None,
    until_failure: bool = False,
) -> None:
    """Run jobs; `heard` takes what came of each in this thread, as they end.

    work: a function of a module, jobs: its arguments; both are pickled. executor: None is processes
    of this machine, `workers` of them, by default a processor each; with one of either the jobs run
    in this process. until_failure: after a failure only what comes before it. On every way out the
    jobs that were not begun are cancelled, and no process of its own is left. Raises CannotGoOn
    when the executor is gone, or is none that these jobs may run on.
    """
    if executor is not None:
        _run_on(executor, work, jobs, on_end, until_failure)
        return
    several = min(workers or processors(), len(jobs))
    if several > 1:
        with Local(several) as local:
            _run_on(local, work, jobs, on_end, until_failure)
        return
    for index, job in enumerate(jobs):
        value, error = None, None
        try:
            value = work(job)
        except Exception as exc:
            error = exc
        on_end(index, value, error)
        if until_failure and error is not None:
            return


def _run_on(
    executor: Executor,
    work: Callable[[J], R],
    jobs: Sequence[J],
    on_end: JobCallback[R],
    until_failure: bool,
) -> None:
    # What has ended goes through one queue: it is heard in its order and in this thread.
    ended_futures: queue.SimpleQueue[Future[R]] = queue.SimpleQueue()
    futures: dict[Future[R], int] = {}
    # Dask blames a worker's death on every job that waited there: each is tried once more alone.
    blamed: list[int] = []
    tried_alone: set[int] = set()
    first_failed = len(jobs)
    check: Callable[[], None] = getattr(executor, "check", lambda: None)

    def submit(index: int) -> Future[R]:
        future = executor.submit(work, jobs[index])
        futures[future] = index
        return future

    try:
        for future in [submit(index) for index in range(len(jobs))]:
            future.add_done_callback(ended_futures.put)
        while futures or blamed:
            if not futures:
                alone = blamed.pop(0)
                if alone < first_failed:
                    submit(alone).add_done_callback(ended_futures.put)
                continue
            check()
            try:
                future = ended_futures.get(timeout=_QUEUE_POLL_S)
            except queue.Empty:
                continue
            # Let go of, so that no more results are held than the caller holds.
            index = futures.pop(future)
            if index > first_failed:
                continue
            if index not in tried_alone and _was_killed(future):
                tried_alone.add(index)
                blamed.append(index)
                continue
            ended = _outcome(future)
            if until_failure and ended[1] is not None:
                first_failed = index
                for pending, place in futures.items():
                    if place > index:
                        pending.cancel()
            on_end(index, *ended)
    finally:
        for future in futures:
            future.cancel()


def _was_killed(future: Future[R]) -> bool:
    return not future.cancelled() and type(future.exception()).__name__ == "KilledWorker"


def _outcome(future: Future[R]) -> tuple[R | None, Exception | None]:
    try:
        return future.result(), None
    except CancelledError as error:  # not by us, who ask no more then
        raise CannotGoOn("what the jobs ran on is gone") from error
    except CannotGoOn:
        raise
    except Exception as error:
        killed = RunFailed(
            "every worker that tried it died (out of memory, or killed); the cluster gave it up"
        )
        return None, killed if _was_killed(future) else error
