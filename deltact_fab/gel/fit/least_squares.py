"""Least squares of a press model: values, intervals, and whether the data determine them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...aliases import Field, Mask
from ...errors import RunFailed
from .press_model import PressModel

Bounds = tuple[float, float]

COEFFICIENTS = (0.25, 0.5, 1.0)  # of friction, solved first where it is looked for
WIDER = (0.0, 0.25, 0.5, 1.0, 2.0)  # where the first ones do not enclose it
LEVEL = 0.95
OUTLIER = 6.0  # robust standard deviations
SCAN = 25  # depths of first touch tried before the fit
EXACT = 1e-10  # of the rms force: residuals below are rounding


@dataclass(frozen=True)
class Estimate:
    """A value with its 95 % interval."""

    value: float
    low: float
    high: float

    def widened(self, rel: float) -> Estimate:
        """With a share of the value more on either side, for what no residual shows."""
        more = rel * abs(self.value)
        return Estimate(self.value, self.low - more, self.high + more)


@dataclass(frozen=True, eq=False)
class FitSolution:
    """names: of the fitted values among modulus, friction, touch. covariance of `values`.

    jacobian (used, values) in N per unit. follow: lag-1 correlation of the residuals, 0 where it
    is within chance. coefficients: of friction, between which the model was interpolated.
    """

    names: tuple[str, ...]
    values: Field
    covariance: Field
    jacobian: Field
    dof: int
    follow: float
    friction: float
    touch_mm: float
    coefficients: tuple[float, ...]
    model_n: Field
    used: Mask

    def estimate(self, name: str) -> Estimate:
        """Student's interval of one of the names."""
        from scipy.stats import t

        k = self.names.index(name)
        half = float(t.ppf((1 + LEVEL) / 2, self.dof)) * math.sqrt(self.covariance[k, k])
        value = float(self.values[k])
        return Estimate(value, value - half, value + half)


def best_touch(model: PressModel, friction: float, bounds: Bounds) -> float:
    """The depth of first touch, of SCAN in the bounds, that leaves the least residual."""
    tried = np.linspace(*bounds, SCAN)
    left = []
    for touch in tried:
        unit = model.unit_n((friction,), friction, float(touch))
        modulus = float(unit @ model.measured_n) / max(float(unit @ unit), 1e-300)
        left.append(float(np.sum((model.measured_n - modulus * unit) ** 2)))
    return float(tried[int(np.argmin(left))])


def solve(model: PressModel, friction: float | None, touch_bounds: Bounds | None) -> FitSolution:
    """Fit the modulus and whatever is not given: friction None, first touch within its bounds.

    Raises RunFailed where the forces give no modulus above 0.
    """
    if friction is not None:
        return _minimise(model, (friction,), friction, touch_bounds)
    found = _minimise(model, COEFFICIENTS, None, touch_bounds)
    coefficients: tuple[float, ...] = COEFFICIENTS
    if not COEFFICIENTS[0] * 1.01 < found.friction < COEFFICIENTS[-1] * 0.99:
        coefficients = WIDER
        found = _minimise(model, coefficients, None, touch_bounds)
    # Solved once more where it came out, so that little is left to interpolation.
    near = float(f"{found.friction:.1g}")
    if near not in coefficients and coefficients[0] < near < coefficients[-1]:
        coefficients = tuple(sorted((*coefficients, near)))
        found = _minimise(model, coefficients, None, touch_bounds)
    return found


