"""Predicted errors and waits against closed forms."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.stats import chi2

from deltact_fab.studies.plan.components import ErrorComponents
from deltact_fab.studies.plan.pilot import LONGEST_SETTLE_S, SETTLED_SHARE, settle_time_s
from deltact_fab.studies.plan.prediction import PlannedStops, predict_errors, validation_presses

M = 4000


def fixed(repeat: float, place: float, tip: float, drift: float) -> ErrorComponents:
    """Components without uncertainty."""
    return ErrorComponents(np.tile([repeat, place, tip, drift], (M, 1)), {})


def stops(count: int, first_place: int, force_n: float = 4.0) -> PlannedStops:
    """Presses of one stop, a place each."""
    rows = np.full((count, 1, 1), force_n)
    return PlannedStops(rows, first_place + np.arange(count), np.zeros(count, int))


def test_chance_is_that_of_chi_square() -> None:
    """Repeats alone, and so many presses fitted that the factor is exact."""
    prediction = predict_errors(stops(2_000, 0), stops(12, 2_000), fixed(0.05, 0, 0, 0), 130, 1, 0)
    for goal_n in (0.04, 0.05, 0.06):
        closed = chi2.cdf(12 * (goal_n / 0.05) ** 2, 12)
        assert prediction.chance(goal_n) == pytest.approx(closed, abs=0.025)
    assert prediction.chance(prediction.reached(0.9)) == pytest.approx(0.9, abs=0.01)


def test_few_presses_add_their_own_error() -> None:
    """Mean square of n fitted places: place^2 f^2 (1 + 1 / n); one tip's error cancels."""
    for count in (2, 5, 40):
        prediction = predict_errors(
            stops(count, 0), stops(8, count), fixed(0, 0.03, 0.5, 0), 130, 1, 0
        )
        closed = (4 * 0.03) ** 2 * (1 + 1 / count)
        assert np.mean(prediction.figures**2) == pytest.approx(closed, rel=0.05)


def test_drift_counts_by_the_duration() -> None:
    for hours in (1.0, 6.0):
        drift = fixed(0, 0, 0, 0.02)
        prediction = predict_errors(stops(50, 0), stops(10, 50), drift, 130, hours, 0)
        closed = (4 * 0.02 * hours) ** 2 / 12 * (1 + 1 / 50)
        assert np.mean(prediction.figures**2) == pytest.approx(closed, rel=0.05)


def test_uncertain_components_widen_the_interval() -> None:
    certain = predict_errors(stops(20, 0), stops(12, 20), fixed(0.05, 0.02, 0, 0), 130, 1, 0)
    assumed = ErrorComponents.assume(0)
    uncertain = predict_errors(stops(20, 0), stops(12, 20), assumed, 130, 1, 0)
    ratios = [high / low for low, high in (certain.interval, uncertain.interval)]
    assert ratios[1] > 1.5 * ratios[0]


def test_validation_number_bounds_the_error() -> None:
    count = validation_presses(5 / 3)
    assert count == 12
    limits = [math.sqrt(n / chi2.ppf(0.025, n)) for n in (count - 1, count)]
    assert limits[0] > 5 / 3 >= limits[1]


def test_settling_leaves_the_stated_share() -> None:
    """One branch: t = tau ln(g (1 - exp(-s / tau)) tau / s / share)."""
    g, tau_s, ramp_s = 0.3, 5.0, 4.0
    start = g * (1 - math.exp(-ramp_s / tau_s)) * tau_s / ramp_s
    closed = tau_s * math.log(start / SETTLED_SHARE)
    assert settle_time_s([(g, tau_s)], ramp_s) == pytest.approx(closed, abs=0.11)
    assert settle_time_s([(0.01, tau_s)], ramp_s) == settle_time_s([], ramp_s) == 1.0
    assert settle_time_s([(0.5, 1e4)], ramp_s) == LONGEST_SETTLE_S
