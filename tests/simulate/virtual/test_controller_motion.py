"""Trapezoids against their closed form; the carriage's path under holds and queues."""

from __future__ import annotations

import itertools
import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from deltact_fab.simulate.virtual.clock import VirtualClock
from deltact_fab.simulate.virtual.controller import GrblController
from deltact_fab.simulate.virtual.motion import Segment, brake, trapezoid

number = st.floats(-50, 50).map(lambda v: round(v, 3))
point = st.tuples(number, number, number)
speed = st.floats(0.02, 50)
accel = st.floats(1, 1000)


def ready(**limits: float) -> tuple[VirtualClock, GrblController]:
    """A homed controller, at (-1, -1, -1)."""
    clock = VirtualClock()
    own = {int(k[1:]): v for k, v in limits.items()}
    grbl = GrblController(own, clock, start_mm=(-1, -1, -1))
    clock.sleep_s(1)
    grbl.write(b"$H\n")
    clock.sleep_s(30)
    assert grbl.read_available().endswith(b"ok\r\n")
    return clock, grbl


@pytest.mark.parametrize(
    ("length", "duration"),
    [
        (100.0, 10.0 + 0.2),  # cruise at 10 mm/s: L/v + v/a
        (2.0, 0.4),  # just reaches 10 mm/s: 2 v/a
        (0.5, 0.2),  # triangle: 2 sqrt(L/a)
        (0.00125, 2 * math.sqrt(0.00125 / 50)),  # one step
    ],
)
def test_duration_is_the_closed_form(length: float, duration: float) -> None:
    move = trapezoid((0, 0, 0), (length, 0, 0), 10, 50, 0)
    assert move.end_ns == pytest.approx(duration * 1e9, abs=1.01)


@given(point, point, speed, accel)
def test_speed_and_acceleration_stay_within_limits(
    a: tuple[float, float, float], b: tuple[float, float, float], v: float, acc: float
) -> None:
    move = trapezoid(a, b, v, acc, 0)
    check_smooth(move, v, acc)
    assert move.position_mm(move.end_ns) == b


@given(point, point, speed, accel, st.floats(0, 1))
def test_braking_is_smooth_within_the_line(
    a: tuple[float, float, float], b: tuple[float, float, float], v: float, acc: float, when: float
) -> None:
    move = trapezoid(a, b, v, acc, 0)
    t = int(when * move.end_ns)
    ramp = brake(move, t)
    assert ramp.start_mm == move.cut(t).end_mm
    assert ramp.speed_mm_s(t) == pytest.approx(move.speed_mm_s(t), abs=1e-9)
    assert math.dist(a, ramp.end_mm) <= math.dist(a, b) + 1e-6
    check_smooth(ramp, v, acc)


def check_smooth(move: Segment, v: float, acc: float) -> None:
    """Finite differences over 200 steps: continuous, not faster than v, no harder than acc."""
    if move.end_ns - move.start_ns < 1_000_000:
        return
    ts = [move.start_ns + (move.end_ns - move.start_ns) * k // 200 for k in range(201)]
    at = [move.position_mm(t) for t in ts]
    # Speeds are means over a step, whose length is whole nanoseconds; positions round at 1e-14 mm.
    dt = [(q - p) / 1e9 for p, q in itertools.pairwise(ts)]
    mean = [math.dist(p, q) / h for (p, q), h in zip(itertools.pairwise(at), dt, strict=True)]
    noise = 1e-6 + 1e-12 / min(dt)
    assert max(mean) <= v + noise
    for (u, w), h in zip(itertools.pairwise(mean), dt, strict=False):
        assert abs(w - u) <= acc * h * (1 + 1e-5) + noise
    assert move.speed_mm_s(move.end_ns - 1) <= acc * 2e-9 + 1e-6 * v


def test_axis_limits_slow_a_diagonal_down() -> None:
    clock, grbl = ready(_112=300, _122=10)
    grbl.write(b"$J=X-31Y-1Z-41F1500\n")
    start = clock.now_s()
    planned = grbl.segments[-1]
    begin, t0, t1 = planned.start_mm, planned.start_ns / 1e9, planned.end_ns / 1e9
    assert (begin, planned.end_mm, t0) == ((-1, -1, -1), (-31, -1, -41), start)
    v, a = 5 / 0.8, 10 / 0.8  # Z takes 0.8 of the line: 300 mm/min = 5 mm/s and 10 mm/s2
    assert t1 - t0 == pytest.approx(50 / v + v / a, abs=2e-9)
    clock.sleep_s(3)
    assert math.dist(begin, grbl.position_mm()) == pytest.approx(v * 3 - v * v / a / 2)
    on_line = grbl.position_mm()
    assert (on_line[0] + 1) / 30 == pytest.approx((on_line[2] + 1) / 40)
    clock.sleep_s(10)
    assert grbl.position_mm() == planned.end_mm


@settings(max_examples=40, deadline=None)
@given(
    st.lists(
        st.tuples(
            st.sampled_from([b"$J=X-%dF900\n", b"$J=Z-%dF600\n", b"$J=Y-%dF1500\n"]),
            st.integers(0, 40),
            st.sampled_from([b"", b"", b"!", b"~", b"\x85", b"\x18", b"$X\n"]),
            st.floats(0, 3),
        ),
        max_size=12,
    )
)
def test_the_carriage_never_jumps(script: list[tuple[bytes, int, bytes, float]]) -> None:
    clock, grbl = ready()
    for line, target, extra, pause in script:
        grbl.write(line % target)
        clock.sleep_s(pause)
        grbl.write(extra)
    clock.sleep_s(30)
    path = grbl.segments
    for a, b in itertools.pairwise(path):
        assert a.end_mm == b.start_mm
        assert a.end_ns <= b.start_ns
    top = 25 * math.sqrt(2)
    for s in path:
        between = range(s.start_ns, s.end_ns, max((s.end_ns - s.start_ns) // 20, 1))
        assert all(s.speed_mm_s(t) <= top * (1 + 1e-9) for t in between)
        assert math.dist(s.position_mm(s.end_ns - 1), s.end_mm) <= top * 2e-9 + 1e-9
    assert not path or path[-1].end_mm == grbl.position_mm()


def test_switch_trips_on_approach_only() -> None:
    """The axis has coasted over its switch, on which it still stands after the next move."""
    clock, grbl = ready(_20=0, _21=1)

    def reply(line: bytes, wait_s: float = 1.0) -> bytes:
        grbl.write(line)
        clock.sleep_s(wait_s)
        return grbl.read_available()

    assert b"ALARM:1" in reply(b"$J=X2F900\n", 2)
    over_mm = grbl.position_mm()[0]
    assert over_mm > 0.1
    reply(b"\x18", 3)
    reply(b"$X\n")
    assert reply(b"$J=G91X-0.05F60\n") == b"ok\r\n"
    assert grbl.position_mm()[0] == pytest.approx(over_mm - 0.05, abs=2e-3)
    assert b"ALARM:1" in reply(b"$J=G91X0.05F60\n")
