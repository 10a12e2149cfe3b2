"""The real Net F/T client on the simulated box."""

from __future__ import annotations

import struct

import numpy as np
import pytest

from deltact_fab.errors import SensorError
from deltact_fab.rig.config import ForceConfig
from deltact_fab.rig.force import RECORD, NetFTSensor
from deltact_fab.virtual.clock import VirtualClock
from deltact_fab.virtual.netft import NetFTBox, Wrench


class Hand:
    """A force that the test sets."""

    def __init__(self) -> None:
        self.wrench: Wrench = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))

    def __call__(self) -> Wrench:
        return self.wrench


def bench(noise_n: float = 0.0) -> tuple[NetFTSensor, NetFTBox, Hand, VirtualClock]:
    hand, clock = Hand(), VirtualClock()
    box = NetFTBox(ForceConfig(), clock, 1, hand, noise_n)
    return NetFTSensor(box, clock), box, hand, clock


def test_a_record_is_36_bytes_and_carries_newtons_and_signs() -> None:
    sensor, _, hand, clock = bench()
    hand.wrench = ((1.25, -0.5, -3.0), (2.0, -4.0, 0.125))
    clock.sleep_s(1.0)
    reading = sensor.read()
    assert RECORD.size == 36
    assert reading.force_n == pytest.approx((1.25, -0.5, -3.0), abs=1e-6)
    assert reading.torque_nmm == pytest.approx((2.0, -4.0, 0.125), abs=1e-5)
    assert not reading.saturated


def test_bias_takes_away_what_pulls_when_nothing_touches() -> None:
    sensor, _, hand, _ = bench()
    hand.wrench = ((0.3, 0.0, -0.2), (0.0, 0.0, 0.0))
    sensor.begin("p1")
    hand.wrench = ((0.3, 0.0, -2.2), (0.0, 0.0, 0.0))
    assert sensor.read().force_n == pytest.approx((0.0, 0.0, -2.0), abs=1e-6)


def test_out_of_range_is_flagged_and_clipped_as_the_box_does() -> None:
    sensor, _, hand, _ = bench()
    hand.wrench = ((0.0, 0.0, -50.0), (0.0, 0.0, 0.0))
    reading = sensor.read()
    assert reading.saturated
    assert reading.force_n[2] == pytest.approx(-35.0)


def test_noise_has_the_stated_size() -> None:
    sensor, _, _, clock = bench(noise_n=0.02)
    samples = []
    for _ in range(2000):
        clock.sleep_s(0.001)
        samples.append(sensor.read().force_n)
    assert np.std(samples) == pytest.approx(0.02, rel=0.05)


def test_silence_takes_the_time_out_and_is_an_error() -> None:
    sensor, box, _, clock = bench()
    box.send = lambda command: None  # type: ignore[method-assign]
    before = clock.now_s()
    with pytest.raises(SensorError, match="no sample within 50 ms"):
        sensor.read()
    assert clock.now_s() - before == pytest.approx(0.05)


def test_a_stale_or_short_record_is_an_error() -> None:
    sensor, box, _, _ = bench()
    sensor.read()
    box.receive = lambda timeout_s: struct.pack(">9i", 1, 1, 0, 0, 0, 0, 0, 0, 0)  # type: ignore[method-assign]
    with pytest.raises(SensorError, match="stale"):
        sensor.read()
    box.receive = lambda timeout_s: b"\0" * 20  # type: ignore[method-assign]
    with pytest.raises(SensorError, match="20 bytes"):
        sensor.read()


def test_the_largest_sensor_and_the_most_noise_fit_into_a_record() -> None:
    hand = Hand()
    most = ForceConfig(range_n=(1e5, 1e5, 1e5), range_nmm=(1e7, 1e7, 1e7))
    sensor = NetFTSensor(NetFTBox(most, VirtualClock(), 1, hand, 100.0), VirtualClock())
    hand.wrench = ((-2e5, 0.0, 0.0), (0.0, 0.0, 0.0))  # on the bias as well
    sensor.begin("press")
    hand.wrench = ((2e5, 0.0, -9e4), (0.0, 3e7, -8e6))
    reading = sensor.read()
    assert reading.saturated
    assert reading.force_n[2] == pytest.approx(-9e4, abs=1e3)
    assert reading.torque_nmm[2] == pytest.approx(-8e6, abs=1e4)
