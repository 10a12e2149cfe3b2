"""The inverse of the face: another forward, closed forms, and what it must not invent."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.interpolate import RectBivariateSpline
from scipy.ndimage import gaussian_filter

from deltact_fab.common.errors import InputError
from deltact_fab.estimate.measure.face import FaceFlow
from deltact_fab.estimate.measure.force import make_features
from deltact_fab.estimate.measure.force.inverse import (
    SHIFT_NOISE_MM,
    FaceInverse,
    Inverse,
    least_squares_signed,
)
from deltact_fab.estimate.measure.force.model import ForceModel
from deltact_fab.estimate.measure.sensor_id import SensorModel
from deltact_fab.estimate.measure.shape.depth import DepthFinder, DepthModel, find_contacts
from deltact_fab.physics.gel.path.knots import Increments, ObservedChannels
from deltact_fab.physics.gel.path.open import choose_level, open_path
from deltact_fab.sensor.elasticity.block import FreeBlock
from deltact_fab.sensor.elasticity.material import GelMaterial
from deltact_fab.sensor.optics.camera import Pinhole, axes_mm
from deltact_fab.sensor.shapes.indenter import parse_indenter
from deltact_fab.sensor.shapes.sensor import SkinDimensions

SKIN = SkinDimensions(width_mm=26.0, length_mm=22.0, thickness_mm=10.0)
CAMERA = Pinhole(0.08, 256, 208, 12.0)
VIEW = SensorModel(CAMERA, SKIN)


@pytest.fixture(scope="module")
def features() -> Inverse:
    made = make_features("inverse-placed", VIEW)
    assert isinstance(made, Inverse)
    return made


@pytest.fixture(scope="module")
def block() -> FreeBlock:
    """The forward: another grid, four times as fine, by transforms."""
    return FreeBlock(SKIN, GelMaterial(1.0, VIEW.poisson), 0.25)


def _spot(block: FreeBlock, x0: float, y0: float, radius: float, t: tuple, even: bool = False):
    """Traction of a round contact, Hertz's or even; total force (3,)."""
    r2 = (block.x_mm - x0) ** 2 + (block.y_mm[:, None] - y0) ** 2
    shape = np.sqrt(np.maximum(1 - r2 / radius**2, 0)) if not even else r2 < radius**2
    traction = shape[..., None] * np.array(t, float)
    return traction, traction.sum(axis=(0, 1)) * block.cell_mm2


def _seen(block: FreeBlock, traction) -> FaceFlow:
    """What the camera shows of it, by its own projection."""
    return _shown(block.x_mm, block.y_mm, block.apply(traction))


def _shown(x_mm, y_mm, displacement_mm) -> FaceFlow:
    xs, ys = (axis.reshape(-1, 4).mean(1) for axis in axes_mm(CAMERA))
    u = np.moveaxis(displacement_mm, -1, 0)
    moved = np.stack([RectBivariateSpline(y_mm, x_mm, f)(ys, xs) for f in u], -1)
    rest = np.stack((*np.meshgrid(xs, ys), np.zeros((len(ys), len(xs)))), -1)
    shift = (CAMERA.project_px(rest + moved) - CAMERA.project_px(rest)) * CAMERA.mm_per_px
    return FaceFlow(shift.astype(np.float32), np.ones(shift.shape[:2], bool), xs, ys)


PLACES = [(0.0, 0.0, 2.5), (3.0, -2.0, 2.0), (-5.0, 4.0, 3.0)]


@pytest.mark.parametrize(("x0", "y0", "radius"), PLACES)
def test_press_of_other_model_recovered(features, block, x0, y0, radius) -> None:
    traction, force = _spot(block, x0, y0, radius, (0.05, -0.07, -0.3))
    flow = _seen(block, traction)
    press = features.inverse.solve(flow)
    six = features.compute(flow)[:6]
    assert np.abs(six[:3] - force).max() < 0.04 * -force[2]
    assert np.hypot(*(press.centre_mm() - (x0, y0))) < 0.35
    assert press.cover > 0.99
    assert press.traction_mpa[..., 2].max() <= 0
    # Torque about the centre, of the same force at its place.
    about = np.cross([x0, y0, 0.0], force)
    assert np.abs(six[3:] - about).max() < 0.35 * -force[2]


