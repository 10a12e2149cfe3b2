from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import pytest

from deltact_fab.estimate.measure.compose import denoise
from deltact_fab.estimate.measure.flow.confidence import DEVIATION_MAX_PX
from deltact_fab.estimate.measure.flow.fused import (
    Plane,
    RefinementReference,
    to_full,
    to_gray,
    to_half,
)
from deltact_fab.estimate.measure.flow.nodes import WINDOW_WEIGHTS

W, H = 320, 256
EDGE = 12  # nodes at the border whose windows are cut


@dataclass(frozen=True)
class Affine:
    """x goes to x + shift + A (x - centre)."""

    shift_px: tuple[float, float]
    a: tuple[tuple[float, float], tuple[float, float]] = ((0, 0), (0, 0))

    def flow_px(self, height: int, width: int) -> Any:
        return self._from_centre(height, width) @ np.array(self.a).T + self.shift_px

    def inverse_px(self, height: int, width: int, start: Any = None) -> Any:
        forth = np.linalg.inv(np.eye(2) + np.array(self.a))
        off = self._from_centre(height, width)
        return _grid(height, width) - off + (off - self.shift_px) @ forth.T

    def _from_centre(self, height: int, width: int) -> Any:
        return _grid(height, width) - [(width - 1) / 2, (height - 1) / 2]


def _reference(image: Any) -> RefinementReference:
    return RefinementReference(Plane.from_image(image))


def _grid(height: int, width: int) -> Any:
    y, x = np.mgrid[0:height, 0:width].astype(float)
    return np.stack((x, y), -1)


@pytest.fixture(scope="module")
def scene(make_scene):
    return make_scene(W, H, patch_mm=0.1)


def off_px(flow: Any, truth: Any) -> Any:
    """Endpoint errors at nodes whose windows are whole."""
    return np.hypot(*np.moveaxis(flow - to_half(truth), -1, 0))[EDGE:-EDGE, EDGE:-EDGE]


# What it finds


@pytest.mark.parametrize("grey", [True, False], ids=["grey", "colour"])
@pytest.mark.parametrize(
    "motion",
    [Affine((6.3, -5.1)), Affine((-2.1, 1.4), ((0.03, 0.06), (-0.02, 0.05)))],
    ids=["six px", "turn and stretch"],
)
def test_affine_motion_within_twentieth_pixel(motion, grey, scene):
    first, second = scene.picture(), scene.picture(motion, 1)
    if grey:
        first, second = to_gray(first), to_gray(second)
    found = _reference(first).refine(Plane.from_image(second))
    error = off_px(found.flow_px, motion.flow_px(H, W))
    print(f"rms {np.sqrt(np.mean(error**2)):.4f} max {error.max():.3f} px")
    assert np.sqrt(np.mean(error**2)) < 0.05
    assert error.max() < 0.25
    assert np.median(found.correlation) > 0.95


@pytest.mark.parametrize("shift_px", [(0.2, 0.0), (0.0, 0.75), (0.15, 0.3), (0.6, 0.9)])
@pytest.mark.parametrize("blob_px", [0.7, 1.4])
def test_no_bias_at_any_fraction(blob_px, shift_px):
    """Shifted by its spectrum, so exactly."""
    speckle = cv2.GaussianBlur(np.random.default_rng(4).normal(size=(H, W)), (0, 0), blob_px)
    waves = np.fft.fft2(128 + 40 * np.tanh(speckle / speckle.std()))
    x, y = np.fft.fftfreq(W), np.fft.fftfreq(H)[:, None]
    first, second = (
        np.rint(np.fft.ifft2(waves * np.exp(-2j * np.pi * (x * dx + y * dy))).real).clip(0, 255)
        for dx, dy in ((0, 0), shift_px)
    )
    found = _reference(first.astype(np.uint8)).refine(Plane.from_image(second.astype(np.uint8)))
    bias = np.median(found.flow_px[EDGE:-EDGE, EDGE:-EDGE], axis=(0, 1)) - shift_px
    print(f"bias {1e3 * bias} px / 1000")
    assert np.abs(bias).max() < 0.003


