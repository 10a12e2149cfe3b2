"""The anchored tracker, the default: what is hidden, what comes back, what is far."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
import pytest
from called import count_calls

import benchmarks.renewal
from deltact_fab.common.errors import InputError
from deltact_fab.estimate.measure import compose
from deltact_fab.estimate.measure.compose import fill_gaps
from deltact_fab.estimate.measure.flow.confidence import FlowState
from deltact_fab.estimate.measure.flow.renewed import RENEW_GREY, FlowMethod
from deltact_fab.estimate.measure.flow.tracker import FlowTracker

MM_PER_PX = 0.0378


def off_px(flow: Any, truth: Any) -> Any:
    return np.hypot(*np.moveaxis(flow - truth, -1, 0))


def follow(images: Any, tracker: FlowTracker | None = None) -> Any:
    tracker = tracker or FlowTracker()
    return [tracker.update(image) for image in images]


# Hidden and found again


@pytest.fixture(scope="module")
def passing(make_scene: Any, make_bump: Any) -> Any:
    """A growing shear over which a foreign patch of another pattern passes from left to right."""
    scene, other = make_scene(320, 256, margin=90), make_scene(320, 256, seed=50)
    bump = make_bump((150, 130), 80, shear_px=(40, -12))
    cover = other.picture()
    images, hidden = [], []
    for k in range(13):
        image = scene.picture(bump.scaled(k / 12), k) if k else scene.picture()
        mask = np.zeros((256, 320), bool)
        if 3 <= k <= 9:
            left = 40 * (k - 3)
            mask[70:190, left : left + 80] = True
            # It carries its pattern with it, so a frame-to-frame flow follows it.
            image[mask] = cover[70:190, :80].reshape(-1, 3)
        images.append(image)
        hidden.append(mask)
    truths = [bump.scaled(k / 12).flow_px(256, 320) for k in range(13)]
    return images, hidden, truths


def under(mask: Any, truth: Any) -> Any:
    """Material pixels that lie under an image mask."""
    h, w = mask.shape
    y, x = np.mgrid[:h, :w]
    column = np.clip(np.rint(x + truth[..., 0]), 0, w - 1).astype(int)
    row = np.clip(np.rint(y + truth[..., 1]), 0, h - 1).astype(int)
    return mask[row, column]


@pytest.mark.slow
def test_hidden_part_recovers_occluder_is_ignored(passing):
    images, hidden, truths = passing
    seen = follow(images)
    inner = np.zeros((256, 320), bool)
    inner[12:-12, 12:-12] = True
    for k in range(3, 10):
        covered = under(hidden[k], truths[k]) & inner
        assert seen[k].confident[covered].mean() <= 0.01
        assert (seen[k].state[covered] == FlowState.MATCHED).mean() < 0.5
        clear = seen[k].confident & ~covered & inner
        assert clear.sum() > 0.4 * (inner & ~covered).sum()
        assert (off_px(seen[k].flow_px, truths[k])[clear] > 1).mean() <= 0.01
    last = seen[-1]
    error = off_px(last.flow_px, truths[-1])[inner & last.visible] * MM_PER_PX
    assert error.mean() <= 0.01
    assert (last.state[inner & last.visible] == FlowState.MATCHED).mean() > 0.98
    # A reference that is renewed takes the hidden part along with what hides it.
    composed = follow(images, FlowTracker("dis-medium", renew_share=0.0))[-1]
    lost = off_px(composed.flow_px, truths[-1])[inner & last.visible] * MM_PER_PX
    assert error.mean() < 0.2 * lost.mean()


def test_states_matched_predicted_lost(make_scene):
    scene = make_scene(320, 256)
    rest = scene.picture()
    covered = rest.copy()
    covered[20:30, 100:110] = 90  # small: its neighbours tell
    covered[100:256, 150:320] = 90  # large: its middle has none
    last = follow([rest, covered])[-1]
    assert last.state.dtype == np.uint8
    assert (last.state[60:90, 40:90] == FlowState.MATCHED).all()
    assert (last.state[24:27, 103:108] >= FlowState.PREDICTED).all()
    assert (last.state[200:240, 220:300] == FlowState.LOST).all()


@pytest.mark.parametrize("share", [0.0, 1.0])
def test_lost_face_recovers(make_scene, make_bump, share):
    scene = make_scene(320, 256, margin=130)
    bump = make_bump((160, 128), 60, shift_px=(90, 0))
    images = [scene.picture(bump.scaled(k / 9), k) for k in range(10)]
    dark, end = np.zeros_like(images[0]), bump.scaled(share)
    frames = follow([*images, dark, scene.picture(end, 20)])[-3:]
    assert [frame.diagnostics.trusted for frame in frames] == [True, False, True]
    error_px = off_px(frames[-1].flow_px, end.flow_px(256, 320))[frames[-1].confident]
    assert error_px.mean() < 0.1


def test_gap_fill_continues_neighbours(monkeypatch):
    y, x = np.mgrid[:120, :160].astype(np.float32)
    truth = np.stack((3 + 0.2 * x - 0.1 * y, -4 + 0.05 * x + 0.15 * y), -1)
    kept = np.ones((120, 160), bool)
    kept[30:80, 40:110] = False
    kept[:, 150:] = False
    shown = np.where(kept[..., None], truth, np.float32(99))
    out = fill_gaps(shown, kept, kept)
    assert np.array_equal(out[kept], truth[kept])
    assert off_px(out, truth)[~kept].mean() < 1.5
    assert not fill_gaps(shown, np.zeros_like(kept), np.zeros_like(kept)).any()
    assert np.array_equal(fill_gaps(shown, kept, np.ones_like(kept)), shown)
    with monkeypatch.context() as patch:
        patch.setattr(compose, "SLOPE_RIDGE", 1e9)  # means instead of planes
        flat = fill_gaps(shown, kept, kept)
    assert off_px(out, truth)[~kept].mean() < 0.5 * off_px(flat, truth)[~kept].mean()


# Contract


def test_half_resolution_equals_flow_at_nodes(make_scene, make_bump):
    scene = make_scene(319, 257)
    bump = make_bump((150, 130), 70, shear_px=(9, -6))
    images = [scene.picture(), scene.picture(bump, 1)]
    whole, half = follow(images)[-1], follow(images, FlowTracker(full=False))[-1]
    assert whole.flow_px.shape == (257, 319, 2)
    assert half.flow_px.shape == (129, 160, 2)
    for name in ("visible", "confident", "state"):
        assert getattr(whole, name).shape == (257, 319)
        assert getattr(half, name).shape == (129, 160)
        assert np.array_equal(getattr(whole, name)[::2, ::2], getattr(half, name))
    middle = whole.flow_px[:256, :318].reshape(128, 2, 159, 2, 2).mean(axis=(1, 3))
    assert np.abs(middle - half.flow_px[:128, :159]).max() < 0.1
    assert not whole.flow_px.flags.writeable


# Names


def test_every_name_is_a_tracker():
    for method in FlowMethod.NAMES:
        default = FlowTracker(method)
        assert default.reference == ("anchored" if method == "fused" else "composed")
        static = FlowTracker(f"{method}/static")
        assert (static.method.name, static.reference) == (method, "static")
    paper = FlowTracker("paper")
    assert (paper.method.name, paper.reference) == ("dis-medium", "published")
    with pytest.raises(InputError, match="flow method 'fuse': unknown; did you mean 'fused'"):
        FlowTracker("fuse")
    with pytest.raises(InputError, match=r"'statik' of 'fused'.*did you mean 'static'"):
        FlowTracker("fused/statik")
    with pytest.raises(InputError, match=r"'anchored' of 'dis-fast'.*valid: composed"):
        FlowTracker("dis-fast/anchored")


def test_share_renews_on_warped_difference(make_scene, make_bump):
    scene = make_scene(320, 256, margin=90)
    bump = make_bump((150, 130), 70, shear_px=(60, -20))
    images = [scene.picture(bump.scaled(k / 4), k) for k in range(5)]
    for share, switches in ((1.0, [0, 0, 0, 0]), (0.0, [1, 2, 3, 4])):
        seen = follow(images, FlowTracker("farneback/summed", renew_share=share))
        assert [o.diagnostics.n_reference_switches for o in seen[1:]] == switches


def test_published_tracker_renews_and_returns():
    """Blocks of 40 px that move away and back: 20 x 20 samples of them are nearly unrelated."""
    blocks = np.random.default_rng(1).integers(0, 256, (15, 20), np.uint8)
    first = cv2.resize(blocks, (798, 586), interpolation=cv2.INTER_NEAREST)
    steps = [*range(1, 6), *range(4, -1, -1)]
    images = [first, *(np.roll(first, (25 * k, 40 * k), (0, 1)) for k in steps)]
    seen = follow(images, FlowTracker("paper"))
    switches = [o.diagnostics.n_reference_switches for o in seen]
    assert 0 < switches[5] < switches[-1]
    assert np.median(seen[5].flow_px, axis=(0, 1)) == pytest.approx((200, 125), abs=1)
    # Back at the first reference, nothing of the way is left in the sum.
    assert not seen[-1].flow_px.any()
    assert seen[-1].visible.all()


@pytest.mark.parametrize(("grey", "renewed"), [(17, 0), (19, 1)])
def test_published_thresholds_are_grey_levels(grey, renewed):
    """A plain change of light is a difference that no flow explains."""
    texture = np.random.default_rng(2).integers(60, 120, (257, 319), np.uint8)
    last = follow([texture, texture + np.uint8(grey)], FlowTracker("paper"))[-1]
    assert last.diagnostics.n_reference_switches == renewed
    assert last.visible.shape == last.flow_px.shape[:2] == texture.shape


def test_equal_flows_are_computed_once(make_scene, make_bump):
    """And their time is told by each: else the second would seem to cost nothing."""
    bump = make_bump((150, 130), 70, shear_px=(60, -20))
    scene = make_scene(320, 256, margin=90)
    images = [scene.picture(bump.scaled(k / 4), k) for k in range(5)]
    found = []
    for shared, most in ((None, 8), ({}, 4)):
        pair = [
            FlowTracker(f"farneback/{total}", shared=shared) for total in ("summed", "composed")
        ]
        seen, calls = count_calls(lambda of=pair: [[t.update(i) for t in of] for i in images])
        assert calls["~ <calcOpticalFlowFarneback>"] == most
        found.append([[o.flow_px for o in pair] for pair in seen])
        first_ms, second_ms = np.sum([[o.diagnostics.cpu_ms for o in p] for p in seen[1:]], axis=0)
        assert second_ms > 0.5 * first_ms
    assert np.array_equal(*found)


@pytest.mark.slow
def test_renewal_possible_on_paper_patterns() -> None:
    """A threshold of 12 grey levels at a quarter of the size could on five of seventeen."""
    found = list(benchmarks.renewal.seen())
    assert len(found) == 17
    assert all(threshold < most for _, threshold, most, _ in found), found
    # The published one: of the paper's best patterns not by their patches, but by their dots.
    coarse = {name: seen for name, *_, seen in found}
    patches, dots_moved, *_ = np.transpose([coarse["d0p075-r0p6"], coarse["d0p1-r0p5"]])
    assert (patches < 0.5 * RENEW_GREY).all()
    assert (dots_moved > 0.9 * RENEW_GREY).all()
    assert min(coarse["d0p2-r0p1"]) > RENEW_GREY
