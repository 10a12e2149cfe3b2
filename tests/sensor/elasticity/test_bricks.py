"""The linear bricks against the finite-strain ones at rest, whose tangent they are."""

from __future__ import annotations

import numpy as np
import pytest

from deltact_fab.physics.gel.finite.assembly import BulkAssembly, MatrixPattern
from deltact_fab.physics.gel.finite.material import NeoHooke
from deltact_fab.physics.gel.finite.mesh import block_mesh
from deltact_fab.sensor.elasticity.edge_compliance import BrickBox, stiffness
from deltact_fab.sensor.elasticity.material import GelMaterial
from deltact_fab.sensor.shapes.sensor import SkinDimensions


@pytest.mark.parametrize("poisson", [0.0, 0.3, 0.4999])
def test_matches_finite_strain_tangent_at_rest(poisson: float) -> None:
    skin = SkinDimensions(width_mm=8, length_mm=6, thickness_mm=3, protrusion_mm=2.5)
    mesh = block_mesh(skin, 1.0)
    box = BrickBox((8, 6, 3), (1.0, 1.0, 1.0))
    free = np.ones((box.nodes, 3), bool)
    free[: box.nodes_a_layer] = False
    free[7::11, 1] = False
    pattern = MatrixPattern(mesh, free)
    law = NeoHooke.from_material(GelMaterial(1.0, poisson))
    data = BulkAssembly(mesh, law, pattern).evaluate(np.zeros((box.nodes, 3))).data
    assert data is not None
    want = pattern.matrix(data).toarray()
    got = stiffness(box, poisson, free).toarray()
    assert np.abs(got - want).max() < 1e-12 * np.abs(want).max()
