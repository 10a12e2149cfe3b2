"""Components of the errors of presses (repeat, place, tip, drift), with their uncertainty.

    y = X b + f (place + tip + drift) + repeat

The deviations of places and tips, and the drift, are shares of the force f; the repeat is in N.
For figures of presses y is the figure's share of their mean, and X and f are 1.
Their standard deviations are estimated by restricted likelihood (Patterson and Thompson, Biometrika
58, 1971, 545), which corrects for the fitted b. Each has a lognormal prior around a measured value:
many groups outweigh it, one group leaves it as it is, which counts as assumed.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from scipy import optimize

from deltact_fab.common import Array, InputError

if TYPE_CHECKING:
    from deltact_fab.estimate import ForceResult

FORCE_MODEL = "inverse-placed"
"""Decision 0026: the feature set that `calibrate force` chooses on several places."""
ASSUMED_ERRORS = {"repeat": 0.05, "place": 0.02, "tip": 0.006, "drift": 0.005}
"""N; shares; share per hour. Measured, docs/evidence/force.md: 0.086 N of noise in 0.134 N over
few states; a factor to 2 % (decision 0024); left-out balls within 4 % of left-out places. Drift by
hand: a lab's reference presses replace it."""
PRIOR_FACTOR = 2.0  # by hand: one standard deviation of the assumed values, up or down
LIGHT_SHARE = 0.05  # by hand: of the largest force; lighter points are of a face at rest
MIN_PILOT_PLACES = 3  # by hand: fewer do not determine the coefficient of the place's distance
COMPONENT_DRAWS = 2000  # by hand: a chance is then within 0.02
_PROPOSAL_COUNT, _PROPOSAL_FREEDOM, _LOG_STEP = 8000, 5, 1e-3  # by hand: of the sampling


@dataclass(frozen=True)
class ForcePoints:
    """Points of a pilot: regressors X (n, k), forces y (n,) in N; codes (n,) by component."""

    X: Array
    y: Array
    groups: dict[str, Array]

    @classmethod
    def from_result(cls, result: ForceResult) -> Self:
        """Take the normal forces of a calibration, without the points of a face at rest."""
        data, features = result.data, result.data.sets[FORCE_MODEL]
        use = [features.names.index(name) for name in features.explains["fz"]]
        normal_n = result.wrench_component("normal")
        rows = normal_n > LIGHT_SHARE * normal_n.max()
        points = data.points[rows]
        # Mirror images are one place, as in cross-validation.
        columns = {"place": "position", "tip": "indenter"}
        groups = {
            name: np.unique(points[column], return_inverse=True)[1]
            for name, column in columns.items()
        }
        if groups["place"].max() + 1 < MIN_PILOT_PLACES:
            use = use[:1]
        return cls(-data.features[FORCE_MODEL][rows][:, use], normal_n[rows], groups)


@dataclass(frozen=True)
class ErrorComponents:
    """Standard deviations of the components, such as those of ASSUMED_ERRORS.

    draws: (COMPONENT_DRAWS, n) from their distribution. basis: sources, by component.
    """

    draws: Array
    basis: dict[str, str]

    @property
    def mean_squares(self) -> Array:
        """Mean squares (4,) over the draws."""
        return np.asarray((self.draws**2).mean(axis=0))

    def interval(self, name: str) -> tuple[float, float, float]:
        """Median of a component, and its 95 % interval."""
        column = self.draws[:, list(self.basis).index(name)]
        middle, low, high = np.quantile(column, (0.5, 0.025, 0.975))
        return float(middle), float(low), float(high)

    def as_dict(self) -> dict[str, Any]:
        names = ("value", "low", "high")
        return {
            name: dict(zip(names, self.interval(name), strict=True)) | {"basis": self.basis[name]}
            for name in self.basis
        }

    @classmethod
    def assume(cls, seed: int, assumed: Mapping[str, float] = ASSUMED_ERRORS) -> Self:
        """Draw all components from their priors."""
        rng = np.random.default_rng(seed)
        normal = rng.standard_normal((COMPONENT_DRAWS, len(assumed)))
        draws = np.array([*assumed.values()]) * PRIOR_FACTOR**normal
        return cls(draws, dict.fromkeys(assumed, "assumed"))

    @classmethod
    def estimate(
        cls, points: ForcePoints, seed: int, drift_per_h: tuple[float, float] | None = None,
        assumed: Mapping[str, float] = ASSUMED_ERRORS,
    ) -> Self:  # fmt: skip
        """Estimate the components from a pilot's points.

        drift_per_h: share of the force per hour and its standard error; None: assumed. assumed:
        priors of the error between repeats, of the points' groups, and of what no pilot tells.
        Raises InputError for fewer points than the model has coefficients plus two.
        """
        count, k = points.X.shape
        if count < k + 2:
            raise InputError(f"pilot: {count} points in contact; at least {k + 2} are needed")
        priors, repeat = cls.assume(seed, assumed), next(iter(assumed))
        likelihood, n = _Likelihood(points), len(points.groups) + 1
        centre = np.log([*assumed.values()][:n])
        log_sd = _sample(likelihood, centre, np.random.default_rng(seed))
        draws = np.column_stack((np.exp(log_sd), priors.draws[:, n:]))
        basis = {**priors.basis, repeat: f"pilot, {count} points"}
        basis |= {name: _basis(codes, name) for name, codes in points.groups.items()}
        if drift_per_h is not None:
            drift, error = drift_per_h
            normal = np.random.default_rng(seed).standard_normal(COMPONENT_DRAWS)
            draws[:, 3] = np.abs(drift + error * normal)
            basis["drift"] = "pilot, reference presses"
        return cls(draws, basis)


