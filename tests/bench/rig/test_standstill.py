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
from deltact_fab.simulate.virtual.netft import LockstepLink, NetFTBox

N_PER_GRAM = 9.80665e-3
SOFT_N = 0.25  # N / mm^1.5: a ball of 4 mm in a gel of 0.1 MPa
POSE_S, BLOCK_S = 0.1, 1.0
Depth = Callable[[NDArray[np.float64]], NDArray[np.float64]]


class Port:
    """Port of a load cell of 1 g in virtual time. depth_mm, noise_g: what it feels."""

    def __init__(
        self, clock: VirtualClock, rate_hz: float, noise_g: float, depth_mm: Depth
    ) -> None:
        self.clock, self.noise_g, self.depth_mm = clock, noise_g, depth_mm
        self.draw, self.data = np.random.default_rng(1), b""
        self.stuck_s = np.inf
        self.ticks = clock.schedule(rate_hz, self.write)

    @property
    def in_waiting(self) -> int:
        return len(self.data)

    def read(self, size: int) -> bytes:
        if not self.data:
            self.clock.advance_to_ns(self.ticks.next_ns)
        data, self.data = self.data, b""
        return data

    def reset_input_buffer(self) -> None:
        self.data = b""

    def write(self, t_ns: NDArray[np.int64]) -> None:
        t_s = np.minimum(t_ns / 1e9, self.stuck_s)
        load_g = -SOFT_N / N_PER_GRAM * self.depth_mm(t_s) ** 1.5
        noise_g = self.noise_g * self.draw.standard_normal(len(t_s)) * (t_s < self.stuck_s)
        self.data += b"".join(b"%.0f g\n" % g for g in (load_g + noise_g + 0.5).tolist())


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


def stop_s(port: Port, rate_hz: float, hours: float = 1.0) -> float | None:
    """Time of the stop, by the driver and the check of a run; None without one."""
    table = {"serial": {"port": "p", "unit": "g"}}
    sensor = SerialScale(ForceConfig.model_validate(table), port.clock, port)
    check = DepthCheck()
    sensor.begin("p1")
    begin_s = port.clock.now_s()
    try:
        while port.clock.now_s() < begin_s + 3600 * hours:
            times_s = port.clock.now_s() + np.arange(0, BLOCK_S, POSE_S)
            port.clock.sleep_s(BLOCK_S)
            check.watch(sensor.read())
            for t_s, depth_mm in zip(times_s, port.depth_mm(times_s), strict=True):
                check.check(int(t_s * 1e9), -float(depth_mm))
    except SensorError:
        return port.clock.now_s()
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
def test_hour_of_coarse_scale_is_not_stopped(rate_hz: float, noise_g: float, motion: str) -> None:
    depth_mm = rest if motion == "rest" else presses(float(motion))
    assert stop_s(Port(VirtualClock(), rate_hz, noise_g, depth_mm), rate_hz) is None


@pytest.mark.parametrize("rate_hz", [10.0, 80.0])
@pytest.mark.parametrize("stuck_s", [0.0, 16.0])  # before the face, 0.1 mm below it
def test_stuck_scale_stops_the_next_press(rate_hz: float, stuck_s: float) -> None:
    port = Port(VirtualClock(), rate_hz, 0.3, presses(3.0))
    port.stuck_s = stuck_s
    felt_mm = float(port.depth_mm(np.array([min(stuck_s, 15.0 + 1e-9)]))[0])
    at_s = stop_s(port, rate_hz)
    assert at_s is not None
    gone_mm = float(port.depth_mm(np.array([at_s]))[0]) - felt_mm
    assert UNFELT_MM < gone_mm < UNFELT_MM + 0.2


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
    port = Port(VirtualClock(), 400.0, 50.0, rest)
    port.stuck_s = 5.0
    at_s = stop_s(port, 400.0, 0.01)
    assert at_s is not None
    assert 5.3 < at_s < 6.5


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
