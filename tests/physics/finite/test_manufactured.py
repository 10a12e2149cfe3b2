"""Order of convergence on a displacement that was made up, with the loads that it needs.

Body force and tractions come from the law written out here, not from the package's, and reach the
assembled bulk as consistent nodal forces by 3 x 3 x 3 Gauss points.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable

import numpy as np
import pytest

from deltact_fab.common.aliases import Field
from deltact_fab.physics.gel.finite.assembly import BulkAssembly, MatrixPattern
from deltact_fab.physics.gel.finite.linear import make_solver
from deltact_fab.physics.gel.finite.material import NeoHooke
from deltact_fab.physics.gel.finite.mesh import HexMesh, block_mesh
from deltact_fab.sensor.elasticity.material import GelMaterial
from deltact_fab.sensor.shapes.sensor import SkinDimensions

WIDTH, LENGTH, THICKNESS = 8.0, 6.0, 4.0
SKIN = SkinDimensions(WIDTH, LENGTH, THICKNESS, 0.5, 2.0)
SIZE_MM, LIFT_MM = 0.8, 0.03
POINTS, WEIGHTS = np.polynomial.legendre.leggauss(3)
CORNERS = np.array(
    [[-1, -1, -1], [1, -1, -1], [1, 1, -1], [-1, 1, -1],
     [-1, -1, 1], [1, -1, 1], [1, 1, 1], [-1, 1, 1]], dtype=np.float64,
)  # fmt: skip


def made_up(x: Field) -> Field:
    """Displacement (n, 3), zero on the base z = -THICKNESS.

    Two shears, one after the other, which keep every volume, and a lift that changes it by
    about a hundredth: more would be a pressure of many mu near incompressibility.
    """
    s = (x[:, 2] + THICKNESS) / THICKNESS
    rise = np.sin(1.2 * s) + 0.3 * s**2
    u = SIZE_MM * rise * np.sin(0.9 * math.pi * x[:, 1] / LENGTH + 0.3)
    v = 0.7 * SIZE_MM * (1 - np.cos(1.5 * s)) * np.cos(1.1 * math.pi * (x[:, 0] + u) / WIDTH)
    w = LIFT_MM * s * np.sin(1.4 * s) * np.cos(2 * x[:, 0] / WIDTH) * np.cos(2.5 * x[:, 1] / LENGTH)
    return np.stack([u, v, w], axis=1)


def differences(of: Callable[[Field], Field], x: Field, step: float = 1e-3) -> Field:
    """d of_i / dx_j (n, ..., 3); what it is off by, 1e-6, does not show beside a mesh's error."""
    return np.stack([(of(x + e) - of(x - e)) / (2 * step) for e in np.eye(3) * step], axis=-1)


def gradient(x: Field) -> Field:
    """F (n, 3, 3) of `made_up`."""
    return np.eye(3) + differences(made_up, x)


def piola(x: Field, mu: float, lam: float) -> Field:
    """mu (F - F^-T) + lambda ln(J) F^-T."""
    f = gradient(x)
    turned = np.swapaxes(np.linalg.inv(f), 1, 2)
    return mu * (f - turned) + lam * np.log(np.linalg.det(f))[:, None, None] * turned


def body_force(x: Field, mu: float, lam: float) -> Field:
    """-div P (n, 3) in N/mm3."""
    return -np.einsum("nijj->ni", differences(lambda at: piola(at, mu, lam), x))


def quadrature(mesh: HexMesh) -> tuple[Field, Field, Field]:
    """Points (m, 27, 3), weights (m, 27) in mm3 and shape functions (27, 8) of box-shaped cells."""
    xi = np.stack(np.meshgrid(POINTS, POINTS, POINTS, indexing="ij"), axis=-1).reshape(-1, 3)
    w = np.einsum("i,j,k->ijk", WEIGHTS, WEIGHTS, WEIGHTS).ravel()
    shape = np.prod(1 + xi[:, None, :] * CORNERS[None], axis=2) / 8
    corners = mesh.nodes_mm[mesh.cells]
    volume = np.prod(np.ptp(corners, axis=1), axis=1)
    return np.matmul(shape, corners), volume[:, None] * w / 8, shape


