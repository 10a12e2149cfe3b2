"""The fresh process in which one setting, or the cases of one engine, are run.

`python -m deltact_fab.numerics.worker JOB`, JOB a JSON object; answers in JSON, a line each. At its
top only the standard library: threads and cores are pinned before any library is loaded, and what
a library costs to load is not yet paid.
"""

from __future__ import annotations

import json
import os
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .memory import peak_resident_mb, reset_peak_mb

if TYPE_CHECKING:
    from .engine import CurveSetting

REPEATS = 5
MAX_REPEATS = 25
LONG_ENOUGH_S = 0.3  # with five repeats done, no more are added past this


def main(job: dict[str, Any]) -> None:
    """Run one job; every answer is a line on stdout, after a mark that no library prints."""
    _pin(job["threads"])
    # What an engine prints must not stand between the answers.
    with os.fdopen(os.dup(1), "w") as answers:
        os.dup2(2, 1)
        for answer in _answers(job):
            answers.write(json.dumps(answer, allow_nan=False) + "\n")
            answers.flush()


def _answers(job: dict[str, Any]) -> Any:
    if job["kind"] == "scene":
        from .scenes import probe

        yield probe(job["probe"])
        return
    from .engines import load
    from .stability import judge, plain

    engine = load(job["module"])
    scratch, quick = Path(job["scratch"]), job["quick"]
    if job["kind"] == "curve":
        setting = next(s for s in engine.curves(quick) if s.key == job["key"])
        yield time_setting(setting, scratch)
    elif job["kind"] == "cases":
        for case in list(engine.cases(quick))[job["first"] :]:
            yield judge(case, scratch)
    elif job["kind"] == "tables":
        for table in engine.tables(scratch):
            yield {
                "title": table.title,
                "note": table.note,
                "columns": list(table.columns),
                "rows": [[plain(v) for v in row] for row in table.rows],
            }


def time_setting(setting: CurveSetting, scratch: Path) -> dict[str, Any]:
    """Times, memory and error of one setting; the warm-up is apart.

    The best of several runs, for whatever else is at work only ever adds, and the slowest.
    """
    from .stability import plain

    work = setting.build(scratch)
    before_mb = reset_peak_mb()
    start_s = time.process_time()
    result = work.run()
    first_s = time.process_time() - start_s
    wall_s: list[float] = []
    cpu_s: list[float] = []
    while len(cpu_s) < REPEATS or (sum(cpu_s) < LONG_ENOUGH_S and len(cpu_s) < MAX_REPEATS):
        start_s, start_cpu_s = time.perf_counter(), time.process_time()
        result = work.run()
        wall_s.append(time.perf_counter() - start_s)
        cpu_s.append(time.process_time() - start_cpu_s)
    peak_mb = peak_resident_mb() - before_mb
    best_s = min(cpu_s)
    return {
        "cpu_s": best_s,
        "cpu_most_s": max(cpu_s),
        "wall_s": min(wall_s),
        "compile_s": max(0.0, first_s - best_s),
        "peak_mb": max(0.0, peak_mb),
        "error": plain(float(work.error(result))),
        "repeats": len(cpu_s),
    }


def _pin(threads: int) -> None:
    """Keep the process on as many cores as it has threads, where the system can."""
    if hasattr(os, "sched_setaffinity"):
        cores = sorted(os.sched_getaffinity(0))
        os.sched_setaffinity(0, cores[-threads:])


if __name__ == "__main__":
    main(json.loads(sys.argv[1]))
