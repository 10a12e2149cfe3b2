"""Virtual time and its one scheduler."""

from __future__ import annotations

import numpy as np
import pytest

from deltact_fab.simulate.virtual.clock import VirtualClock


def test_each_tick_fires_once_on_time() -> None:
    clock = VirtualClock(3.0)
    seen: list[int] = []
    clock.schedule(7000.0, lambda t_ns: seen.extend(t_ns.tolist()))
    for step_s in (0.1, 1e-9, 0.00015, 0.5, 0.39984999):
        clock.sleep_s(step_s)
        assert not seen or seen[-1] <= clock.now_ns()
    assert seen == [3 * 10**9 + round(k * 1e9 / 7000) for k in range(1, 7000)]


def test_ticks_are_ordered_by_time() -> None:
    clock = VirtualClock()
    seen: list[int] = []
    batches = []

    def note(t_ns: np.ndarray) -> None:
        seen.extend(t_ns.tolist())
        batches.append(len(t_ns))

    clock.schedule(1000.0, note)
    clock.schedule(30.0, note)
    slow = clock.schedule(400.0, note)
    clock.sleep_s(0.5)
    assert seen == sorted(seen)
    assert len(seen) == 500 + 15 + 200
    slow.cancel()
    clock.sleep_s(0.01)
    assert len(seen) == 715 + 10
    assert max(batches) > 1


def test_failing_tick_loses_no_other() -> None:
    clock = VirtualClock()
    seen: list[int] = []

    def fail(t_ns: np.ndarray) -> None:
        failing.cancel()
        clock.sleep_s(1.0)

    failing = clock.schedule(100.0, fail)
    clock.schedule(100.0, lambda t_ns: seen.extend(t_ns.tolist()))
    with pytest.raises(RuntimeError, match="cannot let time pass"):
        clock.sleep_s(0.05)
    assert clock.now_s() == 0.05
    clock.sleep_s(0.05)
    assert seen == [k * 10**7 for k in range(1, 11)]
