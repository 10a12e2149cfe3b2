"""The judges of the gel's long tables see what is wrong."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from benchmarks import gel_energy, gel_straight
from deltact_fab.errors import SolverError
from deltact_fab.gel.finite import FinitePress, FiniteState
from deltact_fab.numerics.engine import Flagged
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
def test_only_a_mesh_that_is_no_mirror_makes_a_side_force(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = GelCase("hexprism", 2.5, 0.5, mirrors=(False, False))
    none, told = gel_straight.worst_side_force(scene, 0.5, 1.5, 1e-6, Path())
    assert none < 1e-9
    assert "the largest to 1.5 mm" in told
    star = replace(scene, indenter="star", mirrors=(False, True))
    some, told = gel_straight.worst_side_force(star, 0.5, 1.5, 0.03, Path())
    assert 1e-3 < some < 0.2

    # Refused on the way: what was found before decides whether that is all there is to say.
    solve, deep = FinitePress.solve, 0.0

    def to_1_mm(press: FinitePress, previous: Any, tip: Any, *more: Any) -> Any:
        if tip[2] > 1.01:
            if not deep:
                raise SolverError("press: too deep for a test")
            state = solve(press, previous, tip, *more)
            return replace(state, diagnostics=replace(state.diagnostics, penetration_mm=deep))
        state = solve(press, previous, tip, *more)
        return replace(state, diagnostics=replace(state.diagnostics, penetration_mm=0.01))

    monkeypatch.setattr(FinitePress, "solve", to_1_mm)
    with pytest.raises(Flagged, match=r"the largest to 1 mm.*press: too deep for a test"):
        gel_straight.worst_side_force(star, 0.5, 1.5, 0.5, Path())
    found, told = gel_straight.worst_side_force(star, 0.5, 1.5, 1e-6, Path())
    assert found > 1e-6
    assert "too deep for a test" in told
    deep = 0.08
    with pytest.raises(Flagged, match=r"the largest to 1 mm.*0.08 mm inside the gel at 1.5 mm"):
        gel_straight.worst_side_force(star, 0.5, 1.5, 0.5, Path())
