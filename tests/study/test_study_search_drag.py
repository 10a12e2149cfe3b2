"""The drag of a pattern search, and choices that are judged where they were not made."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import numpy as np
import pytest

from deltact_fab.imaging import ImageSensor, Printer
from deltact_fab.study.search.drag import (
    OUTWARD,
    bridged,
    dragged,
    moving_px,
    probe,
    strides,
    view_of,
)
from deltact_fab.study.search.imager import PatternImager
from deltact_fab.study.search.result import ConfirmedPattern, chosen_by_others, gain

FIELD_PX = 60_000
BENCH = PatternImager(Printer(), ImageSensor(), 0.0378)
QUIET = PatternImager(
    Printer(), ImageSensor(full_well_electrons=1e6, read_noise_electrons=0, mosaic=False), 0.0378
)


def probed(bench: PatternImager = BENCH, **keys: Any) -> dict[str, Any]:
    recipe = {"seed": 4, **keys}
    return probe({"bench": asdict(bench), "recipe": recipe, "seed": 9, "field_px": FIELD_PX})


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
def test_good_light_and_three_chips_leave_next_to_no_error_and_seeds_repeat() -> None:
    keys = {"law": "iid", "patch_mm": 0.15}
    quiet, usual = probed(QUIET, **keys), probed(BENCH, **keys)
    assert quiet["error_mm"] < usual["error_mm"] < 0.005
    assert probed(**keys) == usual


def test_a_blank_sticker_is_refused_with_the_reason() -> None:
    found = probed(law="transparent")
    assert "texture" in found["refused"]
    assert "error_mm" not in found


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


def test_each_seed_is_judged_by_the_choice_of_the_others() -> None:
    errors = np.array([[1.0, 1.0, 9.0], [2.0, 2.0, 2.0]])
    # Seeds 0 and 1 see the 9 and choose the second; seed 2 does not, and gets it
    assert chosen_by_others(errors).tolist() == [2.0, 2.0, 9.0]
    assert chosen_by_others(errors[:, :1]).tolist() == [1.0]


def one(name: str, errors: tuple[float, ...]) -> ConfirmedPattern:
    return ConfirmedPattern(name, "fused", errors, 1.0)


def test_the_gain_is_over_the_papers_pattern_seed_by_seed() -> None:
    found = [one("x", (1.0, 1.1, 0.9, 1.0)), one("paper", (4.0, 4.4, 3.6, 4.0))]
    share = gain(found, ["x"], "paper")
    assert share is not None
    assert share.value == pytest.approx(0.25)
    assert share.low == pytest.approx(0.25)
    assert share.high == pytest.approx(0.25)
    assert gain(found, ["x"], "never tracked") is None
