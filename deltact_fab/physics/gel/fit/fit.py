"""Modulus of a lab's own gel, from a measured press.

Model: the hyperelastic force curve of the same block and indenter at a given friction; forces are
linear in the modulus. Least squares with constant noise; the intervals are Student's t on the
covariance s^2 (J'J)^-1, widened where the residuals are correlated.
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deltact_fab.common import Field, InputError, Point2, Progress, RunFailed
from deltact_fab.sensor import GelMaterial, Indenter, SkinDimensions

from ..error_control import MESH_RATIO
from ..level import Choice, unusual_material
from ..level_selection import FORCE_TOLERANCE
from .force_curve import DEEPEST_SHARE, ForceCurve, cells_mm, force_curve
from .measured import MeasuredIndentation

Bounds = tuple[float, float]

CONFIDENCE_LEVEL = 0.95  # of the intervals: by hand, the usual level
FIT_OUTLIER_SIGMAS = 6.0  # robust standard deviations; by hand: less drops good values
EXACT_REL = 1e-10  # of the rms force; by hand: residuals below are rounding


@dataclass(frozen=True)
class Estimate:
    value: float
    low: float
    high: float

    def widened(self, rel: float) -> Estimate:
        """Widen by a fraction of the value on either side, for errors that no residual shows."""
        margin = rel * abs(self.value)
        return Estimate(self.value, self.low - margin, self.high + margin)


@dataclass(frozen=True, eq=False)
class FitSolution:
    """Fitted values: the modulus and, if fitted, the depth of first touch, with covariance.

    lag1: lag-1 correlation of the residuals, 0 if insignificant.
    """

    values: Field
    covariance: Field
    dof: int
    lag1: float
    touch_mm: float
    model_n: Field
    inliers: NDArray[np.bool_]

    def estimate(self, k: int) -> Estimate:
        from scipy.stats import t

        half = float(t.ppf((1 + CONFIDENCE_LEVEL) / 2, self.dof)) * math.sqrt(self.covariance[k, k])
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
    unit_n = unit.normal_n(data.depth_mm - sum(start[1:]))
    modulus = float(unit_n @ data.normal_n) / max(float(unit_n @ unit_n), 1e-300)
    if not modulus > 0:
        raise RunFailed("gel fit: the forces give no modulus above 0; is normal_n in N, pressed?")

    def forces(x: Field) -> Field:
        offset = float(x[1]) if touch_bounds is not None else 0.0
        return modulus * float(x[0]) * unit.normal_n(data.depth_mm - offset)

    def run(mask: NDArray[np.bool_], begin: Field, loss: str, spread: float) -> Any:
        return least_squares(
            lambda x: (forces(x) - data.normal_n)[mask], begin, bounds=(low, high), loss=loss,
            f_scale=spread, x_scale=np.maximum(np.abs(begin), 0.1),
            ftol=1e-14, xtol=1e-12, gtol=1e-14,
        )  # fmt: skip

    inliers = np.ones(len(data.normal_n), dtype=bool)
    scale = float(np.sqrt(np.mean(data.normal_n**2)))
    plain = run(inliers, np.array(start), "linear", 1.0)
    spread = _robust(forces(plain.x) - data.normal_n)
    if spread > EXACT_REL * scale:
        # A robust fit to find outliers, then least squares on the rest for the intervals.
        calm = run(inliers, plain.x, "soft_l1", spread).x
        residual = forces(calm) - data.normal_n
        inliers = np.abs(residual) <= FIT_OUTLIER_SIGMAS * max(_robust(residual), EXACT_REL * scale)
        if not inliers.all():
            plain = run(inliers, calm, "linear", 1.0)
    x = plain.x
    dof = int(inliers.sum()) - len(x)
    if dof < 2:
        raise RunFailed(f"gel fit: {int(inliers.sum())} usable values for {len(x)} unknowns")
    residual = (forces(x) - data.normal_n)[inliers]
    noisy = float(np.sqrt(np.mean(residual**2))) > EXACT_REL * scale
    lag1 = _lag1(residual) if noisy else 0.0
    variance = float(residual @ residual) / dof * (1 + lag1) / (1 - lag1)
    to_mpa: Field = np.array([modulus, 1.0])[: len(x)]
    scatter = np.asarray(np.linalg.pinv(plain.jac.T @ plain.jac), dtype=np.float64)
    covariance = variance * scatter * np.outer(to_mpa, to_mpa)
    touch = float(x[1]) if touch_bounds is not None else 0.0
    return FitSolution(x * to_mpa, covariance, dof, lag1, touch, forces(x), inliers)


def _robust(residual: Field) -> float:
    """Standard deviation from the median of absolute values, exact for a normal distribution."""
    return 1.4826 * float(np.median(np.abs(residual)))


def _lag1(residual: Field) -> float:
    """Lag-1 correlation in measured order, 0 unless significant (3 sigma)."""
    size = float(residual @ residual)
    r = float(residual[1:] @ residual[:-1]) / size if size > 0 else 0.0
    return min(r, 0.95) if r > 3 / math.sqrt(len(residual)) else 0.0


def smooth_part(x: Field, residual: Field) -> tuple[Field, float]:
    """Cubic trend of a residual over `x`, and the F test's p that it is chance."""
    from scipy.stats import f

    n, order = len(x), 3
    if n < order + 4 or not np.ptp(x) > 0:
        return np.zeros(n), 1.0
    trend = np.polynomial.Legendre.fit(x, residual, order)(x)
    noise = float(np.sum((residual - trend) ** 2)) / (n - order - 1)
    if not noise > 0:
        return trend, 0.0 if float(trend @ trend) > 0 else 1.0
    return trend, float(f.sf(float(trend @ trend) / (order + 1) / noise, order + 1, n - order - 1))


