"""The newest force and the stamps of positions, on the simulated bench in virtual time."""

from __future__ import annotations

import pytest
from felt import bench

from deltact_fab.bench.rig.run.streams import ForceStream, PoseStream
from deltact_fab.common.errors import StageError
from deltact_fab.simulate.virtual.clock import VirtualClock


@pytest.mark.parametrize(("rate_hz", "old_s"), [(1000.0, 0.06), (10.0, 0.16)])
def test_old_force_is_not_shown(rate_hz: float, old_s: float) -> None:
    it = bench(homed=False, rate_hz=rate_hz)
    it.force.start()
    stream = ForceStream(it.force, None, lambda name, text: None)
    for _ in range(3):
        stream.step()
    assert stream.newest_n(it.clock.now_ns()) is not None
    it.clock.sleep_s(old_s - 0.02)
    assert stream.newest_n(it.clock.now_ns()) is not None
    it.clock.sleep_s(0.02)
    assert stream.newest_n(it.clock.now_ns()) is None
    stream.step()
    assert stream.newest_n(it.clock.now_ns()) is not None


def test_position_of_the_future_is_refused() -> None:
    """Of a stage on another clock than its stream."""
    it = bench()
    late = VirtualClock(it.clock.now_s() - 0.3)
    with pytest.raises(StageError, match=r"position: a stamp 0\.30\d s later than its arrival"):
        PoseStream(it.stage, late).step()
    PoseStream(it.stage, it.clock).step()
