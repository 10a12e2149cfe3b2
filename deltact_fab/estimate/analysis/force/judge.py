"""How far a force model can be trusted: on points, presses, places and balls it never saw.

Whatever a model learns from points (its coefficients, and the priors that go with their size) it
learns anew in each fold. What is learned before, from all of them, is said where it happens: the
gel that presses tell (`gel.identify_gel`), and which feature set is best.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from deltact_fab.common import Array, InputError

from ...measure.force.model import COMPONENTS, ForceModel
from ...measure.regression import RegressionFit
from .dataset import ForceData

FOLDS, REPEATS = 5, 10
"""A fifth is left out, as the paper has it (414 of 2070), in each of 5 folds; drawn so often, for
one draw of few points says little: judged by 38, 200 draws gave 0.53 to 1.51 N."""
SHOWN = {
    "normal": "fz",
    "shear_x": "fx",
    "shear_y": "fy",
    "torque_x": "tx",
    "torque_y": "ty",
    "torque_z": "tz",
}
"""The paper's words for a wrench's components, in the order of tables; `normal` is -Fz."""
FORCE_COMPONENTS = tuple(name for name, of in SHOWN.items() if of.startswith("f"))
FORCE_SPLITS = {
    "unseen": "position and indenter left out together",
    "position": "a position left out",
    "press": "a fifth of the presses left out",
    "point": "a fifth of the points left out at random",
    "run": "a run left out",
}
"""What is left out of a fit and predicted by it; models are ranked by the first that there is."""

Predict = Callable[[Array, Array], Array]


@dataclass(frozen=True)
class EvaluatedModel:
    """One feature set's model of all points, and what it predicts of points that it did not see.

    predicted: (repeats, n, 6) of each of SPLITS that there is, nan where the points left for a fit
    are too few.
    """

    name: str
    model: ForceModel
    fits: dict[str, RegressionFit]
    predicted: dict[str, Array]

    @property
    def ranked_by(self) -> str:
        """The hardest of SPLITS that there is."""
        return next(split for split in FORCE_SPLITS if split in self.predicted)

    def component(self, name: str, split: str) -> Array:
        """Predictions of one of SHOWN (repeats, n) by models that this split kept points from."""
        return force_component(self.predicted[split], name)


def folds(points: pd.DataFrame, split: str, seed: int) -> list[list[tuple[Array, Array]]]:
    """Of each repeat, masks (n,) of what is fitted to and what is judged; empty: not to be had.

    "unseen" shares neither position nor indenter with what is judged; where there is but one of
    either, it cannot be left out and is not. Whole presses stay together but in "point".
    """

    def codes(name: str) -> Array:
        return np.unique(points[name], return_inverse=True)[1]

    if split in ("point", "press"):
        of = np.arange(len(points)) if split == "point" else codes("press")
        count = int(of.max()) + 1
        rng = np.random.default_rng(seed)
        draws = [rng.permutation(np.arange(count) % min(FOLDS, count))[of] for _ in range(REPEATS)]
        parts = [[(drawn != k, drawn == k) for k in range(min(FOLDS, count))] for drawn in draws]
        return parts if count > 1 else []
    left = [codes(name) for name in (("position", "indenter") if split == "unseen" else (split,))]
    left = [of for of in left if of.max() > 0]
    if not left:
        return []
    return [
        [
            (np.logical_and.reduce([of != k for of, k in zip(left, cell, strict=True)]),
             np.logical_and.reduce([of == k for of, k in zip(left, cell, strict=True)]))
            for cell in np.unique(np.transpose(left), axis=0)
        ]
    ]  # fmt: skip


def cross_validated(
    points: pd.DataFrame, truth: Array, split: str, seed: int, predict: Predict
) -> Array:
    """What predict(fitted, judged) says of the points judged, (repeats, n, ...).

    fitted, judged: masks of points. nan where it raised InputError, for too few.
    """
    repeats = folds(points, split, seed)
    out = np.full((len(repeats), *truth.shape), np.nan)
    for said, parts in zip(out, repeats, strict=True):
        for fitted, judged in parts:
            try:
                said[judged] = predict(fitted, judged)
            except InputError:
                continue
    return out


def fit_force(data: ForceData, name: str, rows: Array | slice = slice(None)) -> ForceModel:
    """A feature set's model on some points. Raises InputError when they are too few."""
    return ForceModel.fit(data.sets[name], data.features[name][rows], data.wrench[rows])[0]


def left_out(data: ForceData, name: str, split: str, seed: int = 0) -> Array:
    """What a feature set's models predict of the points left out, as of `EvaluatedModel`."""
    X = data.features[name]
    return cross_validated(
        data.points, data.wrench, split, seed,
        lambda fitted, judged: fit_force(data, name, fitted).predict(X[judged]),
    )  # fmt: skip


