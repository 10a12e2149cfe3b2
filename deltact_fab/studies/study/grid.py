"""A grid of pure jobs: each stored under the hash of its arguments, so a study can go on."""

from __future__ import annotations

import hashlib
import json
import sys
import time
from collections import Counter
from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, is_dataclass
from pathlib import Path
from typing import Any

from deltact_fab.common import (
    DeltactFabError,
    Progress,
    RunFailed,
    Stopped,
    Store,
    Table,
    cache_key,
    count_workers,
    format_duration,
    run_jobs,
)


class JobPace:
    """How long jobs still take; costs: seconds of each, all known or they count alike.

    width: how many run at a time. done: is set to what has been done, in the unit of costs.
    """

    def __init__(self, costs: Sequence[float], width: int) -> None:
        costs_known = bool(costs) and all(cost > 0 for cost in costs)
        self.costs = list(costs) if costs_known else [1.0] * len(costs)
        self.done_cost = 0.0
        self._began = time.monotonic()
        self.beforehand = ""
        """What to expect, in words; empty where nothing is known."""
        if costs_known:
            width = max(1, min(width, len(costs)))  # several share the jobs, and no job is shared
            self.beforehand = f"about {format_duration(max(sum(costs) / width, *costs))}"

    def time_left(self) -> str:
        """Time to go at the pace so far, in words; empty before anything is done."""
        if not self.done_cost:
            return ""
        spent_s = time.monotonic() - self._began
        return f"about {format_duration(spent_s * (sum(self.costs) / self.done_cost - 1))} left"


STUDY_STORE = Store("study")
MAX_STORE_BYTES = 4_000_000_000
"""Of all studies; what a grid has just used is kept in any case."""
Value = dict[str, Any]
"""What a job found, as the store keeps it."""

# What may end one job and no other; anything else is a mistake in the code of all of them.
JOB_FAILURES = (DeltactFabError, ArithmeticError, ValueError, MemoryError, OSError)


def seed_of(seed: int, name: str) -> int:
    """The seed of a job in a study's seed: a number below 2**48, by numpy's SeedSequence.

    It depends on the two alone, so a grid that grows keeps the draws of what it had.
    """
    import numpy as np

    words = np.frombuffer(hashlib.sha256(name.encode()).digest(), dtype="<u4")
    sequence = np.random.SeedSequence(seed, spawn_key=tuple(int(w) for w in words))
    high, low = sequence.generate_state(2)
    return (int(high) << 16) | (int(low) >> 16)


@dataclass(frozen=True)
class GridJob:
    """One cell of a grid.

    name: unique in the grid. work: a function of a module. arguments: all that the result depends
    on, the seed among it (`seed_of`): plain data, frozen dataclasses, models of a lab's files.
    cost: seconds that it may take on one core, 0 where that is not known. needs: files of the store
    that it reads; they go with it to another machine.
    """

    name: str
    work: Callable[[Any], Value]
    arguments: Any = None
    cost: float = 0.0
    needs: tuple[str, ...] = ()

    def key(self) -> dict[str, Any]:
        """The key of its result in the store. Raises TypeError for what is not plain data."""
        top, _, module = self.work.__module__.partition(".")
        folder = Path(str(sys.modules[top].__file__)).parent
        work = f"{self.work.__module__}:{self.work.__name__}"
        # The hash alone: with its arguments a key would be written and compared at length.
        try:
            text = json.dumps(self.arguments, sort_keys=True, default=job_arguments)
        except TypeError as error:
            raise TypeError(f"{self.name}: arguments: {error}") from error
        arguments = hashlib.sha256(text.encode()).hexdigest()
        return cache_key(module or top, package=folder, work=work, arguments=arguments)


def job_arguments(value: Any) -> dict[str, Any]:
    """A dataclass or a model of a lab's file as plain data. Raises TypeError for anything else."""
    if is_dataclass(value):
        return vars(value)
    if isinstance(value, Table):
        return value.model_dump(mode="json")
    raise TypeError(f"{type(value).__name__} is no plain data")