def loads(mesh: HexMesh, mu: float, lam: float) -> Field:
    """Consistent nodal forces (n, 3): body force inside, P N on the five free sides."""
    x, w, shape = quadrature(mesh)
    total = np.zeros_like(mesh.nodes_mm)
    b = body_force(x.reshape(-1, 3), mu, lam).reshape(x.shape)
    np.add.at(total, mesh.cells, np.einsum("mq,qa,mqi->mai", w, shape, b))
    xi = np.stack(np.meshgrid(POINTS, POINTS, indexing="ij"), axis=-1).reshape(-1, 2)
    flat = np.einsum("i,j->ij", WEIGHTS, WEIGHTS).ravel()
    corners = mesh.nodes_mm[mesh.cells]
    ends = np.array([mesh.nodes_mm.min(axis=0), mesh.nodes_mm.max(axis=0)])
    for axis, side in ((0, 0), (0, 1), (1, 0), (1, 1), (2, 1)):
        local = CORNERS[:, axis] == (2 * side - 1)
        nodes = corners[:, local]
        here = np.all(np.abs(nodes[..., axis] - ends[side, axis]) < 1e-9, axis=1)
        others = [k for k in range(3) if k != axis]
        shape2 = np.prod(1 + xi[:, None, :] * CORNERS[local][:, others][None], axis=2) / 4
        at = np.matmul(shape2, nodes[here])
        area = np.prod(np.ptp(nodes[here][..., others], axis=1), axis=1)
        traction = (2 * side - 1) * piola(at.reshape(-1, 3), mu, lam)[:, :, axis].reshape(at.shape)
        part = np.einsum("f,q,qa,fqi->fai", area / 4, flat, shape2, traction)
        np.add.at(total, mesh.cells[here][:, local], part)
    return total


def solved(mesh: HexMesh, law: NeoHooke, load: Field) -> Field:
    """Displacements (n, 3) by Newton from the made-up ones at the nodes, whose error is larger."""
    pattern = MatrixPattern(mesh, ~mesh.fixed)
    bulk, solver = BulkAssembly(mesh, law, pattern), make_solver()
    u = made_up(mesh.nodes_mm)
    size = float(np.linalg.norm(load[pattern.free]))
    for _ in range(25):
        now = bulk.evaluate(u)
        residual = (now.force_n - load)[pattern.free]
        if np.linalg.norm(residual) < 1e-11 * size:
            return u
        solver.factorise(pattern.matrix(now.data))
        u[pattern.free] -= solver.solve(residual)
    pytest.fail("no convergence")


def error_mm(mesh: HexMesh, u: Field) -> float:
    """Root mean square over the volume of the displacement's error."""
    x, w, shape = quadrature(mesh)
    off = np.matmul(shape, u[mesh.cells]) - made_up(x.reshape(-1, 3)).reshape(x.shape)
    return math.sqrt(float((w * (off**2).sum(axis=2)).sum() / w.sum()))


@pytest.mark.slow
@pytest.mark.parametrize("nu", [0.3, 0.49])
def test_displacements_converge_with_order_two(nu: float) -> None:
    law = NeoHooke.from_material(GelMaterial(poisson=nu))
    found = []
    for spacing in (1.0, 2 / 3, 0.5):
        mesh = block_mesh(SKIN, spacing)
        u = solved(mesh, law, loads(mesh, law.mu_mpa, law.lambda_mpa))
        found.append((spacing, error_mm(mesh, u)))
    for (h, e), (fine_h, fine_e) in itertools.pairwise(found):
        assert math.log(e / fine_e) / math.log(h / fine_h) >= 1.9, found
    assert found[-1][1] < 0.02 * SIZE_MM
