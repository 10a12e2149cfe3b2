"""Rank correlations, and choices that are judged where they were not made."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from deltact_fab.study.intervals import mean
from deltact_fab.study.search.findings import ConfirmedPattern, chosen_by_others, gain
from deltact_fab.study.search.search import rank_correlation, spearman


def correlated(n: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    a = rng.normal(size=n)
    return a, a + 0.6 * rng.normal(size=n)


@pytest.mark.parametrize("rounded", [3, 0])
def test_rank_correlation_is_scipys(rounded: int) -> None:
    """0 decimals make many ties."""
    a, b = (np.round(v, rounded) for v in correlated(40))
    assert spearman(a, b) == pytest.approx(stats.spearmanr(a, b).statistic, abs=1e-12)


def test_its_interval_is_near_scipys_bootstrap() -> None:
    a, b = correlated(40)
    found = rank_correlation(a, b, [str(k) for k in range(40)])
    drawn = stats.bootstrap(
        (a, b), spearman, paired=True, vectorized=False, n_resamples=999, rng=1
    ).confidence_interval  # fmt: skip
    assert found.low is not None
    assert found.high is not None
    assert found.low == pytest.approx(drawn.low, abs=0.12)
    assert found.high == pytest.approx(drawn.high, abs=0.06)


def test_patterns_of_one_kind_are_no_repeats() -> None:
    a, b = correlated(20)
    twice = [np.repeat(v, 2) for v in (a, b)]
    alone = rank_correlation(a, b, [str(k) for k in range(20)])
    paired = rank_correlation(twice[0], twice[1], [str(k // 2) for k in range(40)])
    assert (paired.low, paired.high) == pytest.approx((alone.low, alone.high), abs=0.01)


def test_a_constant_has_no_order() -> None:
    assert np.isnan(spearman(np.ones(5), np.arange(5.0)))


def test_each_seed_is_judged_by_the_choice_of_the_others() -> None:
    errors = np.array([[1.0, 1.0, 9.0], [2.0, 2.0, 2.0]])
    # Seeds 0 and 1 see the 9 and choose the second; seed 2 does not, and gets it
    assert chosen_by_others(errors).tolist() == [2.0, 2.0, 9.0]
    assert chosen_by_others(errors[:, :1]).tolist() == [1.0]


def one(name: str, errors: tuple[float, ...]) -> ConfirmedPattern:
    error = mean(errors, range(len(errors)), "seed")
    return ConfirmedPattern(name, "fused", errors, (), error, None, None, 1.0)


def test_the_gain_is_over_the_papers_pattern_seed_by_seed() -> None:
    found = [one("x", (1.0, 1.1, 0.9)), one("paper", (4.0, 4.4, 3.6))]
    share = gain(found, ["x"], "paper")
    assert share is not None
    assert share.value == pytest.approx(0.25)
    assert share.low == pytest.approx(0.25)
    assert share.high == pytest.approx(0.25)
    assert gain(found, ["x"], "never tracked") is None
