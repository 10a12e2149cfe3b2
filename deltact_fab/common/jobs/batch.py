"""Running of jobs on an executor and collecting of their results."""

from __future__ import annotations

import queue
from collections.abc import Callable, Sequence
from concurrent.futures import CancelledError, Executor, Future
from typing import TypeVar

from ..aliases import Progress
from ..errors import RunFailed
from .local import Local, Result, processors

_QUEUE_POLL_S = 1.0  # by hand: latency of Ctrl-C, which a blocked wait ignores

Job = TypeVar("Job")


class CannotGoOn(RunFailed):
    """The executor failed, not a job: no further job can run."""


JobCallback = Callable[[int, Result | None, Exception | None], None]
"""Callback with the index of an ended job, and its value or its error."""


def count_workers(executor: Executor | None = None) -> int:
    """Number of jobs that an executor runs at a time; None: processes of this machine."""
    return processors() if executor is None else int(getattr(executor, "workers", 1))


def run_each(
    work: Callable[[Job], Result],
    jobs: Sequence[Job],
    names: Sequence[str],
    executor: Executor | None = None,
    progress: Progress | None = None,
    *,
    on_result: Callable[[int, Result], None] = lambda index, result: None,
    workers: int | None = None,
) -> list[Result]:
    """Run jobs and return their results in order; arguments as of `run_jobs`.

    names: of the jobs, for progress, which is called after each; on_result is called with each
    result as it arrives. The error of the first failing job, in the order of the jobs, is raised
    once all before it have ended; later ones are cancelled.
    """
    results: dict[int, Result] = {}
    failed: dict[int, Exception] = {}

    def collect(index: int, value: Result | None, error: Exception | None) -> None:
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
    work: Callable[[Job], Result],
    jobs: Sequence[Job],
    on_end: JobCallback[Result],
    executor: Executor | None = None,
    *,
    workers: int | None = None,
    until_failure: bool = False,
) -> None:
    """Run jobs; `on_end` is called in this thread with the outcome of each, as they end.

    work: a module-level function, jobs: its arguments; both are pickled. executor: None for
    `workers` processes of this machine, by default one per processor; with one worker or one job,
    jobs run in this process. until_failure: after a failure, finish only earlier jobs. On exit,
    jobs not begun are cancelled and own processes are ended. Raises CannotGoOn if the executor
    is gone or unsuitable.
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
    work: Callable[[Job], Result],
    jobs: Sequence[Job],
    on_end: JobCallback[Result],
    until_failure: bool,
) -> None:
    # Ended jobs pass through one queue, so on_end is called in order and in this thread.
    ended_futures: queue.SimpleQueue[Future[Result]] = queue.SimpleQueue()
    futures: dict[Future[Result], int] = {}
    # Dask blames a worker's death on all jobs queued there: each is retried alone.
    blamed: list[int] = []
    tried_alone: set[int] = set()
    first_failed = len(jobs)
    check: Callable[[], None] = getattr(executor, "check", lambda: None)

    def submit(index: int) -> Future[Result]:
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
            # Drop the future, so only the caller holds results.
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


def _was_killed(future: Future[Result]) -> bool:
    return not future.cancelled() and type(future.exception()).__name__ == "KilledWorker"


def _outcome(future: Future[Result]) -> tuple[Result | None, Exception | None]:
    try:
        return future.result(), None
    except CancelledError as error:  # not cancelled by this function
        raise CannotGoOn("the executor of the jobs is gone") from error
    except CannotGoOn:
        raise
    except Exception as error:
        killed = RunFailed("every worker that tried it died (out of memory, or killed)")
        return None, killed if _was_killed(future) else error
