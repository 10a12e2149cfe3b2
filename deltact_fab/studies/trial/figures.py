"""Trials of a planned mean error and of a planned comparison: whole runs of drawn sensors."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from numpy.typing import ArrayLike

from deltact_fab.bench import Protocol, RigSetup, VirtualConfig, expand_protocol, open_run
from deltact_fab.common import InputError, count_workers, format_duration
from deltact_fab.estimate import Comparison, UnitDifference
from deltact_fab.fabricate import PatternRecipe
from deltact_fab.sensor import SensorDimensions
from deltact_fab.simulate import RunRequest, VirtualKind, run_presses

from ..study.grid import GridJob, solve
from ..study.scene import FRAME_COST_S
from .report import TrialJobs, TrialReport

POOL_SIZE = 60  # by hand: sensors that comparisons are drawn from; ten a side are then few of them
SENSOR_COST_S = 20.0  # by hand: CPU seconds of a sensor's gel, for the announced time only


@dataclass(frozen=True)
class SensorRun:
    """Arguments of `measure_run`: a protocol on one sensor. measure: as of `analyze compare`.

    interval: True for the half width of the mean's interval, False for the sensor's figure.
    """

    protocol: Protocol
    sensor: SensorDimensions
    recipe: PatternRecipe
    rig: VirtualConfig
    source: str
    number: int
    measure: str
    interval: bool
    relative: bool


def measure_run(job: SensorRun) -> dict[str, float]:
    """Record a run on a sensor, and return its "figure". Raises RunFailed and InputError."""
    import cv2

    cv2.setNumThreads(1)  # one job per core
    source, protocol = Path(job.source), job.protocol
    with TemporaryDirectory(prefix="deltact-fab-") as scratch:
        folder = Path(scratch) / protocol.name
        view = VirtualKind(job.rig, source, job.number).camera(protocol, job.sensor)
        setup = RigSetup(protocol, job.sensor, job.recipe, view, job.number, folder)
        presses = {step.press for step in expand_protocol(protocol)}
        run_presses(setup, job.rig, source, presses, job.number)
        if job.interval:
            mean = Comparison.mean_interval(open_run(folder), job.measure, job.relative)
            if mean.low is None or mean.high is None:
                raise InputError(mean.over)
            half = (mean.high - mean.low) / 2
            return {"figure": 100 * float(np.expm1(half)) if job.relative else half}
        figures = Comparison.run_figures([folder], job.measure)[folder]
        measure = Comparison.require_measure(job.measure, (1.0, "%"), "")
        return {"figure": measure.over_presses(figures.values())}


class FigureTrial:
    """Trial of a mean error, or of a comparison: a run for each sensor."""

    def __init__(self, request: RunRequest, rig: VirtualConfig, times: int) -> None:
        self.request, self.rig, self.times = request, rig, times
        promise = request.protocol.promise
        assert promise is not None, "required by `try_plan`"
        self.promise, self.compares = promise, promise.sensors > 0
        words = promise.measure.split()  # "mean tracking error", "difference of tracking"
        self.measure = words[-1] if self.compares else words[1]
        self.size = max(POOL_SIZE, 2 * promise.sensors) if self.compares else times

    def run(self, how: TrialJobs) -> TrialReport:
        """Record a run on each sensor, and count those that reach the goal."""
        jobs = [self._job(number) for number in range(1, self.size + 1)]
        how.say(
            f"a run of {len(self.request.protocol.list_presses())} presses on {self.size} sensors: "
            f"about {format_duration(sum(job.cost for job in jobs))} of computing on "
            f"{count_workers(how.executor)} cores"
        )
        grid = solve(jobs, how.executor, how.progress, how.say)
        figures = {
            number: grid.results[job.name]["figure"]
            for number, job in enumerate(jobs, start=1) if job.name in grid.results
        }  # fmt: skip
        failed = {int(name.split()[-1]): reason for name, reason in grid.missing.items()}
        remark = ["simulated, the protocol's gel, images of all presses"]
        name, promise = self.request.protocol.name, self.promise
        if self.compares:
            remark.append("comparisons share sensors: the interval is narrower than it should be")
            differing, invented = compare_drawn(
                [*figures.values()], promise.sensors, self._effect, self.times, promise.unit == "%"
            )
            return TrialReport(
                name, promise, differing, self.times,
                f"comparisons of {promise.sensors} and {promise.sensors} out of {len(figures)} "
                "sensors, the difference planted,", figures, failed, None, invented, remark,
            )  # fmt: skip
        reached = sum(figure <= promise.goal for figure in figures.values())
        return TrialReport(
            name, promise, reached, self.times, "sensors", figures, failed, remarks=remark
        )

    @property
    def _effect(self) -> float:
        """Difference to plant: a factor, or an amount in the promise's unit."""
        return 1 + self.promise.goal / 100 if self.promise.unit == "%" else self.promise.goal

    def _job(self, number: int) -> GridJob:
        request = self.request
        arguments = SensorRun(
            request.protocol, request.design, request.recipe, self.rig, str(request.rig_path),
            number, self.measure, not self.compares, self.promise.unit == "%",
        )  # fmt: skip
        cost_s = SENSOR_COST_S + FRAME_COST_S * request.estimate().frames
        return GridJob(f"sensor {number}", measure_run, arguments, cost_s)


def compare_drawn(
    pool: ArrayLike, units: int, effect: float, times: int, relative: bool, seed: int = 0
) -> tuple[int, int]:
    """Draw sides from a pool, without replacement; count differences, planted and invented.

    effect: a factor of side a, or an amount added to it. Draws share sensors, so they are less
    independent than the binomial interval takes them. Raises InputError for too small a pool.
    """
    pool = np.asarray(pool, float)
    if len(pool) < 2 * units:
        raise InputError(f"{len(pool)} sensors with a figure; two sides need {2 * units}")
    counts, rng = [0, 0], np.random.default_rng(seed)
    for _ in range(times):
        sides = rng.choice(pool, 2 * units, replace=False)
        b = {f"b{n}": figure for n, figure in enumerate(sides[units:].tolist())}
        planted = sides[:units] * effect if relative else sides[:units] + effect
        for k, side in enumerate((planted, sides[:units])):
            a = {f"a{n}": figure for n, figure in enumerate(side.tolist())}
            low, high = UnitDifference.from_units(a, b, relative).interval()
            counts[k] += low > 0 if k == 0 else low > 0 or high < 0
    return counts[0], counts[1]
