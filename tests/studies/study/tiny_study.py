"""A study of cheap jobs, registered by the tests that run it; `python tiny_study.py WORDS` too."""

from __future__ import annotations

import os
import signal
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

from deltact_fab.common import cache
from deltact_fab.common.errors import SolverError
from deltact_fab.present.report.result import ReportTable, StudyResult
from deltact_fab.studies.study.grid import GridJob, seed_of
from deltact_fab.studies.study.registry import STUDIES, Study, StudyRequest

OPTIONS = {
    "--count": {"help": "Jobs.", "default": 12},
    "--seconds": {"help": "Of each.", "default": 0.0},
    "--fails": {"help": "The job that fails.", "default": ""},
    "--partial": {"help": "Go on without those that failed: yes.", "default": ""},
}
DONE = "DONE_JOBS"


def draw(given: dict[str, Any]) -> dict[str, Any]:
    """Draws of a seed; notes that it was done, where that is asked."""
    began = time.monotonic()
    while time.monotonic() - began < given["seconds"]:
        time.sleep(0.01)
    if given["fails"]:
        raise SolverError("it did not\nconverge")
    if folder := os.environ.get(DONE):
        Path(folder, f"{given['name']}-{time.monotonic_ns()}").touch()
    draws = np.random.default_rng(given["seed"]).normal(size=(4, 2))
    return {"draws": draws, "mean": float(draws.mean()), "pair": (1, 2), "nan": float("nan")}


class Leaves(dict[str, Any]):
    """What `leave` is given; the file comes back."""

    @property
    def makes(self) -> tuple[str, ...]:
        return (self["file"],)


def leave(given: dict[str, Any]) -> dict[str, Any]:
    """A file in the store, and how it got there: the process that wrote or had it."""
    path = cache.cache_folder() / given["file"]
    if not path.exists():
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(str(os.getpid()))
    time.sleep(given.get("s", 0.0))
    return {"by": int(path.read_text()), "in": os.getpid()}


def jobs_of(seed: int, count: int, seconds: float = 0.0, fails: str = "") -> list[GridJob]:
    names = [f"job-{n}" for n in range(count)]
    return [
        GridJob(
            name,
            draw,
            {"name": name, "seed": seed_of(seed, name), "seconds": seconds, "fails": name == fails},
            cost=seconds,
        )
        for name in names
    ]


def run(asked: StudyRequest) -> StudyResult:
    import pandas as pd

    more = asked.options
    jobs = jobs_of(asked.seed, more["count"], more["seconds"], more["fails"])
    grid = asked.solve(jobs)
    found = grid.results if more["partial"] else {job.name: grid[job.name] for job in jobs}
    frame = pd.DataFrame({"job": list(found), "mean": [v["mean"] for v in found.values()]})
    return StudyResult(
        study="tiny",
        title="Tiny",
        answer=(f"{len(found)} means.",),
        simulated=True,
        seed=asked.seed,
        scale=asked.scale,
        tables=(ReportTable("means", "Means of draws.", frame),),
    )


def register() -> None:
    STUDIES["tiny"] = Study("tiny_study", "Tiny.", takes=("seed", "grid"), options=OPTIONS)
    sys.modules["deltact_fab.studies.study.tiny_study"] = sys.modules[__name__]


if __name__ == "__main__":
    import tiny_study

    from deltact_fab.app.cli.main import entry

    # A shell starts what it puts in the background, this test perhaps, with Ctrl-C ignored.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    tiny_study.register()
    entry()
