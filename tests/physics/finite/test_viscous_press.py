"""Presses of a relaxing gel: limits, holds, dents, cut time, and what an elastic one saves."""

from dataclasses import replace

import numpy as np
import pytest

from deltact_fab.common.errors import InputError, SolverError
from deltact_fab.physics.gel.finite.material import NeoHooke
from deltact_fab.physics.gel.finite.mesh import block_mesh
from deltact_fab.physics.gel.finite.press import FinitePress
from deltact_fab.physics.gel.finite.state import FiniteState
from deltact_fab.physics.gel.level import follow_path
from deltact_fab.sensor.elasticity.material import GelMaterial
from deltact_fab.sensor.shapes import indenter
from deltact_fab.sensor.shapes.sensor import SkinDimensions

SERIES = ((0.4, 0.3), (0.25, 5.0))
SOFT = GelMaterial()
GEL = replace(SOFT, prony=SERIES)
MESH = block_mesh(SkinDimensions(), 3.0, (-4.0, 4.0, -4.0, 4.0))
DEEP = (0.0, 0.0, 3.0)
UP = (0.0, 0.0, -1.0)


def pressing(material: GelMaterial = GEL, friction: float = 0.0, **options) -> FinitePress:
    return FinitePress(
        MESH, material, indenter.parse_indenter("sphere:15"), friction=friction, **options
    )


def last(press: FinitePress, seconds: float | None, tip=DEEP, step: float = 1.0) -> FiniteState:
    return list(follow_path(press, press.rest(), tip, step, seconds))[-1]


def same(one: FiniteState, two: FiniteState, rel: float) -> None:
    assert one.force_n[2] == pytest.approx(two.force_n[2], rel=rel)
    assert one.displacement_mm == pytest.approx(two.displacement_mm, abs=rel)


@pytest.fixture(scope="module")
def sudden() -> tuple[FinitePress, FiniteState]:
    press = pressing()
    return press, last(press, 0.0)


@pytest.mark.slow
@pytest.mark.parametrize("friction", [0.0, 0.5])
def test_infinitely_slow_press_is_elastic(friction):
    elastic, relaxing = pressing(SOFT, friction), pressing(GEL, friction)
    one = last(elastic, None)
    same(last(relaxing, np.inf), one, 1e-12)
    same(last(relaxing, 1e15), one, 1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("friction", [0.0, 0.5])
def test_sudden_press_has_stiff_shear_modulus(friction):
    law = NeoHooke.from_material(SOFT)
    stiff = NeoHooke(law.mu_mpa * (1 + GEL.prony_sum), law.lambda_mpa)
    poisson = stiff.lambda_mpa / (2 * (stiff.lambda_mpa + stiff.mu_mpa))
    elastic = pressing(GelMaterial(2 * stiff.mu_mpa * (1 + poisson), poisson), friction)
    relaxing = pressing(GEL, friction)
    # Both press against the same penalty: that of the contact does not relax.
    elastic.surface = relaxing.surface
    one = last(elastic, None)
    same(last(relaxing, 0.0), one, 1e-9)
    same(last(relaxing, 1e-15), one, 1e-9)


@pytest.mark.slow
def test_hold_relaxes_from_stiff_to_soft(sudden):
    press, state = sudden
    soft = -last(pressing(SOFT), None).force_n[2]
    forces, t = [-state.force_n[2]], 0.0
    for seconds in (1e-6, 1e-3, 0.1, 0.3, 1.0, 3.0, 10.0, 100.0):
        state = press.solve(state, DEEP, seconds)
        t += seconds
        forces.append(-state.force_n[2])
        curve = 1 + sum(g * np.exp(-t / tau) for g, tau in SERIES)
        # All but compressibility and the penalty of the contact scales with the shear modulus.
        assert forces[-1] == pytest.approx(soft * curve, rel=0.03)
        assert np.add(state.force_n, state.base_force_n) == pytest.approx(np.zeros(3), abs=1e-6)
    assert (np.diff(forces) < 0).all()
    state = press.solve(state, DEEP, np.inf)
    assert forces[-1] > -state.force_n[2] > soft * (1 - 1e-6)
    assert -state.force_n[2] == pytest.approx(soft, rel=1e-6)


@pytest.mark.parametrize("friction", [0.0, 0.5])
def test_dent_recovers_fully_after_long_rest(friction):
    press = pressing(friction=friction)
    state = press.solve(last(press, 0.0), DEEP, 10.0)
    state = press.solve(state, UP, 0.1)
    assert state.force_n == pytest.approx((0, 0, 0), abs=1e-12)
    dents = [np.abs(state.displacement_mm).max()]
    assert dents[0] > 0.3
    for seconds in (0.5, 2.0, 10.0, 60.0):
        state = press.solve(state, UP, seconds)
        dents.append(np.abs(state.displacement_mm).max())
    assert (np.diff(dents) < 0).all()
    state = press.solve(state, UP, np.inf)
    assert np.abs(state.displacement_mm).max() < 1e-8
    assert np.abs(state.overstress_mpa).max() < 1e-12


def test_tip_advances_into_dent_without_contact(sudden):
    press, state = sudden
    state = press.solve(press.solve(state, DEEP, np.inf), UP, 0.0)
    away = press.solve(state, (0.0, 0.0, 0.3), 0.0)
    assert away.contact_points == 0
    assert press.solve(away, (0.0, 0.0, 2.9), 0.0).contact_points > 0


def test_cut_increment_divides_its_time(monkeypatch):
    press, tip = pressing(), (0.0, 0.0, 1.0)
    right = last(press, 0.4, tip, 0.5)
    whole, calls = press._increment, []

    def once(previous, to, memory, change):
        calls.append(to)
        if len(calls) == 1:
            raise SolverError("not this time")
        return whole(previous, to, memory, change)

    monkeypatch.setattr(press, "_increment", once)
    cut = press.solve(press.rest(), tip, 0.4)
    assert cut.diagnostics.cuts == 1
    assert cut.force_n[2] == right.force_n[2]
    assert (cut.overstress_mpa == right.overstress_mpa).all()


def test_a_relaxing_gel_needs_the_time():
    press = pressing()
    with pytest.raises(InputError, match="needs the duration"):
        press.solve(press.rest(), DEEP)
    with pytest.raises(InputError, match="needs the duration"):
        next(follow_path(press, press.rest(), DEEP, 1.0))
    for bad in (-1.0, np.nan):
        with pytest.raises(InputError, match="seconds must be >= 0"):
            press.solve(press.rest(), DEEP, bad)


@pytest.mark.parametrize("seconds", [0.0, 1e-12, 1.0, 1e12])
def test_any_increment_converges_with_strong_series(seconds):
    press = pressing(replace(SOFT, prony=((1.0, 1.0),)), friction=0.5)
    state = press.solve(press.rest(), DEEP, seconds)
    assert state.diagnostics.residual <= 1e-8
    back = press.solve(press.solve(state, UP, seconds), UP, np.inf)
    assert np.abs(back.displacement_mm).max() < 1e-8
