"""Intervals over whole groups: they hold the truth as often as they say, with few groups too."""

import math

import numpy as np
import pytest
from scipy import stats

from deltact_fab.common.errors import InputError
from deltact_fab.estimate.analysis.intervals import Interval

WITHIN = 20
GROUP_SD = 0.5


def _coverage(count: int, figure, truth: float, trials: int = 400) -> float:
    """How often the interval over `count` groups that err together holds the truth."""
    rng = np.random.default_rng(7)
    groups = np.repeat(np.arange(count), WITHIN)
    held = 0
    for _ in range(trials):
        own = np.repeat(rng.normal(0, GROUP_SD, count), WITHIN)
        found = figure(own + rng.normal(0, 1, count * WITHIN), groups, "position")
        held += found.low <= truth <= found.high
    return held / trials


@pytest.mark.parametrize("count", [4, 9])
@pytest.mark.parametrize(
    ("figure", "truth"), [(Interval.mean, 0.0), (Interval.rmse, math.sqrt(1 + GROUP_SD**2))]
)
def test_interval_has_nominal_coverage(count, figure, truth):
    """95 % nominal; 400 trials have a standard error of 1.1 %."""
    assert 0.90 <= _coverage(count, figure, truth) <= 0.98


def test_single_samples_give_student_interval():
    sample = np.random.default_rng(2).normal(3, 2, 9)
    _, low, high, *_ = Interval.jackknife(sample, np.arange(9), np.mean, "seed")
    own = stats.ttest_1samp(sample, 0).confidence_interval(0.95)
    assert (low, high) == pytest.approx((own.low, own.high), rel=1e-12)


def test_several_columns_and_unequal_groups():
    """Total over total: with each group's ratio the same, nothing is uncertain."""
    rng = np.random.default_rng(4)
    below = rng.uniform(1, 2, 30)
    rows = np.column_stack([3 * below, below])
    groups = np.repeat([0, 1, 2, 3], [3, 5, 7, 15])
    total = Interval.jackknife(rows, groups, lambda r: r[:, 0].sum() / r[:, 1].sum(), "group")
    assert (total.low, total.high) == pytest.approx((3, 3), rel=1e-12)


@pytest.mark.parametrize(
    ("groups", "over"),
    [([1, 1, 1], "one position: no interval below four"),
     ([1, 2, 3], "3 positions: no interval below four")],
)  # fmt: skip
def test_few_groups_have_no_interval(groups, over):
    assert Interval.mean([1.0, 2.0, 3.0], groups, "position")[:4] == (2.0, None, None, over)


@pytest.mark.parametrize(
    ("values", "groups"), [([1.0, 2.0], ["a"]), ([], []), ([1.0, math.nan], ["a", "b"])]
)
def test_invalid_input_is_refused(values, groups):
    with pytest.raises(InputError, match="as many as groups"):
        Interval.jackknife(values, groups, np.mean, "seed")
