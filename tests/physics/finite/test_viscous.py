"""Relaxation against analytic curves and quadrature, extreme steps, the step's potential."""

import numpy as np
import pytest
import scipy.integrate
import scipy.sparse as sp

from deltact_fab.common.errors import InputError
from deltact_fab.physics.gel.finite.assembly import BulkAssembly, MatrixPattern
from deltact_fab.physics.gel.finite.material import NeoHooke, Viscosity
from deltact_fab.physics.gel.finite.mesh import block_mesh
from deltact_fab.sensor.elasticity.material import GelMaterial
from deltact_fab.sensor.shapes.sensor import SkinDimensions

SERIES = ((0.4, 0.3), (0.25, 5.0))
GEL = GelMaterial(poisson=0.45, prony=SERIES)
LAW = NeoHooke.from_material(GEL)
SKIN = SkinDimensions(8.0, 6.0, 4.0, edge_fillet_mm=0.5, protrusion_mm=2.0)
SHEAR = np.array([[1.0, 0, 0.8], [0, 1, 0], [0, 0, 1]])
STRETCH = np.diag([0.8, 1.1, 1.3])
BOTH = SHEAR @ STRETCH @ np.array([[1.0, 0.3, 0], [0, 1, -0.4], [0.2, 0, 1]])
SIX = ((0, 1, 2, 0, 0, 1), (0, 1, 2, 1, 2, 2))


def viscosity(material: GelMaterial = GEL) -> Viscosity:
    found = Viscosity.from_material(material, NeoHooke.from_material(material))
    assert found is not None
    return found


def exact_local(f: np.ndarray) -> np.ndarray:
    """mu (I - C^-1) by LAPACK, six components."""
    return (LAW.mu_mpa * (np.eye(3) - np.linalg.inv(f.T @ f)))[SIX]


class Point:
    """One material point that is driven through deformation gradients."""

    def __init__(self, material: GelMaterial = GEL) -> None:
        self.law = viscosity(material)
        self.f = np.eye(3)
        self.held: np.ndarray | None = None

    def go(self, f: np.ndarray, seconds: float) -> np.ndarray:
        """The whole local stress S + sum H (6,) at the end, formed from the step's potential."""
        memory = self.law.memory(self.f[None, None], self.held, seconds)
        self.f = f
        at = f[None, None]
        self.held = self.law.overstress(at, memory)
        from_potential = memory.scale * self.law.local_stress(at) + memory.stress_mpa
        from_parts = self.law.local_stress(at) + self.held.sum(axis=0)
        assert from_potential == pytest.approx(from_parts, abs=1e-13)
        return from_potential[0, 0]


def faded(t: float) -> float:
    return 1 + sum(g * np.exp(-t / tau) for g, tau in SERIES)


@pytest.mark.parametrize("f", [SHEAR, STRETCH, BOTH])
@pytest.mark.parametrize("step", [1e-3, 0.07, 1.0, 40.0])
def test_held_step_relaxes_by_the_series(f, step):
    point = Point()
    s = exact_local(f)
    assert point.go(f, 0.0) == pytest.approx(s * faded(0), abs=1e-12)
    for k in range(1, 6):
        assert point.go(f, step) == pytest.approx(s * faded(k * step), abs=1e-10)


def convolved(way, t: float) -> np.ndarray:
    """S(t) + sum g x integral of exp(-(t-s)/tau) dS/ds, by parts, with quadrature."""
    total = exact_local(way(t))
    for g, tau in SERIES:
        tail, _ = scipy.integrate.quad_vec(
            lambda s, tau=tau: np.exp(-(t - s) / tau) * exact_local(way(s)) / tau,
            0, t, epsabs=1e-13, epsrel=1e-12,
        )  # fmt: skip
        total = total + g * (exact_local(way(t)) - tail)
    return total


def ramp(s: float) -> np.ndarray:
    """One second of stretching, shearing and turning together."""
    c, d = np.cos(s), np.sin(s)
    turn = np.array([[c, -d, 0], [d, c, 0], [0, 0, 1]])
    return (
        turn
        @ np.array([[1.0, 0, 1.2 * s], [0, 1, 0], [0, 0, 1]])
        @ np.array([[1, 0.3 * s, 0], [0, 1, -s], [0, 0, 1 + s / 2]])
    )


def test_ramp_converges_with_second_order():
    right = convolved(ramp, 1.0)
    errors = []
    for n in (4, 8, 16, 32):
        point = Point()
        for k in range(1, n + 1):
            got = point.go(ramp(k / n), 1 / n)
        errors.append(np.abs(got - right).max())
    orders = np.log2(np.divide(errors[:-1], errors[1:]))
    assert errors[0] < 0.02 * np.abs(right).max()
    assert orders[-1] == pytest.approx(2.0, abs=0.05)
    assert errors[-1] < 2e-4 * np.abs(right).max()


@pytest.mark.parametrize("seconds", [1.7e308, np.inf])
def test_long_rest_is_elastic(seconds):
    point = Point()
    point.go(BOTH, 0.0)
    assert point.go(SHEAR, seconds) == pytest.approx(exact_local(SHEAR), abs=1e-15)
    assert np.abs(point.held).max() < 1e-15
    assert np.abs(point.go(np.eye(3), seconds)).max() < 1e-15


def test_turning_the_gel_changes_nothing():
    one, two = Point(), Point()
    turn = np.linalg.qr(np.random.default_rng(5).standard_normal((3, 3)))[0]
    turn *= np.sign(np.linalg.det(turn))
    for f, t in ((SHEAR, 0.2), (BOTH, 0.0), (STRETCH, 3.0)):
        assert one.go(f, t) == pytest.approx(two.go(turn @ f, t), abs=1e-13)


def bulk_with_history():
    """A mesh with a random past, and a random present displacement."""
    mesh = block_mesh(SKIN, 1.5)
    free = np.ones(mesh.nodes_mm.shape, bool)
    free[mesh.base] = False
    bulk = BulkAssembly(mesh, LAW, MatrixPattern(mesh, free))
    law, rng, held = viscosity(), np.random.default_rng(1), None
    f = bulk.deformation_gradient(np.zeros(free.shape))
    for seconds in (0.1, 2.0):
        memory = law.memory(f, held, seconds)
        f = bulk.deformation_gradient(0.15 * rng.standard_normal(free.shape) * free)
        held = law.overstress(f, memory)
    memory = law.memory(f, held, 0.4)
    return bulk, law, memory, 0.1 * rng.standard_normal(free.shape) * free, rng


def test_forces_are_derivatives_with_history():
    bulk, _, memory, u, rng = bulk_with_history()
    past = {"memory": memory}
    free = bulk.pattern.free
    v, step = rng.standard_normal(free.shape) * free, 1e-5
    now = bulk.evaluate(u, **past)
    plus, minus = (bulk.evaluate(u + s * step * v, False, **past) for s in (1, -1))
    slope = (plus.energy_nmm - minus.energy_nmm) / (2 * step)
    assert float((now.force_n * v).sum()) == pytest.approx(slope, rel=1e-7)
    turn = ((plus.force_n - minus.force_n) / (2 * step))[free]
    upper = bulk.pattern.matrix(now.data)
    ours = (upper + sp.triu(upper, k=1).T) @ v[free]
    assert np.linalg.norm(ours - turn) < 1e-7 * np.linalg.norm(turn)


@pytest.mark.parametrize("bad", [-1.0, np.nan, -np.inf])
def test_time_does_not_run_backwards(bad):
    with pytest.raises(InputError, match="seconds must be >= 0"):
        viscosity().weights(bad)