def judge(data: ForceData, name: str, seed: int) -> EvaluatedModel:
    """Fit and cross-validate one feature set. Raises InputError for too few points."""
    X, presses = data.features[name], data.points["press"].tolist()
    model, fits = ForceModel.fit(data.sets[name], X, data.wrench, presses)
    tried = {split: left_out(data, name, split, seed) for split in FORCE_SPLITS}
    held = {split: said for split, said in tried.items() if len(said)}
    return EvaluatedModel(name, model, fits, held)


def force_component(wrench: Array, name: str) -> Array:
    """One of SHOWN (...) of wrenches (..., 6), its sign that of the figures."""
    part: Array = wrench[..., COMPONENTS.index(SHOWN[name])]
    return -part if name == "normal" else part


def root_mean_square(errors: Array) -> float | None:
    """Of all repeats together; None where something, or all, could not be predicted."""
    return None if not errors.size or np.isnan(errors).any() else float(np.sqrt(np.mean(errors**2)))


def force_figures(judged: EvaluatedModel, data: ForceData) -> dict[str, dict[str, Any]]:
    """Of each of SHOWN: errors in N or N mm, its range, R2 of all points, its error of that range.

    What never varied was not calibrated, and has no errors: None.
    """
    out = {}
    for name, of in SHOWN.items():
        unit, measured = ("n" if of.startswith("f") else "nmm"), force_component(data.wrench, name)
        span = float(np.ptp(measured))
        held = {
            split: root_mean_square(force_component(said, name) - measured)
            for split, said in (judged.predicted if span else {}).items()
        }
        worst = held.get(judged.ranked_by)
        out[name] = {
            "adjusted_r2": judged.fits[of].adjusted_r2,
            "adjusted_r2_about_zero": judged.fits[of].adjusted_r2_about_zero,
            f"rmse_fitted_{unit}": judged.fits[of].rmse if span else None,
            **{f"rmse_left_out_{split}_{unit}": held.get(split) for split in FORCE_SPLITS},
            f"range_{unit}": span,
            "percent_of_range": None if worst is None else 100 * worst / span,
        }
    return out


def calibrated_errors(judged: EvaluatedModel, data: ForceData) -> dict[str, dict[str, Any]]:
    """Those of `force_figures` that a calibration file keeps: of what was calibrated."""
    every = force_figures(judged, data)
    return {name: of for name, of in every.items() if of.get("range_n", of.get("range_nmm"))}


def fit_model(
    data: ForceData, name: str, seed: int
) -> tuple[ForceModel, dict[str, dict[str, Any]]]:
    """Fit one feature set to all points; with its errors as a calibration file keeps them.

    seed: of the folds. Raises InputError for too few points.
    """
    judged = judge(data, name, seed)
    return judged.model, calibrated_errors(judged, data)


def force_error_n(off: Array) -> float | None:
    """Root mean square length of the force, of errors (..., 6)."""
    each = root_mean_square(off[..., :3])
    return None if each is None else float(np.sqrt(3) * each)


def score(judged: EvaluatedModel, data: ForceData) -> float:
    """What models are ranked by: the force's error on the hardest of SPLITS that there is."""
    error = force_error_n(judged.predicted[judged.ranked_by] - data.wrench)
    return np.inf if error is None else error


SIZES = (1, 2, 3, 5, 8, 12, 20, 30, 40)
MAX_SHARE = 0.8
"""Of the presses, the most that are used: what is left must judge."""
ENOUGH = 1.1
"""The error that counts as no worse, over that from the most presses."""


def learning_curve(data: ForceData, name: str, seed: int) -> dict[int, float]:
    """By the number of presses fitted to: the force's error on all others, N, over REPEATS draws.

    Without the numbers that some draw could not be fitted from.
    """
    of = np.unique(data.points["press"], return_inverse=True)[1]
    count, rng, curve = int(of.max()) + 1, np.random.default_rng(seed), {}
    most = int(MAX_SHARE * count)
    for size in sorted({one for one in (*SIZES, most) if 0 < one <= most}):
        draws = [(rng.permutation(count) < size)[of] for _ in range(REPEATS)]
        try:
            said = [
                fit_force(data, name, used).predict(data.features[name][~used]) for used in draws
            ]
        except InputError:
            continue
        off = [p - data.wrench[~used] for p, used in zip(said, draws, strict=True)]
        curve[size] = force_error_n(np.concatenate(off)) or 0.0
    return curve


def presses_needed(curve: dict[int, float]) -> int | None:
    """The fewest presses whose error is within a tenth of the last one's; None without any."""
    return next((n for n, e in curve.items() if e <= ENOUGH * [*curve.values()][-1]), None)
