from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from deltact_fab.common.errors import InputError, SensorError
from deltact_fab.estimate.measure.compose import compose, landing_px, sample
from deltact_fab.estimate.measure.flow import renewed
from deltact_fab.estimate.measure.flow.fused import to_gray
from deltact_fab.estimate.measure.flow.renewed import FlowMethod
from deltact_fab.estimate.measure.flow.tracker import FlowTracker

MM_PER_PX = 0.0378
W, H = 798, 586
BORDER = 8


def error_mm(flow: Any, truth: Any, visible: Any = True) -> Any:
    """Endpoint errors of the pixels that are in view before and after, BORDER px from the edge."""
    h, w = flow.shape[:2]
    mask = np.zeros((h, w), bool)
    mask[BORDER:-BORDER, BORDER:-BORDER] = True
    mask &= visible
    x, y = np.moveaxis(landing_px(truth), -1, 0)
    mask &= (x > BORDER) & (x < w - 1 - BORDER) & (y > BORDER) & (y < h - 1 - BORDER)
    return np.hypot(*np.moveaxis(flow - truth, -1, 0))[mask] * MM_PER_PX


def run(images: Any, *args: Any, **kwargs: Any) -> Any:
    tracker = FlowTracker(*args, **kwargs)
    return [tracker.update(image) for image in images]


# One flow


@pytest.fixture(scope="module")
def pressed(make_scene, make_bump):
    """Two images of a press with shear, 2.3 mm at the peak."""
    bump = make_bump((430, 290), 140, shear_px=(50, 20), press_px=30)
    scene = make_scene(W, H, patch_mm=0.1)
    return scene.picture(), scene.picture(bump, 1), bump.flow_px(H, W)


@pytest.mark.parametrize("name", FlowMethod.NAMES)
def test_methods_track_press_cold_warm(name, pressed):
    first, second, truth = pressed
    method = FlowMethod(name)
    cold = method.between(to_gray(first), to_gray(second))
    start = (0.9 * truth).astype(np.float32)
    kept = start.copy()
    warm = method.between(to_gray(first), to_gray(second), start)
    print(name, error_mm(cold, truth).mean(), error_mm(warm, truth).mean())
    assert cold.dtype == warm.dtype == np.float32
    assert error_mm(cold, truth).mean() <= 0.03
    assert error_mm(warm, truth).mean() <= 0.03
    assert np.array_equal(start, kept)


# Confidence


@pytest.fixture(scope="module")
def small(make_scene, make_bump):
    scene = make_scene(320, 256)
    bump = make_bump((150, 130), 70, shear_px=(24, -10))
    return scene, bump


def test_low_contrast_pattern_is_tracked(small, make_scene):
    _, bump = small
    faint = make_scene(320, 256, contrast=0.25, noise=8.0, shading=0.0)
    seen = run([faint.picture(bump.scaled(k / 5), k) for k in range(6)])
    assert error_mm(seen[-1].flow_px, bump.flow_px(256, 320)).mean() <= 0.03
    assert min(o.diagnostics.confident_share for o in seen) > 0.85


@pytest.mark.parametrize("contrast", [0.25, 1.0])
def test_renewal_threshold_scales_with_pattern(contrast, make_scene):
    """Of prints of two seeds, without and with light that falls off."""
    one, other = (
        to_gray(make_scene(640, 480, seed=seed, contrast=contrast, shading=0.0).picture())
        for seed in (1, 2)
    )
    apart = np.abs(one.astype(float) - other).mean()
    found = renewed.unrelated_difference(one)
    assert found == pytest.approx(apart, rel=0.15)
    light = 1 - 0.35 * np.linspace(0, 1, 640) ** 2
    assert renewed.unrelated_difference(np.uint8(one * light)) == pytest.approx(
        found * light.mean(), rel=0.1
    )
    assert renewed.photometric_error(one, other, np.zeros((480, 640, 2), np.float32)) > found / 2


# Composition and visibility


@settings(max_examples=25, deadline=None)
@given(*[st.floats(-0.1, 0.1) for _ in range(6)], *[st.floats(-4, 4) for _ in range(2)])
def test_composition_of_affine_flows_is_exact(a, b, c, d, e, f, tx, ty):
    y, x = np.mgrid[0:48, 0:64].astype(np.float32)
    first = np.stack((a * x + b * y + tx, c * x + d * y + ty), -1).astype(np.float32)
    second = np.stack((e * x - f * y, f * x + e * y), -1).astype(np.float32)
    where = landing_px(first)
    u, v = where[..., 0], where[..., 1]
    truth = first + np.stack((e * u - f * v, f * u + e * v), -1)
    inside = (u >= 0) & (u <= 63) & (v >= 0) & (v <= 47)
    # cv2 may round sampling points to 1/32 px: half of that times a gradient of 0.15.
    assert np.abs(compose(first, second) - truth)[inside].max(initial=0.0) < 0.005
    assert sample(second, where).shape == second.shape


def test_composed_path_outside_stays_invisible(make_scene, make_bump):
    scene = make_scene(320, 256, patch_mm=0.2, margin=90)
    way = [0, 15, 30, 45, 60, 45, 30, 15, 0]
    images = [
        scene.picture(make_bump((0, 0), 100, shift_px=(float(s), 0.0)), k)
        for k, s in enumerate(way)
    ]
    out = run(images, "dis-medium", renew_share=0.0)
    static = run(images, "dis-medium/static")
    columns = out[4].visible[40:-40].mean(axis=0)
    assert columns[: 320 - 63].min() == 1.0
    assert columns[320 - 57 :].max() == 0.0
    assert out[-1].visible[40:-40, 320 - 42 :].mean() < 0.05
    assert static[-1].visible[40:-40, 4:-4].mean() > 0.95


# Contract


def test_reused_camera_buffer_is_safe(small):
    scene, bump = small
    frames = [to_gray(scene.picture(bump.scaled(k / 3), k)) for k in range(4)]
    separate = run(frames, "dis-fast")
    buffer = np.empty_like(frames[0])
    tracker = FlowTracker("dis-fast")
    for frame in frames:
        buffer[:] = frame
        last = tracker.update(buffer)
    assert np.array_equal(last.flow_px, separate[-1].flow_px)


def test_images_are_checked(small):
    scene, bump = small
    image = scene.picture()
    tracker = FlowTracker("dis-fast")
    with pytest.raises(SensorError, match="texture"):
        tracker.update(np.zeros((256, 320, 3), np.uint8))
    with pytest.raises(InputError, match="float64"):
        tracker.update(image.astype(float))
    with pytest.raises(InputError, match="64 px or more"):
        tracker.update(image[:40])
    tracker.update(image)
    with pytest.raises(InputError, match=r"\(200, 320\), the first one was \(256, 320\)"):
        tracker.update(image[:200])
    with pytest.raises(InputError, match=r"\(256, 320\), the first one was \(256, 320, 3\)"):
        tracker.update(to_gray(image))
    assert tracker.update(scene.picture(bump, 1)).diagnostics.frame == 1
