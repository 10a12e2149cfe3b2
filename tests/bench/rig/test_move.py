"""How much of a move a controller is told, and when: the law of the dead man."""

from __future__ import annotations

from dataclasses import replace

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from deltact_fab.bench.rig.interface import StageState
from deltact_fab.bench.rig.stage.controller import MIN_PIECE_MM, PIECE_S, PLANNED_AHEAD_S, Move


@settings(suppress_health_check=[HealthCheck.too_slow], deadline=None)  # on a busy machine
@given(
    feed=st.floats(0.001, 1500),
    accel=st.floats(5, 2000),
    length=st.floats(0.001, 60),
    steps=st.lists(st.floats(0.001, PIECE_S), min_size=1, max_size=60),
)
def test_sent_distance_is_bounded_never_repeated(
    feed: float, accel: float, length: float, steps: list[float]
) -> None:
    speed = feed / 60
    ahead_s = max(PLANNED_AHEAD_S, speed / accel)
    move = Move((0, 0, 0), (0, 0, -length), feed, accel, 0, 0.0, ahead_s)
    t_s, sent = 0.0, move.first_mm()
    move = replace(move, sent_mm=sent)
    for step in [0.0, *steps]:
        t_s += step
        if (due := move.due_mm(round(t_s * 1e9))) is not None:
            assert due > sent
            sent = due
            move = replace(move, sent_mm=sent)
        assert sent <= max(speed * (t_s + ahead_s), MIN_PIECE_MM) + 1e-9
        assert -move.point_at_mm(sent)[2] <= length + 1e-4
        assert move.is_sent == (sent >= length)
        if not move.is_sent and speed * PIECE_S > MIN_PIECE_MM and t_s > speed / accel:
            assert not move.runs_dry(round(t_s * 1e9)), "a host that is on time lets none rest"


def at(way_mm: float, t_s: float) -> StageState:
    return StageState((0.0, 0.0, -way_mm), "Jog", t_s)


def test_clock_drift_is_followed_hold_detected() -> None:
    move = Move((0, 0, 0), (0, 0, -10), 60.0, 1000.0, 0, 10.0, PLANNED_AHEAD_S, sent_mm=0.17)
    for k in range(1, 60):  # a resonator that is 1 % slow
        t_s = 0.1 * k
        state = at(0.99 * t_s, t_s)
        move = replace(move, sent_mm=t_s + PLANNED_AHEAD_S)
        assert not move.was_held(state, 0.03)
        move = move.retimed(state)
    assert move.start_ns == pytest.approx(0.01 * 5.9 * 1e9, rel=0.2)
    held = at(0.99 * 5.96, 6.0)
    assert move.was_held(held, 0.03)
    assert not replace(move, late_ns=round(5.9e9)).was_held(held, 0.03), "the host was late"
    assert not replace(move, sent_mm=5.8).was_held(held, 0.03), "it had nothing to go on with"
