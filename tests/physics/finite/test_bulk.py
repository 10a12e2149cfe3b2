"""The bulk against homogeneous states, differences and the other implementation."""

import numpy as np
import pytest
import scipy.sparse as sp

from deltact_fab.common.errors import InputError
from deltact_fab.physics.gel.finite import newton
from deltact_fab.physics.gel.finite.assembly import BulkAssembly, MatrixPattern
from deltact_fab.physics.gel.finite.linear import make_solver
from deltact_fab.physics.gel.finite.material import NeoHooke
from deltact_fab.physics.gel.finite.mesh import HexMesh, block_mesh
from deltact_fab.physics.gel.finite.newton import Evaluation, descend
from deltact_fab.sensor.elasticity.material import GelMaterial
from deltact_fab.sensor.shapes.sensor import SkinDimensions

SKIN = SkinDimensions(8.0, 6.0, 4.0, edge_fillet_mm=0.5, protrusion_mm=2.0)
LINEAR = np.array([[0.2, 0.1, -0.15], [0.05, -0.25, 0.1], [0.12, 0.08, -0.2]])


def law(poisson: float = 0.49) -> NeoHooke:
    return NeoHooke.from_material(GelMaterial(poisson=poisson))


def energy(w: NeoHooke, f: np.ndarray) -> np.ndarray:
    """MPa (n,) of deformation gradients (n, 3, 3), as if each were a whole cell."""
    j = np.linalg.det(f)
    local = w.mu_mpa * ((np.einsum("nij,nij->n", f, f) - 3) / 2 - np.log(j))
    return local + w.lambda_mpa / 2 * np.log(j) ** 2


def stress(w: NeoHooke, f: np.ndarray) -> np.ndarray:
    """First Piola stress (n, 3, 3) in MPa: mu (F - F^-T) + lambda ln J F^-T."""
    cofactor = np.swapaxes(np.linalg.inv(f), 1, 2)
    pressure = w.lambda_mpa * np.log(np.linalg.det(f))
    return w.mu_mpa * (f - cofactor) + pressure[:, None, None] * cofactor


def skewed(spacing_mm: float = 1.5) -> tuple[HexMesh, np.ndarray]:
    """A mesh with its inner nodes moved about, and which nodes are inner ones."""
    mesh = block_mesh(SKIN, spacing_mm)
    low, high = mesh.nodes_mm.min(axis=0), mesh.nodes_mm.max(axis=0)
    inner = ((mesh.nodes_mm > low + 1e-9) & (mesh.nodes_mm < high - 1e-9)).all(axis=1)
    rng = np.random.default_rng(3)
    shift = rng.uniform(-0.15, 0.15, mesh.nodes_mm.shape) * spacing_mm
    nodes = mesh.nodes_mm + shift * inner[:, None]
    return HexMesh(nodes, mesh.cells, mesh.touched, mesh.base), inner


class Held:
    """A bulk whose hull is held at given displacements."""

    def __init__(self, bulk: BulkAssembly, held_mm: np.ndarray, free: np.ndarray) -> None:
        self.bulk, self.held_mm, self.free = bulk, held_mm, free

    def whole(self, x: np.ndarray) -> np.ndarray:
        u = self.held_mm.copy()
        u[self.free] = x
        return u

    def evaluate(self, x, pressure, tangent, curved):
        self.seen = b = self.bulk.evaluate(self.whole(x), tangent, pressure)
        if not b.least_j > 0:
            return None
        first, self.second = self.bulk.law.volumetric(b.jbar)[1:]
        return Evaluation(b.force_n[self.free], 1.0, b.data, first, b.energy_nmm)

    def pressure_rate(self, step):
        return self.second * self.change(step, self.seen) / self.bulk.volumes_mm3

    def change(self, step, seen):
        u = np.zeros_like(self.held_mm)
        u[self.free] = step
        cells = u[self.bulk.mesh.cells].reshape(len(seen.jbar), -1)
        return (cells * seen.volume_rate_mm2).sum(axis=1)

    couples = False

    def unbalance_n(self, x, pressure):
        b = self.bulk.evaluate(self.whole(x), False)
        if not b.least_j > 0:
            return None
        own = (pressure - self.bulk.law.volumetric(b.jbar)[1])[:, None] * b.volume_rate_mm2
        return np.linalg.norm((b.force_n + self.bulk.scatter(own.reshape(-1, 8, 3)))[self.free])


def full(pattern: MatrixPattern, data: np.ndarray) -> sp.csr_matrix:
    upper = pattern.matrix(data)
    return upper + sp.triu(upper, k=1).T


def test_mesh_keeps_volume_and_faces():
    mesh = block_mesh(SKIN, 0.8, (-1.0, 1.0, -1.5, 0.5))
    bulk = BulkAssembly(mesh, law(), MatrixPattern(mesh, np.ones(mesh.nodes_mm.shape, bool)))
    assert bulk.volumes_mm3.sum() == pytest.approx(8 * 6 * 4, rel=1e-12)
    assert np.all(mesh.nodes_mm[mesh.faces][..., 2] == 0.0)
    assert np.all(mesh.nodes_mm[mesh.base][:, 2] == -4.0)
    assert len(mesh.base) * 3 + mesh.free_dofs == mesh.nodes_mm.size


