"""Trial of a plan: on how many drawn sensors its goal is reached, beside what it promises."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from deltact_fab.bench import VirtualConfig
from deltact_fab.common import InputError, Progress, count_workers, format_duration
from deltact_fab.estimate import ForceModel, SensorModel, make_features
from deltact_fab.physics import GelLevel
from deltact_fab.simulate import RunRequest, SensorDraw

from ..plan.components import FORCE_MODEL
from ..study.grid import STUDY_STORE, GridJob, solve
from .points import PressSensors, StopPoints, measure_sensors

IMAGE_SENSORS = 10  # by hand: sensors with images of all presses; they tell a tenth of the error
POOL_SENSORS = 3  # by hand: those of them whose noise serves the others, of a hundred presses
IMAGE_EVERY = 16  # by hand: presses of the other sensors, of which one is tracked in images
EQUAL_SHARE = 0.1  # by hand: of the error, within which images and noise count as equal
SENSOR_LEVEL = 0.95  # definition: of the intervals
GELS_COST_S, IMAGES_COST_S, NOISE_COST_S, FINITE_COST_S = 8.0, 3.0, 0.4, 60.0
"""By hand, CPU seconds of a press: on five linear gels, in images, without them, and what finite
strain adds; for the announced time only."""

PressedGel = Literal["linear", "hyperelastic"]


@dataclass(frozen=True)
class TrialReport:
    """Errors on drawn sensors beside the promise of a plan.

    errors: by number of the sensor, in the promise's unit. by_images, by_noise: of the sensors that
    were measured in both ways. failed: reason by sensor without an error.
    """

    name: str
    promise: Any
    level: GelLevel
    errors: dict[int, float]
    by_images: list[float]
    by_noise: list[float]
    failed: dict[int, str]

    @property
    def reached(self) -> int:
        """Number of sensors whose error is within the goal; one without an error is not."""
        return sum(error <= self.promise.goal for error in self.errors.values())

    @property
    def in_interval(self) -> int:
        """Number of sensors whose error is within the promised interval."""
        low, high = self.promise.interval
        return sum(low <= error <= high for error in self.errors.values())

    @property
    def times(self) -> int:
        """Number of sensors."""
        return len(self.errors) + len(self.failed)

    def interval(self, count: int) -> tuple[float, float]:
        """Exact binomial interval (Clopper and Pearson) of a share of the sensors."""
        from scipy.stats import binomtest

        low, high = binomtest(count, self.times).proportion_ci(SENSOR_LEVEL)
        return float(low), float(high)

    @property
    def as_promised(self) -> bool:
        """True if the promised chance is within the interval of the share that reached the goal."""
        low, high = self.interval(self.reached)
        return low <= self.promise.chance <= high

    @property
    def ratio(self) -> tuple[float, float, float] | None:
        """Error by noise over that by images, less 1, and its 90 % interval; None for one sensor.

        Two one-sided tests at 5 % find both equal if the interval is within EQUAL_SHARE.
        """
        from scipy.stats import ttest_1samp

        logs = np.log(self.by_noise) - np.log(self.by_images)
        if len(logs) < 2:
            return None
        low, high = ttest_1samp(logs, 0.0).confidence_interval(0.9)
        return math.expm1(float(logs.mean())), math.expm1(float(low)), math.expm1(float(high))

    @property
    def equal(self) -> bool | None:
        """True if images and noise give the same error; None if that is not known."""
        if self.ratio is None:
            return None
        return max(abs(self.ratio[1]), abs(self.ratio[2])) <= EQUAL_SHARE

    @property
    def lines(self) -> list[str]:
        promise = self.promise
        low, high = self.interval(self.reached)
        verdict = "as promised" if self.as_promised else "NOT as promised"
        rms = float(np.sqrt(np.mean(np.square([*self.errors.values()])))) if self.errors else 0.0
        lines = [
            f"{self.name}: goal {promise.goal:g} {promise.unit} reached on {self.reached} of "
            f"{self.times} sensors [{low:.2f} to {high:.2f}], promised {promise.chance:.2f}: "
            f"{verdict}",
            f"promised interval held on {self.in_interval} of {self.times}; rms error {rms:.2g} "
            f"{promise.unit}",
            self._images_line,
            self._gel_line,
        ]
        return [*lines, *(f"sensor {n}: no error: {text}" for n, text in self.failed.items())]

    @property
    def _images_line(self) -> str:
        if self.ratio is None:
            return "images: two sensors or more are needed to hold the measured noise against them"
        value, low, high = self.ratio
        equal = "yes" if self.equal else "NO"
        return (
            f"measured noise instead of images, {len(self.by_images)} sensors: error {value:+.1%} "
            f"[{low:+.1%} to {high:+.1%}]; equal within {EQUAL_SHARE:.0%}: {equal}"
        )

    @property
    def _gel_line(self) -> str:
        if self.level == "linear":
            return (
                "simulated, linear gel, the planner's own: a test of flow, fit and statistics, not "
                "of the gel; --gel hyperelastic presses another"
            )
        return f"simulated, {self.level} gel; the plan is by the linear one"

    def as_dict(self) -> dict[str, Any]:
        """Plain data."""
        names = ("value", "low", "high")
        return {
            "promise": self.promise.model_dump(mode="json"),
            "simulated": True,
            "gel": self.level,
            "times": self.times,
            "reached": self.reached,
            "reached_interval": self.interval(self.reached),
            "as_promised": self.as_promised,
            "in_interval": self.in_interval,
            "images": None if self.ratio is None else dict(zip(names, self.ratio, strict=True)),
            "equal_images": self.equal,
            "errors": self.errors,
            "failed": self.failed,
        }


def try_plan(
    plan: str, rig: str, times: int = 100, gel: PressedGel = "linear",
    executor: Executor | None = None, progress: Progress | None = None,
    say: Callable[[str], None] = lambda text: None,
) -> TrialReport:  # fmt: skip
    """Try a planned force calibration on drawn sensors 1 to `times` of a virtual rig.

    say: called with the cost, beforehand. Raises InputError for a protocol without a promise, or
    with one of another kind, and for a rig that draws no sensors.
    """
    request = RunRequest(plan, rig)
    promise = request.protocol.promise
    if promise is None:
        raise InputError(f"{request.source}: no [promise]; write a plan with `protocol plan`")
    if not isinstance(request.rig, VirtualConfig):
        raise InputError(f"{request.rig_path}: a real rig; a trial needs a virtual one")
    SensorDraw.from_population(request.rig, 1, str(request.rig_path))
    trial = _ForceTrial(request, request.rig, times, gel)
    trial.announce(say, executor)
    return trial.run(executor, progress, say)


class _ForceTrial:
    """Trial of a force calibration: jobs of presses, then a fit for each sensor."""

    def __init__(
        self, request: RunRequest, rig: VirtualConfig, times: int, gel: PressedGel
    ) -> None:
        self.request, self.rig, self.gel = request, rig, gel
        self.sensors = tuple(range(1, times + 1))
        presses = request.protocol.list_presses()
        self.presses = {press.name: press for press in presses if press.role != "reference"}

    def announce(self, say: Callable[[str], None], executor: Executor | None) -> None:
        """Say what the trial costs, for nothing solved yet."""
        with_images = sum(len(self._with_images(k)) for k in range(len(self.presses)))
        cost_s = len(self.presses) * (
            GELS_COST_S + (FINITE_COST_S if self.gel != "linear" else 0.0)
            + NOISE_COST_S * len(self.sensors)
        ) + IMAGES_COST_S * with_images  # fmt: skip
        say(
            f"{len(self.presses)} presses on {len(self.sensors)} sensors, {with_images} of them "
            f"in images: about {format_duration(cost_s)} of computing, on "
            f"{count_workers(executor)} cores"
        )

    def run(
        self, executor: Executor | None, progress: Progress | None, say: Callable[[str], None]
    ) -> TrialReport:
        """Measure all presses, images first, and fit each sensor's model."""
        first = self.sensors[:IMAGE_SENSORS]
        jobs = [self._job(name, first) for name in self.presses]
        images = solve(jobs, executor, progress, say)
        by_images = {n: {name: images[name]["images"][n] for name in self.presses} for n in first}
        keys = json.dumps([job.key() for job in jobs], sort_keys=True)
        pool_key = {"noise": hashlib.sha256(keys.encode()).hexdigest()}
        pool = [
            noise for n in first[:POOL_SENSORS] for p in by_images[n].values() for noise in p.noise
        ]
        STUDY_STORE.write(pool_key, pool)
        jobs = [
            self._job(name, self._with_images(k)[len(first):], self.sensors, pool_key)
            for k, name in enumerate(self.presses)
        ]  # fmt: skip
        grid = solve(jobs, executor, progress, say)
        by_noise = {
            n: {name: grid[name]["noise"][n] for name in self.presses} for n in self.sensors
        }
        mixed = {
            n: by_images[n] if n in by_images else
            by_noise[n] | {m: grid[m]["images"][n] for m in grid.results if n in grid[m]["images"]}
            for n in self.sensors
        }  # fmt: skip
        errors, failed = {}, {}
        for number, points in mixed.items():
            try:
                errors[number] = self.error_n(points)
            except InputError as error:
                failed[number] = str(error)
        pairs = [n for n in first if n in errors]
        protocol = self.request.protocol
        return TrialReport(
            protocol.name, protocol.promise, self.gel, errors, [errors[n] for n in pairs],
            [self.error_n(by_noise[n]) for n in pairs], failed,
        )  # fmt: skip

    def error_n(self, points: dict[str, StopPoints]) -> float:
        """Rms error of the normal force on presses to validate, by a fit to the others.

        Raises InputError for too few points.
        """
        view, design = self.request.view, self.request.design
        assert view is not None, "the plan takes images"
        features = make_features(FORCE_MODEL, SensorModel(view, design.skin))
        roles: dict[str, list[StopPoints]] = {"fit": [], "validate": []}
        for name, part in points.items():
            roles[self.presses[name].role].append(part)
        X, wrench = (
            np.concatenate([getattr(part, key) for part in roles["fit"]])
            for key in ("features", "wrench")
        )
        model = ForceModel.fit(features, X, wrench)[0]
        residuals = [
            model.predict(part.features[part.pressed])[:, 2] - part.wrench[part.pressed, 2]
            for part in roles["validate"]
        ]
        return float(np.sqrt(np.mean(np.concatenate(residuals) ** 2)))

    def _with_images(self, k: int) -> tuple[int, ...]:
        """Sensors for which the press number k is tracked in images."""
        return tuple(n for n in self.sensors if n <= IMAGE_SENSORS or (n + k) % IMAGE_EVERY == 0)

    def _job(
        self, name: str, with_images: Sequence[int], without: Sequence[int] = (),
        pool: dict[str, Any] | None = None,
    ) -> GridJob:  # fmt: skip
        request = self.request
        cost_s = IMAGES_COST_S * len(with_images) + NOISE_COST_S * len(without)
        arguments = PressSensors(
            request.protocol, name, request.design, self.rig, str(request.rig_path), self.gel,
            request.recipe, tuple(with_images), tuple(without), pool,
        )  # fmt: skip
        return GridJob(name, measure_sensors, arguments, cost_s)
