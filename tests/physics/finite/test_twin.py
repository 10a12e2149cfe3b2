"""The finite-strain level against an independent axisymmetric solution of the same cylinder.

Sphere R 7.5 mm, no friction but where it is said, cylinder of the block's face area, 12 mm, E 0.56
MPa, nu 0.49. The twin at cells of 1/8 mm (31 410 unknowns) gives TWIN_N; half the cell from 1/4 to
1/8 changes these by at most 0.1 % at 1 mm and 0.02 % beyond. Facts of felupe's first trial lie 0.2
to 0.9 % above.
"""

import numpy as np
import pytest

from benchmarks.gel_axisymmetric import Ball, Cylinder, cylinder, graded
from deltact_fab.physics.gel.press import press_gel
from deltact_fab.sensor.elasticity.material import GelMaterial
from deltact_fab.sensor.shapes import indenter
from deltact_fab.sensor.shapes.sensor import SkinDimensions

RADIUS, THICKNESS, SPHERE = float(np.sqrt(36 * 34 / np.pi)), 12.0, 7.5
DEPTHS = [1.0, 2.0, 3.0, 4.0, 5.0]
TWIN_N = np.array([3.4087, 10.6446, 20.8940, 33.6147, 48.3019])


@pytest.fixture(scope="module")
def twin():
    return cylinder(0.5, RADIUS, THICKNESS).press(Ball(SPHERE), DEPTHS)


# -- the twin itself ----------------------------------------------------------------------------


def test_twin_tangent_and_forces_are_derivatives():
    body = cylinder(2.0, RADIUS, THICKNESS)
    rng = np.random.default_rng(0)
    u = 0.03 * rng.standard_normal(body.nodes.shape)
    v = rng.standard_normal(u.shape)
    u[body.nodes[:, 0] == 0, 0] = v[body.nodes[:, 0] == 0, 0] = 0.0
    h, along = 1e-6, v.ravel()[body.dofs]
    _, force, tangent = body.bulk(u)
    (up, f_up, _), (down, f_down, _) = (body.bulk(u + s * h * v) for s in (1, -1))
    assert float((force * along).sum()) == pytest.approx((up - down) / (2 * h), rel=1e-7)
    turn = np.einsum("mij,mj->mi", tangent, along)
    assert np.abs(turn - (f_up - f_down) / (2 * h)).max() < 1e-6 * np.abs(turn).max()


def test_twin_is_exact_at_homogeneous_strain():
    """A free cylinder stretched by uniform factors: energy of the law, and balanced inside."""
    body = Cylinder(np.array([0.0, 1.0, 2.5, 4.0]), np.array([-3.0, -1.0, 0.0]), 0.56, 0.49)
    a, c = 1.1, 0.8
    u = body.nodes * np.array([a - 1, c - 1])
    energy, force, _ = body.bulk(u)
    j = a * a * c
    law = body.mu * ((2 * a * a + c * c - 3) / 2 - np.log(j)) + body.lam / 2 * np.log(j) ** 2
    assert energy == pytest.approx(law * np.pi * 16 * 3, rel=1e-12)
    total = np.bincount(body.dofs.ravel(), force.ravel(), body.nodes.size).reshape(-1, 2)
    r, z = body.nodes.T
    inside = (r > 0) & (r < 4) & (z > -3) & (z < 0)
    assert np.abs(total[inside]).max() < 1e-12
    axial = body.mu * (c - 1 / c) + body.lam * np.log(j) / c
    assert total[z == 0, 1].sum() == pytest.approx(axial * np.pi * 16, rel=1e-12)


@pytest.mark.evidence
def test_twin_light_touch_agrees_with_hertz():
    """a/h = 1/160: F = 4/3 E/(1 - nu^2) sqrt(R) d^1.5; the base adds about a / h to it."""
    lines = np.append(graded(72.0, 0.1, 1.0, growth=1.4, most=200.0), 80.0)
    touch = Cylinder(lines, -lines[::-1], 1.0, 0.3).press(Ball(5.0), [0.05], step_mm=0.01)[0]
    hertz = 4 / 3 / (1 - 0.3**2) * np.sqrt(5.0) * 0.05**1.5
    assert touch.force_n == pytest.approx(hertz, rel=0.02)


@pytest.mark.evidence
def test_the_twin_has_converged(twin):
    """Cells of 1/2 mm are within 0.05 % of 1/8 mm at every depth: the contact edge is resolved."""
    assert [s.force_n for s in twin] == pytest.approx(list(TWIN_N), rel=5e-4)
    assert max(s.penetration_mm for s in twin) <= 1.1e-5


# -- what `gel press` states --------------------------------------------------------------------


def estimated(nu, thickness, radius, depth, friction):
    """True and estimated relative error of the force; the block's sides are far away."""
    side = round(2 * (2.5 * thickness + np.sqrt(radius * depth)), 1)
    fillet = min(2.0, thickness / 2)
    skin = SkinDimensions(side, side, thickness, fillet, thickness)
    cell = np.sqrt(radius * depth) / 6
    r = graded(side / np.sqrt(np.pi), cell, 10 * cell, growth=1.35, most=24.0)
    z = -graded(thickness, cell, 4 * cell, growth=1.35, most=12.0)[::-1]
    true = Cylinder(r, z, 0.56, nu).press(
        Ball(radius), [depth], step_mm=0.3 * cell, friction=friction,
        closed_mm=1e-4 if friction else 1e-5,
    )[0].force_n  # fmt: skip
    ball = indenter.parse_indenter(f"sphere:{2 * radius:g}")
    gel = GelMaterial(poisson=nu, friction=friction)
    found = press_gel(skin, gel, ball, (0.0, 0.0), depth, model="hyperelastic").result
    assert found["within_tolerance"], found
    return abs(-found["force_n"][2] / true - 1), found["error_estimate"]["force_rel"]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("nu", "thickness", "radius", "depth", "friction"),
    [
        (0.45, 7.3, 6.1, 1.14, 0.5),
        pytest.param(0.38, 7.4, 11.4, 1.38, 0.0, marks=pytest.mark.evidence),
        pytest.param(0.495, 19.6, 12.8, 2.63, 0.5, marks=pytest.mark.evidence),
    ],
)
def test_estimate_covers_the_error(nu, thickness, radius, depth, friction):
    true, estimate = estimated(nu, thickness, radius, depth, friction)
    assert true <= estimate <= 0.03


@pytest.mark.slow
def test_thin_incompressible_gel_meets_tolerance():
    true, _ = estimated(0.495, 1.5, 10.0, 0.3, 0.0)
    assert true <= 0.03
