"""Error components of a pilot: closed forms, coverage, and what one place cannot tell."""

from __future__ import annotations

import numpy as np
import pytest

from deltact_fab.common import InputError
from deltact_fab.studies.plan.components import ASSUMED_ERRORS, ErrorComponents, ForcePoints


def pilot(
    rng: np.random.Generator, places: int, repeats: int, repeat_n: float, place: float
) -> ForcePoints:
    """Presses of one tip with 4 N each, at several places."""
    codes = np.repeat(np.arange(places), repeats)
    X = np.full((len(codes), 1), 4.0)
    shares = place * rng.standard_normal(places)[codes]
    y = 4.0 * (1.02 + shares) + repeat_n * rng.standard_normal(len(codes))
    return ForcePoints(X, y, {"place": codes, "tip": np.zeros(len(codes), int)})


def test_many_places_give_anova_estimates() -> None:
    """Balanced one-way analysis of variance: place^2 = (between - within) / (n f^2)."""
    places, repeats = 80, 4
    points = pilot(np.random.default_rng(5), places, repeats, 0.08, 0.03)
    y = points.y.reshape(places, repeats)
    within = y.var(axis=1, ddof=1).mean()
    between = repeats * y.mean(axis=1).var(ddof=1)
    expected = np.sqrt(within), np.sqrt((between - within) / repeats) / points.y.mean()
    estimated = ErrorComponents.estimate(points, 0)
    for name, value in zip(("repeat", "place"), expected, strict=True):
        assert estimated.interval(name)[0] == pytest.approx(value, rel=0.05)
        assert estimated.basis[name].startswith("pilot, ")


def test_one_place_leaves_place_assumed() -> None:
    points = pilot(np.random.default_rng(6), 1, 20, 0.08, 0.03)
    estimated = ErrorComponents.estimate(points, 0)
    assert estimated.basis["place"] == "assumed (one place in the pilot)"
    assert estimated.basis["tip"] == "assumed (one tip in the pilot)"
    prior = ErrorComponents.assume(0)
    for name in ("place", "tip"):
        assert estimated.interval(name)[0] == pytest.approx(prior.interval(name)[0], rel=0.1)
        assert estimated.interval(name)[2] == pytest.approx(prior.interval(name)[2], rel=0.3)
    # Chi-square of 19 degrees of freedom: 0.76 to 1.46 of the sample's deviation.
    spread = points.y.std(ddof=1) * np.array([0.76, 1.46])
    assert estimated.interval("repeat")[1:] == pytest.approx(spread, rel=0.1)


def test_pilot_overrules_a_wrong_assumption() -> None:
    """Eight times the assumed place error in the pilot is told, as is a quarter of it."""
    for factor in (8.0, 0.25):
        place = factor * ASSUMED_ERRORS["place"]
        points = pilot(np.random.default_rng(7), 60, 4, 0.02, place)
        assert ErrorComponents.estimate(points, 0).interval("place")[0] == pytest.approx(
            place, rel=0.3
        )


def test_reference_presses_give_the_drift() -> None:
    points = pilot(np.random.default_rng(8), 6, 2, 0.05, 0.02)
    value, low, high = ErrorComponents.estimate(points, 0, (-0.03, 0.005)).interval("drift")
    assert (value, low, high) == pytest.approx((0.03, 0.02, 0.04), abs=0.002)
    assert ErrorComponents.estimate(points, 0).basis["drift"] == "assumed"


def test_too_few_points_are_refused() -> None:
    points = pilot(np.random.default_rng(9), 2, 1, 0.05, 0.02)
    with pytest.raises(InputError, match="pilot: 2 points in contact; at least 3 are needed"):
        ErrorComponents.estimate(points, 0)


@pytest.mark.slow
def test_intervals_cover_drawn_components() -> None:
    """Pilots of five places, their components drawn from the assumption: 95 % are covered."""
    rng = np.random.default_rng(10)
    trials, covered = 60, {"repeat": 0, "place": 0}
    for _ in range(trials):
        true = {name: ASSUMED_ERRORS[name] * 2 ** rng.standard_normal() for name in covered}
        points = pilot(rng, 5, 3, true["repeat"], true["place"])
        estimated = ErrorComponents.estimate(points, 0)
        for name, value in true.items():
            _, low, high = estimated.interval(name)
            covered[name] += low <= value <= high
    # Binomial, 60 of 0.95: 52 or more in 99 of 100 such tests.
    assert min(covered.values()) >= 52, covered
