"""Every projection against rays that are traced face by face with Snell's law of vectors.

The tracer shares nothing with the package but a lens's numbers: it starts from angles at the
lens, turns them with matrices of its own, and refracts vectors at planes.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest

from deltact_fab.common.aliases import Field
from deltact_fab.sensor.optics.camera import Pinhole
from deltact_fab.sensor.optics.fisheye import Fisheye, LayeredPath
from deltact_fab.sensor.optics.rectified import Rectified
from deltact_fab.sensor.shapes.sensor import SensorDimensions

SENSOR = SensorDimensions()
NORMAL = np.array([0.0, 0.0, 1.0])

NOMINAL = Fisheye.from_sensor(SENSOR)
REAL = Fisheye(
    f_px=391.3,
    k1=-0.021,
    k2=0.0034,
    cx_px=646.2,
    cy_px=351.7,
    tilt_x_deg=1.6,
    tilt_y_deg=-2.1,
    roll_deg=0.8,
    x0_mm=0.35,
    y0_mm=-0.22,
    air_gap_mm=2.7,
    pupil_shift_mm=-0.31,
    acrylic_mm=2.08,
    gel_mm=11.8,
    n_acrylic=1.492,
    n_gel=1.405,
)
LENSES = {
    "nominal": NOMINAL,
    "decentred": replace(NOMINAL, cx_px=655.0, cy_px=340.0, x0_mm=0.6, y0_mm=0.4, roll_deg=-33.0),
    "tilted": replace(NOMINAL, tilt_x_deg=-3.0, tilt_y_deg=2.0),
    "moving pupil": replace(NOMINAL, pupil_shift_mm=0.4, k1=0.01),
    "as a real one": REAL,
    "far from any": replace(REAL, tilt_x_deg=8.0, tilt_y_deg=-6.0, pupil_shift_mm=-0.7),
    "decentred elements": replace(REAL, k3=0.003, k4=-0.0008, p1=0.0012, p2=-0.0008, aspect=1.002),
}
DEPTHS = [*(("gel", z) for z in (0.8, 0.0, -3.0, -9.0)), *(("air", z) for z in (0.0, 5.0))]


@dataclass
class Traced:
    """What a ray was at the lens, and where it is: pixels (n, 2), at rest and at z (n, 3)."""

    px: Field
    rest_mm: Field
    points_mm: Field


def turned(lens: Fisheye) -> Field:
    """(3, 3): roll about the axis, then the turn about y, then the one about x."""

    def about(axis: int, degrees: float) -> Field:
        a, b = [i for i in range(3) if i != axis]
        matrix = np.eye(3)
        c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
        matrix[a, a] = matrix[b, b] = c
        matrix[a, b], matrix[b, a] = (s, -s) if axis == 1 else (-s, s)
        return matrix

    return about(0, lens.tilt_x_deg) @ about(1, lens.tilt_y_deg) @ about(2, lens.roll_deg)


def refracted(way: Field, n_before: float, n_after: float) -> Field:
    """Snell's law of unit vectors (n, 3) at a plane whose normal is z."""
    ratio = n_before / n_after
    cosine = way @ NORMAL
    along = np.sqrt(1 - ratio**2 * (1 - cosine**2)) - ratio * cosine
    return ratio * way + along[:, None] * NORMAL


def to_plane(start: Field, way: Field, z: float) -> Field:
    return start + way * ((z - start[:, 2]) / way[:, 2])[:, None]


def trace(lens: Fisheye, medium: str, z_mm: float, widest_deg: float = 66.0) -> Traced:
    """Rays at angles all over the image, up to z in the gel or in the air beyond the face."""
    rng = np.random.default_rng(5)
    theta = np.radians(np.concatenate(([0.0], rng.uniform(0, widest_deg, 400))))
    turn = rng.uniform(0, 2 * np.pi, len(theta))
    aside = np.stack((np.cos(turn), np.sin(turn)), axis=-1)
    terms = (1.0, lens.k1, lens.k2, lens.k3, lens.k4)
    u, v = aside.T * sum(k * theta ** (2 * i + 1) for i, k in enumerate(terms))
    square = u**2 + v**2
    across = u + 2 * lens.p1 * u * v + lens.p2 * (square + 2 * u**2)
    down = v + lens.p1 * (square + 2 * v**2) + 2 * lens.p2 * u * v
    px = np.column_stack((across, lens.aspect * down)) * lens.f_px + (lens.cx_px, lens.cy_px)
    way = np.column_stack((np.sin(theta)[:, None] * aside, np.cos(theta))) @ turned(lens).T

    foot = np.array([lens.x0_mm, lens.y0_mm, -lens.gel_mm - lens.acrylic_mm - lens.air_gap_mm])
    axis = turned(lens) @ NORMAL
    at = foot - np.outer(lens.pupil_shift_mm * theta**2, axis)
    at = to_plane(at, way, -lens.gel_mm - lens.acrylic_mm)
    way = refracted(way, 1.0, lens.n_acrylic)
    at = to_plane(at, way, -lens.gel_mm)
    way = refracted(way, lens.n_acrylic, lens.n_gel)
    rest = to_plane(at, way, 0.0)
    if medium == "air":
        way = refracted(way, lens.n_gel, 1.0)
    return Traced(px, rest[:, :2], to_plane(rest, way, z_mm))


