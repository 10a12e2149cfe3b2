"""Presses: equilibrium, symmetry, history, friction, refusals, and forces of known presses."""

import numpy as np
import pytest
import scipy.sparse as sp

from deltact_fab.common.errors import SolverError
from deltact_fab.physics.gel.finite.mesh import block_mesh
from deltact_fab.physics.gel.finite.press import FinitePress
from deltact_fab.physics.gel.finite.surface import FrictionGrip
from deltact_fab.physics.gel.level import follow_path
from deltact_fab.sensor.elasticity.material import GelMaterial
from deltact_fab.sensor.shapes import indenter
from deltact_fab.sensor.shapes.sensor import SkinDimensions

SKIN = SkinDimensions()
COARSE = block_mesh(SKIN, 2.0)
FOCUS = block_mesh(SKIN, 2.0, (-6.0, 6.0, -6.0, 6.0))
ROUGH = block_mesh(SKIN, 3.0, (-6.0, 6.0, -6.0, 6.0))  # for what holds on any mesh


def pressing(name="sphere:15", mesh=COARSE, friction=0.0, **options) -> FinitePress:
    material = options.pop("material", GelMaterial())
    return FinitePress(mesh, material, indenter.parse_indenter(name), friction=friction, **options)


def last(press, state, tip, step=1.0):
    return list(follow_path(press, state, tip, step))[-1]


def dented(rng) -> tuple[np.ndarray, np.ndarray]:
    """Displacements of COARSE, rough and with a dent, and a tip (3,) in it."""
    u = 0.05 * rng.standard_normal(COARSE.nodes_mm.shape)
    u[:, 2] -= 2.0 * np.exp(-np.sum(COARSE.nodes_mm[:, :2] ** 2, axis=1) / 30)
    return u, np.array([0.3, -0.2, 2.2])


def test_contact_forces_and_tangent_are_derivatives():
    press = pressing(friction=0.5)
    surface, free = press.surface, press.pattern.free
    rng = np.random.default_rng(0)
    u, tip = dented(rng)
    at = surface.points(u, tip)
    seen = surface.evaluate(u, tip)
    start = at + 0.01 * rng.standard_normal(at.shape)
    normal = seen.gap.normal.reshape(at.shape)
    grip = FrictionGrip(start, 0 * at, normal, seen.pressure_mpa > 0, 0.5)
    v = rng.standard_normal(free.shape) * free
    h = 1e-6
    plus, minus = (surface.evaluate(u + s * h * v, tip, None, False) for s in (1, -1))
    slope = (plus.energy_nmm - minus.energy_nmm) / (2 * h)
    assert float((seen.force_n * v).sum()) == pytest.approx(slope, rel=1e-7)
    now = surface.evaluate(u, tip, grip)
    assert 0 < (now.coupling.gain_n_mm != 0).sum() < (seen.pressure_mpa > 0).sum()
    plus, minus = (surface.evaluate(u + s * h * v, tip, grip, False) for s in (1, -1))
    upper = press.pattern.matrix(now.data)
    ours = (upper + sp.triu(upper, k=1).T) @ v[free] + surface.coupling_force(now.coupling, v)[free]
    turn = ((plus.force_n - minus.force_n) / (2 * h))[free]
    assert np.linalg.norm(ours - turn) < 1e-6 * np.linalg.norm(turn)


@pytest.mark.parametrize("points", [2, 5])
def test_fixed_friction_bound_has_a_potential(points):
    """Also where a point has left the indenter since and its bound is still held."""
    press = pressing(friction=0.5, points=points)
    surface, free = press.surface, press.pattern.free
    rng = np.random.default_rng(1)
    u, tip = dented(rng)
    at = surface.points(u, tip)
    seen = surface.evaluate(u, tip)
    held = rng.random(seen.pressure_mpa.shape) < 0.5
    assert (held & (seen.pressure_mpa == 0)).any()
    grip = FrictionGrip(
        at + 0.02 * rng.standard_normal(at.shape), 0 * at, seen.gap.normal.reshape(at.shape), held,
        0.5, 0.3 * rng.random(held.shape),
    )  # fmt: skip
    v = rng.standard_normal(free.shape) * free
    h = 1e-6
    now = surface.evaluate(u, tip, grip)
    assert now.coupling is None
    plus, minus = (surface.evaluate(u + s * h * v, tip, grip, False) for s in (1, -1))
    slope = (plus.energy_nmm - minus.energy_nmm) / (2 * h)
    assert float((now.force_n * v).sum()) == pytest.approx(slope, rel=1e-6)
    upper = press.pattern.matrix(now.data)
    turn = ((plus.force_n - minus.force_n) / (2 * h))[free]
    ours = (upper + sp.triu(upper, k=1).T) @ v[free]
    assert np.linalg.norm(ours - turn) < 1e-6 * np.linalg.norm(turn)


