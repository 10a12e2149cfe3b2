"""Trial of a planned force calibration on drawn sensors."""

from __future__ import annotations

import numpy as np

from deltact_fab.bench import VirtualConfig
from deltact_fab.common import InputError, count_workers, format_duration
from deltact_fab.estimate import ForceModel, SensorModel, make_features
from deltact_fab.physics import GelLevel
from deltact_fab.simulate import RunRequest

from ..plan.components import FORCE_MODEL
from ..study.grid import GridJob, solve
from .points import POOL_SENSORS, PressSensors, StopPoints, measure_sensors
from .report import ImageCheck, TrialJobs, TrialReport

IMAGE_EVERY = 16  # by hand: presses of the other sensors, of which one is tracked in images
GELS_COST_S, IMAGES_COST_S, NOISE_COST_S, FINITE_COST_S = 8.0, 3.0, 0.2, 60.0
"""By hand, CPU seconds of a press: on five linear gels, in images, without them, and what finite
strain adds; for the announced time only."""


class ForceTrial:
    """Trial of a force calibration: jobs of presses, then a fit for each sensor."""

    def __init__(self, request: RunRequest, rig: VirtualConfig, times: int, gel: GelLevel) -> None:
        self.request, self.rig, self.gel = request, rig, gel
        self.sensors = tuple(range(1, times + 1))
        presses = request.protocol.list_presses()
        self.presses = {press.name: press for press in presses if press.role != "reference"}

    def run(self, how: TrialJobs) -> TrialReport:
        """Measure all presses, and fit each sensor's model."""
        self._announce(how)
        jobs = [self._job(k, name) for k, name in enumerate(self.presses)]
        grid = solve(jobs, how.executor, how.progress, how.say)
        by_images, by_noise = (
            {n: {m: grid[m][kind][n] for m in self.presses if n in grid[m][kind]}
             for n in self.sensors}
            for kind in ("images", "noise")
        )  # fmt: skip
        mixed = {n: points | by_images[n] for n, points in by_noise.items()}
        errors, failed = {}, {}
        for number, points in mixed.items():
            try:
                errors[number] = self.error_n(points)
            except InputError as error:
                failed[number] = str(error)
        pairs = [n for n in self.sensors[:POOL_SENSORS] if n in errors]
        check = ImageCheck(
            [errors[n] for n in pairs], [self.error_n(by_noise[n]) for n in pairs]
        )  # fmt: skip
        protocol = self.request.protocol
        promise = protocol.promise
        assert promise is not None, "required by `try_plan`"
        return TrialReport(
            protocol.name, promise, sum(e <= promise.goal for e in errors.values()),
            len(self.sensors), "sensors", errors, failed, check if len(pairs) > 1 else None,
            remarks=self._remarks(),
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

    def _announce(self, how: TrialJobs) -> None:
        """Say what the trial costs, for nothing solved yet."""
        with_images = sum(len(self._with_images(k)) for k in range(len(self.presses)))
        finite_s = FINITE_COST_S if self.gel != "linear" else 0.0
        press_s = GELS_COST_S + finite_s + NOISE_COST_S * len(self.sensors)
        cost_s = len(self.presses) * press_s + IMAGES_COST_S * with_images
        how.say(
            f"{len(self.presses)} presses on {len(self.sensors)} sensors, {with_images} in images: "
            f"about {format_duration(cost_s)} of computing on {count_workers(how.executor)} cores"
        )

    def _remarks(self) -> list[str]:
        lines = [
            "simulated, linear gel, the planner's own: a test of flow, fit and statistics, not of "
            "the gel; --gel hyperelastic presses another"
            if self.gel == "linear"
            else f"simulated, {self.gel} gel; the plan is by the linear one"
        ]
        if self.request.protocol.specimen.prony:
            lines.append("the gel does not creep, as the specimen does")
        return lines

    def _with_images(self, k: int) -> tuple[int, ...]:
        """Sensors for which the press number k is tracked in images."""
        return tuple(n for n in self.sensors if n <= POOL_SENSORS or (n + k) % IMAGE_EVERY == 0)

    def _job(self, k: int, name: str) -> GridJob:
        request, with_images = self.request, self._with_images(k)
        cost_s = IMAGES_COST_S * len(with_images) + NOISE_COST_S * len(self.sensors)
        arguments = PressSensors(
            request.protocol, name, request.design, self.rig, str(request.rig_path), self.gel,
            request.recipe, with_images, self.sensors,
        )  # fmt: skip
        return GridJob(name, measure_sensors, arguments, GELS_COST_S + cost_s)
