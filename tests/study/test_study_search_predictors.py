"""Predictors of a pattern search are right where the answer is known."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import numpy as np
import pytest

from deltact_fab.imaging import ImageSensor, Printer
from deltact_fab.study.search.imager import PatternImager
from deltact_fab.study.search.probe import (
    OUTWARD,
    SHIFTS_PX,
    at_rest,
    bias_figures,
    bridged,
    dragged,
    moving_px,
    probe,
    shifted,
    strides,
    view_of,
)

FIELD_PX = 60_000
BENCH = PatternImager(Printer(), ImageSensor(), 0.0378)
QUIET = PatternImager(
    Printer(), ImageSensor(full_well_electrons=1e6, read_noise_electrons=0, mosaic=False), 0.0378
)


def probed(bench: PatternImager = BENCH, **keys: Any) -> dict[str, Any]:
    recipe = {"seed": 4, **keys}
    return probe({"bench": asdict(bench), "recipe": recipe, "seed": 9, "field_px": FIELD_PX})


def test_bias_at_a_place_and_noise_are_told_apart() -> None:
    rng = np.random.default_rng(2)
    place = rng.normal(0, 0.02, (3, 1, 40, 60, 2))
    noise = rng.normal(0, 0.05, (3, 2, 40, 60, 2))
    found = bias_figures(place + noise + np.array([0.03, 0.04]))
    assert found["bias_px"] == pytest.approx(0.05, rel=0.03)
    assert found["local_bias_px"] == pytest.approx(0.02 * np.sqrt(2), rel=0.15)
    assert found["noise_px"] == pytest.approx(0.05 * np.sqrt(2), rel=0.03)


def test_a_shift_that_is_followed_exactly_has_no_bias() -> None:
    found = bias_figures(np.zeros((2, 2, 8, 8, 2)))
    assert found == {"bias_px": 0.0, "local_bias_px": 0.0, "noise_px": 0.0}


def test_shifts_are_drawn_where_they_say() -> None:
    view = view_of(BENCH, FIELD_PX)
    rest = at_rest(view).at_px
    for drawn, shift in zip(shifted(view), SHIFTS_PX, strict=True):
        assert np.abs(rest - drawn.at_px - shift).max() < 2e-3
        assert np.abs(drawn.truth_px - shift).max() < 1e-3


def test_the_drag_goes_there_and_back_in_equal_steps() -> None:
    view = view_of(BENCH, FIELD_PX)
    frames = [d.truth_px * 0.0378 for d in dragged(view, 3)]
    lengths_mm = np.array([np.hypot(*np.moveaxis(f, -1, 0)).max() for f in frames])
    assert len(frames) == 2 * OUTWARD - 1
    assert np.argmax(lengths_mm) == OUTWARD - 1
    # The dent magnifies what moves in it
    assert lengths_mm[OUTWARD - 1] == pytest.approx(2.4, rel=0.2)
    assert np.abs(np.diff(lengths_mm)).max() < 0.3
    assert np.array_equal(frames[0], frames[-1])


def test_the_skin_before_the_drag_nearly_folds() -> None:
    """Else a pattern that repeats itself looks better than it is on the gel."""
    view = view_of(BENCH, FIELD_PX)
    truth = dragged(view, 3)[OUTWARD - 1].truth_px
    along_y, along_x = np.gradient(truth, axis=(0, 1))
    det = (1 + along_x[..., 0]) * (1 + along_y[..., 1]) - along_x[..., 1] * along_y[..., 0]
    assert 0 < det.min() < 0.3


@pytest.mark.slow
def test_good_light_and_three_chips_leave_next_to_no_error() -> None:
    keys = {"law": "iid", "patch_mm": 0.15}
    quiet, usual = probed(QUIET, **keys), probed(BENCH, **keys)
    assert quiet["noise_px"] < 0.3 * usual["noise_px"]
    assert quiet["bias_px"] < 0.01
    assert quiet["error_mm"] < usual["error_mm"] < 0.005


@pytest.mark.slow
def test_resolution_is_lost_where_patches_are_larger_than_the_window() -> None:
    fine, coarse = (probed(QUIET, law="binary", patch_mm=d)["resolution_px"] for d in (0.1, 0.8))
    assert coarse > 1.3 * fine


def test_a_blank_sticker_is_refused_with_the_reason() -> None:
    found = probed(law="transparent")
    assert "texture" in found["refused"]
    assert "error_mm" not in found


@pytest.mark.slow
def test_equal_seeds_give_equal_figures() -> None:
    keys = {"law": "iid", "patch_mm": 0.2}
    assert probed(**keys) == probed(**keys)


def test_strides_all_end_at_the_last_frame() -> None:
    assert strides(12) == [1, 2, 3, 4, 6, 12]


def test_a_step_is_bridged_until_the_error_doubles() -> None:
    errors = {1: 1.0, 2: 1.9, 3: 2.1, 6: 1.0}
    assert bridged(errors) == 2


def test_moving_pixels_move_and_stay_in_view() -> None:
    truth = np.zeros((4, 6, 2))
    truth[1, 1] = 3, 0
    truth[2, 5] = 3, 0  # leaves to the right
    truth[3, 1] = 2, 0
    assert np.argwhere(moving_px(truth, 0.04)).tolist() == [[1, 1]]
