"""How far a force model can be trusted: on points, places, balls and runs that it never saw."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ...aliases import Array
from ...errors import InputError
from ...measure.force import COMPONENTS, ForceModel
from ...measure.regression import RegressionFit
from .dataset import ForceData

TEST_SHARE = 0.2
"""Of the points, not used for the fit: the paper's 414 of 2070."""
SHOWN = {
    "normal": "fz",
    "shear_x": "fx",
    "shear_y": "fy",
    "torque_x": "tx",
    "torque_y": "ty",
    "torque_z": "tz",
}
"""The paper's words for a wrench's components, in the order of tables; `normal` is -Fz."""
FORCES = tuple(name for name, of in SHOWN.items() if of.startswith("f"))
LEFT_OUT = ("position", "indenter", "run")


@dataclass(frozen=True)
class EvaluatedModel:
    """One feature set's model under the paper's split and cross-validation.

    model, fits: of the training points; train, test: their indices. predicted: (n, 6) by what was
    left out ("test": the model itself, of all points; nan where a fold could not be fitted).
    """

    name: str
    model: ForceModel
    fits: dict[str, RegressionFit]
    train: Array
    test: Array
    predicted: dict[str, Array]


def split(n: int, seed: int) -> tuple[Array, Array]:
    """Indices to train on and to test on, 80 to 20, drawn from the seed."""
    order = np.random.default_rng(seed).permutation(n)
    n_test = round(TEST_SHARE * n)
    return np.sort(order[n_test:]), np.sort(order[:n_test])


def fit(data: ForceData, name: str, rows: Array | slice = slice(None)) -> ForceModel:
    """A feature set's model on some points. Raises InputError when they are too few."""
    return ForceModel.fit(data.sets[name], data.features[name][rows], data.wrench[rows])[0]


def judge(data: ForceData, name: str, seed: int) -> EvaluatedModel:
    """Fit and cross-validate one feature set. Raises InputError for too few points."""
    train, test = split(len(data), seed)
    X, presses = data.features[name][train], data.points["press"].iloc[train].tolist()
    model, fits = ForceModel.fit(data.sets[name], X, data.wrench[train], presses)
    predicted = {"test": model.predict(data.features[name])}
    for group in LEFT_OUT:
        if data.points[group].nunique() > 1:
            predicted[group] = left_out(data, name, group)
    return EvaluatedModel(name, model, fits, train, test, predicted)


def left_out(data: ForceData, name: str, group: str) -> Array:
    """Predictions (n, 6) of each group's points by a model that saw none of the group.

    nan where the others are too few to fit.
    """
    out = np.full((len(data), 6), np.nan)
    of = data.points[group].to_numpy()
    for value in dict.fromkeys(of):
        mine = of == value
        try:
            out[mine] = fit(data, name, ~mine).predict(data.features[name][mine])
        except InputError:
            continue
    return out


def component(wrench: Array, name: str) -> Array:
    """One of SHOWN (n,) of wrenches (n, 6), its sign that of the figures."""
    part: Array = wrench[:, COMPONENTS.index(SHOWN[name])]
    return -part if name == "normal" else part


def rmse(predicted: Array, wrench: Array, name: str) -> float | None:
    """Of one of SHOWN; None where something could not be predicted."""
    error = component(predicted, name) - component(wrench, name)
    return None if np.isnan(error).any() else float(np.sqrt(np.mean(error**2)))


