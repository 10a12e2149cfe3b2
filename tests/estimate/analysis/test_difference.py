"""Differences over units, against statsmodels and against drawn units of known difference."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.stats import binom
from statsmodels.stats.power import TTestIndPower, TTestPower
from statsmodels.stats.weightstats import CompareMeans, DescrStatsW

from benchmarks import compare_trials
from deltact_fab.common import InputError, read_json
from deltact_fab.estimate.analysis.difference import (
    UnitDifference,
    chance_of_difference,
    chance_of_equality,
)
from deltact_fab.studies.trial.figures import compare_drawn

RNG = np.random.default_rng(61)
X, Y = RNG.normal(5.0, 0.5, 6), RNG.normal(5.3, 0.9, 9)


def units(values: np.ndarray, side: str = "") -> dict[str, float]:
    return {f"{side}{k}": float(v) for k, v in enumerate(values)}


@pytest.mark.parametrize("relative", [False, True])
def test_sides_are_compared_by_welch(relative: bool) -> None:
    found = UnitDifference.from_units(units(X, "a"), units(Y, "b"), relative)
    x, y = (np.log(X), np.log(Y)) if relative else (X, Y)
    peer = CompareMeans(DescrStatsW(x), DescrStatsW(y))
    assert found.value == pytest.approx(x.mean() - y.mean())
    assert found.interval() == pytest.approx(peer.tconfint_diff(usevar="unequal"))
    lower = peer.tconfint_diff(alpha=0.1, usevar="unequal")
    assert found.interval(0.9) == pytest.approx(lower)
    for margin in (0.2, 1.5):
        p = peer.ttost_ind(-margin, margin, usevar="unequal")[0]
        assert found.is_equal(margin) == (p < 0.05)


def test_shared_units_are_paired() -> None:
    found = UnitDifference.from_units(units(X), units(X[::-1] + 0.1), relative=False)
    assert found.paired
    assert found.counts == (6, 6)
    peer = DescrStatsW(X - X[::-1] - 0.1)
    assert found.interval() == pytest.approx(peer.tconfint_mean())
    assert found.spread == pytest.approx(peer.std * math.sqrt(6 / 5))
    # By name, in whatever order.
    turned = dict(reversed(units(X[::-1] + 0.1).items()))
    assert UnitDifference.from_units(units(X), turned, relative=False) == found


@pytest.mark.parametrize("effect", [0.0, 0.1, -0.3, 0.5, 30.0])
@pytest.mark.parametrize("n", [2, 5, 40])
def test_power_is_that_of_statsmodels(effect: float, n: int) -> None:
    two, one = TTestIndPower(), TTestPower()
    if abs(effect) < 2:  # the peer gives nan far in a tail
        # The peer's test takes the spreads for equal, which gains a little with few units.
        pooled = two.power(abs(effect) / 0.4, n, 0.05)
        found = chance_of_difference(effect, 0.4, n, paired=False)
        assert pooled - 0.15 < found < pooled + 1e-6
        assert found == pytest.approx(pooled, abs=2 / n**2)
        assert chance_of_difference(effect, 0.4, n, paired=True) == pytest.approx(
            one.power(abs(effect) / 0.4, n, 0.05), abs=1e-6
        )
    else:
        assert chance_of_difference(effect, 0.4, n, paired=False) == pytest.approx(1.0)


@pytest.mark.parametrize(("effect", "paired"), [(0.0, False), (0.05, False), (0.05, True)])
def test_chance_of_equality_is_reached(effect: float, paired: bool) -> None:
    """Share of drawn comparisons that are equal within the margin."""
    rng, n, spread, margin = np.random.default_rng(3), 12, 0.1, 0.12
    chance = chance_of_equality(effect, spread, n, margin, paired=paired)
    found = 0
    for _ in range(1500):
        if paired:
            difference = rng.normal(effect, spread, n)
            x, y = units(difference), units(np.zeros(n))
        else:
            x, y = units(rng.normal(effect, spread, n), "a"), units(rng.normal(0, spread, n), "b")
        found += UnitDifference.from_units(x, y, relative=False).is_equal(margin)
    assert 0.1 < chance < 0.99
    assert found / 1500 == pytest.approx(chance, abs=4 * math.sqrt(0.25 / 1500))


@pytest.mark.parametrize(("n", "effect"), [(2, 5.0), (3, 3.0), (5, 2.0), (10, 1.3)])
def test_power_of_welch_is_reached(n: int, effect: float) -> None:
    """Share of drawn comparisons that find a planted difference."""
    rng, trials = np.random.default_rng(n), 2000
    found = 0
    for _ in range(trials):
        x, y = units(rng.normal(effect, 1.0, n), "a"), units(rng.normal(0.0, 1.0, n), "b")
        low, high = UnitDifference.from_units(x, y, relative=False).interval()
        found += low > 0 or high < 0
    chance = chance_of_difference(effect, 1.0, n, paired=False)
    assert found / trials == pytest.approx(chance, abs=4 * math.sqrt(0.25 / trials))


@pytest.mark.parametrize("measure", compare_trials.POOL_MEASURES)
def test_pool_of_sensors_is_compared_fairly(measure: str) -> None:
    """At most 16 of 200 trials of one kind differ; a planted difference is found as told."""
    pool = np.array(read_json(compare_trials.POOL_FILE)[measure])
    assert len(pool) >= 60
    count, times = compare_trials.UNITS, compare_trials.TRIALS
    assert compare_drawn(pool, count, 1.0, times, True, 61)[1] <= 16
    factor, chance = compare_trials.planted(pool)
    low, high = binom.interval(0.95, compare_trials.TRIALS, chance)
    assert low <= compare_drawn(pool, count, factor, times, True, 62)[0] <= high


def test_outcomes_follow_the_figures() -> None:
    a, b = units(X, "a"), units(X + 3, "b")
    assert UnitDifference.from_units(a, b, relative=False).outcome(0.1) == "a smaller"
    assert UnitDifference.from_units(b, a, relative=False).outcome(0.1) == "b smaller"
    near = UnitDifference.from_units(a, units(X + 0.01, "b"), relative=False)
    assert near.outcome(2.0) == "equal"
    assert near.outcome(0.1) == "undecided"


def test_units_needed_would_decide() -> None:
    """One unit a side less would not; a larger difference needs fewer."""
    found = UnitDifference(0.1, 0.08, 8.0, (5, 5), paired=False, relative=True)
    n = found.units_needed(0.02)
    assert n is not None
    assert n > 5
    peer = TTestIndPower().solve_power(0.1 / found.spread, power=0.8, alpha=0.05)
    assert n - math.ceil(peer) in (0, 1)  # the peer takes the spreads for equal
    larger = UnitDifference(0.3, 0.08, 8.0, (5, 5), paired=False, relative=True)
    assert (larger.units_needed(0.02) or 0) < n
    none = UnitDifference(0.02, 5.0, 8.0, (5, 5), paired=False, relative=True)
    assert none.units_needed(0.02) is None
    # Decided as equal, where the margin is wide.
    assert (found.units_needed(0.5) or 0) < n


@pytest.mark.parametrize(
    ("a", "b", "text"),
    [
        ({"A1": 1.0}, {"B1": 1.0, "B2": 2.0}, "two a side"),
        ({"A1": 1.0, "A2": 1.0}, {"A1": 1.0, "B2": 2.0}, "A1 is on both sides and A2 is not"),
        ({"A1": 1.0, "A2": 0.0}, {"B1": 1.0, "B2": 2.0}, "has no percentage"),
    ],
)
def test_unfit_units_are_refused(a: dict[str, float], b: dict[str, float], text: str) -> None:
    with pytest.raises(InputError, match=text):
        UnitDifference.from_units(a, b, relative=True)


def test_same_against_same_seldom_differs() -> None:
    """At most 16 of 200 comparisons of units of one kind find a difference."""
    rng = np.random.default_rng(7)
    pool = rng.lognormal(-4.0, 0.15, 60)
    differing = 0
    for _ in range(200):
        drawn = rng.choice(pool, 10, replace=False)
        found = UnitDifference.from_units(units(drawn[:5], "a"), units(drawn[5:], "b"), True)
        differing += found.outcome(0.01) != "undecided"
    assert differing <= 16
