"""The newest force and the stamps of positions, on the simulated bench in virtual time."""

from __future__ import annotations

import pytest
from felt import bench

from deltact_fab.bench.rig.run.streams import ForceStream, PoseStream
from deltact_fab.common.errors import SensorError
from deltact_fab.simulate.virtual.clock import VirtualClock


def test_old_force_is_not_shown() -> None:
    it = bench(homed=False, rate_hz=10.0)
    it.force.start()
    stream = ForceStream(it.force, None, lambda name, text: None)
    stream.step()
    assert stream.newest_n(it.clock.now_ns()) is not None
    it.clock.sleep_s(0.14)
    assert stream.newest_n(it.clock.now_ns()) is not None
    it.clock.sleep_s(0.02)
    assert stream.newest_n(it.clock.now_ns()) is None
    stream.step()
    assert stream.newest_n(it.clock.now_ns()) is not None


def test_position_of_the_future_is_refused() -> None:
    """Of a stage on another clock than its stream."""
    it = bench()
    late = VirtualClock(it.clock.now_s() - 0.3)
    with pytest.raises(SensorError, match=r"position: a stamp 0\.30\d s later than its"):
        PoseStream(it.stage, late).step()
    PoseStream(it.stage, it.clock).step()
