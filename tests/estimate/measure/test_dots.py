from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from deltact_fab.common.errors import InputError, SensorError
from deltact_fab.estimate.measure.dots.tracker import DotTracker

MM_PER_PX = 0.0378
DIAMETER_PX = 0.6 / MM_PER_PX


def error_mm(seen: Any, scene: Any, bump: Any) -> Any:
    """Displacement errors of the dots that were found."""
    truth = bump.displacement_px(scene.rest_px)
    return np.hypot(*(seen.displacement_px - truth)[seen.located].T) * MM_PER_PX


def in_view(scene: Any, bump: Any, border: float = 11.0) -> Any:
    position = scene.rest_px + bump.displacement_px(scene.rest_px)
    return ((position > border) & (position < [scene.width - border, scene.height - border])).all(1)


@pytest.fixture(scope="module")
def small(make_scene):
    scene = make_scene(400, 320, dots=True, margin=150)
    assert len(scene.rest_px) == 49
    return scene


@pytest.mark.parametrize("jump_px", [(58.2, 0.0), (0.0, -42.3), (116.4, 42.3), (150.0, 10.0)])
def test_jump_by_pitches_keeps_identities(jump_px, small, make_bump):
    tracker = DotTracker(small.rest_px, DIAMETER_PX)
    tracker.update(small.picture())
    jump = make_bump((0, 0), 100, shift_px=jump_px)
    seen = tracker.update(small.picture(jump, 1))
    assert error_mm(seen, small, jump).max() <= 0.06
    assert error_mm(seen, small, jump).mean() <= 0.01
    assert not (in_view(small, jump) & ~seen.located).any()


def test_covered_dots_flagged_and_return(small, make_bump):
    bump = make_bump((200, 160), 80, shear_px=(20, 8))
    tracker = DotTracker(small.rest_px, DIAMETER_PX)
    tracker.update(small.picture())
    for k, s in enumerate((0.25, 0.5, 0.75, 1.0)):
        now = bump.scaled(s)
        image = small.picture(now, k + 1)
        where = small.rest_px + now.displacement_px(small.rest_px)
        hidden = np.zeros(49, bool)
        if s in (0.5, 0.75):
            x, y = (int(v) for v in where[24])
            image[y - 60 : y + 60, x - 70 : x + 70] = 60
            hidden = (np.abs(where - [x, y]) < [62, 52]).all(1)
            assert hidden.sum() >= 5
            # And one only half covered: its centroid would be off by a fifth of a dot.
            left, top = (int(v) for v in where[0])
            image[top - 14 : top + 14, left : left + 14] = 0
            hidden[0] = True
        seen = tracker.update(image)
        assert not seen.located[hidden].any()
        assert seen.located[:7][1:].all()
        assert error_mm(seen, small, now).max() <= 0.06
    assert seen.located.all()


def test_tracking_recovers_after_unrelated_image(small, make_scene):
    tracker = DotTracker(small.rest_px, DIAMETER_PX)
    tracker.update(small.picture())
    other = make_scene(400, 320, dots=True, seed=9).picture()
    noise = np.random.default_rng(1).integers(0, 256, (320, 400, 3), np.uint8)
    for image in (np.zeros((320, 400, 3), np.uint8), np.full((320, 400, 3), 255, np.uint8), noise):
        assert not tracker.update(image).located.any()
    # The same grid of dots in other colours: every dot is where it should be, and none is ours.
    assert not tracker.update(other).located.any()
    assert tracker.update(small.picture(None, 7)).located.all()


def test_first_image_needs_dots(small, make_scene):
    without = make_scene(400, 320, dots=False).picture()
    for image in (without, np.zeros((320, 400, 3), np.uint8)):
        tracker = DotTracker(small.rest_px, DIAMETER_PX)
        with pytest.raises(SensorError, match="of 49 white dots found in the first image"):
            tracker.update(image)
        assert tracker.update(small.picture()).located.all()
    with pytest.raises(SensorError, match="shifted by more than 8 px"):
        DotTracker(small.rest_px + 20.0, DIAMETER_PX).update(small.picture())


def test_dot_hidden_at_first_stays_unreported(small, make_bump):
    image = small.picture()
    x, y = (int(v) for v in small.rest_px[10])
    image[y - 15 : y + 15, x - 15 : x + 15] = 40
    tracker = DotTracker(small.rest_px, DIAMETER_PX)
    assert np.flatnonzero(~tracker.update(image).located).tolist() == [10]
    bump = make_bump((200, 160), 80, shear_px=(8, 5))
    seen = tracker.update(small.picture(bump, 1))
    assert np.flatnonzero(~seen.located).tolist() == [10]
    assert np.isnan(tracker.first_px[10]).all()
    assert error_mm(seen, small, bump).max() <= 0.06


def test_input_is_checked(small):
    rest = small.rest_px
    for dots, diameter_px, says in (
        (rest[:3], DIAMETER_PX, "n >= 4 dots"),
        (rest, 2.0, "diameter_px is 2"),
        (rest[:7], DIAMETER_PX, "on one line"),
        (rest * 0.4, DIAMETER_PX, "two rest positions are"),
    ):
        with pytest.raises(InputError, match=says):
            DotTracker(dots, diameter_px)
    tracker = DotTracker(rest, DIAMETER_PX)
    with pytest.raises(InputError, match="BGR uint8"):
        tracker.update(np.zeros((320, 400), np.uint8))
    tracker.update(small.picture())
    with pytest.raises(InputError, match="the first one was"):
        tracker.update(np.zeros((300, 400, 3), np.uint8))
    with pytest.raises(InputError, match="no expected position"):
        DotTracker(rest + 5000, DIAMETER_PX).update(small.picture())
