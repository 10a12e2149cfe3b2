"""What is believed: true pairs, and images that have nothing to do with the first one."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
import pytest

from deltact_fab.estimate.measure.flow.confidence import WINDOW_PX, ConfidenceEstimator, FlowState
from deltact_fab.estimate.measure.flow.fused import Plane, RefinedFlow, to_gray
from deltact_fab.estimate.measure.flow.tracker import FlowTracker

W, H = 480, 360
MM_PER_PX = 0.0378
# Two patterns and seeds that no threshold was set on.
PATTERNS = {"0.1 mm": {"patch_mm": 0.1, "seed": 31}, "0.2 mm with dots": {
    "patch_mm": 0.2, "seed": 32, "dots": True}}  # fmt: skip
UNRELATED = {
    "mirrored": lambda image, _: image[:, ::-1],
    "negative": lambda image, _: 255 - image,
    "other seed": lambda _, other: other,
    "noise": lambda image, _: np.random.default_rng(3).integers(0, 256, image.shape, np.uint8),
    "flat": lambda image, _: np.full_like(image, 120),
}


@pytest.fixture(scope="module", params=PATTERNS)
def sequence(request, make_scene, make_bump):
    """Five images of a motion of 30 px, its truths, and one image of another seed."""
    options = PATTERNS[request.param]
    scene = make_scene(W, H, **options)
    other = make_scene(W, H, **(options | {"seed": 900})).picture()
    bumps = [make_bump((230, 180), 90, shear_px=(7.0 * k, -3.0 * k)) for k in range(5)]
    images = [scene.picture(b, k) for k, b in enumerate(bumps)]
    return images, [b.flow_px(H, W) for b in bumps], other


def follow(images: Any, tracker: FlowTracker | None = None) -> Any:
    tracker = tracker or FlowTracker()
    for image in images:
        last = tracker.update(np.ascontiguousarray(image))
    return last


def off_px(seen: Any, truth: Any) -> Any:
    return np.hypot(*np.moveaxis(seen.flow_px - truth, -1, 0))


@pytest.mark.parametrize("gray", [False, True])
@pytest.mark.parametrize("what", UNRELATED)
def test_an_unrelated_image_is_not_believed(what, gray, sequence):
    images, _, other = sequence
    for before in (images[:1], images[2:]):
        bad, tracker = UNRELATED[what](before[-1], other), FlowTracker()
        for image in (*before, bad, bad):
            image = np.ascontiguousarray(image)
            seen = tracker.update(to_gray(image) if gray else image)
            if image is not before[0] and np.array_equal(image, bad):
                assert seen.confident.mean() <= 0.005
                assert not seen.diagnostics.trusted


@pytest.mark.parametrize("gray", [False, True])
def test_unrelated_image_leaves_no_trace(gray, sequence):
    images, truths, other = sequence
    take = to_gray if gray else np.asarray
    shown = [take(i) for i in (*images[:3], other, *images[3:])]
    seen = follow(shown)
    assert seen.diagnostics.trusted
    assert seen.diagnostics.textured_share > 0.95
    # A grey image has one witness, so that one must say more.
    assert seen.diagnostics.confident_share > (0.8 if gray else 0.92)
    error = off_px(seen, truths[-1])[seen.confident]
    assert error.mean() < 0.2
    assert (error > 2.6).mean() <= 0.0005


def test_confident_from_three_pixels_inside_edge(sequence):
    still = follow([sequence[0][0]] * 2).confident
    assert not still[:2].any()
    assert still[30:40, 30:-30].mean() > 0.9


@pytest.mark.parametrize(("sign", "stands"), [(-1, True), (1, False)], ids=["turn", "fold"])
def test_rotation_valid_fold_invalid(sign, stands):
    """A slope of 0.97 across: turned the face has 1.94 of its area, sheared 0.06."""
    image = np.random.default_rng(2).integers(0, 256, (256, 256), np.uint8)
    y, x = np.mgrid[-64:64, -64:64].astype(np.float32) * 2
    one = np.ones_like(x)
    match = RefinedFlow(np.stack((sign * 0.97 * y, 0.97 * x), -1), one, 0 * one, 0 * one)
    kept, _ = ConfidenceEstimator(image, Plane.from_image(image)).check([], match)
    assert (kept[54:74, 54:74] == stands).all()


@pytest.mark.parametrize("with_what", ["grey card", "another pattern"])
def test_half_covered_view_trusts_visible_half(with_what, sequence):
    images, truths, other = sequence
    half = images[-1].copy()
    half[:, : W // 2] = 80 if with_what == "grey card" else other[:, : W // 2]
    seen = follow([*images[:-1], half])
    x = np.arange(W) + truths[-1][..., 0]
    assert seen.confident[x < W // 2 - 10].mean() <= 0.005
    clear = (x > W // 2 + 34) & seen.visible
    assert seen.confident[clear].mean() > 0.85
    assert (off_px(seen, truths[-1])[seen.confident] > 2.6).mean() <= 0.002


@pytest.mark.parametrize("level", [0, 120, 255])
def test_plain_half_is_not_known(level, sequence):
    images, truths, _ = sequence
    halves = [image.copy() for image in images]
    for k, half in enumerate(halves):
        noise = np.random.default_rng(k).normal(0, 1.5, half[:, W // 2 :].shape)
        half[:, W // 2 :] = level + (noise if level == 120 else 0)
    tracker = FlowTracker()
    tracker.update(halves[0])
    for half, truth in zip(halves[1:], truths[1:], strict=True):
        seen = tracker.update(half)
        # A window at the border holds both.
        is_face = np.arange(W) + truth[..., 0] < W // 2 + WINDOW_PX // 2
        wrong = (off_px(seen, truth) > 0.1 / MM_PER_PX) | ~is_face
        assert wrong[seen.visible & (seen.state > FlowState.LOST)].mean() <= 0.01
        assert (seen.state > FlowState.LOST)[20:-20, 20 : W // 2 - 60].mean() > 0.95


def test_plain_between_lines_is_unknown(make_bump):
    """A white skin with a drawn grid of 90 px, its cells four times as wide as a window."""
    bump, tracker, x = make_bump((230, 180), 90, shear_px=(4.0, -2.0)), FlowTracker(), np.arange(W)
    for k in range(5):
        at = bump.scaled(k / 2).inverse_px(H, W)
        lines = sum(np.exp(-(((at[..., i] + 7) % 90 - 45) ** 2) / 8) for i in (0, 1))
        grey = 200 - 120 * np.minimum(lines, 1) + 10 * np.sin(x / 90)
        noise = np.random.default_rng(k).normal(0, 2.0, (H, W))
        seen = tracker.update(np.clip(cv2.GaussianBlur(grey, (0, 0), 0.8) + noise, 0, 255).astype(
            np.uint8))  # fmt: skip
        known = seen.visible & (seen.state > FlowState.LOST)
        off = off_px(seen, bump.scaled(k / 2).flow_px(H, W))
        assert (known & (off > 1)).mean() <= 0.005


def test_trust_needs_texture_over_half(sequence):
    images, _, _ = sequence
    corner = [np.full_like(image, 120) for image in images[:2]]
    for image, true in zip(corner, images, strict=False):
        image[-140:, -160:] = true[-140:, -160:]
    tracker = FlowTracker()
    first, second = (tracker.update(image) for image in corner)
    for seen in (first, second):
        assert 0.1 < seen.diagnostics.textured_share < 0.25
        assert not seen.diagnostics.trusted
    assert second.confident[-100:-20, -120:-20].mean() > 0.9


@pytest.mark.parametrize("light", [0.6, 1.4, "gradient"])
def test_light_does_not_matter(light, sequence):
    images, truths, _ = sequence
    gain = np.linspace(0.6, 1.3, W)[:, None] if light == "gradient" else light
    lit = np.clip(images[-1] * gain, 0, 255).astype(np.uint8)
    seen = follow([*images[:-1], lit])
    assert seen.diagnostics.trusted
    assert seen.diagnostics.confident_share > 0.8
    assert (off_px(seen, truths[-1])[seen.confident] > 2.6).mean() <= 0.002


@pytest.mark.parametrize("name", ["dis-fast", "dis-fast/static", "paper"])
def test_trackers_share_confidence_rule(name, sequence):
    images, truths, _ = sequence
    true = follow(images, FlowTracker(name))
    assert true.diagnostics.trusted
    assert (off_px(true, truths[-1])[true.confident] > 2.6).mean() < 0.05
    turned = follow([images[0], images[0][::-1, ::-1]], FlowTracker(name))
    assert turned.confident.mean() <= 0.005
    assert not turned.diagnostics.trusted


@pytest.mark.parametrize("at_once", [True, False], ids=["first", "after a sequence"])
def test_blurred_detail_is_not_confident(at_once, sequence):
    """Steps that the blurred image makes too short have not arrived, however small they are."""
    images, truths, _ = sequence
    before = images[:1] if at_once else images[:-1]
    confident = []
    for side in (9, 21):
        seen = follow([*before, cv2.blur(images[-1], (side, 1))])
        off = off_px(seen, truths[-1])[seen.confident]
        print(f"{side} px: {seen.confident.mean():.3f}, off {(off > 1).mean() if off.size else 0}")
        assert not off.size or (off > 1).mean() < 0.005
        confident.append(seen.confident.mean())
    assert confident[0] > 0.4 > 0.1 > confident[1]
