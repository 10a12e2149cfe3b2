"""Force models under cross-validation: what a random split hides is told."""

from __future__ import annotations

import json
import re
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from deltact_fab.common.errors import InputError
from deltact_fab.estimate.analysis.force.calibrate import fit_best_model, transfer
from deltact_fab.estimate.analysis.force.dataset import ForceData
from deltact_fab.estimate.analysis.force.gel import UnrelaxedForces
from deltact_fab.estimate.analysis.force.judge import (
    CV_FOLDS,
    CV_REPEATS,
    LearningCurve,
    evaluate_features,
    fit_force,
    folds,
    force_figures,
    learning_curve,
    ranking_error_n,
)
from deltact_fab.estimate.analysis.force.result import ForceResult
from deltact_fab.estimate.analysis.intervals import Interval
from deltact_fab.estimate.measure.force import make_features
from deltact_fab.estimate.measure.force.calibration import ForceCalibration
from deltact_fab.estimate.measure.force.model import WRENCH_AXES
from deltact_fab.estimate.measure.sensor_id import CalibrationHead, CalibrationSource, SensorModel
from deltact_fab.sensor.optics.camera import Pinhole
from deltact_fab.sensor.shapes.sensor import SkinDimensions

VIEW = SensorModel(Pinhole(0.0378, 798, 586, 12.85), SkinDimensions())
SETS = {name: make_features(name, VIEW) for name in ("sums", "paper")}
LAW = (2.0, 1.5, -6.0, 3.0, -3.0, 1.0)
BALLS, PLACES, POINTS = ("sphere:10", "sphere:15"), 4, 12


def made(noise_n: float = 0.0, seed: int = 0) -> ForceData:
    """Points whose wrench is linear in their features, and noise."""
    rng = np.random.default_rng(seed)
    rows = [
        {"run": "r", "indenter": ball, "position": f"({at}, 0)", "press": f"{ball}/{at}",
         "x_mm": float(at), "y_mm": 0.0, "frame_id": f"{ball}/{at}/{k}", "cover": 1.0}
        for ball in BALLS for at in range(PLACES) for k in range(POINTS)
    ]  # fmt: skip
    X = {name: rng.uniform(0.5, 1.5, (len(rows), len(of.names))) for name, of in SETS.items()}
    law = np.zeros((len(WRENCH_AXES), len(SETS["sums"].names)))
    for i, name in enumerate(WRENCH_AXES):
        law[i, [SETS["sums"].names.index(n) for n in SETS["sums"].explains[name]]] = LAW[i]
    wrench = X["sums"] @ law.T
    wrench += rng.normal(0, noise_n, wrench.shape) if noise_n else 0
    return ForceData(pd.DataFrame(rows), wrench, X, SETS, [])


def _part(data: ForceData, rows: np.ndarray) -> ForceData:
    """The points of a mask."""
    return replace(
        data,
        points=data.points[rows].reset_index(drop=True),
        wrench=data.wrench[rows],
        features={name: values[rows] for name, values in data.features.items()},
    )


def test_exact_law_predicts_left_out_points() -> None:
    data = made()
    judged = evaluate_features(data, "sums", seed=0)
    assert ranking_error_n(judged, data) < 1e-9
    for name, of in force_figures(judged, data).items():
        unit = "n" if "range_n" in of else "nmm"
        for split in ("unseen", "position", "press", "point"):
            assert of[f"rmse_left_out_{split}_{unit}"] < 1e-9
        assert of[f"rmse_left_out_run_{unit}"] is None, "there is one run"
        assert name.startswith("torque") == (unit == "nmm")


def test_deviating_position_shows_only_when_unseen() -> None:
    data = made()
    odd = (data.points["position"] == "(3, 0)").to_numpy()
    bent = replace(data, wrench=data.wrench * np.where(odd, 1.5, 1.0)[:, None])
    judged = evaluate_features(bent, "sums", seed=0)
    of = force_figures(judged, bent)["normal"]
    for split in ("position", "unseen"):
        assert of[f"rmse_left_out_{split}_n"] > 1.1 * of["rmse_left_out_point_n"]
    assert judged.ranked_by == "unseen"
    assert ranking_error_n(judged, bent) >= of["rmse_left_out_unseen_n"]