@pytest.mark.parametrize(("gain", "offset"), [(1, -60), (1, 40), (0.6, 0)])
@pytest.mark.parametrize("shift_px", [0, 5])
def test_light_change_harmless_at_border(shift_px, gain, offset, make_scene):
    """What the current image does not show must not pull by the difference of the light."""
    scene = make_scene(W, H, patch_mm=0.1, contrast=0.4, shading=0.0)
    motion = Affine((shift_px, shift_px))
    first, second = to_gray(scene.picture()), to_gray(scene.picture(motion, 1))
    lit = np.clip(np.rint(gain * second.astype(float) + offset), 0, 255).astype(np.uint8)
    assert np.mean(lit == 0) < 0.01
    truth = to_half(motion.flow_px(H, W))
    start = np.ascontiguousarray(truth, np.float32)
    found = _reference(first).refine(Plane.from_image(lit), start).flow_px
    stays = np.s_[: H // 2 - 4, : W // 2 - 4]
    error = np.hypot(*np.moveaxis(found - truth, -1, 0))[stays]
    print(f"max {error.max():.3f} px")
    assert error.max() < 0.35


def test_restart_from_result_is_stable(scene):
    motion = Affine((1.2, 0.7), ((0.03, 0.0), (0.0, -0.02)))
    reference = _reference(scene.picture())
    current = Plane.from_image(scene.picture(motion, 1))
    first = flow = reference.refine(current).flow_px
    for _ in range(30):
        flow = reference.refine(current, flow).flow_px
    assert np.abs(flow - first)[EDGE:-EDGE, EDGE:-EDGE].max() < 0.02


# What it knows of itself


@pytest.mark.parametrize("grey", [True, False], ids=["grey", "colour"])
@pytest.mark.parametrize("noise", [2.0, 10.0])
def test_deviation_equals_noise_error(noise, grey, make_scene):
    scene = make_scene(W, H, patch_mm=0.1, noise=noise)
    first, second = scene.picture(), scene.picture(Affine((0.5, 0.5)), 1)
    if grey:
        first, second = to_gray(first), to_gray(second)
    found = _reference(first).refine(Plane.from_image(second))
    error = off_px(found.flow_px, Affine((0.5, 0.5)).flow_px(H, W))
    told = found.deviation_px[EDGE:-EDGE, EDGE:-EDGE]
    ratio = np.sqrt(np.mean(error**2) / np.mean(told**2))
    print(f"noise {noise}: error {np.sqrt(np.mean(error**2)):.4f} px, {ratio:.2f} of the deviation")
    assert 1 / 1.5 < ratio < 1.5


def test_correlation_is_that_of_the_windows(scene, make_scene):
    image = to_gray(scene.picture())
    same = _reference(image).evaluate(
        Plane.from_image(image), np.zeros((H // 2, W // 2, 2), np.float32)
    )
    assert same.correlation[1:-1, 1:-1].min() > 0.999
    negative = _reference(image).evaluate(Plane.from_image(255 - image), same.flow_px)
    assert negative.correlation[1:-1, 1:-1].max() < -0.999
    # By hand, at one node: the weights are those of the window, cell by cell.
    other = to_gray(make_scene(W, H, patch_mm=0.1, seed=9).picture())
    found = _reference(image).evaluate(Plane.from_image(other), same.flow_px)
    i, j = 60, 70
    cut = np.s_[2 * i - 10 : 2 * i + 12, 2 * j - 10 : 2 * j + 12]
    weight = np.repeat(WINDOW_WEIGHTS.astype(float), 2)
    first, second = (Plane.from_image(a).gray[cut].ravel() for a in (image, other))
    by_hand = np.cov(first, second, aweights=np.outer(weight, weight).ravel())
    expected = by_hand[0, 1] / np.sqrt(by_hand[0, 0] * by_hand[1, 1])
    assert found.correlation[i, j] == pytest.approx(expected, abs=2e-3)


# What is left of noise


def _noise_px(deviation_px: Any) -> Any:
    """Noise of a fit: alike within a window."""
    white = np.random.default_rng(6).normal(size=(H, W, 2)).astype(np.float32)
    alike = cv2.GaussianBlur(white, (0, 0), 3.0)
    return alike * np.float32(np.sqrt(0.5) / alike.std()) * deviation_px[..., None]


@pytest.mark.parametrize(("period", "most_px"), [(np.inf, 0.01), (150, 0.015), (25, 0.03)])
@pytest.mark.parametrize("unknown_px", [0.03, 1.0])
def test_denoise_keeps_waves(unknown_px, period, most_px):
    deviation = np.full((H, W), 0.03, np.float32)
    deviation[:, W // 2 :] = unknown_px
    truth = np.zeros((H, W, 2), np.float32)
    truth += 0.5 * np.sin(2 * np.pi * np.arange(W) / period)[:, None]
    found, _ = denoise(truth + _noise_px(deviation), deviation, deviation > 0)
    error = np.hypot(*np.moveaxis(found - truth, -1, 0))[EDGE:-EDGE, EDGE : W // 2]
    beside = 40 if unknown_px > 0.1 else 0
    print(f"{np.sqrt(np.mean(error**2)):.4f} px, beside {error[:, -8:].mean():.4f}")
    assert np.sqrt(np.mean(error[:, : -1 - beside] ** 2)) < most_px
    assert error[:, -8:].mean() < 0.05


@pytest.mark.parametrize("is_smooth", [True, False], ids=["press", "behind a bubble"])
def test_rough_flow_is_not_confident(is_smooth):
    """A bubble shows its part of the face larger."""
    x, y = np.moveaxis(_grid(H, W) - [W / 2, H / 2], -1, 0)
    off2, deviation = x**2 + y**2, np.full((H, W), 0.05, np.float32)
    reach = np.exp(-off2 / 2 / 60**2) if is_smooth else np.clip(1 - off2 / 20**2, 0, 1)
    flow = (0.3 if is_smooth else 0.4) * np.stack((x, y), -1) * reach[..., None] + _noise_px(
        deviation
    )
    _, rough_px2 = denoise(flow.astype(np.float32), deviation, deviation > 0)
    seen = np.s_[EDGE:-EDGE, EDGE:-EDGE]
    print(
        f"{np.sqrt(rough_px2.max()):.3f} px, share {(rough_px2 > DEVIATION_MAX_PX**2).mean():.4f}"
    )
    assert rough_px2[seen].max() < 0.001 if is_smooth else rough_px2.max() > DEVIATION_MAX_PX**2
    assert rough_px2[off2 > 60**2][: 20 * W].max() < 0.02


# The half grid


@pytest.mark.parametrize("shape", [(64, 96), (65, 97), (67, 64)])
def test_node_is_centre_of_pixels(shape):
    h, w = shape
    hh, ww = -(-h // 2), -(-w // 2)
    field = (0.3 * _grid(h, w) @ np.array([[1.0, -0.4], [0.2, 2.0]]) + [3, -5]).astype(np.float32)
    at = 2 * _grid(hh, ww) + 0.5
    nodes = (0.3 * at @ np.array([[1.0, -0.4], [0.2, 2.0]]) + [3, -5]).astype(np.float32)
    assert to_half(field) == pytest.approx(nodes, abs=1e-3)
    assert to_full(nodes, shape) == pytest.approx(field, abs=1e-3)
    assert to_full(nodes[..., 0], shape) == pytest.approx(field[..., 0], abs=1e-3)


def test_leaving_parts_do_not_disturb(scene):
    motion = Affine((45.0, -30.0))
    reference = _reference(scene.picture())
    current = Plane.from_image(scene.picture(motion, 1))
    start = to_half(motion.flow_px(H, W)) + np.float32(0.8)
    found = reference.refine(current, start)
    stays = np.s_[15 + EDGE : -EDGE, EDGE : -23 - EDGE]
    error = np.hypot(*np.moveaxis(found.flow_px - to_half(motion.flow_px(H, W)), -1, 0))
    assert error[stays].mean() < 0.05
    away = reference.refine(current, np.full_like(start, 1e7))
    for result in (found, away):
        assert all(np.isfinite(a).all() for a in result)


def test_plain_windows_do_not_correlate():
    plain = np.full((H, W), 255, np.uint8)
    still = np.zeros((H // 2, W // 2, 2), np.float32)
    found = _reference(plain).evaluate(Plane.from_image(plain), still)
    assert np.abs(found.correlation).max() < 0.01