@pytest.mark.parametrize(("medium", "z_mm"), DEPTHS)
@pytest.mark.parametrize("lens", LENSES.values(), ids=LENSES.keys())
def test_fisheye_matches_traced_rays(lens, medium, z_mm):
    traced = trace(lens, medium, z_mm)
    np.testing.assert_allclose(lens.project_px(traced.points_mm, medium), traced.px, atol=1e-9)
    np.testing.assert_allclose(lens.rest_mm(traced.px), traced.rest_mm, atol=1e-11)
    np.testing.assert_allclose(lens.rest_px(traced.rest_mm), traced.px, atol=1e-9)
    np.testing.assert_allclose(
        lens.crossing_mm(traced.points_mm, medium), traced.rest_mm, atol=1e-11
    )
    for origin, way in (lens.ray(traced.px, medium), lens.ray_to(traced.points_mm, medium)):
        np.testing.assert_allclose(origin + z_mm * way, traced.points_mm, atol=1e-11)


@pytest.mark.parametrize("seed", range(6))
def test_any_lens_matches_traced_rays(seed):
    rng = np.random.default_rng(seed)
    gap_mm = rng.uniform(0.3, 8)
    lens = Fisheye(
        f_px=rng.uniform(150, 1500),
        k1=rng.uniform(-0.05, 0.05),
        k2=rng.uniform(0, 0.02),
        tilt_x_deg=rng.uniform(-10, 10),
        tilt_y_deg=rng.uniform(-10, 10),
        roll_deg=rng.uniform(-180, 180),
        x0_mm=rng.uniform(-3, 3),
        y0_mm=rng.uniform(-3, 3),
        air_gap_mm=gap_mm,
        pupil_shift_mm=rng.uniform(-gap_mm / 3.1, gap_mm),
        acrylic_mm=rng.uniform(0.5, 6),
        gel_mm=rng.uniform(2, 25),
        n_acrylic=rng.uniform(1, 2),
        n_gel=rng.uniform(1, 2),
    )
    for medium, z_mm in (("gel", 0.8), ("gel", -0.9 * lens.gel_mm), ("air", 0.0), ("air", 15.0)):
        traced = trace(lens, medium, z_mm)
        np.testing.assert_allclose(lens.project_px(traced.points_mm, medium), traced.px, atol=1e-9)
        origin, way = lens.ray(traced.px, medium)
        np.testing.assert_allclose(origin + z_mm * way, traced.points_mm, atol=1e-10)


@pytest.mark.parametrize(("medium", "z_mm"), DEPTHS)
@pytest.mark.parametrize("lens", LENSES.values(), ids=LENSES.keys())
def test_rectified_points_are_face_crossings(lens, medium, z_mm):
    view = Rectified.from_sensor(SENSOR, lens)
    traced = trace(lens, medium, z_mm)
    px = traced.rest_mm / view.mm_per_px + (np.array([view.width_px, view.height_px]) - 1) / 2
    np.testing.assert_allclose(view.project_px(traced.points_mm, medium), px, atol=1e-9)
    np.testing.assert_allclose(view.rest_mm(px), traced.rest_mm, atol=1e-12)
    origin, way = view.ray(px, medium)
    np.testing.assert_allclose(origin + z_mm * way, traced.points_mm, atol=1e-10)


@pytest.mark.parametrize(("medium", "z_mm"), DEPTHS)
def test_pinhole_approximates_lens_near_axis(medium, z_mm):
    camera = Pinhole.from_sensor(SENSOR)
    in_px, in_mm = [], []
    for widest_deg in (2.0, 1.0):
        traced = trace(NOMINAL, medium, z_mm, widest_deg)
        px = camera.rest_px(traced.rest_mm)
        in_px.append(np.max(np.abs(camera.project_px(traced.points_mm, medium) - px)))
        origin, way = camera.ray(px, medium)
        in_mm.append(np.max(np.abs(origin + z_mm * way - traced.points_mm)))
    assert in_px[0] < 0.03
    assert in_mm[0] < 0.002
    if z_mm:  # what is left grows with the cube of the angle
        assert in_px[0] / in_px[1] == pytest.approx(8, rel=0.1)
        assert in_mm[0] / in_mm[1] == pytest.approx(8, rel=0.1)


@pytest.mark.parametrize("degrees", [1.0, 30.0, 57.6, 80.0])
def test_reach_matches_traced_rays(degrees):
    """What the design's checks of the view go by."""
    traced = trace(NOMINAL, "gel", 0.0, degrees)
    widest = np.argmax(np.hypot(*(traced.px - NOMINAL.centre_px).T))
    radius_mm = np.hypot(*traced.rest_mm[widest])
    angle = np.hypot(*(traced.px[widest] - NOMINAL.centre_px)) / NOMINAL.f_px
    assert LayeredPath(3.0, 2.0, 12.0).reach_mm(angle) == pytest.approx(radius_mm, rel=1e-12)
    assert LayeredPath(3.0, 2.0, 12.0).half_angle_rad(radius_mm) == pytest.approx(angle, abs=1e-11)
