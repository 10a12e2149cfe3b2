"""The signed distance against the indenters' height fields and its own derivatives."""

import numpy as np
import pytest

from deltact_fab.physics.gel.finite.distance import gap
from deltact_fab.sensor.shapes import indenter

NAMES = [
    "sphere:15", "sphere:4", "4dots", "edges", "ellipsoid", "hexprism", "star", "cylinder",
    "ring", "hat", "tilted-edge", "two-axis",
]  # fmt: skip


def near(name: str) -> tuple:
    body = indenter.parse_indenter(name)
    a, b = body.footprint_half_mm
    rng = np.random.default_rng(1)
    p = rng.uniform([-a - 1, -b - 1, -1.0], [a + 1, b + 1, body.reach_mm - 0.5], (4000, 3))
    d = gap(body, p).distance_mm
    return body, p[(d > -0.25) & (d < 2)]


@pytest.mark.parametrize("name", [*NAMES, "cross"])
def test_height_field_has_distance_zero(name):
    body = indenter.parse_indenter(name)
    xy = np.random.default_rng(2).uniform(-1, 1, (2000, 2)) * body.footprint_half_mm
    z = body.height_mm(xy[:, 0], xy[:, 1])
    on = np.isfinite(z)
    p = np.column_stack([xy, z])[on]
    assert gap(body, p).distance_mm == pytest.approx(np.zeros(on.sum()), abs=1e-12)
    inside = gap(body, p + [0, 0, 0.05]).distance_mm
    assert (inside <= 1e-12).all()
    assert inside.min() < -0.01


@pytest.mark.parametrize("name", NAMES)
def test_the_normal_leads_to_the_surface(name):
    body, p = near(name)
    g = gap(body, p)
    foot = p - g.distance_mm[:, None] * g.normal
    assert gap(body, foot).distance_mm == pytest.approx(np.zeros(len(p)), abs=1e-9)
    assert np.linalg.norm(g.normal, axis=1) == pytest.approx(np.ones(len(p)), abs=1e-12)


@pytest.mark.parametrize("name", NAMES)
def test_normal_and_curvature_are_derivatives(name):
    body, p = near(name)
    g, h = gap(body, p), 1e-6
    slope, turn = np.empty_like(g.normal), np.empty_like(g.curvature_per_mm)
    for i, e in enumerate(h * np.eye(3)):
        plus, minus = gap(body, p + e), gap(body, p - e)
        slope[:, i] = (plus.distance_mm - minus.distance_mm) / (2 * h)
        turn[:, i] = (plus.normal - minus.normal) / (2 * h)
    # At a few points of the sample the foot jumps between two pieces.
    assert np.quantile(np.abs(g.normal - slope).max(axis=1), 0.995) < 1e-6
    assert np.quantile(np.abs(g.curvature_per_mm - turn).max(axis=(1, 2)), 0.97) < 1e-4


def test_shanks_and_back_plate_are_solid():
    body = indenter.parse_indenter("4dots")
    tip = body.tips[0]
    high = body.reach_mm - 1.0
    p = np.array([[tip.x_mm, tip.y_mm, high], [0.0, 0.0, high], [30.0, 0.0, body.reach_mm + 0.2]])
    d = gap(body, p).distance_mm
    assert d[0] == pytest.approx(-2.0)
    assert d[1] == pytest.approx(1.0)
    assert d[2] == pytest.approx(-0.2)
