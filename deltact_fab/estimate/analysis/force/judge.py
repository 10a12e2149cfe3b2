"""Cross-validation of force models on unseen points, presses, positions and indenters.

Coefficients and the priors that scale with them are refitted in each fold. Fitted to all points and
not cross-validated: the gel (`gel.identify_gel`), and the choice of the best feature set.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from deltact_fab.common import Array, InputError

from ...measure.force.model import WRENCH_AXES, ForceModel
from ...measure.regression import RegressionFit
from ..intervals import Interval
from .dataset import ForceData

CV_FOLDS, CV_REPEATS = 5, 10
"""A fifth is left out, as in the paper (414 of 2070), in each of 5 folds; drawn ten times, for a
single draw varies: on 38 test points, 200 draws gave 0.53 to 1.51 N (decision 0026)."""
WRENCH_LABELS = {
    "normal": "fz",
    "shear_x": "fx",
    "shear_y": "fy",
    "torque_x": "tx",
    "torque_y": "ty",
    "torque_z": "tz",
}
"""The paper's words for a wrench's components, in the order of tables; `normal` is -Fz."""
FORCE_COMPONENTS = tuple(name for name, axis in WRENCH_LABELS.items() if axis.startswith("f"))
FORCE_SPLITS = {
    "unseen": "unseen position and indenter",
    "position": "unseen position",
    "press": "unseen fifth of the presses",
    "point": "unseen random fifth of the points",
    "run": "unseen run",
}
"""Kinds of test data, hardest first; models are ranked by the first that the points allow."""

Predict = Callable[[Array, Array], Array]


@dataclass(frozen=True)
class EvaluatedModel:
    """One feature set's model of all points, and its predictions of unseen points.

    predicted: (repeats, n, 6) by each of FORCE_SPLITS that the points allow, nan where too few
    points are left for a fit.
    """

    name: str
    model: ForceModel
    fits: dict[str, RegressionFit]
    predicted: dict[str, Array]

    @property
    def ranked_by(self) -> str:
        """The hardest of FORCE_SPLITS that the points allow."""
        return next(split for split in FORCE_SPLITS if split in self.predicted)

    def component(self, name: str, split: str) -> Array:
        """Predictions (repeats, n) of one of WRENCH_LABELS on the test data of a split."""
        return force_component(self.predicted[split], name)


def folds(points: pd.DataFrame, split: str, seed: int) -> list[list[tuple[Array, Array]]]:
    """Return, for each repeat, the folds as masks (n,) of training and test points; empty: none.

    "unseen" trains on points that share neither position nor indenter with the test points; a sole
    position or indenter is not left out. Presses stay together except in "point".
    """

    def codes(name: str) -> Array:
        return np.unique(points[name], return_inverse=True)[1]

    if split in ("point", "press"):
        group = np.arange(len(points)) if split == "point" else codes("press")
        count = int(group.max()) + 1
        rng = np.random.default_rng(seed)
        k_folds = min(CV_FOLDS, count)
        draws = [rng.permutation(np.arange(count) % k_folds)[group] for _ in range(CV_REPEATS)]
        parts = [[(fold != k, fold == k) for k in range(k_folds)] for fold in draws]
        return parts if count > 1 else []
    groups = [codes(name) for name in (("position", "indenter") if split == "unseen" else (split,))]
    groups = [group for group in groups if group.max() > 0]
    if not groups:
        return []
    return [
        [
            (np.logical_and.reduce([group != k for group, k in zip(groups, cell, strict=True)]),
             np.logical_and.reduce([group == k for group, k in zip(groups, cell, strict=True)]))
            for cell in np.unique(np.transpose(groups), axis=0)
        ]
    ]  # fmt: skip


def cross_validate(
    points: pd.DataFrame, truth: Array, split: str, seed: int, predict: Predict
) -> Array:
    """Return predict(train, test) of each fold at its test points, (repeats, n, ...).

    train, test: masks of points. nan where it raised InputError for too few.
    """
    repeats = folds(points, split, seed)
    out = np.full((len(repeats), *truth.shape), np.nan)
    for prediction, parts in zip(out, repeats, strict=True):
        for train, test in parts:
            try:
                prediction[test] = predict(train, test)
            except InputError:
                continue
    return out


def fit_force(data: ForceData, name: str, rows: Array | slice = slice(None)) -> ForceModel:
    """Fit a feature set's model to some points. Raises InputError when they are too few."""
    return ForceModel.fit(data.sets[name], data.features[name][rows], data.wrench[rows])[0]


def predict_left_out(data: ForceData, name: str, split: str, seed: int = 0) -> Array:
    """Predict the left-out points by a feature set's models, as in `EvaluatedModel.predicted`."""
    X = data.features[name]
    return cross_validate(
        data.points, data.wrench, split, seed,
        lambda train, test: fit_force(data, name, train).predict(X[test]),
    )  # fmt: skip


