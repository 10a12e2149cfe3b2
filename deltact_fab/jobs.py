"""The one executor: jobs side by side, each a pure function of what it is given."""

from __future__ import annotations

import multiprocessing
from collections.abc import Callable, Sequence
from concurrent.futures import Executor, ProcessPoolExecutor
from typing import TypeVar

Progress = Callable[[int, int, str], None]
J = TypeVar("J")
R = TypeVar("R")


def each(
    work: Callable[[J], R],
    jobs: Sequence[J],
    names: Sequence[str],
    executor: Executor | None = None,
    progress: Progress | None = None,
) -> list[R]:
    """The results of jobs in their order, on an executor or on two processes of this machine."""
    if executor is None:
        with ProcessPoolExecutor(
            max_workers=max(1, min(2, len(jobs))),
            mp_context=multiprocessing.get_context("spawn"),
        ) as local:
            return each(work, jobs, names, local, progress)
    futures = [executor.submit(work, job) for job in jobs]
    results = []
    for done, (name, future) in enumerate(zip(names, futures, strict=True), start=1):
        results.append(future.result())
        if progress is not None:
            progress(done, len(jobs), name)
    return results
