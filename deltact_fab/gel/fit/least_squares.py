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
    covariance: Field
    dof: int
    follow: float
    touch_mm: float
    model_n: Field
    used: Mask

    def estimate(self, k: int) -> Estimate:
        from scipy.stats import t

        half = float(t.ppf((1 + LEVEL) / 2, self.dof)) * math.sqrt(self.covariance[k, k])
        value = float(self.values[k])
        return Estimate(value, value - half, value + half)


def solve(data: MeasuredIndentation, unit: ForceCurve, touch_bounds: Bounds | None) -> FitSolution:
    """Fit the modulus, and the depth of first touch where it has bounds.

    unit: the curve for 1 MPa. Raises RunFailed where the forces give no modulus above 0.
    """
    from scipy.optimize import least_squares

    start, low, high = [1.0], [0.0], [np.inf]
    if touch_bounds is not None:
        start.append(sum(touch_bounds) / 2)
        low.append(touch_bounds[0])
        high.append(touch_bounds[1])
    one = unit.normal_n(data.depth_mm - sum(start[1:]))
    modulus = float(one @ data.normal_n) / max(float(one @ one), 1e-300)
    if not modulus > 0:
        raise RunFailed("gel fit: the forces give no modulus above 0; is normal_n in N, pressed?")

    def forces(x: Field) -> Field:
        at = float(x[1]) if touch_bounds is not None else 0.0
        return modulus * float(x[0]) * unit.normal_n(data.depth_mm - at)

    def run(used: Mask, begin: Field, loss: str, spread: float) -> Field:
        result = least_squares(
            lambda x: (forces(x) - data.normal_n)[used], begin, bounds=(low, high), loss=loss,
            f_scale=spread, x_scale=np.maximum(np.abs(begin), 0.1),
            ftol=1e-14, xtol=1e-12, gtol=1e-14,
        )  # fmt: skip
        return np.asarray(result.x)

    used = np.ones(len(data.normal_n), dtype=bool)
    scale = float(np.sqrt(np.mean(data.normal_n**2)))
    x = run(used, np.array(start), "linear", 1.0)
    spread = _robust(forces(x) - data.normal_n)
    if spread > EXACT * scale:
        # Robust first, to see what does not belong; then plain on the rest, for the intervals.
        calm = run(used, x, "soft_l1", spread)
        residual = forces(calm) - data.normal_n
        used = np.abs(residual) <= OUTLIER * max(_robust(residual), EXACT * scale)
        if not used.all():
            x = run(used, calm, "linear", 1.0)
    dof = int(used.sum()) - len(x)
    if dof < 2:
        raise RunFailed(f"gel fit: {int(used.sum())} usable values for {len(x)} unknowns")
    jacobian = np.column_stack([_slope(forces, x, k, low[k], high[k]) for k in range(len(x))])[used]
    residual = (forces(x) - data.normal_n)[used]
    follow = _follow(residual) if float(np.sqrt(np.mean(residual**2))) > EXACT * scale else 0.0
    variance = float(residual @ residual) / dof * (1 + follow) / (1 - follow)
    to_mpa: Field = np.array([modulus, 1.0])[: len(x)]
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