def test_incompressible_is_refused_by_name():
    with pytest.raises(InputError, match="poisson"):
        law(0.5)


@pytest.mark.parametrize("poisson", [0.3, 0.49, 0.4999])
def test_patch(poisson):
    """A linear displacement on the hull is found inside a skewed mesh, at large strain."""
    mesh, inner = skewed()
    free = np.repeat(inner[:, None], 3, axis=1)
    pattern = MatrixPattern(mesh, free)
    bulk = BulkAssembly(mesh, law(poisson), pattern)
    exact = mesh.nodes_mm @ LINEAR.T
    problem = Held(bulk, exact, free)
    rng = np.random.default_rng(5)
    start = exact[free] + 0.1 * rng.uniform(-1, 1, pattern.size)
    solver = make_solver("superlu")
    relaxed = np.zeros(len(mesh.cells))
    rest = bulk.evaluate(np.zeros_like(exact)).data
    low = descend(problem, start, solver, pattern, rest, 1.0)
    found = newton.solve(problem, low.free_mm, relaxed, solver, pattern, 1e-11)
    assert found.free_mm == pytest.approx(exact[free], abs=1e-10)
    f = bulk.deformation_gradient(exact)
    assert f == pytest.approx(np.broadcast_to(np.eye(3) + LINEAR, f.shape), abs=1e-12)


def test_homogeneous_state_has_energy_and_forces():
    mesh, _ = skewed()
    bulk = BulkAssembly(mesh, law(), MatrixPattern(mesh, np.ones(mesh.nodes_mm.shape, bool)))
    b = bulk.evaluate(mesh.nodes_mm @ LINEAR.T)
    f = (np.eye(3) + LINEAR)[None]
    assert b.energy_nmm == pytest.approx(float(energy(law(), f)[0]) * 8 * 6 * 4, rel=1e-12)
    # The moment of the hull's forces is the stress times the volume.
    virial = np.einsum("ni,nj->ij", b.force_n, mesh.nodes_mm) / (8 * 6 * 4)
    assert virial == pytest.approx(stress(law(), f)[0], rel=1e-10, abs=1e-12)


@pytest.mark.parametrize("poisson", [0.3, 0.4999])
def test_forces_and_tangent_are_derivatives(poisson):
    mesh, _ = skewed()
    free = np.ones(mesh.nodes_mm.shape, bool)
    free[mesh.base] = False
    pattern = MatrixPattern(mesh, free)
    bulk = BulkAssembly(mesh, law(poisson), pattern)
    rng = np.random.default_rng(1)
    u = 0.1 * rng.standard_normal(free.shape)
    u[~free] = 0.0
    v = rng.standard_normal(free.shape)
    v[~free] = 0.0
    b, h = bulk.evaluate(u), 1e-5
    plus, minus = bulk.evaluate(u + h * v, False), bulk.evaluate(u - h * v, False)
    slope = (plus.energy_nmm - minus.energy_nmm) / (2 * h)
    assert float((b.force_n * v).sum()) == pytest.approx(slope, rel=1e-7)
    turn = ((plus.force_n - minus.force_n) / (2 * h))[free]
    ours = full(pattern, b.data) @ v[free]
    assert np.linalg.norm(ours - turn) < 1e-7 * np.linalg.norm(turn)


def test_inverted_cell_has_no_energy():
    mesh = block_mesh(SKIN, 2.0)
    bulk = BulkAssembly(mesh, law(), MatrixPattern(mesh, np.ones(mesh.nodes_mm.shape, bool)))
    b = bulk.evaluate(mesh.nodes_mm * [0.0, 0.0, -2.0])
    assert b.energy_nmm == np.inf
    assert b.least_j < 0


@pytest.mark.parametrize("name", ["pardiso", "superlu"])
def test_linear_solvers_agree_after_new_entries(name):
    if name == "pardiso":
        pytest.importorskip("pypardiso")
    mesh = block_mesh(SKIN, 1.5)
    free = np.ones(mesh.nodes_mm.shape, bool)
    free[mesh.base] = False
    pattern = MatrixPattern(mesh, free)
    data = BulkAssembly(mesh, law(), pattern).evaluate(np.zeros(free.shape)).data
    right = np.random.default_rng(4).standard_normal(pattern.size)
    solver = make_solver(name)
    for scale in (1.0, 3.0):
        solver.factorise(pattern.matrix(scale * data))
        x = solver.solve(right)
        assert np.linalg.norm(full(pattern, scale * data) @ x - right) < 1e-6
    assert not solver.negative


@pytest.mark.parametrize("name", ["pardiso", "superlu"])
def test_direct_solvers_count_negative_eigenvalues(name):
    if name == "pardiso":
        pytest.importorskip("pypardiso")
    a = np.diag([2.0, -1.0, 3.0, -4.0]) + 0.1
    upper = sp.csr_matrix(np.triu(a))
    solver = make_solver(name)
    solver.factorise(upper)
    assert solver.negative == 2
    assert a @ solver.solve(np.ones(4)) == pytest.approx(np.ones(4))
