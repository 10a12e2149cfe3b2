"""Prediction of the error that presses to validate will show, and of the chance to meet a goal."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from deltact_fab.common import Array

from .components import ErrorComponents
from .exchange import CURVATURE_MM2

SURE_CHANCE = 0.9  # by hand: of meeting a goal; nine of ten such plans do


@dataclass(frozen=True)
class PlannedStops:
    """Regressors (p, r, k) of one force at the stops of presses; codes (p,) of place and tip."""

    rows: Array
    places: Array
    tips: Array


@dataclass(frozen=True)
class ErrorPrediction:
    """Predicted figures, sorted, one per draw of the error components, in the unit of the goal."""

    figures: Array

    @property
    def error(self) -> float:
        """Median of the predicted figures."""
        return float(np.median(self.figures))

    @property
    def interval(self) -> tuple[float, float]:
        """Interval that holds 95 % of the predicted figures."""
        low, high = np.quantile(self.figures, (0.025, 0.975))
        return float(low), float(high)

    def chance(self, goal: float) -> float:
        """Share of the draws that meet a goal."""
        return float(np.mean(self.figures <= goal))

    def reached(self, chance: float = SURE_CHANCE) -> float:
        """Smallest goal that is met with a chance."""
        return float(np.quantile(self.figures, chance))


def predict_errors(
    fitted: PlannedStops,
    validation: PlannedStops,
    components: ErrorComponents,
    prior_mm2: float,
    hours: float,
    seed: int,
) -> ErrorPrediction:
    """Simulate rms errors in N of validated calibrations, one per draw of the error components.

    Each is fitted as `calibrate force` does. Places of the validation are others than the fitted
    ones; its tips are among them. hours: duration of the run, over which drift is spread evenly.
    """
    rng = np.random.default_rng(seed)
    draws = components.draws
    repeat, place, tip, drift = draws.T
    X = fitted.rows.reshape(-1, fitted.rows.shape[-1])
    prior = np.zeros(X.shape[1])
    if len(prior) > 1:
        prior[1] = prior_mm2**2 * np.mean(X[:, 0] ** 2)
    solve = np.linalg.solve(X.T @ X + np.diag(prior), X.T)
    tips = int(max(fitted.tips.max(), validation.tips.max())) + 1
    tip_shares = tip[:, None] * rng.standard_normal((len(draws), tips))
    curvature = CURVATURE_MM2 * rng.standard_normal((len(draws), 1))

    def errors(stops: PlannedStops) -> Array:
        """Errors (m, n) of the measured forces about the regressors' first column."""
        codes = np.unique(stops.places, return_inverse=True)[1]
        shares = place[:, None] * rng.standard_normal((len(draws), codes.max() + 1))
        shares = shares[:, codes] + tip_shares[:, stops.tips]
        # Presses in random order: their times are spread evenly over the run.
        times = rng.uniform(-0.5, 0.5, (len(draws), len(codes)))
        shares = np.repeat(shares + (drift * hours)[:, None] * times, stops.rows.shape[1], axis=1)
        rows = stops.rows.reshape(-1, stops.rows.shape[-1])
        bend = curvature * rows[:, 1] if rows.shape[1] > 1 else 0.0
        noise = repeat[:, None] * rng.standard_normal((len(draws), len(rows)))
        return np.asarray(shares * rows[:, 0] + bend + noise)

    coefficients = errors(fitted) @ solve.T
    # The first column times 1 is fitted too, but for what the prior takes off it.
    shortfall = solve @ X[:, 0] - np.eye(X.shape[1])[0]
    rows = validation.rows.reshape(-1, validation.rows.shape[-1])
    misfit = (coefficients + shortfall) @ rows.T - errors(validation)
    return ErrorPrediction(np.sort(np.sqrt((misfit**2).mean(axis=1))))


def drift_share(components: ErrorComponents, hours: float) -> Array:
    """Mean squares (4,) of the components, with the drift of presses spread over a run."""
    squares = components.mean_squares.copy()
    squares[3] *= hours**2 / 12
    return squares


def validation_presses(ratio: float) -> int:
    """Number of presses whose rms error is within a ratio of the true one, from above, at 95 %."""
    from scipy.stats import chi2

    count = 2
    while math.sqrt(count / chi2.ppf(0.025, count)) > ratio:
        count += 1
    return count
