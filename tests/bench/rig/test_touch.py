"""The face is found by the force sensor: real host, real client, simulated controller and box."""

from __future__ import annotations

import re

import numpy as np
import pytest
from felt import Bench, bench
from numpy.typing import NDArray

from deltact_fab.bench.rig.config import load_rig
from deltact_fab.bench.rig.interface import move_to
from deltact_fab.bench.rig.run.streams import ForceStream, PoseStream
from deltact_fab.bench.rig.tables import TouchConfig
from deltact_fab.bench.rig.tool.touch import FaceTouch, fit_contact, tool_change_s
from deltact_fab.common.errors import SensorError
from deltact_fab.sensor.shapes.indenter import parse_indenter
from deltact_fab.simulate.virtual.clock import VirtualClock

HOST_MM = 0.5 / 60 * 30 * 0.03  # at the feed of the approach, in the time that a host takes
QUICK = TouchConfig(repeats=1)


def found(it: Bench, name: str, config: TouchConfig = QUICK) -> FaceTouch:
    """From above the face, as after a change of indenter."""
    it.stage.start_move((0.0, 0.0, 10.0), 1200)
    it.stage.wait()
    return it.touch(config).find(parse_indenter(name), config.at_mm)


@pytest.mark.parametrize(
    ("name", "noise_n", "longer_mm"),
    [
        ("sphere:10", 0.018, 2.0),
        pytest.param("cylinder", 0.01, -2.0, marks=pytest.mark.slow),
        pytest.param("4dots", 0.018, -2.0, marks=pytest.mark.slow),
    ],
)
def test_height_error_below_a_fiftieth(name: str, noise_n: float, longer_mm: float) -> None:
    it = bench(name, (0.0, 0.0, 0.3), longer_mm, noise_n)
    touch = found(it, name)
    assert touch.z_mm == pytest.approx(0.3 + longer_mm, abs=0.02)
    assert touch.noise_n == pytest.approx(noise_n, rel=0.3)
    # Never deeper than it takes to feel the threshold, a few steps, and the way to a stop.
    contact = next(
        d for d in np.arange(0, 1, 1e-3)
        if -it.face.wrench((-60.0, -60.0, -39.7 + longer_mm - d))[2] > 0.1
    )  # fmt: skip
    braking_mm = (30 / 60) ** 2 / (2 * 50)
    assert it.face.deepest_mm < contact + braking_mm + HOST_MM + 0.03
    assert it.stage.position_mm()[2] == pytest.approx(10.0, abs=0.002)


@pytest.mark.parametrize(("x_mm", "y_mm"), [(3.0, -2.0), (-4.0, 5.0)])
def test_torque_is_arm_times_force(x_mm: float, y_mm: float) -> None:
    face = bench("sphere:10", homed=False).face
    wrench = face.wrench((-60.0 + x_mm, -60.0 + y_mm, -41.0))
    assert wrench[2] < -1.0
    assert wrench[3:] == pytest.approx(np.cross((x_mm, y_mm, 0.0), wrench[:3]))


@pytest.mark.slow
def test_repeats_are_compared_with_guard_active() -> None:
    it = bench("sphere:10")
    touch = found(it, "sphere:10", TouchConfig(repeats=3))
    assert (touch.repeats, touch.by) == (3, "force")
    assert 0 < touch.spread_mm < 0.02
    assert touch.most_n is not None
    assert 0.1 < touch.most_n < 0.3
    assert "3 touches within" in touch.line()


def fails(it: Bench, config: TouchConfig = QUICK, name: str = "sphere:10") -> str:
    """What it says; the tip is lifted then."""
    with pytest.raises(SensorError) as why:
        found(it, name, config)
    text = str(why.value)
    assert "\n" not in text
    assert re.search(r"the tip was lifted by \d+\.\d\d mm, force 0\.\d\d N$", text)
    assert it.stage.position_mm()[2] >= 9.998
    return text


@pytest.mark.slow
def test_search_never_leaves_its_range() -> None:
    it = bench("sphere:10", longer_mm=-3.5)
    assert "no contact down to 3 mm below" in fails(it)
    assert it.lowest_mm() == pytest.approx(-43.0, abs=0.002)


def test_contact_above_range_is_too_early() -> None:
    it = bench("sphere:10", longer_mm=4.0)
    assert "above the expected height, more than touch.search_mm = 3" in fails(it)
    assert it.face.deepest_mm < 0.4


def test_noise_over_threshold_refused_before_descent() -> None:
    it = bench("sphere:10", noise_n=0.05)
    text = fails(it)
    assert "the sensor's noise is 0.05" in text
    assert "at least 0.2" in text
    assert it.lowest_mm() == pytest.approx(-30.0, abs=0.002)


