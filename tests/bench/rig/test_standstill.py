"""Readings that stand still: told for every sensor, and no false stop in an hour of coarse ones."""

from __future__ import annotations

import itertools
from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from deltact_fab.bench.rig.force.netft import NetFTSensor
from deltact_fab.bench.rig.force.scale import SerialScale
from deltact_fab.bench.rig.force.standstill import UNFELT_MM, DepthCheck
from deltact_fab.bench.rig.interface import ForceSamples
from deltact_fab.bench.rig.tables import ForceConfig
from deltact_fab.common.errors import SensorError
from deltact_fab.simulate.virtual.clock import VirtualClock
from deltact_fab.simulate.virtual.fault_bench import ScalePort
from deltact_fab.simulate.virtual.netft import LockstepLink, NetFTBox

N_PER_GRAM = 9.80665e-3
SOFT_N = 0.25  # N / mm^1.5: a ball of 4 mm in a gel of 0.1 MPa
POSE_S, BLOCK_S = 0.1, 1.0
Depth = Callable[[NDArray[np.float64]], NDArray[np.float64]]


def cell(clock: VirtualClock, rate_hz: float, noise_g: float, depth_mm: Depth) -> ScalePort:
    """A load cell of 1 g with noise behind a soft gel; half a gram off, the worst place."""
    draw = np.random.default_rng(1)

    def load_n(t_ns: NDArray[np.int64]) -> NDArray[np.float64]:
        noise_g_now = noise_g * draw.standard_normal(len(t_ns)) + 0.5
        return -SOFT_N * depth_mm(t_ns / 1e9) ** 1.5 + noise_g_now * N_PER_GRAM

    return ScalePort(clock, load_n, rate_hz)


def presses(feed_mm_min: float, to_mm: float = 1.0, hold_s: float = 60.0) -> Depth:
    """From 0.5 mm above the face down, a hold, up, a rest, and so on."""
    down_s = (to_mm + 0.5) / feed_mm_min * 60
    times = np.cumsum([5.0, down_s, hold_s, down_s, 5.0])

    def depth_mm(t_s: NDArray[np.float64]) -> NDArray[np.float64]:
        z_mm = np.interp(t_s % times[-1], times, [-0.5, to_mm, to_mm, -0.5, -0.5])
        return np.maximum(z_mm, 0.0)

    return depth_mm


def rest(t_s: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.zeros_like(t_s)


def stop_s(
    rate_hz: float, noise_g: float, depth_mm: Depth, stuck_s: float = np.inf, hours: float = 1.0
) -> float | None:
    """Time of the stop, by the driver and the check of a run; None without one."""
    clock = VirtualClock()
    port = cell(clock, rate_hz, noise_g, depth_mm)
    port.stuck = stuck_s == 0
    table = {"serial": {"port": "p", "unit": "g"}}
    sensor = SerialScale(ForceConfig.model_validate(table), clock, port)
    check = DepthCheck()
    sensor.begin("p1")
    end_s = clock.now_s() + 3600 * hours
    try:
        while clock.now_s() < end_s:
            port.stuck = clock.now_s() >= stuck_s
            times_s = clock.now_s() + np.arange(0, BLOCK_S, POSE_S)
            clock.sleep_s(BLOCK_S)
            check.watch(sensor.read())
            for t_s, mm in zip(times_s, depth_mm(times_s), strict=True):
                check.check(int(t_s * 1e9), -float(mm))
    except SensorError:
        return clock.now_s()
    return None


HOURS = [
    (rate_hz, noise_g, motion)
    for rate_hz, noise_g in itertools.product((10.0, 80.0), (0.0, 0.3, 1.0))
    for motion in ("rest", "3", "10")
]


@pytest.mark.parametrize(
    ("rate_hz", "noise_g", "motion"),
    [pytest.param(*h, marks=() if h == (10.0, 0.0, "3") else pytest.mark.slow) for h in HOURS],
)
def test_coarse_scale_runs_an_hour(rate_hz: float, noise_g: float, motion: str) -> None:
    depth_mm = rest if motion == "rest" else presses(float(motion))
    assert stop_s(rate_hz, noise_g, depth_mm) is None


@pytest.mark.parametrize("rate_hz", [10.0, 80.0])
@pytest.mark.parametrize("stuck_s", [0.0, 18.0])  # from the start; in the gel
def test_stuck_scale_stops_the_next_press(rate_hz: float, stuck_s: float) -> None:
    depth_mm = presses(3.0)
    at_s = stop_s(rate_hz, 0.3, depth_mm, stuck_s)
    assert at_s is not None
    from_mm, to_mm = depth_mm(np.array([stuck_s, at_s]))
    assert UNFELT_MM < to_mm - from_mm < UNFELT_MM + 0.2


def box(fault: str = "", noise_n: float = 0.01) -> tuple[NetFTSensor, NetFTBox, VirtualClock]:
    clock = VirtualClock()
    made = NetFTBox(ForceConfig(), clock, 1, lambda t_ns: np.zeros((len(t_ns), 6)), noise_n)
    sensor = NetFTSensor(LockstepLink(made), clock)
    if fault:
        setattr(made.faults, fault, True)
    return sensor, made, clock


def read_for(sensor: NetFTSensor, clock: VirtualClock, seconds: float) -> float:
    """Read each 10 ms; the time of the last one."""
    end_s = clock.now_s() + seconds
    while clock.now_s() < end_s:
        clock.sleep_s(0.01)
        sensor.read()
    return clock.now_s()


@pytest.mark.parametrize(
    ("fault", "says", "within_s"),
    [("frozen", "the FT sequence stands at ", 0.03), ("stuck", "all axes equal for 0.1", 0.13)],
)
@pytest.mark.parametrize("before", [False, True])
def test_frozen_box_is_a_fault(fault: str, says: str, within_s: float, before: bool) -> None:
    sensor, made, clock = box(fault if before else "")
    sensor.begin("p1")
    if not before:
        read_for(sensor, clock, 1.0)
        setattr(made.faults, fault, True)
    since_s = clock.now_s()
    with pytest.raises(SensorError, match=says):
        read_for(sensor, clock, 1.0)
    assert clock.now_s() - since_s < within_s
    setattr(made.faults, fault, False)
    sensor.start()
    assert len(sensor.read().t_ns)


def test_quiet_box_is_no_fault() -> None:
    for noise_n in (0.0, 1e-7, 0.01):
        sensor, _, clock = box(noise_n=noise_n)
        sensor.begin("p1")
        read_for(sensor, clock, 20.0)


def test_fine_scale_must_not_stand() -> None:
    at_s = stop_s(400.0, 50.0, rest, 5.0, 0.01)
    assert at_s is not None
    assert 5.3 < at_s < 8.0


def samples(values: list[int], first_s: float) -> ForceSamples:
    t_ns = ((first_s + 0.1 * np.arange(len(values))) * 1e9).astype(np.int64)
    counts = np.zeros((len(values), 6), np.int32)
    counts[:, 2] = values
    return ForceSamples(t_ns, counts, np.ones(6), np.zeros(len(values), bool))


@pytest.mark.parametrize(("change", "stops"), [(False, True), (True, False)])
def test_one_change_clears_the_depth(change: bool, stops: bool) -> None:
    check = DepthCheck()
    check.watch(samples([7] * 30 + [8 if change else 7] * 30, 0.0))
    stopped = False
    for k in range(60):
        try:
            check.check(int(1e8 * k), -0.011 * k + 0.1)
        except SensorError:
            stopped = True
    assert stopped == stops