def test_an_even_pressure_is_not_lost(features, block) -> None:
    """What a bonded gel hides most: a linear first look returns less than two thirds of it."""
    traction, force = _spot(block, 1.0, -1.0, 4.5, (0, 0, -0.1), even=True)
    six = features.compute(_seen(block, traction))
    assert six[2] == pytest.approx(force[2], rel=0.05)


def test_traction_sums_to_model_force(features, block) -> None:
    rng = np.random.default_rng(4)
    flows, wrenches = [], []
    for x0, y0, radius in PLACES * 4:
        t, force = _spot(
            block, x0, y0, radius, (*rng.uniform(-0.03, 0.03, 2), rng.uniform(-0.15, -0.05))
        )
        flows.append(_seen(block, t))
        wrenches.append(0.6 * np.concatenate((force, np.cross([x0, y0, 0], force))))
    made = make_features("inverse-placed", VIEW)
    X = np.array([made.compute(flow) for flow in flows])
    model, _ = ForceModel.fit(made, X, np.array(wrenches))
    for flow in flows:
        field = made.traction(flow, model)
        np.testing.assert_allclose(
            field.force_n, model.predict(made.compute(flow)[None])[0, :3], atol=1e-9
        )
        assert field.traction_mpa[..., 2].max() <= 0
    # Young's modulus is what it should find.
    assert model.coefficients[2, 2] == pytest.approx(0.6, rel=0.05)


def test_single_place_keeps_factor(features, block) -> None:
    """Else it would be drawn from next to nothing, and wrong by far elsewhere."""
    made = make_features("inverse-placed", VIEW)
    found, wrenches = [], []
    for i, t_z in enumerate((-0.1, -0.2, -0.3)):
        traction, force = _spot(block, 0.5, -0.3 * i, 2.5, (0.01, 0.02, t_z))
        found.append(features.compute(_seen(block, traction)))
        wrenches.append(np.concatenate((force, np.cross([0.5, -0.3 * i, 0.0], force))))
    model, _ = ForceModel.fit(made, np.array(found), np.array(wrenches))
    far, force = _spot(block, 5.0, 4.0, 2.5, (0, 0, -0.2))
    told = model.predict(features.compute(_seen(block, far))[None])[0]
    assert told[2] == pytest.approx(force[2], rel=0.08)


@pytest.mark.parametrize("wide_mm", [1.0, 5.0])
def test_noise_is_no_press(features, block, wide_mm) -> None:
    flow = _seen(block, np.zeros((*block.shape, 3)))
    assert not features.inverse.solve(flow).traction_mpa.any()
    rng = np.random.default_rng(5)
    for _ in range(20):
        noise = gaussian_filter(
            rng.normal(size=flow.shift_mm.shape), (*[wide_mm / flow.cell_mm] * 2, 0)
        )
        noise *= SHIFT_NOISE_MM / noise.std()
        press = features.inverse.solve(replace(flow, shift_mm=noise.astype(np.float32)))
        assert not press.traction_mpa.any()
        assert press.cover == 1


def test_hole_is_excluded_and_reported(features, block) -> None:
    traction, force = _spot(block, 1.0, 0.0, 2.5, (0.02, 0, -0.12))
    flow = _seen(block, traction)
    beside = flow.known & ~(np.hypot(flow.x_mm + 4, flow.y_mm[:, None] - 3) < 2)
    told = features.compute(replace(flow, known=beside, shift_mm=_wild(flow, ~beside)))
    assert told[2] == pytest.approx(force[2], rel=0.05)
    assert features.cover(replace(flow, known=beside)) > 0.98
    middle = flow.known & ~(np.hypot(flow.x_mm - 1, flow.y_mm[:, None]) < 2.5)
    assert 0.3 < features.cover(replace(flow, known=middle)) < 0.9
    assert features.compute(replace(flow, known=middle))[2] == pytest.approx(force[2], rel=0.15)
    lost = replace(flow, known=np.zeros_like(flow.known), shift_mm=_wild(flow, flow.known))
    assert not features.compute(lost).any()
    assert features.cover(lost) == 0


