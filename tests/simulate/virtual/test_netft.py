"""The real Net F/T client on the simulated box, which streams at its own rate in virtual time."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from deltact_fab.bench.rig.force.netft import NetFTSensor, NetFTSettings
from deltact_fab.bench.rig.tables import ForceConfig
from deltact_fab.common.errors import SensorError, SolverError
from deltact_fab.simulate.virtual.clock import VirtualClock
from deltact_fab.simulate.virtual.netft import (
    BOX_RECORD,
    COMMAND_HEADER,
    RDT_COMMAND,
    STREAM_COMMAND,
    LockstepLink,
    NetFTBox,
)


class Hand:
    """A wrench that the test sets, and that grows by so much a second."""

    def __init__(self) -> None:
        self.wrench = np.zeros(6)
        self.growth = np.zeros(6)

    def __call__(self, t_ns: NDArray[np.int64]) -> NDArray[np.float64]:
        return np.asarray(self.wrench + t_ns[:, None] / 1e9 * self.growth)


def bench(
    noise_n: float = 0.0, rate_hz: float = 1000.0
) -> tuple[NetFTSensor, NetFTBox, Hand, VirtualClock]:
    hand, clock = Hand(), VirtualClock()
    box = NetFTBox(ForceConfig(rate_hz=rate_hz), clock, 1, hand, noise_n)
    return NetFTSensor(LockstepLink(box), clock), box, hand, clock


def test_record_has_36_bytes_and_signs() -> None:
    sensor, _, hand, _ = bench()
    hand.wrench = np.array([1.25, -0.5, -3.0, 2.0, -4.0, 0.125])
    sensor.start()
    samples = sensor.read()
    assert BOX_RECORD.itemsize == 36
    assert samples.force_n[-1] == pytest.approx((1.25, -0.5, -3.0), abs=1e-6)
    assert samples.torque_nmm[-1] == pytest.approx((2.0, -4.0, 0.125), abs=2e-5)
    assert not samples.saturated.any()


@pytest.mark.parametrize("rate_hz", [1000.0, 700.0])
def test_each_sample_arrives_once_with_time(rate_hz: float) -> None:
    sensor, _, hand, clock = bench(rate_hz=rate_hz)
    hand.growth = np.array([0.0, 0.0, -2.0, 0.0, 0.0, 0.0])
    clock.sleep_s(0.4321)
    sensor.start()
    parts = []
    for wait_s in (0.0, 0.0123, 0.2, 1e-5, 0.7):
        clock.sleep_s(wait_s)
        parts.append(sensor.read())
        assert parts[-1].t_ns[-1] == clock.now_ns()  # the last one was waited for
        assert parts[-1].n_lost == 0
    t_ns = np.concatenate([part.t_ns for part in parts])
    assert len(t_ns) == pytest.approx(0.9123 * rate_hz, abs=6)
    assert np.abs(np.diff(t_ns) - 1e9 / rate_hz).max() <= 1
    fz_n = np.concatenate([part.force_n[:, 2] for part in parts])
    assert fz_n == pytest.approx(-2.0 * t_ns / 1e9, abs=2e-6)


def test_out_of_range_is_flagged_clipped() -> None:
    sensor, _, hand, clock = bench()
    hand.growth = np.array([0.0, 0.0, -50.0, 0.0, 0.0, 0.0])
    sensor.start()
    clock.sleep_s(0.8)
    samples = sensor.read()
    over = samples.t_ns > 0.7e9  # 35 N
    assert (samples.saturated == over).all()
    assert over.any()
    assert samples.force_n[over, 2] == pytest.approx(-35.0)


def test_noise_size_is_independent_of_reads() -> None:
    runs = []
    for pause_s in (2.0, 0.017):
        sensor, box, _, clock = bench(noise_n=0.02)
        box.reseed("7")
        sensor.start()
        parts = []
        while clock.now_s() < 2.0:
            clock.sleep_s(pause_s)
            parts.append(sensor.read().counts)
        runs.append(np.concatenate(parts)[:1900])
    assert np.array_equal(*runs)
    assert np.std(runs[0][:, :3] / 1e6) == pytest.approx(0.02, rel=0.05)


def test_lost_datagrams_are_counted() -> None:
    sensor, box, _, clock = bench()
    sensor.start()
    sensor.read()
    clock.sleep_s(0.02)
    for _ in range(3):
        box.receive(0.0)
    samples = sensor.read()
    assert samples.n_lost == 3
    assert np.diff(samples.t_ns).max() == 1_000_000
    assert samples.t_ns[-1] == clock.now_ns()
    clock.sleep_s(0.1)
    for _ in range(60):
        box.receive(0.0)
    with pytest.raises(SensorError, match="60 samples lost in a row"):
        sensor.read()


def test_scene_errors_reach_the_reader() -> None:
    sensor, box, _, clock = bench()
    sensor.start()

    def unsolved(t_ns: NDArray[np.int64]) -> NDArray[np.float64]:
        raise SolverError("no convergence")

    sensor.read()
    box._wrenches = unsolved
    clock.sleep_s(0.5)  # the host sleeps on, whatever becomes of the gel
    with pytest.raises(SolverError, match="no convergence"):
        sensor.read()


def test_faulty_box_sends_no_counts() -> None:
    _, box, hand, clock = bench()
    hand.wrench[:] = 1.0
    box.faults.error = True
    box.send(RDT_COMMAND.pack(COMMAND_HEADER, STREAM_COMMAND, 0))
    clock.sleep_s(0.01)
    data = box.receive(0.0)
    assert data is not None
    (record,) = np.frombuffer(data.payload, BOX_RECORD)
    assert record["status"] & 0x80000000
    assert not record["counts"].any()


def test_datagrams_in_flight_are_dropped() -> None:
    sensor, _, _, clock = bench()
    sensor.start()
    clock.sleep_s(0.1)
    sensor.stop()
    sensor.start()
    assert len(sensor.read().t_ns) == 1  # nothing of the stream before


def test_largest_sensor_fits_a_record() -> None:
    hand, clock = Hand(), VirtualClock()
    most = ForceConfig(range_n=(1e5, 1e5, 1e5), range_nmm=(1e7, 1e7, 1e7))
    sensor = NetFTSensor(LockstepLink(NetFTBox(most, clock, 1, hand, 100.0)), clock)
    hand.wrench = np.array([-2e5, 0, 0, 0, 0, 0])  # on the bias as well
    sensor.begin("press")
    hand.wrench = np.array([2e5, 0, -9e4, 0, 3e7, -8e6])
    clock.sleep_s(0.01)
    samples = sensor.read()
    assert samples.saturated[-1]
    assert samples.force_n[-1, 2] == pytest.approx(-9e4, abs=1e3)
    assert samples.torque_nmm[-1, 2] == pytest.approx(-8e6, abs=1e4)


class OffQuartz(LockstepLink):
    """A box that states the nominal rate and streams at its quartz's own."""

    def settings(self) -> NetFTSettings:
        return replace(super().settings(), rate_hz=1000.0)


@pytest.mark.parametrize("ppm", [-100, 100])
def test_sample_times_follow_clock_drift(ppm: int) -> None:
    clock = VirtualClock()
    box = NetFTBox(ForceConfig(rate_hz=1000.0 * (1 + ppm / 1e6)), clock, 1, Hand(), 0.0)
    sensor = NetFTSensor(OffQuartz(box), clock)
    sensor.start()
    for _ in range(30):
        clock.sleep_s(1.0)
        samples = sensor.read()
    # By the number in the stream alone it would be 3 ms off by now.
    assert samples.t_ns[-1] == pytest.approx(clock.now_ns(), abs=0.3e6)
    assert samples.n_late == 0


def test_earlier_tie_keeps_time_monotonic() -> None:
    """All that came so far came late."""
    sensor, box, _, clock = bench()
    box.faults.late_s = 0.03
    sensor.start()
    parts = []
    for wait_s in (0.1, 0.05, 0.05):
        clock.sleep_s(wait_s)
        parts.append(sensor.read())
        box.faults.late_s = 0.0
    t_ns = np.concatenate([part.t_ns for part in parts])
    assert (np.diff(t_ns) > 0).all()
    assert t_ns[-1] == clock.now_ns()