@pytest.mark.slow
def test_sharp_tip_gets_more_points():
    """A face that wraps an edge is stretched: between 2 x 2 points the tip stands deep inside."""
    mesh = block_mesh(SKIN, 2.0, (-5.0, 5.0, -5.0, 5.0))
    few, more = (pressing("star", mesh, points=n) for n in (2, 5))
    deep = [last(p, p.rest(), (0.0, 0.0, 4.0), 0.5) for p in (few, more)]
    inside = [s.diagnostics.penetration_mm for s in deep]
    assert inside[1] < 0.5 * inside[0]
    assert pressing("star", mesh).surface.weights_mm2.shape[1] == 25
    assert pressing("sphere:15", mesh).surface.weights_mm2.shape[1] == 4


def test_centred_press_is_symmetric_and_balanced():
    press = pressing(mesh=ROUGH)
    s = last(press, press.rest(), (0.0, 0.0, 3.0), 1.5)
    u, at = s.displacement_mm, ROUGH.nodes_mm
    keys = {tuple(np.round(x, 6)): i for i, x in enumerate(at)}
    for axis in (0, 1):
        flip = np.ones(3)
        flip[axis] = -1
        twin = [keys[tuple(np.round(x * flip + 0.0, 6))] for x in at]
        assert np.abs(u - u[twin] * flip).max() < 1e-8
    assert np.abs(s.force_n[:2]).max() < 1e-7
    assert np.abs(s.torque_nmm).max() < 1e-5
    assert np.add(s.force_n, s.base_force_n) == pytest.approx(np.zeros(3), abs=1e-5)


def test_work_is_stored_as_energy():
    press = pressing(mesh=ROUGH)
    states = [press.rest(), *follow_path(press, press.rest(), (0.0, 0.0, 3.0), 0.3)]
    force = np.array([-s.force_n[2] for s in states])
    assert len(force) == 11
    weight = np.array([1, *[4, 2] * 4, 4, 1])  # Simpson's rule
    end, tip = states[-1].displacement_mm, np.array(states[-1].tip_mm)
    energy = press.bulk.evaluate(end, False).energy_nmm
    energy += press.surface.evaluate(end, tip, tangent=False).energy_nmm
    assert weight @ force * 0.1 == pytest.approx(energy, rel=5e-3)


def test_drag_keeps_the_friction_cone():
    press = pressing(mesh=ROUGH, friction=0.5)
    down = last(press, press.rest(), (0.0, 0.0, 3.0), 1.5)
    dragged = last(press, down, (1.0, 0.0, 3.0), 1.5)
    bound = press.friction * dragged.pressure_mpa
    shear = np.linalg.norm(dragged.shear_mpa, axis=2)
    assert (shear - bound).max() < 5e-3 * bound.max()
    assert shear.max() > 0.5 * bound.max()
    assert np.add(dragged.force_n, dragged.base_force_n) == pytest.approx(np.zeros(3), abs=1e-5)


@pytest.mark.slow
def test_drag_continues_past_a_fold():
    """Ahead of the indenter the equilibrium ends; a way down the energy finds the next one."""
    press = pressing("edges", block_mesh(SKIN, 2.5), friction=0.5)
    s = last(press, press.rest(), (0.0, 0.0, 5.0))
    path = list(follow_path(press, s, (7.0, 0.0, 5.0), 1.0))
    assert sum(p.diagnostics.damped for p in path) > 0
    assert sum(p.diagnostics.lagged == 0 for p in path) >= 4
    for p in path:
        assert p.diagnostics.residual <= 1e-8
        shear, bound = np.linalg.norm(p.shear_mpa, axis=2), 0.5 * p.pressure_mpa
        assert not (p.diagnostics.lagged and p.trusted)
        assert p.diagnostics.lagged or (shear <= bound + 1e-12 * bound.max()).all()
        off = np.add(p.force_n, p.base_force_n)
        assert np.linalg.norm(off) < 1e-6 * np.linalg.norm(p.force_n)
    # As high as friction 0.5 and the flank in front of it together may hold.
    assert 0.3 < path[-1].force_n[0] / -path[-1].force_n[2] < 1.5
    assert not path[-1].trusted


@pytest.mark.slow
def test_no_convergence_raises():
    press = pressing(mesh=ROUGH)
    press.tolerance = 1e-30
    with pytest.raises(SolverError, match="halvings of the increment"):
        press.solve(press.rest(), (0.0, 0.0, 1.0))
