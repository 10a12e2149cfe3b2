"""The linear bricks against the finite-strain ones at rest, whose tangent they are."""

from __future__ import annotations

import numpy as np
import pytest

from deltact_fab.elasticity.edge_compliance import BrickBox, stiffness
from deltact_fab.elasticity.material import GelMaterial
from deltact_fab.gel.finite import block_mesh
from deltact_fab.gel.finite.assembly import BulkAssembly
from deltact_fab.gel.finite.material import NeoHooke
from deltact_fab.gel.finite.pattern import Pattern
from deltact_fab.shapes import SkinDimensions


@pytest.mark.parametrize("poisson", [0.0, 0.3, 0.4999])
def test_it_is_the_tangent_of_the_finite_strain_bricks_at_rest(poisson: float) -> None:
    skin = SkinDimensions(width_mm=8, length_mm=6, thickness_mm=3, protrusion_mm=2.5)
    mesh = block_mesh(skin, 1.0)
    box = BrickBox((8, 6, 3), (1.0, 1.0, 1.0))
    free = np.ones((box.nodes, 3), bool)
    free[: box.nodes_a_layer] = False
    free[7::11, 1] = False
    pattern = Pattern(mesh, free)
    law = NeoHooke.of(GelMaterial(1.0, poisson))
    data = BulkAssembly(mesh, law, pattern).evaluate(np.zeros((box.nodes, 3))).data
    assert data is not None
    want = pattern.matrix(data).toarray()
    got = stiffness(box, poisson, free).toarray()
    assert np.abs(got - want).max() < 1e-12 * np.abs(want).max()


def test_turning_a_box_takes_no_force_and_stretching_it_that_of_hookes_law() -> None:
    box = BrickBox((2, 3, 2), (0.5, 0.4, 0.3))
    free = np.ones((box.nodes, 3), bool)
    upper = stiffness(box, 0.3, free).toarray()
    whole = upper + np.triu(upper, 1).T
    z, y, x = (i.ravel() for i in np.meshgrid(
        0.3 * np.arange(3), 0.4 * np.arange(4), 0.5 * np.arange(3), indexing="ij"))  # fmt: skip
    turned = np.stack([-y, x, 0 * z], axis=1)
    assert np.abs(whole @ turned.ravel()).max() < 1e-12
    pulled = np.stack([x, -0.3 * y, -0.3 * z], axis=1)  # a strain of 1, free across
    force = (whole @ pulled.ravel()).reshape(-1, 3)
    end = x == x.max()
    assert force[end, 0].sum() == pytest.approx(1.2 * 0.6)  # 1 MPa on the end face
    assert np.abs(force[:, 1:]).max() < 1e-12