@dataclass(frozen=True)
class Grid:
    """Results of jobs by name, in their order.

    found: those that there are. missing: why each other job has no result. kept: how many were
    there from before.
    """

    results: dict[str, Value]
    missing: dict[str, str]
    n_cached: int

    def __getitem__(self, name: str) -> Value:
        """One that must be there. Raises RunFailed where it has no result."""
        if name in self.missing:
            raise RunFailed(
                f"{name}: has no result: {self.missing[name]}; the rest is kept, and the same "
                "command tries it again"
            )
        return self.results[name]


def solve(
    jobs: Sequence[GridJob],
    executor: Executor | None = None,
    progress: Progress | None = None,
    say: Callable[[str], None] = lambda text: None,
) -> Grid:
    """The results of jobs; those that are kept are not done again, and each is kept when it ends.

    A failure ends that job and no other. progress: told of each job's end, with the remaining
    time. say: told what there is to do, before it begins, and each failure. Raises ValueError
    for two jobs of one name; the error itself when every job fails; Stopped on Ctrl-C; RunFailed
    when what they run on is gone.
    """
    if duplicates := [name for name, n in Counter(job.name for job in jobs).items() if n > 1]:
        raise ValueError(f"jobs of one name: {', '.join(duplicates)}")
    keys = {job.name: job.key() for job in jobs}
    stored = {name: STUDY_STORE.read(key) for name, key in keys.items()}
    results = {name: value for name, value in stored.items() if value is not None}
    n_cached = len(results)
    missing: dict[str, str] = {}
    errors: list[Exception] = []
    refused: list[str] = []
    # The longest are begun first, so that none is left alone at the end.
    todo = sorted((job for job in jobs if job.name not in results), key=lambda job: -job.cost)
    pace = JobPace([job.cost for job in todo], count_workers(executor))

    def tick(label: str) -> None:
        if progress is not None:
            eta = pace.time_left()
            progress(len(results) + len(missing), len(jobs), f"{label}{eta and f', {eta}'}")

    def on_end(index: int, value: Value | None, error: Exception | None) -> None:
        """Keep what a job gave, or why it gave nothing. Raises a mistake in the code of a job."""
        name = todo[index].name
        pace.done_cost += pace.costs[index]
        if value is not None:
            results[name] = value
            if not STUDY_STORE.write(keys[name], value) and not refused:
                refused.append(f"{STUDY_STORE.folder.parent}: nothing can be kept there")
                say(f"{refused[0]}; do not interrupt this")
        elif isinstance(error, JOB_FAILURES):
            errors.append(error)
            missing[name] = " ".join(str(error).split()) or type(error).__name__
            say(f"failed: {name}: {missing[name]}")
        elif error is not None:
            error.add_note(f"in the job {name}")
            raise error
        tick(name)

    if todo:
        about = pace.beforehand and f", {pace.beforehand}"
        say(f"{n_cached} of {len(jobs)} jobs are kept, {len(todo)} to do{about}")
    tick("")
    try:
        run_jobs(_run_job, todo, on_end, executor)
    except (KeyboardInterrupt, RunFailed) as cause:
        state = f"{len(results)} of {len(jobs)} jobs are kept; the same command goes on there"
        if isinstance(cause, KeyboardInterrupt):
            raise Stopped(f"stopped: {state}") from cause
        raise RunFailed(f"{cause}; {state}") from cause
    if errors and not results:
        raise errors[0]
    # The longest unused make room, and never what has been used now, which is the youngest.
    STUDY_STORE.trim(MAX_STORE_BYTES, keys.values())
    return Grid({j.name: results[j.name] for j in jobs if j.name in results}, missing, n_cached)


def _run_job(job: GridJob) -> Value:
    return job.work(job.arguments)
