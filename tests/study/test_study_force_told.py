"""What the force study says of points: figures, goals with their reasons, refusals of a line."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from deltact_fab.analysis.force import PAPER, ForceData, ForceResult, fit_best
from deltact_fab.errors import InputError
from deltact_fab.measure.force import COMPONENTS, make_features
from deltact_fab.measure.force.calibration import ForceCalibration
from deltact_fab.measure.sensor_id import CalibrationSource, Head, SensorId
from deltact_fab.measure.view import SensorView
from deltact_fab.optics import Pinhole
from deltact_fab.report.result import StudyResult
from deltact_fab.shapes import SkinDimensions
from deltact_fab.study.force.reasons import parts, under_shear
from deltact_fab.study.force.simulated import scene
from deltact_fab.study.force.summary import modulus, told
from deltact_fab.study.force_calibration import run
from deltact_fab.study.request import StudyRequest

VIEW = SensorView(Pinhole(0.0378, 798, 586, 12.85), SkinDimensions())
LAW = (2.0, 1.5, -6.0, 3.0, -3.0, 1.0)
BALLS, PLACES, POINTS = ("sphere:10", "sphere:15", "sphere:22"), 3, 16
FIGURES = {
    "adjusted_r2", "adjusted_r2_about_zero", "rmse_n", "rmse_left_out_position_n",
    "rmse_left_out_indenter_n", "range_n",
}  # fmt: skip


def made(noise_n: float = 0.02, bent: float = 1.0, less_n: float = 0.0) -> ForceResult:
    """Points whose wrench is linear in the sums, with noise.

    bent: a factor at the last place. less_n: of normal force, which the sums do not see, at each
    stop with shear.
    """
    rng = np.random.default_rng(0)
    rows = [
        {"run": "r", "indenter": ball, "position": f"({at}, 0)", "press": f"r/{ball}/{at}",
         "x_mm": float(at), "y_mm": 0.0, "frame_id": f"{ball}/{at}/{leg}#{k:03d}", "cover": 1.0}
        for ball in BALLS for at in range(PLACES) for leg in ("press", "shear-x+")
        for k in range(POINTS // 2)
    ]  # fmt: skip
    points = pd.DataFrame(rows)
    sets = {name: make_features(name, VIEW) for name in ("sums", PAPER)}
    X = {name: rng.uniform(0.5, 1.5, (len(rows), len(of.names))) for name, of in sets.items()}
    law = np.zeros((len(COMPONENTS), len(sets["sums"].names)))
    for i, name in enumerate(COMPONENTS):
        columns = [sets["sums"].names.index(n) for n in sets["sums"].explains[name]]
        law[i, columns] = LAW[i]
    wrench = X["sums"] @ law.T + rng.normal(0, noise_n, (len(rows), 6))
    wrench[(points["x_mm"] == PLACES - 1).to_numpy()] *= bent
    wrench[points["frame_id"].str.contains("shear").to_numpy(), 2] += less_n
    data = ForceData(points, wrench, X, sets, [])
    head = Head("force", SensorId.of(VIEW.camera), CalibrationSource(("r",), True, "0", 0))
    return fit_best(
        data, 0, lambda model, _: ForceCalibration(head, model, VIEW.skin, VIEW.poisson)
    )


def said(result: ForceResult) -> StudyResult:
    return told(result, 0.1, None)


def test_the_json_is_as_it_was_asked_for() -> None:
    data = json.loads(json.dumps(said(made()).data, allow_nan=False))
    assert set(data["models"]) == {"paper", "best"}
    for of in data["models"].values():
        assert set(of) == {"normal", "shear_x", "shear_y"}
        for component in of.values():
            assert set(component) == FIGURES
            assert all(isinstance(value, float) for value in component.values())
    n = len(BALLS) * PLACES * POINTS
    assert (data["n_points"], data["n_train"], data["n_test"]) == (
        n,
        n - round(n / 5),
        round(n / 5),
    )
    assert data["paper_table"]["normal"] == {"adjusted_r2": 0.99, "rmse_n": 0.3}
    assert data["paper_table"]["shear_y"]["rmse_n"] == 0.17
    assert data["best"] == "sums"
    assert data["models"]["best"]["normal"]["rmse_left_out_position_n"] == pytest.approx(
        0.02, rel=0.2
    )


def test_every_headline_has_an_interval_that_holds_it_and_says_over_what() -> None:
    heads = said(made()).headlines
    assert len(heads) == 9
    for head in heads:
        assert head.low is not None
        assert head.high is not None
        assert 0 < head.low < head.value < head.high
    assert [head.over for head in heads[::3]] == [
        "3 positions",
        "3 indenters",
        "9 distinct presses",
    ]
    assert [head.paper for head in heads[6:]] == [0.3, 0.14, 0.17]


@pytest.mark.slow
def test_a_goal_that_is_met_is_met_and_one_that_is_missed_has_its_reason() -> None:
    good = said(made())
    assert all(head.met for head in good.headlines[:6])
    assert "is met" in good.verdict[1]
    bad = said(made(bent=1.4))
    missed = bad.headlines[0]
    assert missed.met is False
    assert "worst at (2, 0)" in missed.remark
    assert "N of it the same for all (gain 0.7" in missed.remark
    assert "is missed" in bad.verdict[1]
    assert "normal force, a position left out: RMSE" in bad.verdict[1]


def test_the_tables_say_where_errors_are() -> None:
    tables = {table.name: table.frame for table in said(made(bent=1.4)).tables}
    where = tables["force-left-out"]
    assert len(where) == 2 * (PLACES + len(BALLS))
    mine = where[(where["model"] == "best") & (where["left_out"] == "position")].set_index("which")
    assert mine["normal_rmse_n"].idxmax() == "(2, 0)"
    assert mine["normal_gain"]["(2, 0)"] == pytest.approx(1 / 1.4, abs=0.02)
    assert list(tables["force-paper-refits"]["fitted_to"]) == [
        "all points", "one place", "one indenter", "one press", "stops without shear",
        "stops without shear",
    ]  # fmt: skip
    printed = tables["force-models"].set_index(["model", "component"]).loc["as printed"]
    assert list(printed["rmse"]) == [0.3, 0.14, 0.17]
    assert not tables["force-learning"].empty


def test_what_shear_does_to_the_papers_normal_force_is_told() -> None:
    refits = parts(made(less_n=2.0), "sums").set_index(["fitted_to", "judged_on"])["normal_mean_n"]
    assert refits["stops without shear", "stops with shear"] == pytest.approx(2.0, abs=0.05)
    result = said(made(less_n=2.0))
    paper = result.headlines[6]
    assert paper.value > 0.3
    assert "the normal force varies by" in paper.remark
    assert paper.remark in result.verdict[3]


def test_what_varies_at_a_depth_is_measured_and_said() -> None:
    result = made()
    data, judged = result.data, result.best
    still = np.zeros_like(data.wrench)
    still[:, 2] = -(data.points["x_mm"].to_numpy() + data.points["indenter"].str.len())
    said = still.copy()
    said[:, 2] += np.where(np.arange(len(data)) % 2, 0.5, -0.5)
    varies = under_shear(
        replace(judged, predicted={**judged.predicted, "test": said}), replace(data, wrench=still)
    )
    assert varies == pytest.approx((0.0, 0.5))


def test_the_modulus_scales_newtons_and_no_share() -> None:
    result = made()
    table = modulus(result, 0.56, (25.0, 25.0, 35.0), (250.0, 250.0, 250.0))
    rows = told(result, 0.1, table).data["modulus"]["at"]
    low, here, high = rows
    assert (low["modulus_mpa"], high["modulus_mpa"]) == (0.28, 1.12)
    for key in ("normal_range_n", "shear_x_rmse_left_out_position_n", "of_sensor_force_range"):
        assert high[key] == pytest.approx(2 * here[key]) == pytest.approx(4 * low[key])
    peak = np.abs(result.data.wrench[:, :3]).max(axis=0)
    assert here["of_sensor_force_range"] == pytest.approx(max(peak / (25, 25, 35)))


def test_figures_are_drawn_with_where_they_are_from() -> None:
    figures = {one.name: one.draw() for one in said(made()).figures}
    assert set(figures) == {"force-predicted", "force-residual", "force-place", "force-learning"}
    for figure in figures.values():
        assert any("simulated, seed 0" in text.get_text() for text in figure.texts)


@pytest.mark.parametrize(
    ("asked", "words"),
    [
        (StudyRequest(rig="grbl-bench"), "a study simulates on a 'virtual' rig"),
        (StudyRequest(rig="virtul"), "did you mean 'virtual'"),
        (StudyRequest(more={"protocol": "deep-drag"}), "channels: without force"),
        (StudyRequest(scale=0.0), "expected above 0 and at most 1"),
    ],
)
def test_a_scene_that_will_not_do_is_refused_in_one_line(asked: StudyRequest, words: str) -> None:
    with pytest.raises(InputError, match=words) as why:
        scene(asked)
    assert "\n" not in str(why.value)


def test_a_gel_that_no_tolerance_picks_is_refused(mini: tuple[Path, Path], mini_run: Path) -> None:
    with pytest.raises(
        InputError, match=r"specimen.gel_model: 'linear'; a calibration needs .*'hyperelastic'"
    ):
        scene(StudyRequest(more={"protocol": str(mini[0])}))
    with pytest.raises(InputError, match=r"gel_model = 'linear'.*judged on 'hyperelastic'"):
        run(StudyRequest(runs=(mini_run,)))


def test_recorded_runs_take_no_scale_and_no_rig(mini_run: Path, tmp_path: Path) -> None:
    for asked, words in (
        (StudyRequest(runs=(mini_run,), scale=0.1), "--scale: does not go with --from"),
        (StudyRequest(runs=(mini_run,), rig="virtual"), "--rig: does not go with --from"),
        (
            StudyRequest(runs=(mini_run,), more={"protocol": "twist"}),
            "--protocol: does not go with",
        ),
        (StudyRequest(runs=(tmp_path / "gone",)), "no such folder"),
    ):
        with pytest.raises(InputError, match=words):
            run(asked)