def figures(judged: EvaluatedModel, data: ForceData) -> dict[str, dict[str, Any]]:
    """Of each of SHOWN: errors in N or N mm, range, the regression and its intervals.

    What never varied was not calibrated, and has no errors: None.
    """
    out = {}
    for name, of in SHOWN.items():
        unit, measured = ("n" if of.startswith("f") else "nmm"), component(data.wrench, name)
        fit, whole = judged.fits[of], judged.predicted["test"]
        span = float(np.ptp(measured))
        tried = judged.predicted if span else {}
        held = {group: rmse(p, data.wrench, name) for group, p in tried.items()}
        tested = rmse(whole[judged.test], data.wrench[judged.test], name) if span else None
        worst = max(
            (held[g] or np.inf for g in ("position", "indenter") if g in held), default=None
        )
        known = worst is not None and np.isfinite(worst)
        out[name] = {
            "adjusted_r2": fit.adjusted_r2,
            "adjusted_r2_about_zero": fit.adjusted_r2_about_zero,
            f"rmse_{unit}": tested,
            f"rmse_train_{unit}": fit.rmse if span else None,
            **{f"rmse_left_out_{group}_{unit}": held.get(group) for group in LEFT_OUT},
            f"range_{unit}": span,
            "percent_of_range": 100 * worst / span if known and worst is not None else None,
            "condition_raw": fit.condition_raw,
            "condition_scaled": fit.condition_scaled,
            "regression": fit.as_dict(),
        }
    return out


def force_error_n(predicted: Array, wrench: Array) -> float | None:
    """Root mean square length of the force's error."""
    error = (predicted - wrench)[:, :3]
    return None if np.isnan(error).any() else float(np.sqrt(np.mean(np.sum(error**2, axis=1))))


def score(judged: EvaluatedModel, data: ForceData) -> float:
    """What models are ranked by: the force's error, the worse of left-out position and indenter.

    With a single position and indenter, the error on the test points.
    """
    held = [judged.predicted[g] for g in ("position", "indenter") if g in judged.predicted]
    if held:
        errors = [force_error_n(p, data.wrench) for p in held]
    else:
        errors = [force_error_n(judged.predicted["test"][judged.test], data.wrench[judged.test])]
    return max(np.inf if e is None else e for e in errors)


SIZES = (1, 2, 3, 5, 8, 12, 20, 30, 40)
DRAWS = 12
MAX_SHARE = 0.8
"""Of the presses, the most that are used: what is left must judge."""
ENOUGH = 1.1
"""The error that counts as no worse, over that from the most presses."""


@dataclass(frozen=True)
class LearningPoint:
    """Errors on the presses that were left out, when so many were used; root mean squares of draws.

    force_error_n: of the force's length; low, high: 10th and 90th percentile over draws. None where
    no draw could be fitted: the points are fewer than the parameters.
    """

    presses: int
    draws: int
    force_error_n: float | None
    low_n: float | None
    high_n: float | None
    normal_n: float | None
    shear_x_n: float | None
    shear_y_n: float | None


def learning_curve(data: ForceData, name: str, seed: int) -> list[LearningPoint]:
    """Fit to a few presses drawn at random and judge by all others, for growing numbers of them."""
    of = data.points["press"].to_numpy()
    presses = np.array(list(dict.fromkeys(of)))
    rng = np.random.default_rng(seed)
    curve = []
    most = min(max(1, round(MAX_SHARE * len(presses))), len(presses) - 1)
    for size in sorted({s for s in (*SIZES, most) if 0 < s <= most}):
        rows = []
        for _ in range(DRAWS):
            used = np.isin(of, rng.permutation(presses)[:size])
            try:
                model = fit(data, name, used)
            except InputError:
                continue
            seen, truth = model.predict(data.features[name][~used]), data.wrench[~used]
            rows.append([force_error_n(seen, truth), *(rmse(seen, truth, c) for c in FORCES)])
        if not rows:
            curve.append(LearningPoint(size, 0, *[None] * 6))
            continue
        errors = np.array(rows, float)
        force, *each = np.sqrt(np.mean(errors**2, axis=0)).tolist()
        low, high = np.percentile(errors[:, 0], (10, 90)).tolist()
        curve.append(LearningPoint(size, len(rows), force, low, high, *each))
    return curve


def enough(curve: list[LearningPoint]) -> int | None:
    """The fewest presses whose error is within a tenth of the last one's; None where none is."""
    known = [point for point in curve if point.force_error_n is not None]
    for point in known:
        if point.force_error_n <= ENOUGH * known[-1].force_error_n:  # type: ignore[operator]
            return point.presses
    return None