@pytest.mark.slow
def test_loose_tool_is_found_by_spread(monkeypatch: pytest.MonkeyPatch) -> None:
    it = bench("sphere:10")
    touch = it.touch(TouchConfig(repeats=2))
    once = touch._step_down
    lengths = iter((0.0, 0.08))

    def slips(*words: object) -> object:
        it.face.mount("sphere:10", next(lengths))
        return once(*words)  # type: ignore[arg-type]

    monkeypatch.setattr(touch, "_step_down", slips)
    with pytest.raises(SensorError, match=r"2 touches differ by 0\.0[78]\d mm, .* loose"):
        touch.find(parse_indenter("sphere:10"), (0.0, 0.0))
    assert it.stage.position_mm()[2] > 5


def test_guard_trips_during_touch() -> None:
    it = bench("sphere:10", guard_n=0.08)
    assert "over the guard's 0.08 N" in fails(it, TouchConfig(repeats=1, force_n=0.1))
    assert it.guard.tripped


@pytest.mark.slow
def test_wrong_sensor_axes_are_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    it = bench("sphere:10")
    wrenches = it.box._wrenches
    monkeypatch.setattr(it.box, "_wrenches", lambda t_ns: -wrenches(t_ns))
    assert "does not press along -z" in fails(it)


def test_sensor_failure_stops_the_approach() -> None:
    it = bench("sphere:10")
    dead_s = it.clock.now_s() + 9.0
    receive = it.force._link.receive
    it.force._link.receive = (  # type: ignore[method-assign]
        lambda timeout_s: (
            receive(timeout_s)[:0] if it.clock.now_s() > dead_s else receive(timeout_s)
        )
    )
    with pytest.raises(SensorError, match=r"raised by .* contact unknown: no force reading"):
        found(it, "sphere:10")
    moved_after = [s for s in it.grbl.segments if s.start_ns / 1e9 > dead_s + 1.0]
    assert all(s.end_mm[2] >= s.start_mm[2] for s in moved_after)


def test_fit_of_clean_curves_is_exact() -> None:
    z = np.arange(0.3, -0.2, -0.01)
    for power, powers in ((1.5, (1.5,)), (1.0, (1.0, 1.25, 1.5))):
        force = 0.02 + 3.0 * np.maximum(0.0371 - z, 0) ** power
        contact = fit_contact(z.tolist(), force.tolist(), powers)
        assert contact.z_mm == pytest.approx(0.0371, abs=2e-5)
        assert contact.power == power


@pytest.mark.parametrize("rate_hz", [10.0, 80.0, 1000.0])
def test_duration_matches_the_estimate(rate_hz: float) -> None:
    it, config = bench("cylinder", rate_hz=rate_hz), TouchConfig(feed_mm_min=60.0)
    move_to(it.stage, (0.0, 0.0, 10.0), 600.0)
    start_s = it.clock.now_s()
    it.touch(config).find(parse_indenter("cylinder"), (0.0, 0.0))
    told_s = tool_change_s(load_rig("virtual")[0].stage, config, 10.0, 1 / rate_hz)
    assert told_s == pytest.approx(it.clock.now_s() - start_s, rel=0.1)


@pytest.mark.parametrize(
    ("delay_s", "off_mm"), [((0.06, 0.03), 0.0), ((0.12, 0.03), -0.2), ((0.2, 0.03), 0.0)]
)
def test_slow_link_goes_no_deeper(delay_s: tuple[float, float], off_mm: float) -> None:
    """The threshold is 0.11 mm deep; without a look in each part of a move it was up to 0.5 mm."""
    it = bench("sphere:10", (0.0, 0.0, off_mm), delay_s=delay_s)
    touch = found(it, "sphere:10")
    assert touch.z_mm == pytest.approx(off_mm, abs=0.01)
    assert it.face.deepest_mm < 0.2


@pytest.mark.parametrize(
    ("delay_s", "rate_hz", "says"), [((0.12, 0.03), 1000.0, r"[56]\d"), ((0.0, 0.0), 8.0, r"10\d")]
)
def test_slow_answers_refused_before_descent(
    delay_s: tuple[float, float], rate_hz: float, says: str
) -> None:
    it = bench("sphere:10", delay_s=delay_s, rate_hz=rate_hz)
    text = fails(it, TouchConfig(repeats=1, feed_mm_min=120.0))
    assert re.search(rf"deeper at touch.feed_mm_min = 120; set at most {says},", text)
    assert it.lowest_mm() == pytest.approx(-30.0, abs=0.002)


def test_old_samples_stop_the_descent() -> None:
    it = bench("sphere:10")
    it.force._timeout_s = 1.0
    receive, late_s = it.force._link.receive, it.clock.now_s() + 9.0

    def late(timeout_s: float) -> NDArray[np.void]:
        it.box.faults.late_s = 0.3 * (it.clock.now_s() > late_s)
        return receive(timeout_s)

    it.force._link.receive = late  # type: ignore[method-assign]
    assert "the newest force sample is 0.30 s old, 0.05 s are allowed" in fails(it)
    assert it.lowest_mm() > -40.0


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
