"""The sums of the tracking error: figures are what their names say, and nothing is no number."""

from __future__ import annotations

import json

import numpy as np
import pytest

from deltact_fab.analysis.tracking_error import shown
from deltact_fab.analysis.tracking_error.tally import BIN_MM, END_MM, ErrorTally


def test_the_figures_of_moving_pixels() -> None:
    tally = ErrorTally()
    errors = np.array([0.01, 0.03, 0.2, 0.5])
    tally.take_moving(errors, np.array([True, True, True, False]))
    found = tally.figures()
    assert found["mean_off_dots_mm"] == pytest.approx(errors.mean())
    assert found["mean_confident_mm"] == pytest.approx(0.08)
    assert found["max_confident_mm"] == 0.2
    assert found["coverage"] == 0.75
    assert found["confident_wrong_share"] == pytest.approx(1 / 3)


def test_two_parts_joined_are_the_whole() -> None:
    rng = np.random.default_rng(1)
    errors, sure = rng.gamma(2.0, 0.03, 5000), rng.random(5000) < 0.9
    whole, one, two = ErrorTally(), ErrorTally(), ErrorTally()
    whole.take_moving(errors, sure)
    one.take_moving(errors[:2000], sure[:2000])
    two.take_moving(errors[2000:], sure[2000:])
    one.join(two)
    joined = one.figures()
    for key, value in whole.figures().items():
        assert joined[key] == (pytest.approx(value) if isinstance(value, float) else value), key


def test_a_percentile_is_the_percentile() -> None:
    errors = np.random.default_rng(0).gamma(2.0, 0.01, 200_000)
    tally = ErrorTally()
    tally.take_moving(errors, errors < 0)
    row = tally.figures()
    assert row["p95_off_dots_mm"] == pytest.approx(np.percentile(errors, 95), abs=BIN_MM)
    assert row["p95_off_dots_beyond_mm"] is None
    assert shown(row, "p95_off_dots_mm") == row["p95_off_dots_mm"]


@pytest.mark.parametrize(("far", "beyond"), [(4, None), (6, END_MM)])
def test_a_percentile_past_the_end_says_so(far: int, beyond: float | None) -> None:
    errors = np.r_[np.full(100 - far, 0.2), np.full(far, 7.0)]
    tally = ErrorTally()
    tally.take_moving(errors, errors < 1)
    row = tally.figures()
    assert row["p95_off_dots_beyond_mm"] == beyond
    assert (row["p95_off_dots_mm"] is None) == (beyond is not None)
    if beyond is not None:
        assert shown(row, "p95_off_dots_mm") == "> 5"
    assert row["mean_off_dots_mm"] == pytest.approx(errors.mean())  # the mean knows no end


def test_nothing_measured_is_none_and_never_nan() -> None:
    figures = ErrorTally().figures()
    json.dumps(figures, allow_nan=False)
    assert {k for k, v in figures.items() if isinstance(v, float)} == set()
    assert figures["cpu_ms"] == {"p50": None, "p95": None}


def test_all_lost_has_an_error_and_a_coverage_of_nothing() -> None:
    tally = ErrorTally()
    tally.take_moving(np.full(50, 0.3), np.zeros(50, bool))
    figures = tally.figures()
    json.dumps(figures, allow_nan=False)
    assert figures["mean_off_dots_mm"] == pytest.approx(0.3)
    assert figures["coverage"] == 0
    assert figures["mean_confident_mm"] is None
    assert figures["confident_wrong_share"] is None
    assert figures["max_confident_mm"] is None


def test_a_frame_in_which_nothing_moves_counts_as_a_frame_and_adds_no_pixel() -> None:
    tally = ErrorTally()
    tally.take_moving(np.zeros(0), np.zeros(0, bool))
    tally.believed.take(1.0)
    figures = tally.figures()
    assert figures["n_frames"] == 1
    assert figures["n_moving_px"] == 0
    assert figures["mean_off_dots_mm"] is None