# Relative force error that cells by the default tolerance may have.
CELLS_REL = Choice.model_share * FORCE_TOLERANCE
# By hand, as fractions: smaller ones warn or refuse more often, larger ones miss wrong data.
MODEL_REL = 0.01  # of the force: expected error of the model
TOUCH_FORCE = 0.02  # of the largest force, for a first guess of the first touch
TOUCH_BEFORE, TOUCH_AFTER = 0.4, 0.15  # of the press: search range around that guess
MIN_DEPTH_SPREAD = 0.1  # of the deepest press: least range of the depths


@dataclass(frozen=True, eq=False)
class GelFit:
    """Gel modulus fitted to a measured press.

    friction_used: friction of the model. offset_mm: depth_mm at first touch, None if not fitted.
    rms_n, rms_rel: of all residuals, over the rms of the forces. mesh_error_rel: of the modulus,
    from a mesh MESH_RATIO as coarse, part of its interval; None if not requested.
    trend_rel: rms of the smooth part of the residual over the rms force. depth_mm (n,) from first
    touch of measured_n (n,) and model_n (n,); inliers (n,): False for outliers, not fitted.
    """

    modulus_mpa: Estimate
    friction_used: float
    offset_mm: Estimate | None
    rms_n: float
    rms_rel: float
    trend_rel: float
    mesh_error_rel: float | None
    points: int
    spacing_mm: float
    notes: tuple[str, ...]
    depth_mm: Field
    measured_n: Field
    model_n: Field
    inliers: NDArray[np.bool_]

    def as_dict(self) -> dict[str, Any]:
        """Return plain data, without the arrays."""
        plain = {k: v for k, v in asdict(self).items() if not isinstance(v, np.ndarray)}
        return {**plain, "model": "hyperelastic", "notes": list(self.notes)}


def fit_press(
    data: MeasuredIndentation,
    skin: SkinDimensions,
    indenter: Indenter,
    at_mm: Point2 = (0.0, 0.0),
    poisson: float = 0.49,
    friction: float = 0.5,
    *,
    fit_offset: bool = False,
    spacing_mm: float | None = None,
    mesh_error: bool = True,
    progress: Progress | None = None,
) -> GelFit:
    """Fit the modulus and, with fit_offset, the depth of first touch.

    mesh_error: also solve on a coarser mesh. Raises InputError where the file's depths do not fit
    the gel or are all equal, RunFailed where there is no modulus or its interval includes 0, and
    the solver's errors.
    """
    bounds, deepest = _reach(data, skin, fit_offset)
    default_mm = cells_mm(skin, indenter, poisson, at_mm, deepest)
    h = default_mm if spacing_mm is None else spacing_mm

    def solve_on(cell_mm: float) -> FitSolution:
        unit = force_curve(
            skin, GelMaterial(1.0, poisson, friction), indenter, at_mm, deepest,
            spacing_mm=cell_mm, progress=progress,
        )  # fmt: skip
        return solve(data, unit, bounds)

    solution = solve_on(h)
    error = None
    if mesh_error:
        # Cells are of second order. One pair of meshes may agree by chance: never less than the
        # error that the cells were chosen for.
        ratio = float(solve_on(h * MESH_RATIO).values[0] / solution.values[0])
        error = max(abs(ratio - 1) / (MESH_RATIO**2 - 1), CELLS_REL * (h / default_mm) ** 2)
    residual, inliers = data.normal_n - solution.model_n, solution.inliers
    scale = float(np.sqrt(np.mean(data.normal_n[inliers] ** 2)))
    rms = float(np.sqrt(np.mean(residual[inliers] ** 2)))
    trend, notes = _trend(data, solution, residual, scale)
    modulus = solution.estimate(0).widened(error or 0.0)
    if not modulus.low > 0:
        raise RunFailed(
            f"gel fit: {modulus.value:.3g} MPa with an interval of {modulus.low:.3g} to "
            f"{modulus.high:.3g} includes 0: the data do not determine a modulus; less noise, more "
            "rows or a deeper press is needed"
        )
    return GelFit(
        modulus_mpa=modulus,
        friction_used=friction,
        offset_mm=solution.estimate(1) if bounds is not None else None,
        rms_n=rms,
        rms_rel=rms / scale,
        trend_rel=trend,
        mesh_error_rel=error,
        points=int(inliers.sum()),
        spacing_mm=h,
        notes=tuple(notes + _data_notes(data, solution, modulus, bounds)),
        depth_mm=data.depth_mm - solution.touch_mm,
        measured_n=data.normal_n,
        model_n=solution.model_n,
        inliers=inliers,
    )


