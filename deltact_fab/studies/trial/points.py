"""Points of one press of a plan on many drawn sensors: features and wrenches at settled stops."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from deltact_fab.bench import Protocol, RunEstimate, VirtualConfig, expand_protocol
from deltact_fab.common import Array, SolverError
from deltact_fab.estimate import FaceFlow, SensorModel, make_features
from deltact_fab.fabricate import PatternRecipe
from deltact_fab.physics import GelLevel
from deltact_fab.sensor import SensorDimensions

from ..plan.components import FORCE_MODEL
from ..study.stream import PressStream
from .flows import add_noise, settled_stops, track_stops, true_shifts_mm
from .gels import DrawnPress

POOL_SENSORS = 10  # by hand: sensors whose noise serves the others
FORCE_WIDTH_S = 0.2  # definition: width of the mean in `settled_wrenches`
_SECONDS_PER_HOUR = 3600.0  # definition


@dataclass(frozen=True)
class PressSensors:
    """Arguments of `measure_sensors`: a press, the sensors with images, and those without.

    source: of the rig file.
    """

    protocol: Protocol
    press: str
    sensor: SensorDimensions
    rig: VirtualConfig
    source: str
    level: GelLevel
    recipe: PatternRecipe
    with_images: tuple[int, ...]
    without: tuple[int, ...]


@dataclass(frozen=True)
class StopPoints:
    """Features (n, k), and wrenches (n, 6) in N and N mm, at settled stops in contact or at rest.

    pressed: mask (n,) of those in contact.
    """

    features: Array
    wrench: Array
    pressed: Array


def measure_sensors(job: PressSensors) -> dict[str, dict[int, StopPoints]]:
    """Measure a press on sensors: points by number, of "images" and of "noise".

    The noise is that of a sensor with images, drawn from the first POOL_SENSORS. Raises SolverError
    and InputError where the gel cannot be solved.
    """
    press = DrawnPress(
        job.protocol, job.press, job.sensor, job.rig, Path(job.source), job.level
    )  # fmt: skip
    points: dict[str, dict[int, StopPoints]] = {"images": {}, "noise": {}}
    pool: dict[int, tuple[list[FaceFlow], list[Array]]] = {}
    for number in job.with_images:
        stream = press.on_sensor(number)
        flows = track_stops(stream, job.recipe, number)
        if len(pool) < POOL_SENSORS:
            pool[number] = flows, true_shifts_mm(stream)
        points["images"][number] = _points(press, stream, number, flows)
    for number in job.without:
        stream = press.on_sensor(number)
        # One donor for all presses: what its print and camera do to all is fitted.
        donors = [n for n in pool if n != number]
        noise = pool[int(np.random.default_rng(number).choice(donors))]
        flows = add_noise(true_shifts_mm(stream), *noise)
        points["noise"][number] = _points(press, stream, number, flows)
    return points


def _points(
    press: DrawnPress, stream: PressStream, number: int, flows: Sequence[FaceFlow]
) -> StopPoints:
    """Compute features of flows, and what the force sensor measures at their stops."""
    specimen, skin = press.protocol.specimen, press.sensor.skin
    features = make_features(FORCE_MODEL, SensorModel(stream.view, skin, specimen.poisson))
    virtual, force = press.rig.virtual, press.rig.force
    assert force is not None, "required of the rig of a force calibration"
    scatter_n = virtual.force.noise_n / np.sqrt(max(FORCE_WIDTH_S * force.rate_hz, 1.0))
    rng = np.random.default_rng([number, 1, *press.press.encode()])
    gain_per_s = (virtual.drift.force_gain_per_h if virtual.drift else 0.0) / _SECONDS_PER_HOUR
    steps = expand_protocol(press.protocol)
    ends_s = RunEstimate.planned_ends_s(steps, press.rig.stage)[1:]
    times_s = dict(zip((step.id for step in steps), ends_s, strict=True))
    rows, wrenches, pressed = [], [], []
    for flow, (moment, kind) in zip(flows, settled_stops(stream).items(), strict=True):
        if not flow.trusted:
            continue
        with suppress(SolverError):
            rows.append(features.compute(flow))
            true = stream.wrench(moment) * (1 + gain_per_s * times_s[moment.step])
            wrenches.append(true + scatter_n * rng.standard_normal(6))
            pressed.append(kind != "travel")
    return StopPoints(
        np.array(rows).reshape(-1, len(features.names)),
        np.array(wrenches).reshape(-1, 6),
        np.array(pressed, bool),
    )