@pytest.mark.parametrize("split", ["unseen", "position", "press", "point"])
def test_folds_are_disjoint_and_complete(split: str) -> None:
    points = made().points
    repeats = folds(points, split, seed=1)
    assert len(repeats) == (CV_REPEATS if split in ("press", "point") else 1)
    for parts in repeats:
        assert np.sum([judged for _, judged in parts], axis=0).tolist() == [1] * len(points)
        for fitted, judged in parts:
            for name in {"unseen": ["position", "indenter"], "point": []}.get(split, [split]):
                assert not set(points[name][fitted]) & set(points[name][judged])
            assert not (fitted & judged).any()
            if split == "point":
                assert judged.sum() in (len(points) // CV_FOLDS, len(points) // CV_FOLDS + 1)
    again = folds(points, split, seed=1)[0][0][1]
    assert (again == repeats[0][0][1]).all()


def test_splits_with_one_position_or_press() -> None:
    data = made(noise_n=0.1)
    centre = (data.points["position"] == "(0, 0)").to_numpy()
    place = evaluate_features(_part(data, centre), "sums", seed=0)
    assert list(place.predicted) == ["unseen", "press", "point"]
    one = _part(data, (data.points["press"] == "sphere:10/0").to_numpy())
    judged = evaluate_features(one, "sums", seed=0)
    assert list(judged.predicted) == [judged.ranked_by] == ["point"]
    assert force_figures(judged, one)["normal"]["percent_of_range"] > 0
    assert np.isfinite(ranking_error_n(judged, one))
    assert learning_curve(one, "sums", seed=0).errors_n == {}


def steep(last: float, low: float, high: float | None) -> LearningCurve:
    """A curve that falls at its end."""
    return LearningCurve({1: 3.0, 2: 2.0, 3: last}, Interval(last / 2, low, high, "8 presses"))


@pytest.mark.parametrize(
    ("curve", "said"),
    [
        (LearningCurve({}), "unknown if"),
        (LearningCurve({1: 0.3}), "unknown if"),  # two presses
        (LearningCurve({1: 0.3, 2: 0.3}), "unknown if"),  # one larger number may be chance
        (
            LearningCurve({1: 0.5, 2: 0.3, 3: 0.28, 5: 0.31}),
            "more than 2 presses improve it little",
        ),
        (LearningCurve({1: 0.5, 2: 0.3, 3: 0.28, 5: 0.26}), "unknown if"),  # better by 1.15
        (steep(1.0, 0.4, 0.6), "would improve it (error of 3 over that of 2: 0.50 [0.40 to 0.60])"),
        (steep(1.6, 0.6, 1.1), "unknown if"),
        (steep(1.6, 0.6, None), "unknown if"),
    ],
)
def test_gain_of_presses_needs_evidence(curve: LearningCurve, said: str) -> None:
    assert said in curve.clause


@pytest.mark.parametrize(("spread", "said"), [(0.1, "more presses would"), (0.0, "improve it lit")])
def test_learning_curve_of_differing_presses(spread: float, said: str) -> None:
    data, rng = made(noise_n=0.05), np.random.default_rng(0)
    for press in data.points["press"].unique():  # each press answers in its own way
        data.wrench[data.points["press"] == press] *= rng.normal(1, spread)
    curve = learning_curve(data, "sums", seed=0)
    assert list(curve.errors_n) == [1, 2, 3, 5, 6]
    assert said in curve.clause
    assert curve == learning_curve(data, "sums", seed=0)


def judged(data: ForceData) -> ForceResult:
    head = CalibrationHead("force", VIEW.id, CalibrationSource(("r",), True, "0", 0))
    return fit_best_model(
        data, 0, lambda model, _: ForceCalibration(head, model, VIEW.skin, VIEW.poisson)
    )


@pytest.mark.parametrize(
    ("presses", "said", "unsaid"),
    [
        ([f"{b}/{k}" for b in BALLS for k in range(4)],
         ["unseen position and indenter (2 indenters: no interval"], ["says nothing", "at least"]),
        ([f"{BALLS[0]}/{k}" for k in range(4)],
         ["0.05 N [0.04 to 0.06] (0.9 % of 5.9 N)", "unseen position (4 positions)", "other tips"],
         ["places", "at least"]),
        ([f"{b}/0" for b in BALLS],
         ["unseen indenter", "of other places; at least 4 places"], ["tips", "presses or"]),
        (["sphere:10/0"],
         ["other presses or places or tips; at least 4", "unknown if more"], ["unseen pos"]),
    ],
)  # fmt: skip
def test_verdict_names_untested_units(
    presses: list[str], said: list[str], unsaid: list[str]
) -> None:
    data = made(noise_n=0.05)
    line = judged(_part(data, data.points["press"].isin(presses).to_numpy())).line
    assert [part for part in said if part not in line] == [], line
    assert [part for part in unsaid if part in line] == [], line
    assert re.search(r"\(\d+\.\d % of \d+\.\d N and \d+\.\d % of \d+\.\d N\)", line)


def test_validation_presses_only_judge() -> None:
    """With validation and reference presses as wrong as can be, and without them."""
    data = made(noise_n=0.05)
    unlike = {f"{BALLS[1]}/{k}": role for k, role in enumerate(["validate"] * 3 + ["reference"])}
    roles = data.points["press"].map(unlike).fillna("fit")
    fitted = (roles == "fit").to_numpy()
    marked = replace(
        data,
        points=data.points.assign(role=roles),
        wrench=data.wrench * np.where(fitted, 1, 9)[:, None],
    )
    alone, told = judged(_part(data, fitted)), judged(marked)
    assert told.calibration.toml("") == alone.calibration.toml("")
    assert told.line == alone.line
    assert told.curves == alone.curves
    assert alone.validation == {}
    assert told.validation["normal"].value > 10 * alone.figures()["sums"]["normal"]["range_n"] / 9
    assert "validation: normal force to" in told.findings[0]
    assert "3 distinct presses: no interval" in told.findings[0]
    assert json.loads(json.dumps(told.as_dict(), allow_nan=False))["validation"]["normal"]["value"]


def test_late_validation_leaves_fitted_labels() -> None:
    """Labels are corrected to the longest wait of the presses that are fitted."""
    data = made()
    late = data.points["press"] == "sphere:10/1"
    points = data.points.assign(wait_s=np.where(late, 90.0, 1.0), role="fit")
    points.loc[late, "role"] = "validate"
    relaxed = UnrelaxedForces(0.2, 3.0).relaxed_wrenches(replace(data, points=points)).wrench
    assert relaxed[~late] == pytest.approx(data.wrench[~late])
    assert (np.abs(relaxed[late]) > np.abs(data.wrench[late])).all()


def test_softer_gel_transfers_by_two_factors() -> None:
    stiff = made(noise_n=0.02)
    model = fit_force(stiff, "sums")
    few = _part(stiff, np.isin(stiff.points["press"], ["sphere:10/1", "sphere:15/2"]))
    pressure, shear = (
        np.isin(WRENCH_AXES, ["fz", "tx", "ty"]),
        np.isin(WRENCH_AXES, ["fx", "fy", "tz"]),
    )
    soft = replace(few, wrench=few.wrench * np.where(pressure, 0.6, 0.7))
    assert shear.sum() == 3
    moved = transfer(model, soft)
    assert (moved.pressure, moved.shear) == pytest.approx((0.6, 0.7), rel=0.01)
    assert moved.error_n is not None
    assert moved.error_n < 0.1 < moved.as_is_error_n
    assert moved.model.predict(soft.features["sums"]) == pytest.approx(soft.wrench, abs=0.3)


def test_unsheared_presses_use_pressure_factor() -> None:
    data = made()
    model = fit_force(data, "sums")
    wrench = data.wrench * 0.5
    wrench[:, :2] = np.random.default_rng(0).normal(0, 50, (len(data), 2))
    moved = transfer(model, replace(data, wrench=wrench))
    assert not moved.shear_known
    assert moved.shear == moved.pressure == pytest.approx(0.5)
    nothing = replace(data, wrench=np.random.default_rng(0).normal(0, 50, wrench.shape))
    with pytest.raises(InputError, match="do not determine the factor of the normal"):
        transfer(model, nothing)