def _basis(codes: Array, noun: str) -> str:
    count = int(codes.max()) + 1
    return f"pilot, {count} {noun}s" if count > 1 else f"assumed (one {noun} in the pilot)"


class _Likelihood:
    """Restricted log-likelihood of log standard deviations (n,): of a repeat, of the groups.

    Points are first rotated onto the span of all columns; the rest depends on the repeat alone.
    """

    def __init__(self, points: ForcePoints) -> None:
        factor = np.linalg.lstsq(points.X[:, :1], points.y, rcond=None)[0]
        force_n = points.X[:, 0] * factor
        parts = [
            force_n[:, None] * (codes[:, None] == np.unique(codes))
            for codes in points.groups.values()
        ]
        scaled = points.X / np.linalg.norm(points.X, axis=0)
        columns = np.column_stack((scaled, *parts))
        q, r = np.linalg.qr(columns)
        self._y, k = q.T @ points.y, scaled.shape[1]
        self._X, z = r[:, :k], r[:, k:]
        ends = np.cumsum([part.shape[1] for part in parts])
        self._covariances = [block @ block.T for block in np.split(z, ends[:-1], axis=1)]
        self._free = len(points.y) - q.shape[1]
        self._rest = float(points.y @ points.y - self._y @ self._y)

    def __call__(self, log_sd: Array) -> float:
        repeat, *shares = np.exp(2 * np.asarray(log_sd))
        V = repeat * np.eye(len(self._y))
        for share, covariance in zip(shares, self._covariances, strict=True):
            V += share * covariance
        lower = np.linalg.cholesky(V)
        X, y = (np.linalg.solve(lower, part) for part in (self._X, self._y))
        gram = X.T @ X
        misfit = y - X @ np.linalg.solve(gram, X.T @ y)
        determinants = 2 * np.log(np.diag(lower)).sum() + np.linalg.slogdet(gram)[1]
        rest = self._free * math.log(repeat) + self._rest / repeat
        return -0.5 * float(determinants + misfit @ misfit + rest)


def _sample(likelihood: _Likelihood, centre: Array, rng: np.random.Generator) -> Array:
    """Draw log standard deviations (COMPONENT_DRAWS, n): importance sampling around the mode.

    centre: of their prior.
    """
    n = len(centre)

    def minus_log(p: Array) -> float:
        return -likelihood(p) + 0.5 * float(np.sum(((p - centre) / math.log(PRIOR_FACTOR)) ** 2))

    mode = optimize.minimize(minus_log, centre, method="Nelder-Mead").x
    unit = _LOG_STEP * np.eye(n)
    signs = [(s, t) for s in (1, -1) for t in (1, -1)]
    curvature = [
        [sum(s * t * minus_log(mode + s * a + t * b) for s, t in signs) for b in unit] for a in unit
    ]
    hessian = np.array(curvature) / (4 * _LOG_STEP**2)
    values, vectors = np.linalg.eigh((hessian + hessian.T) / 2)
    # No direction is surer than its curvature says, nor less sure than twice the prior.
    root = vectors / np.sqrt(np.maximum(values, 0.25 / math.log(PRIOR_FACTOR) ** 2))
    normal = rng.standard_normal((_PROPOSAL_COUNT, n))
    stretch = np.sqrt(_PROPOSAL_FREEDOM / rng.chisquare(_PROPOSAL_FREEDOM, _PROPOSAL_COUNT))
    steps = normal * stretch[:, None]
    distance2 = (steps**2).sum(axis=1)
    log_proposal = -(_PROPOSAL_FREEDOM + n) / 2 * np.log1p(distance2 / _PROPOSAL_FREEDOM)
    proposals = mode + steps @ root.T
    log_weight = np.array([-minus_log(p) for p in proposals]) - log_proposal
    weight = np.exp(log_weight - log_weight.max())
    return np.asarray(
        proposals[rng.choice(_PROPOSAL_COUNT, COMPONENT_DRAWS, p=weight / weight.sum())]
    )