def _reach(
    data: MeasuredIndentation, skin: SkinDimensions, fit_offset: bool
) -> tuple[Bounds | None, float]:
    """Return bounds of the depth_mm of first touch, if fitted, and the deepest press they need."""
    low_mm, high_mm = float(data.depth_mm.min()), float(data.depth_mm.max())
    # A force at a single depth does not determine modulus and offset.
    if not high_mm - low_mm >= MIN_DEPTH_SPREAD * high_mm:
        raise InputError(
            f"{data.name}: column depth_mm: all rows are {low_mm:.3g} to {high_mm:.3g} mm deep; "
            f"depths spread over at least {MIN_DEPTH_SPREAD:.0%} of the deepest are needed"
        )
    limit = DEEPEST_SHARE * skin.thickness_mm
    bounds: Bounds | None = None
    deepest = high_mm
    if fit_offset:
        level = TOUCH_FORCE * float(data.normal_n.max())
        guess = float(data.depth_mm[data.normal_n > level].min())
        press = high_mm - guess
        low = max(guess - TOUCH_BEFORE * press, high_mm - limit)
        bounds = (low, guess + TOUCH_AFTER * press)
        deepest = high_mm - low
        if not low < bounds[1]:
            deepest = press
    if not 0 < deepest <= limit * (1 + 1e-9):
        raise InputError(
            f"{data.name}: column depth_mm: a press of {deepest:g} mm; above 0 and up to "
            f"{limit:g} mm, {DEEPEST_SHARE:.0%} of the gel's thickness, is needed"
        )
    return bounds, min(deepest, limit)


def _trend(
    data: MeasuredIndentation, solution: FitSolution, residual: Field, scale: float
) -> tuple[float, list[str]]:
    """Relative size of the residual's trend over depth, and a warning about it."""
    press = solution.inliers & (data.depth_mm > solution.touch_mm)
    if not press.any():
        return 0.0, []
    smooth, chance = smooth_part(data.depth_mm[press], residual[press])
    size = float(np.sqrt(np.mean(smooth**2))) / scale
    if chance > 0.001 or size < MODEL_REL:
        return size, []
    return size, [
        f"warning: the residual has a trend over depth of {size:.1%} of the force: thickness, "
        "indenter, position or the depth of first touch (--offset fit) may be wrong, or the gel "
        "creeps"
    ]


def _data_notes(
    data: MeasuredIndentation, solution: FitSolution, modulus: Estimate, bounds: Bounds | None
) -> list[str]:
    notes = []
    if data.dragged:
        notes.append(f"{data.dragged} rows from the first move along the face on: not fitted")
    if odd := unusual_material(modulus.value):
        notes.append(f"warning: {odd}; normal_n must be in N (not mN or g), depth_mm in mm")
    out = int((~solution.inliers).sum())
    if out:
        notes.append(f"{out}/{len(solution.inliers)} values not fitted (outliers)")
    if solution.lag1:
        notes.append(
            f"residuals are correlated (lag-1 correlation {solution.lag1:.2f}): intervals widened "
            f"{math.sqrt((1 + solution.lag1) / (1 - solution.lag1)):.1f} times"
        )
    if bounds is not None:
        edge = 1e-3 * (bounds[1] - bounds[0])
        if not bounds[0] + edge < solution.touch_mm < bounds[1] - edge:
            notes.append(
                f"warning: the first touch is at the end of its range, {bounds[0]:.3g} to "
                f"{bounds[1]:.3g} mm; rows before touch would determine it"
            )
    free_n = data.normal_n[data.depth_mm < solution.touch_mm]
    if len(free_n) > 3:
        bias, error = float(free_n.mean()), float(free_n.std(ddof=1)) / math.sqrt(len(free_n))
        if abs(bias) > 4 * error and abs(bias) > 1e-3 * float(data.normal_n.max()):
            notes.append(f"warning: the sensor reads {bias:.3g} N before touch; tare it")
    return notes