def evaluate_features(data: ForceData, name: str, seed: int) -> EvaluatedModel:
    """Fit and cross-validate one feature set. Raises InputError for too few points."""
    X, presses = data.features[name], data.points["press"].tolist()
    model, fits = ForceModel.fit(data.sets[name], X, data.wrench, presses)
    predictions = {split: predict_left_out(data, name, split, seed) for split in FORCE_SPLITS}
    available = {split: prediction for split, prediction in predictions.items() if len(prediction)}
    return EvaluatedModel(name, model, fits, available)


def force_component(wrench: Array, name: str) -> Array:
    """Return one of WRENCH_LABELS (...) of wrenches (..., 6), with the sign of the figures."""
    part: Array = wrench[..., WRENCH_AXES.index(WRENCH_LABELS[name])]
    return -part if name == "normal" else part


def root_mean_square(errors: Array) -> float | None:
    """Root mean square over all repeats; None if a value is nan, or there is none."""
    return None if not errors.size or np.isnan(errors).any() else float(np.sqrt(np.mean(errors**2)))


def force_figures(evaluated: EvaluatedModel, data: ForceData) -> dict[str, dict[str, Any]]:
    """Return, for each of WRENCH_LABELS: errors in N or N mm, range, R2 of all points, % of range.

    A component that never varied is not calibrated, and its errors are None.
    """
    out = {}
    for name, axis in WRENCH_LABELS.items():
        measured, unit = force_component(data.wrench, name), "n" if axis[0] == "f" else "nmm"
        span = float(np.ptp(measured))
        errors = {
            split: root_mean_square(force_component(prediction, name) - measured)
            for split, prediction in (evaluated.predicted if span else {}).items()
        }
        worst = errors.get(evaluated.ranked_by)
        out[name] = {
            "adjusted_r2": evaluated.fits[axis].adjusted_r2,
            "adjusted_r2_about_zero": evaluated.fits[axis].adjusted_r2_about_zero,
            f"rmse_fitted_{unit}": evaluated.fits[axis].rmse if span else None,
            **{f"rmse_left_out_{split}_{unit}": errors.get(split) for split in FORCE_SPLITS},
            f"range_{unit}": span,
            "percent_of_range": None if worst is None else 100 * worst / span,
        }
    return out


def calibrated_errors(evaluated: EvaluatedModel, data: ForceData) -> dict[str, dict[str, Any]]:
    """Return the rows of `force_figures` for a calibration file: of the calibrated components."""
    figures = force_figures(evaluated, data)
    return {name: row for name, row in figures.items() if row.get("range_n", row.get("range_nmm"))}


def fit_model(
    data: ForceData, name: str, seed: int
) -> tuple[ForceModel, dict[str, dict[str, Any]]]:
    """Fit one feature set to all points; with its errors, see `calibrated_errors`.

    seed: for the folds. Raises InputError for too few points.
    """
    evaluated = evaluate_features(data, name, seed)
    return evaluated.model, calibrated_errors(evaluated, data)


def force_error_n(residual: Array) -> float | None:
    """Root mean square length of the force, of errors (..., 6)."""
    component_n = root_mean_square(residual[..., :3])
    return None if component_n is None else float(np.sqrt(3) * component_n)


def ranking_error_n(evaluated: EvaluatedModel, data: ForceData) -> float:
    """Force error that models are ranked by: on the hardest of FORCE_SPLITS that there is."""
    error = force_error_n(evaluated.predicted[evaluated.ranked_by] - data.wrench)
    return np.inf if error is None else error


CURVE_SIZES = (1, 2, 3, 5, 8, 12, 20, 30, 40)  # presses; by hand: more sizes take more fits
MAX_TRAINING_SHARE = 0.8
"""Largest share of the presses to train on; by hand: the rest must suffice as test data."""
CURVE_TOLERANCE = 1.1
"""Error that counts as no worse, over that from the most presses; by hand: above noise of draws."""
FLAT_SIZES = 2  # that do not improve on fewer presses; by hand: one alone may be chance


@dataclass(frozen=True)
class LearningCurve:
    """Force errors on all other presses, N, by the number of training presses.

    last_step: the last error over the one before, with the wider interval, over presses or draws;
    None where unknown.
    """

    errors_n: dict[int, float]
    last_step: Interval | None = None

    @property
    def enough(self) -> int | None:
        """The fewest presses that no FLAT_SIZES or more larger numbers improve on, None: unknown.

        An improvement exceeds CURVE_TOLERANCE.
        """
        sizes, errors_n = list(self.errors_n), list(self.errors_n.values())
        for k in range(len(sizes) - FLAT_SIZES):
            if errors_n[k] <= CURVE_TOLERANCE * min(errors_n[k + 1 :]):
                return sizes[k]
        return None

    @property
    def clause(self) -> str:
        """Gain of more presses: little, some, or unknown."""
        if self.enough is not None:
            return f"more than {self.enough} presses improve it little"
        step = self.last_step
        if step is not None and step.high is not None and step.high < 1:
            fewer, last = list(self.errors_n)[-2:]
            change = f"error of {last} over that of {fewer}: {step.value:.2f}"
            return f"more presses would improve it ({change} [{step.low:.2f} to {step.high:.2f}])"
        return "unknown if more presses would improve it"


