"""The flow's engine: its star and its judges can tell fine from coarse and right from wrong."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from called import count_calls

from benchmarks.star import Star
from deltact_fab.estimate.measure.flow.tracker import FlowTracker
from deltact_fab.studies.numerics.engines import flow, flow_frames
from deltact_fab.studies.numerics.engines.flow_frames import DEFAULT_CAMERA, FlowSequence, Vectors

STAR = Star(DEFAULT_CAMERA.width_px, DEFAULT_CAMERA.height_px)


def pixels() -> tuple[flow_frames.Field, flow_frames.Field]:
    size_px = DEFAULT_CAMERA.width_px, DEFAULT_CAMERA.height_px
    x, y = np.meshgrid(*(np.arange(float(n)) for n in size_px))
    return x, y


@pytest.fixture
def star() -> Vectors:
    return STAR.motion(*pixels()).astype(np.float32)


def test_star_noise_equals_image_noise(star: Vectors) -> None:
    noisy = star + np.random.default_rng(1).normal(0, 0.02, star.shape).astype(np.float32)
    assert STAR.figures(noisy).noise_px == pytest.approx(0.02, rel=0.02)


def test_star_on_nodes_has_same_figures(star: Vectors) -> None:
    seen = np.asarray(cv2.blur(star, (1, 21)))
    nodes = np.full_like(seen, np.nan)
    nodes[2::4, 2::4] = seen[2::4, 2::4]
    assert STAR.figures(nodes).loss_px == pytest.approx(84, rel=0.06)


@pytest.mark.slow
def test_rendered_frame_has_requested_motion(tmp_path: Path) -> None:
    """Its truth is the field itself, and the flow finds it."""
    given = flow_frames.scene(tmp_path, "near")
    x, y = pixels()
    np.testing.assert_allclose(given.truth_px, flow_frames.near_bump(x, y), atol=1e-4)
    seen = flow.track_sequence(FlowTracker(), given.images[::4], given)
    assert seen.trusted
    assert seen.confident > 0.9
    assert seen.wrong == 0
    # The same against a truth that is 2 px elsewhere: every confident pixel is wrong.
    false = FlowSequence(given.images, given.truth_px + np.float32(2))
    assert flow.track_sequence(FlowTracker(), given.images[::4], false).wrong == 1


@pytest.mark.slow
def test_trackers_differ_and_run_once(tmp_path: Path) -> None:
    works = [s.build(tmp_path) for s in flow.curves() if s.case == flow.FAR_CASE]
    flows, calls = count_calls(lambda: [work.run() for work in works])
    n_frames = len(flow_frames.scene(tmp_path, "far").images)
    assert calls["flow/tracker.py update"] == n_frames * len(works)
    assert len({found.tobytes() for found in flows}) == len(works) > 2
