"""The judges of the gel's long tables see what is wrong."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from benchmarks import gel_energy, gel_straight
from deltact_fab.gel.finite import FiniteState
from deltact_fab.numerics.engines import gel_scene
from deltact_fab.numerics.engines.gel_scene import FiniteSolution, GelCase


@pytest.fixture(scope="module")
def found() -> FiniteSolution:
    return gel_scene.solved(GelCase(spacing_mm=3.0), 0.3, (0.0, 0.0, 3.0))


@pytest.mark.slow
def test_energy_from_nowhere_is_seen_and_a_jump_s_loss_is_not_an_error(
    found: FiniteSolution, monkeypatch: pytest.MonkeyPatch
) -> None:
    def judged(states: tuple[FiniteState, ...]) -> tuple[float, str]:
        monkeypatch.setattr(gel_energy, "solved", lambda *_: FiniteSolution(found.press, states))
        return gel_energy.work_but_jumps(GelCase(), 2.0, Path())

    def scaled(factor: float, jumps: bool) -> tuple[FiniteState, ...]:
        last = replace(found.last, force_n=tuple(factor * f for f in found.last.force_n))
        damped = replace(last.diagnostics, damped=int(jumps))
        return (*found.states[:-1], replace(last, diagnostics=damped))

    plain, _ = judged(found.states)
    assert plain < 3  # the trapezoid rule in few steps
    assert judged(scaled(1.5, False))[0] > plain + 5
    lost, note = judged(scaled(1.5, True))
    assert lost < 3
    assert "1 of" in note
    assert judged(scaled(0.5, True))[0] > 5


@pytest.mark.slow
def test_only_a_mesh_that_is_no_mirror_makes_a_side_force() -> None:
    scene = GelCase("hexprism", 2.5, 0.5, mirrors=(False, False))
    none, told = gel_straight.worst_side_force(scene, 0.5, 1.5, 1e-6, Path())
    assert none < 1e-9
    assert "the largest to 1.5 mm" in told
    star = replace(scene, indenter="star", mirrors=(False, True))
    some, told = gel_straight.worst_side_force(star, 0.5, 1.5, 0.03, Path())
    assert 1e-3 < some < 0.2