def _minimise(
    model: PressModel,
    coefficients: tuple[float, ...],
    friction: float | None,
    touch_bounds: Bounds | None,
) -> FitSolution:
    from scipy.optimize import least_squares

    start_friction = coefficients[len(coefficients) // 2]
    touch = 0.0 if touch_bounds is None else best_touch(model, start_friction, touch_bounds)
    unit = model.unit_n(coefficients, start_friction, touch)
    modulus = float(unit @ model.measured_n) / max(float(unit @ unit), 1e-300)
    if not modulus > 0:
        raise RunFailed("gel fit: the forces give no modulus above 0; is normal_n in N, pressed?")
    names, start, low, high = ["modulus"], [1.0], [0.0], [np.inf]
    if friction is None:
        names.append("friction")
        start.append(start_friction)
        low.append(coefficients[0])
        high.append(coefficients[-1])
    if touch_bounds is not None:
        names.append("touch")
        start.append(min(max(touch, touch_bounds[0] + 1e-6), touch_bounds[1] - 1e-6))
        low.append(touch_bounds[0])
        high.append(touch_bounds[1])

    def forces(x: Field) -> Field:
        mu = friction if friction is not None else float(x[1])
        at = float(x[-1]) if touch_bounds is not None else 0.0
        return modulus * float(x[0]) * model.unit_n(coefficients, mu, at)

    def run(used: Mask, begin: Field, loss: str, spread: float) -> Field:
        result = least_squares(
            lambda x: (forces(x) - model.measured_n)[used], begin, bounds=(low, high), loss=loss,
            f_scale=spread, x_scale=np.maximum(np.abs(begin), 0.1),
            ftol=1e-14, xtol=1e-12, gtol=1e-14,
        )  # fmt: skip
        return np.asarray(result.x)

    everything = np.ones(len(model.measured_n), dtype=bool)
    scale = float(np.sqrt(np.mean(model.measured_n**2)))
    x = run(everything, np.array(start), "linear", 1.0)
    spread = _robust(forces(x) - model.measured_n)
    used = everything
    if spread > EXACT * scale:
        # Robust first, to see what does not belong; then plain on the rest, for the intervals.
        calm = run(everything, x, "soft_l1", spread)
        residual = forces(calm) - model.measured_n
        used = np.abs(residual) <= OUTLIER * max(_robust(residual), EXACT * scale)
        if not used.all():
            x = run(used, calm, "linear", 1.0)
    dof = int(used.sum()) - len(names)
    if dof < 2:
        raise RunFailed(f"gel fit: {int(used.sum())} usable values for {len(names)} unknowns")
    jacobian = np.column_stack([_slope(forces, x, k, low[k], high[k]) for k in range(len(x))])[used]
    residual = (forces(x) - model.measured_n)[used]
    follow = _follow(residual) if float(np.sqrt(np.mean(residual**2))) > EXACT * scale else 0.0
    variance = float(residual @ residual) / dof * (1 + follow) / (1 - follow)
    covariance = variance * np.linalg.pinv(jacobian.T @ jacobian)
    to_mpa = np.ones(len(x))
    to_mpa[0] = modulus
    return FitSolution(
        names=tuple(names),
        values=x * to_mpa,
        covariance=covariance * np.outer(to_mpa, to_mpa),
        jacobian=jacobian / to_mpa,
        dof=dof,
        follow=follow,
        friction=friction if friction is not None else float(x[1]),
        touch_mm=float(x[-1]) if touch_bounds is not None else 0.0,
        coefficients=coefficients,
        model_n=forces(x),
        used=used,
    )


def own_share(solution: FitSolution, name: str) -> float:
    """Size of what one value changes in the forces and no other value can, over the forces.

    Per unit of the value: the norm of its column across the others, over the model's norm.
    """
    k = solution.names.index(name)
    column = solution.jacobian[:, k]
    others = np.delete(solution.jacobian, k, axis=1)
    weights, *_ = np.linalg.lstsq(others, column, rcond=None)
    size = float(np.linalg.norm(solution.model_n[solution.used]))
    return float(np.linalg.norm(column - others @ weights)) / size


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


def smooth_part(at: Sequence[float] | Field, residual: Field) -> tuple[Field, float]:
    """Cubic trend of a residual over `at`, and the F test's p that it is chance."""
    from scipy.stats import f

    x = np.asarray(at, dtype=np.float64)
    n, order = len(x), 3
    if n < order + 4 or not np.ptp(x) > 0:
        return np.zeros(n), 1.0
    basis = np.polynomial.legendre.legvander(2 * (x - x.min()) / np.ptp(x) - 1, order)
    weights, *_ = np.linalg.lstsq(basis, residual, rcond=None)
    trend = basis @ weights
    left = float(np.sum((residual - trend) ** 2)) / (n - order - 1)
    if not left > 0:
        return trend, 0.0 if float(trend @ trend) > 0 else 1.0
    return trend, float(f.sf(float(trend @ trend) / (order + 1) / left, order + 1, n - order - 1))
