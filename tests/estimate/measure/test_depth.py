"""Depth in mm: the ball that calibrates it, a press that is found, and what is no press."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from deltact_fab.common.errors import InputError
from deltact_fab.estimate.measure.face import FaceFlow
from deltact_fab.estimate.measure.sensor_id import SensorModel
from deltact_fab.estimate.measure.shape.density import jacobian_density, relative_depth
from deltact_fab.estimate.measure.shape.depth import (
    DepthFinder,
    DepthModel,
    ball_depth_mm,
    find_contacts,
)
from deltact_fab.sensor.elasticity.block import FreeBlock
from deltact_fab.sensor.elasticity.material import GelMaterial
from deltact_fab.sensor.optics.camera import Pinhole, axes_mm
from deltact_fab.sensor.shapes.sensor import SkinDimensions

SKIN = SkinDimensions(width_mm=26.0, length_mm=22.0, thickness_mm=10.0)
VIEW = SensorModel(Pinhole(0.08, 256, 208, 12.0), SKIN)
EVERY = 4
X, Y = (
    axis[: len(axis) // EVERY * EVERY].reshape(-1, EVERY).mean(1) for axis in axes_mm(VIEW.camera)
)
AT = np.stack((*np.meshgrid(X, Y), np.zeros((len(Y), len(X)))), axis=-1)


def _seen(u_mm: np.ndarray) -> FaceFlow:
    """What the camera sees of a displacement (h, w, 3) mm."""
    camera = VIEW.camera
    shift = (camera.project_px(AT + u_mm) - camera.project_px(AT)) * camera.mm_per_px
    return FaceFlow(shift.astype(np.float32), np.ones(u_mm.shape[:2], bool), X, Y)


def _in_plane(dx: object, dy: object) -> FaceFlow:
    shift = np.stack(np.broadcast_arrays(dx, dy, AT[..., 0])[:2], axis=-1)
    return FaceFlow(shift.astype(np.float32), np.ones(shift.shape[:2], bool), X, Y)


@pytest.fixture(scope="module")
def finder() -> DepthFinder:
    return DepthFinder(VIEW, DepthModel(1.0, 2.0))


@pytest.fixture(scope="module")
def pressed() -> np.ndarray:
    """The face (h, w, 3) under a round pressure at (4, -3) mm, by the free block."""
    block = FreeBlock(SKIN, GelMaterial(1.0, VIEW.poisson, 0.5, ()), 0.5)
    x, y = np.meshgrid(block.x_mm, block.y_mm)
    pressure = np.sqrt(np.maximum(1 - ((x - 4) ** 2 + (y + 3) ** 2) / 2.5**2, 0))
    u = block.apply(np.stack((0 * x, 0 * x, -0.5 * pressure), axis=-1))
    from scipy.interpolate import RectBivariateSpline

    parts = [RectBivariateSpline(block.y_mm, block.x_mm, u[..., i])(Y, X) for i in range(3)]
    return np.stack(parts, axis=-1)


def test_ball_depth_is_its_cap():
    tip, radius = np.array([5.0, -4.0, -1.5]), 6.0
    cap = radius - np.sqrt(np.maximum(radius**2 - ((AT[..., :2] - tip[:2]) ** 2).sum(-1), 1))
    depth = np.maximum(1.5 - cap, 0)
    drawn = _seen(np.stack((0 * depth, 0 * depth, -depth), axis=-1))
    assert np.abs(drawn.shift_mm).max() > 0.3  # off the axis depth is seen as motion
    assert np.abs(ball_depth_mm(drawn, VIEW, tip, radius) - depth).max() < 1e-3


def test_press_position_and_depth(finder, pressed):
    true = -pressed[..., 2]
    got = finder.find(_seen(pressed))
    assert got.cover == 1
    contact = true > 0.4 * true.max()
    assert np.abs(got.depth_mm - true)[contact].mean() < 0.15 * true.max()
    assert np.abs(got.depth_mm - true).mean() < 0.02 * true.max()
    row, column = np.unravel_index(got.depth_mm.argmax(), true.shape)
    assert np.hypot(X[column] - 4, Y[row] + 3) < 0.5


def test_gain_scales_and_extrapolation_is_flagged(finder, pressed):
    flow = _seen(pressed)
    once = finder.find(flow)
    shallow = DepthFinder(VIEW, DepthModel(1.5, 0.3)).find(flow)
    assert np.allclose(shallow.depth_mm, 1.5 * once.depth_mm)
    assert (once.extrapolated, shallow.extrapolated) == (False, True)


def test_hidden_part_lowers_cover_only(finder, pressed):
    shift = _seen(pressed).shift_mm
    known = np.hypot(AT[..., 0] - 5, AT[..., 1] + 3) > 2.5
    guessed = np.where(known[..., None], shift, 3.0).astype(np.float32)
    seen, other = (finder.find(FaceFlow(s, known, X, Y)) for s in (shift, guessed))
    assert seen.cover < 0.9
    assert (seen.valid == known).all()
    assert (seen.depth_mm == other.depth_mm).all()


@pytest.mark.parametrize("lost", ["contact", "all"])
def test_nan_points_do_not_spread(finder, pressed, lost):
    shift = _seen(pressed).shift_mm.copy()
    gone = np.hypot(AT[..., 0] - 4, AT[..., 1] + 3) < (2 if lost == "contact" else 99)
    shift[gone] = np.nan
    flow = FaceFlow(shift, np.ones(gone.shape, bool), X, Y)
    density = jacobian_density(flow, VIEW.camera.mm_per_px)
    depth = finder.find(flow)
    for values in (density.value, relative_depth(density, flow), depth.depth_mm):
        assert np.isfinite(values).all()
    assert not (density.reliable | depth.valid)[gone].any()
    found = find_contacts(depth, flow, VIEW.camera)
    if lost == "all":
        assert (depth.cover, density.cover, found) == (0, 0, [])
    else:
        assert depth.cover < 0.95
        assert np.isfinite(found[0].place_mm).all()


@pytest.mark.parametrize(
    "flow",
    [
        _in_plane(0.0, 0.0),
        _in_plane(0.5, -0.2),
        _in_plane(0.3 - 0.05 * AT[..., 1], 0.05 * AT[..., 0]),
    ],
    ids=["none", "shift", "shift and turn"],
)
def test_a_rigid_motion_has_no_depth(finder, flow):
    assert finder.find(flow).depth_mm.max() == 0
    density = jacobian_density(flow, VIEW.camera.mm_per_px)
    assert np.abs(relative_depth(density, flow)).max() < 3e-3


def test_relative_depth_keeps_edges():
    rng = np.random.default_rng(1)
    grow = 0.3 * (np.hypot(AT[..., 0], AT[..., 1]) < 4)
    noise = rng.normal(0, 0.0015, (2, len(Y), len(X)))
    flow = _in_plane(*(grow * AT[..., k] + noise[k] for k in (0, 1)))
    density = jacobian_density(flow, VIEW.camera.mm_per_px)
    got = relative_depth(density, flow)
    inner = np.hypot(AT[..., 0], AT[..., 1]) < 2.5
    outer = np.hypot(AT[..., 0], AT[..., 1]) > 6
    assert got[inner].mean() == pytest.approx(1 - 1 / 1.3**2, abs=0.01)
    assert abs(got[outer].mean()) < 0.002
    assert got[outer].std() < 0.5 * density.relative_depth[outer].std()


def test_file_without_gain_is_refused(tmp_path: Path):
    file = tmp_path / "depth.toml"
    made = '[made]\nruns = []\nsimulated = true\nversion = "0"\n'
    file.write_text(f'schema = 1\nkind = "depth"\n{made}')
    with pytest.raises(InputError, match=f"{file}: depth.*gain"):
        DepthModel.load(file)
