"""How studies grow: with workers, patterns and frames. Some minutes; nothing is kept.

    python -m benchmarks.study_scaling          # the bounds alone, in seconds
    python -m benchmarks.study_scaling timed    # and what two processes, patterns and frames cost

A bound is on the speed-up of any number of workers, from the costs that jobs declare: their sum
over the longest job of each grid, for a grid begins when the one before it has ended.
"""

from __future__ import annotations

import os
import resource
import sys
import tempfile
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from types import SimpleNamespace
from typing import Any, cast
from unittest import mock

import numpy as np

from deltact_fab.bench import expand_protocol
from deltact_fab.common import cache
from deltact_fab.common.jobs.cluster import open_executor
from deltact_fab.studies.study import force_calibration, pattern_selection, press_jobs, shapes
from deltact_fab.studies.study.grid import Grid, GridJob, solve
from deltact_fab.studies.study.pattern_selection import Selection
from deltact_fab.studies.study.registry import StudyRequest
from deltact_fab.studies.study.scene import PressScene

PATTERNS, DEPTHS_MM = (1, 2, 4), (1.0, 2.0, 3.0)
KNOT_S = 5.0  # of the gel at finite strain, about


class EnoughError(Exception):
    """No grid after this one depends on no result."""


@dataclass(frozen=True)
class Counted(StudyRequest):
    """A request whose grids are counted and not solved; the first that is read ends it."""

    costs: list[list[float]] = field(default_factory=list)

    def solve(self, jobs: Sequence[GridJob]) -> Grid:
        """Note what they cost. Raises EnoughError."""
        self.costs.append([job.cost for job in jobs])
        raise EnoughError


def solve_gels(of: PressScene, asked: StudyRequest) -> None:
    """Note what the gels would cost, one for the mirror images of a press."""
    solvers = [presses.planned_press(path).solver for presses in map(of.gel, of.protocols)
               for path in presses.paths]  # fmt: skip
    costs = {solver.stored_as: KNOT_S * len(solver.poses) for solver in solvers}
    cast(Counted, asked).costs.append(list(costs.values()))


def grids(study: str) -> list[list[float]]:
    """The costs of the grids of a study at its default scale, with nothing kept."""
    asked = Counted(executor=cast(Any, SimpleNamespace(workers=1000)))
    module = {"force": force_calibration, "selection": pattern_selection, "shapes": shapes}[study]
    with suppress(EnoughError), mock.patch.object(PressScene, "solve_gels", solve_gels):
        module.run(asked)
    if study == "shapes":  # its objects wait for the calibrations
        of = shapes.load_scene(asked)
        presses = [(n, p) for n in (*shapes.OBJECT_SETS, shapes.TWIST_PRESS) for p in of.presses(n)]
        work, kind = press_jobs.shape_job, press_jobs.ShapeJob
        jobs = [of.job("", n, p, work, kind, depth="", force="") for n, p in presses]
        asked.costs.append([job.cost for job in jobs])
    return asked.costs


def bounds() -> None:
    """A line a study."""
    for study in ("force", "selection", "shapes"):
        found = grids(study)
        told = ", ".join(f"{len(own)} jobs of at most {max(own):.0f} s" for own in found)
        bound = sum(map(sum, found)) / sum(map(max, found))
        print(f"{study}: at most {bound:.1f} times as fast: {told}")


def measured(job: press_jobs.TrackingJob) -> dict[str, Any]:
    """A press followed in a process of its own: CPU seconds, and the most memory, MB."""
    began = time.process_time()
    press_jobs.track_press(job)
    frames = sum(step.frames for step in expand_protocol(job.protocol))
    peak_kb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return {"frames": frames, "cpu_s": time.process_time() - began, "mb": peak_kb / 1024}


def alone(job: GridJob) -> dict[str, Any]:
    """What a job costs in a process that has done nothing else."""
    import benchmarks.study_scaling as own  # by a name that the process can import

    with open_executor(workers=1) as one:
        return one.submit(own.measured, job.arguments).result()


def scene(depth_mm: float) -> Selection:
    """One press without a drag, its gel solved."""
    small = Selection.from_request(StudyRequest(options={"indenter": ["ellipsoid"]}))
    lone = {"depths_mm": (depth_mm,), "shear": None}
    protocols = {small.name: small.protocol.model_copy(update=lone)}
    found = replace(small, scene=replace(small.scene, protocols=protocols))
    found.scene.solve_gels(StudyRequest())
    return found


def job(of: Selection, count: int, name: str = "", seed: int = 0) -> GridJob:
    """Its press under so many patterns; jobs of another seed are other ones to the store."""
    (whole,) = of.jobs((seed,), [entry.name for entry in of.entries[:count]])
    return replace(whole, name=name)


def timed() -> None:
    """What patterns, frames and a second process cost and give."""
    scenes = [scene(depth_mm) for depth_mm in DEPTHS_MM]
    rows = [alone(job(scenes[0], count)) for count in PATTERNS]
    for count, row in zip(PATTERNS, rows, strict=True):
        print(f"{count} patterns, {row['frames']} frames: {row['cpu_s']:.1f} CPU s, "
              f"{row['mb']:.0f} MB")  # fmt: skip
    _line("patterns", PATTERNS, rows)
    rows = [alone(job(of, 2)) for of in scenes]
    _line("frames", [row["frames"] for row in rows], rows)
    spent = []
    for workers in (1, 2):
        with open_executor(workers=workers) as where:
            began = time.monotonic()
            seeds = range(4 * workers, 4 * workers + 4)
            solve([job(scenes[0], 1, f"{seed}", seed) for seed in seeds], where)
            spent.append(time.monotonic() - began)
    print(f"two processes: {spent[0] / spent[1]:.2f} times as fast (load {os.getloadavg()[0]:.1f})")


def _line(what: str, at: Sequence[int], rows: Sequence[dict[str, Any]]) -> None:
    cost = np.array([row["cpu_s"] for row in rows])
    fit = np.polyval(np.polyfit(at, cost, 1), at)
    print(
        f"{what} {', '.join(map(str, at))}: {np.abs(fit / cost - 1).max():.1%} off a straight line"
    )


def main(words: Sequence[str]) -> None:
    """The bounds, and with "timed" the rest, in a store of their own."""
    with tempfile.TemporaryDirectory() as store:
        os.environ[cache.FOLDER_VARIABLE] = store
        bounds()
        if "timed" in words:
            timed()


if __name__ == "__main__":
    main(sys.argv[1:])
