"""A grid of pure jobs: each kept under the hash of what it was given, so that a study goes on."""

from __future__ import annotations

import io
import json
import zipfile
from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from .. import cache, digest
from ..jobs import Progress, each

KIND = "study"
Value = dict[str, Any]
"""Plain JSON data, and numpy arrays as values of its top level."""


@dataclass(frozen=True)
class Job:
    """One cell of a grid.

    name: unique in the grid, shown while it runs. work: a function of a module of the package.
    given: all that the result depends on, plain JSON data, the seed among it.
    """

    name: str
    work: Callable[[dict[str, Any]], Value]
    given: dict[str, Any] = field(default_factory=dict)

    def key(self) -> dict[str, Any]:
        """What its result is kept under."""
        module = self.work.__module__.removeprefix("deltact_fab.")
        return {
            "work": f"{module}:{self.work.__name__}",
            "code": digest.of(module),
            "given": self.given,
        }


def solve(
    jobs: Sequence[Job], executor: Executor | None = None, progress: Progress | None = None
) -> dict[str, Value]:
    """The result of every job by its name; those that are kept are not done again."""
    found = {job.name: _load(job) for job in jobs}
    todo = [job for job in jobs if found[job.name] is None]
    each(_do, todo, [job.name for job in todo], executor, progress)
    return {job.name: found[job.name] or _load(job) or {} for job in jobs}


def _do(job: Job) -> None:
    value = job.work(job.given)
    arrays: dict[str, Any] = {k: v for k, v in value.items() if isinstance(v, np.ndarray)}
    plain = {k: v for k, v in value.items() if k not in arrays}
    packed = io.BytesIO()
    np.savez_compressed(packed, **arrays)
    cache.put_file(KIND, job.key(), packed.getvalue(), plain)


def _load(job: Job) -> Value | None:
    kept = cache.get_file(KIND, job.key())
    if kept is None:
        return None
    data, plain = kept
    try:
        with np.load(io.BytesIO(data), allow_pickle=False) as arrays:
            return {**plain, **{name: arrays[name] for name in arrays.files}}
    except (ValueError, OSError, zipfile.BadZipFile, json.JSONDecodeError):
        return None
