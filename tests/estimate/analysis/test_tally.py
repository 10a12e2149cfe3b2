"""The sums of the tracking error: figures are what their names say, and nothing is no number."""

from __future__ import annotations

import json

import numpy as np
import pytest

from deltact_fab.estimate.analysis.tracking_error.tally import ErrorTally


def test_the_figures_of_moving_pixels() -> None:
    tally = ErrorTally()
    errors = np.array([0.01, 0.03, 0.2, 0.5])
    tally.add_moving(errors, np.array([True, True, True, False]))
    found = tally.figures()
    assert found["mean_off_dots_mm"] == pytest.approx(errors.mean())
    assert found["mean_confident_mm"] == pytest.approx(0.08)
    assert found["coverage"] == 0.75
    assert found["confident_wrong_share"] == pytest.approx(1 / 3)


def test_two_parts_joined_are_the_whole() -> None:
    rng = np.random.default_rng(1)
    errors, sure = rng.gamma(2.0, 0.03, 5000), rng.random(5000) < 0.9
    whole, one, two = ErrorTally(), ErrorTally(), ErrorTally()
    whole.add_moving(errors, sure)
    one.add_moving(errors[:2000], sure[:2000])
    two.add_moving(errors[2000:], sure[2000:])
    one.join(two)
    joined = one.figures()
    for key, value in whole.figures().items():
        assert joined[key] == (pytest.approx(value) if isinstance(value, float) else value), key


@pytest.mark.parametrize("scale_mm", [1e-5, 0.01, 3.0])
def test_percentile_is_accurate_to_one_percent(scale_mm: float) -> None:
    errors = np.random.default_rng(0).gamma(2.0, scale_mm, 200_000)
    tally = ErrorTally()
    tally.add_moving(errors, errors < 0)
    p95 = np.percentile(errors, 95)
    assert tally.figures()["p95_off_dots_mm"] == pytest.approx(max(p95, 1e-4), rel=0.011)


def test_missing_figures_are_none_not_nan() -> None:
    figures = ErrorTally().figures()
    json.dumps(figures, allow_nan=False)
    assert {k for k, v in figures.items() if isinstance(v, float)} == set()
    lost = ErrorTally()
    lost.add_moving(np.full(50, 0.3), np.zeros(50, bool))
    figures = lost.figures()
    assert (figures["mean_off_dots_mm"], figures["coverage"]) == (pytest.approx(0.3), 0)
    assert figures["mean_confident_mm"] is figures["confident_wrong_share"] is None