def _wild(flow: FaceFlow, where) -> np.ndarray:
    """What stands where nothing is known: anything."""
    shift = flow.shift_mm.copy()
    shift[where] = np.nan
    return shift


@pytest.mark.parametrize("size_mm", [0.5, 20.0])
def test_impossible_motion_is_foreign(features, block, size_mm) -> None:
    flow = _seen(block, np.zeros((*block.shape, 3)))
    wild = np.random.default_rng(6).normal(size=flow.shift_mm.shape).astype(np.float32) * size_mm
    wild_flow = replace(flow, shift_mm=wild)
    assert np.isfinite(features.compute(wild_flow)).all()
    assert features.cover(wild_flow) == 0


@pytest.mark.parametrize(
    ("apart", "counts"), [(0.0, ["one"]), (3.0, ["cannot tell"]), (8.0, ["one", "one"])]
)
def test_near_spots_are_not_one(features, block, apart, counts) -> None:
    """Spots of a radius of 1.2 mm, which do not touch, behind 10 mm of gel."""
    parts = [_spot(block, x, 2.0, 1.2, (0, 0, -0.6))[0] for x in (-apart / 2, apart / 2)]
    flow = _seen(block, sum(parts))
    depth = DepthFinder(features.view, DepthModel(1.0, 20.0)).find(flow)
    found = find_contacts(depth, flow, features.view.camera)
    assert [contact.count for contact in found] == counts
    assert all(contact.resolution_mm < 3 for contact in found)


@pytest.mark.slow
def test_finite_strain_ball_needs_modulus_only(features) -> None:
    """Another theory and another mesh: what a calibration is left to do is a few percent."""
    poses = Increments(1.3, 1.3).poses([(-3.0, 2.0, 0.0), (-3.0, 2.0, -1.2), (-2.5, 1.7, -1.2)])
    gel, ball = GelMaterial(0.56, 0.49, 0.5), parse_indenter("sphere:15")
    choice = choose_level(SKIN, gel, ball, poses, 0.05, level="hyperelastic", most_unknowns=4000)
    solver = open_path(
        SKIN, gel, ball, poses, ObservedChannels(fields="all", lattice_mm=0.5), choice
    )
    for pose, knot in zip(poses, solver.solve_all(), strict=True):
        flow = _shown(*solver.axes_mm, knot.displacement_mm)
        force = 0.56 * np.array(knot.force_n)
        assert np.abs(0.56 * features.compute(flow)[:3] - force).max() < 0.08 * -force[2]
        finder = DepthFinder(features.view, DepthModel(1.0, 20.0))
        (found,) = find_contacts(finder.find(flow), flow, features.view.camera)
        assert np.hypot(*(found.place_mm - pose.tip_mm[:2])) < 0.5


def test_impossible_skin_is_refused() -> None:
    with pytest.raises(InputError, match="poisson"):
        FaceInverse(replace(VIEW, poisson=0.49995))


@given(st.integers(0, 10_000))
def test_signed_least_squares_meet_their_conditions(seed: int) -> None:
    rng = np.random.default_rng(seed)
    n = int(rng.integers(2, 12))
    a = rng.normal(size=(n + 2, n))
    matrix, right = a.T @ a + 0.01 * np.eye(n), rng.normal(size=n)
    signed = rng.random(n) < 0.6
    signed[:2] = False, True
    t = least_squares_signed(matrix.copy(), right, signed)
    pull = matrix @ t - right
    assert (t[signed] <= 1e-9).all()
    np.testing.assert_allclose(pull[~signed], 0, atol=1e-7)
    assert (pull[signed] <= 1e-7).all()
    np.testing.assert_allclose(pull[signed] * t[signed], 0, atol=1e-6)