def learning_curve(data: ForceData, name: str, seed: int) -> LearningCurve:
    """Evaluate the learning curve of a feature set, over CV_REPEATS draws of presses.

    Numbers of presses are omitted for which a draw could not be fitted.
    """
    X, press = data.features[name], np.unique(data.points["press"], return_inverse=True)[1]
    count, rng = int(press.max()) + 1, np.random.default_rng(seed)
    errors_n: dict[int, float] = {}

    def residual(train: Array, test: Array) -> Array:
        return fit_force(data, name, train).predict(X[test]) - data.wrench[test]

    max_presses = int(MAX_TRAINING_SHARE * count)
    for size in sorted({n for n in (*CURVE_SIZES, max_presses) if 0 < n <= max_presses}):
        draws = [(rng.permutation(count) < size)[press] for _ in range(CV_REPEATS)]
        with suppress(InputError):
            residuals = [residual(train, ~train) for train in draws]
            errors_n[size] = force_error_n(np.concatenate(residuals)) or 0.0
    rows = []
    with suppress(InputError):  # of the last step: each draw's fewer presses are among its more
        for draw in range(CV_REPEATS) if len(errors_n) > 1 else ():
            turn = rng.permutation(count)[press]
            test = turn >= max(errors_n)
            pair = (residual(turn < n, test) for n in list(errors_n)[-2:])
            squares = [(r[:, :3] ** 2).sum(axis=1) for r in pair]
            rows.append(np.column_stack((*squares, press[test], np.full(test.sum(), draw))))
    steps = np.concatenate(rows) if rows else np.zeros((1, 4))
    if not steps[:, :2].any(axis=0).all():
        return LearningCurve(errors_n)
    of_press, of_draw = (
        Interval.jackknife(
            steps[:, :2], steps[:, k], lambda r: float(np.sqrt(r[:, 1].mean() / r[:, 0].mean())),
            noun, "positive",
        )
        for k, noun in ((2, "press"), (3, "draw"))
    )  # fmt: skip
    return LearningCurve(errors_n, _widest((of_press, of_draw)))


def _widest(intervals: Iterable[Interval]) -> Interval:
    """Return the widest interval, or one that is not known."""
    return max(intervals, key=lambda i: np.inf if i.low is None else (i.high or 0) - i.low)


def error_interval(errors: Array, points: pd.DataFrame, split: str) -> Interval | None:
    """RMSE with the wider interval over the units that a split tests on; None where unknown.

    errors: (repeats, n), N or N mm, of points by this split. Units: positions, indenters, presses
    or runs; distinct presses (indenter and position) for single points.
    """
    if not errors.size or np.isnan(errors).any():
        return None
    columns = ("position", "indenter") if split == "unseen" else (split,)
    groups = {c: points[c] for c in columns if c != "point" and points[c].nunique() > 1}
    groups = groups or {"distinct press": _distinct_presses(points)}
    return _widest(
        Interval.rmse(errors.ravel(), np.tile(g, len(errors)), n) for n, g in groups.items()
    )


def _distinct_presses(points: pd.DataFrame) -> pd.Series[str]:
    """Label of the indenter and position of each point: errors of one label are correlated."""
    return points["indenter"] + " " + points["position"]


def validate(model: ForceModel, data: ForceData) -> dict[str, Interval]:
    """Errors of a model by component on presses to validate, which nothing was fitted to."""
    errors, data = _validation_errors(model, data)
    intervals = {name: error_interval(e, data.points, "point") for name, e in errors.items()}
    return {name: interval for name, interval in intervals.items() if interval}


def validation_squares(model: ForceModel, data: ForceData) -> dict[str, list[float]]:
    """Mean square errors by component, N^2 or N^2 mm^2, of each distinct press to validate."""
    errors, data = _validation_errors(model, data)
    places = _distinct_presses(data.points)
    return {
        name: pd.Series(e[0] ** 2).groupby(places.to_numpy(), sort=False).mean().tolist()
        for name, e in errors.items()
    }


def _validation_errors(model: ForceModel, data: ForceData) -> tuple[dict[str, Array], ForceData]:
    """Errors (1, n) of a model by component on the points of presses to validate; the points.

    Frames at rest are left out: without contact there is no error to speak of.
    """
    data = data.select(data.has_role("validate") & ~data.points["frame_id"].str.contains("/rest#"))
    residual = model.predict(data.features[model.features]) - data.wrench
    return {name: force_component(residual, name)[None] for name in WRENCH_LABELS}, data
