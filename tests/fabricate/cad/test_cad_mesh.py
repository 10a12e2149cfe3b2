"""Meshes: closed, as near to the surface as they say, and not those of the call before."""

from __future__ import annotations

import numpy as np
import pytest

from deltact_fab.fabricate.cad import kernel, registry
from deltact_fab.fabricate.cad.build import build_part
from deltact_fab.fabricate.cad.design import load_design
from deltact_fab.fabricate.cad.kernel import require
from deltact_fab.fabricate.cad.mesh import is_closed, mesh_solid

DESIGN = load_design()


def test_deviation_matches_the_sphere():
    """Against distances in closed form on 231 points of every triangle of sphere and cylinders."""
    solid, _ = build_part(registry.find_part("sphere:10"), DESIGN)
    mesh = mesh_solid(solid, 0.05, "indenter")
    n = 20
    grid = np.array([(i, j, n - i - j) for i in range(n + 1) for j in range(n + 1 - i)]) / n
    points = np.einsum("sc,mcx->msx", grid, mesh.corners_mm)
    z = mesh.corners_mm[:, :, 2]
    r = np.hypot(mesh.corners_mm[:, :, 0], mesh.corners_mm[:, :, 1])
    cap = (z <= 5.0 + 1e-5).all(axis=1)
    worst = np.abs(np.linalg.norm(points[cap] - (0, 0, 5.0), axis=2) - 5.0).max()
    flat = np.ptp(z, axis=1) < 1e-6
    for radius in (5.0, 3.0):
        side = ~cap & ~flat & (np.abs(r - radius) < 1e-4).all(axis=1)
        # The corners of the stem's flat lie on the cylinder, too.
        side &= np.ptp(mesh.corners_mm[:, :, 0], axis=1) > 1e-6
        assert side.any()
        worst = max(worst, np.abs(np.hypot(*points[side].T[:2]) - radius).max())
    assert mesh.deviation_mm == pytest.approx(worst, rel=0.02)
    assert mesh.deviation_mm <= 0.05


def test_coarse_mesh_after_fine_is_coarse():
    solid, _ = build_part(registry.find_part("sphere:10"), DESIGN)
    fine = mesh_solid(solid, 0.005, "indenter")
    coarse = mesh_solid(solid, 0.1, "indenter")
    assert len(coarse.triangles) < len(fine.triangles) / 2
    assert coarse.deviation_mm > fine.deviation_mm


def test_open_mesh_is_detected():
    tetrahedron = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])
    assert is_closed(tetrahedron)
    assert not is_closed(tetrahedron[:3])
    assert not is_closed(tetrahedron[[0, 1, 2, 3, 3]])
    flipped = tetrahedron.copy()
    flipped[0] = flipped[0, ::-1]
    assert not is_closed(flipped)


@pytest.mark.parametrize("tolerance_mm", [0.1, 0.02, 0.005])
def test_tolerance_holds_on_largest_sphere(tolerance_mm):
    solid, _ = build_part(registry.find_part("sphere:22"), DESIGN)
    assert mesh_solid(solid, tolerance_mm, "indenter").deviation_mm <= tolerance_mm


def test_tiny_ball_stays_within_tolerance():
    ball = require().Solid.makeSphere(0.25, angleDegrees1=-90)
    made = mesh_solid(ball, 1.0, "ball")
    assert np.linalg.norm(made.corners_mm, axis=-1) == pytest.approx(0.25, abs=1e-6)
    assert made.deviation_mm <= 1.0


def test_gate_ignores_the_mesh_box():
    solid, found = build_part(registry.find_part("skin"), DESIGN)
    mesh_solid(solid, 0.1, "skin")
    assert np.array(kernel.bounding_box(solid)) == pytest.approx(np.array(found.box_mm), abs=1e-5)
