"""Least squares of a measured press: the modulus and the first touch, with their intervals."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ...aliases import Field, Mask
from ...errors import RunFailed
from .force_curve import ForceCurve
from .measured import MeasuredIndentation

Bounds = tuple[float, float]

LEVEL = 0.95
OUTLIER = 6.0  # robust standard deviations
SCAN = 25  # depths of first touch tried before the fit
EXACT = 1e-10  # of the rms force: residuals below are rounding


@dataclass(frozen=True)
class Estimate:
    value: float
    low: float
    high: float

    def widened(self, rel: float) -> Estimate:
        """With a share of the value more on either side, for what no residual shows."""
        more = rel * abs(self.value)
        return Estimate(self.value, self.low - more, self.high + more)


@dataclass(frozen=True, eq=False)
class FitSolution:
    """values: the modulus and, where it is fitted, the depth of first touch, with covariance.

    follow: lag-1 correlation of the residuals, 0 where it is within chance.
    """

    values: Field
    scatter = np.asarray(np.linalg.pinv(jacobian.T @ jacobian), dtype=np.float64)
    covariance = variance * scatter * np.outer(to_mpa, to_mpa)
    touch = float(x[1]) if touch_bounds is not None else 0.0
    return FitSolution(x * to_mpa, covariance, dof, follow, touch, forces(x), used)


def _slope(forces, x: Field, k: int, low: float, high: float) -> Field:  # type: ignore[no-untyped-def]
    """Central difference of the forces by one value, one-sided at its bounds."""
    step = 1e-5 * max(abs(float(x[k])), 0.1)
    up, down = x.copy(), x.copy()
    up[k], down[k] = min(x[k] + step, high), max(x[k] - step, low)
    return np.asarray((forces(up) - forces(down)) / (up[k] - down[k]))


def _robust(residual: Field) -> float:
    """Standard deviation from the median of absolute values, exact for a normal distribution."""
    return 1.4826 * float(np.median(np.abs(residual)))


def _follow(residual: Field) -> float:
    """Lag-1 correlation in the order measured, 0 unless it is past chance (3 sigma)."""
    size = float(residual @ residual)
    r = float(residual[1:] @ residual[:-1]) / size if size > 0 else 0.0
    return min(r, 0.95) if r > 3 / math.sqrt(len(residual)) else 0.0


def smooth_part(at: Field, residual: Field) -> tuple[Field, float]:
    """Cubic trend of a residual over `at`, and the F test's p that it is chance."""
    from scipy.stats import f

    n, order = len(at), 3
    if n < order + 4 or not np.ptp(at) > 0:
        return np.zeros(n), 1.0
    trend = np.polynomial.Legendre.fit(at, residual, order)(at)
    left = float(np.sum((residual - trend) ** 2)) / (n - order - 1)
    if not left > 0:
        return trend, 0.0 if float(trend @ trend) > 0 else 1.0
    return trend, float(f.sf(float(trend @ trend) / (order + 1) / left, order + 1, n - order - 1))
