"""Grid of pure jobs, each stored under the hash of its arguments, so a study can resume."""

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
    """Estimator of the remaining time of jobs.

    costs: seconds per job; equal weights unless all are known. width: number of parallel jobs.
    done_cost: sum of the finished jobs' costs, set by the caller.
    """

    def __init__(self, costs: Sequence[float], width: int) -> None:
        costs_known = bool(costs) and all(cost > 0 for cost in costs)
        self.costs = list(costs) if costs_known else [1.0] * len(costs)
        self.done_cost = 0.0
        self._began = time.monotonic()
        self.beforehand = ""
        """Estimated total time, in words; empty if unknown."""
        if costs_known:
            width = max(1, min(width, len(costs)))  # a job runs on one worker
            self.beforehand = f"about {format_duration(max(sum(costs) / width, *costs))}"

    def time_left(self) -> str:
        """Return the remaining time at the pace so far, in words; empty before the first job."""
        if not self.done_cost:
            return ""
        spent_s = time.monotonic() - self._began
        return f"about {format_duration(spent_s * (sum(self.costs) / self.done_cost - 1))} left"


STUDY_STORE = Store("study")
MAX_STORE_BYTES = 4_000_000_000
"""By hand: limit of the store; larger keeps more to resume. Results in use are never deleted."""
Value = dict[str, Any]
"""Result of a job, as stored."""

# Failures of one job; any other exception is a bug in the code of all jobs.
JOB_FAILURES = (DeltactFabError, ArithmeticError, ValueError, MemoryError, OSError)


def seed_of(seed: int, name: str) -> int:
    """Seed of a job: a number below 2**48, by numpy's SeedSequence.

    Depends on the study's seed and the job's name only, so a growing grid keeps its draws.
    """
    import numpy as np

    words = np.frombuffer(hashlib.sha256(name.encode()).digest(), dtype="<u4")
    sequence = np.random.SeedSequence(seed, spawn_key=tuple(int(w) for w in words))
    high, low = sequence.generate_state(2)
    return (int(high) << 16) | (int(low) >> 16)


@dataclass(frozen=True)
class GridJob:
    """One cell of a grid.

    name: unique in the grid. work: a function of a module. arguments: all inputs of the result,
    with the seed (`seed_of`): plain data, frozen dataclasses, models of a lab's files. cost:
    estimated seconds on one core, 0 if unknown. needs: files of the store that it reads, copied
    with it to another machine.
    """

    name: str
    work: Callable[[Any], Value]
    arguments: Any = None
    cost: float = 0.0
    needs: tuple[str, ...] = ()

    def key(self) -> dict[str, Any]:
        """Return the store key of its result. Raises TypeError for non-plain data."""
        top, _, module = self.work.__module__.partition(".")
        folder = Path(str(sys.modules[top].__file__)).parent
        work = f"{self.work.__module__}:{self.work.__name__}"
        # Only the hash: the arguments would make keys long to write and compare.
        try:
            text = json.dumps(self.arguments, sort_keys=True, default=job_arguments)
        except TypeError as error:
            raise TypeError(f"{self.name}: arguments: {error}") from error
        arguments = hashlib.sha256(text.encode()).hexdigest()
        return cache_key(module or top, package=folder, work=work, arguments=arguments)

    @property
    def is_stored(self) -> bool:
        """True if the store has its result."""
        return STUDY_STORE.read(self.key()) is not None


def job_arguments(value: Any) -> dict[str, Any]:
    """Return a dataclass or lab-file model as plain data. Raises TypeError for others."""
    if is_dataclass(value):
        return vars(value)
    if isinstance(value, Table):
        return value.model_dump(mode="json")
    raise TypeError(f"{type(value).__name__} is not plain data")


@dataclass(frozen=True)
class Grid:
    """Results of jobs by name, in order.

    missing: reason per job without a result. n_cached: results found in the store. new_cpu_s: CPU
    time of the others.
    """

    results: dict[str, Value]
    missing: dict[str, str]
    n_cached: int
    new_cpu_s: float = 0.0

    @property
    def cpu_s(self) -> float:
        """CPU time of all results, that of earlier calls included."""
        return float(sum(value["cpu_s"] for value in self.results.values()))

    def __getitem__(self, name: str) -> Value:
        """Return a required result. Raises RunFailed if it is missing."""
        if name in self.missing:
            raise RunFailed(
                f"{name}: no result: {self.missing[name]}; other results are stored; run the "
                "same command to retry"
            )
        return self.results[name]


def solve(
    jobs: Sequence[GridJob],
    executor: Executor | None = None,
    progress: Progress | None = None,
    say: Callable[[str], None] = lambda text: None,
) -> Grid:
    """Run jobs, except those with a stored result; store each result when it is ready.

    A failure ends only its job. progress: called at each job's end, with the remaining time. say:
    called with the amount of work before it begins, and with each failure. Raises ValueError for
    duplicate names; the first error if every job fails; Stopped on Ctrl-C; RunFailed if the
    executor is lost.
    """
    if duplicates := [name for name, n in Counter(job.name for job in jobs).items() if n > 1]:
        raise ValueError(f"duplicate job names: {', '.join(duplicates)}")
    keys = {job.name: job.key() for job in jobs}
    stored = {name: STUDY_STORE.read(key) for name, key in keys.items()}
    results = {name: value for name, value in stored.items() if value is not None}
    n_cached, new = len(results), {job.name for job in jobs} - results.keys()
    missing: dict[str, str] = {}
    errors: list[Exception] = []
    refused: list[str] = []
    # Longest first, so that no long job runs alone at the end.
    todo = sorted((job for job in jobs if job.name not in results), key=lambda job: -job.cost)
    pace = JobPace([job.cost for job in todo], count_workers(executor))

    def tick(label: str) -> None:
        if progress is not None:
            eta = pace.time_left()
            progress(len(results) + len(missing), len(jobs), f"{label}{eta and f', {eta}'}")

    def on_end(index: int, value: Value | None, error: Exception | None) -> None:
        """Store a job's result or failure. Raises an error that is a bug in its code."""
        name = todo[index].name
        pace.done_cost += pace.costs[index]
        if value is not None:
            results[name] = value
            if not STUDY_STORE.write(keys[name], value) and not refused:
                refused.append(f"{STUDY_STORE.folder.parent}: cannot store results there")
                say(f"{refused[0]}; an interruption loses them")
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
        say(f"{n_cached} of {len(jobs)} jobs stored, {len(todo)} to do{about}")
    tick("")
    try:
        run_jobs(_run_job, todo, on_end, executor)
    except (KeyboardInterrupt, RunFailed) as cause:
        state = f"{len(results)} of {len(jobs)} jobs stored; run the same command to resume"
        if isinstance(cause, KeyboardInterrupt):
            raise Stopped(f"stopped: {state}") from cause
        raise RunFailed(f"{cause}; {state}") from cause
    if errors and not results:
        raise errors[0]
    # Delete the least recently used, never those of this grid, which are the newest.
    STUDY_STORE.trim(MAX_STORE_BYTES, keys.values())
    new_cpu_s = float(sum(results[name]["cpu_s"] for name in new if name in results))
    ended = {j.name: results[j.name] for j in jobs if j.name in results}
    return Grid(ended, missing, n_cached, new_cpu_s)


def _run_job(job: GridJob) -> Value:
    """Run a job; its result tells the CPU time, `cpu_s`."""
    began_s = time.process_time()
    value = job.work(job.arguments)
    return {**value, "cpu_s": time.process_time() - began_s}
