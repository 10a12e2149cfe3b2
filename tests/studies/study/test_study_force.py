"""The force study: what it says of points, what a scale thins, and that a record says the same."""

from __future__ import annotations

import json
import re
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from deltact_fab.bench.protocols import plan
from deltact_fab.bench.protocols.plan import Protocol
from deltact_fab.common.errors import InputError
from deltact_fab.estimate.analysis.force.calibrate import fit_best_model
from deltact_fab.estimate.analysis.force.dataset import ForceData
from deltact_fab.estimate.analysis.force.result import PAPER_CONDITIONS, ForceResult
from deltact_fab.estimate.measure.force import make_features
from deltact_fab.estimate.measure.force.calibration import ForceCalibration
from deltact_fab.estimate.measure.force.model import WRENCH_AXES
from deltact_fab.estimate.measure.sensor_id import CalibrationHead, CalibrationSource, SensorModel
from deltact_fab.sensor.optics.camera import Pinhole
from deltact_fab.sensor.shapes.sensor import SkinDimensions
from deltact_fab.simulate.experiment.request import RunRequest
from deltact_fab.simulate.experiment.session import run_experiment
from deltact_fab.studies.study.force_calibration import (
    build_result,
    count_points,
    load_scene,
    order_places,
    run,
    scale_protocol,
)
from deltact_fab.studies.study.registry import StudyRequest

VIEW = SensorModel(Pinhole(0.0378, 798, 586, 12.85), SkinDimensions())
LAW = (2.0, 1.5, -6.0, 3.0, -3.0, 1.0)
BALLS = tuple(f"sphere:{d}" for d in (10, 12, 15, 22))
PLACES, POINTS = 4, 8


@cache
def made(noise_n: float = 0.02, bent: float = 1.0, places: int = PLACES) -> ForceResult:
    """Points whose wrench is linear in the sums, with noise; bent: a factor at the last place."""
    rng = np.random.default_rng(0)
    rows = [
        {"run": "r", "indenter": ball, "position": f"({at}, 0)", "press": f"r/{ball}/{at}",
         "x_mm": float(at), "y_mm": 0.0, "frame_id": f"{ball}/{at}/{leg}#{k:03d}", "cover": 1.0}
        for ball in BALLS for at in range(places) for leg in ("press", "shear-x+")
        for k in range(POINTS // 2)
    ]  # fmt: skip
    points = pd.DataFrame(rows)
    sets = {name: make_features(name, VIEW) for name in ("sums", PAPER_CONDITIONS, "paper-signed")}
    X = {name: rng.uniform(0.5, 1.5, (len(rows), len(of.names))) for name, of in sets.items()}
    law = np.zeros((len(WRENCH_AXES), len(sets["sums"].names)))
    for i, name in enumerate(WRENCH_AXES):
        columns = [sets["sums"].names.index(n) for n in sets["sums"].explains[name]]
        law[i, columns] = LAW[i]
    wrench = X["sums"] @ law.T + rng.normal(0, noise_n, (len(rows), 6))
    wrench[(points["x_mm"] == places - 1).to_numpy()] *= bent
    data = ForceData(points, wrench, X, sets, [])
    head = CalibrationHead("force", VIEW.id, CalibrationSource(("r",), True, "0", 0))
    return fit_best_model(
        data, 0, lambda model, _: ForceCalibration(head, model, VIEW.skin, VIEW.poisson)
    )


def test_verdict_is_short_with_intervals() -> None:
    told = build_result(made(), scale=0.1)
    assert told.answer[0].startswith("Use the model sums; more than ")
    best, paper = told.headlines[:3], told.headlines[3:]
    for head in told.headlines:
        assert head.low is not None
        assert head.high is not None
        assert 0 < head.low < head.value < head.high
    assert {head.over for head in best} <= {"4 positions", "4 indenters"}
    assert [head.over for head in paper] == ["16 distinct presses"] * 3
    assert [head.paper for head in paper] == [0.3, 0.14, 0.17]
    assert [head.state for head in best] == ["met"] * 3
    assert best[0].value == pytest.approx(0.02, rel=0.2)
    assert len(" ".join(told.verdict).split()) <= 80
    data = json.loads(json.dumps(told.data, allow_nan=False))
    assert (data["best"], data["n_points"]) == ("sums", len(BALLS) * PLACES * POINTS)
    assert [one for one in told.notes if "docs/evidence/strangers.md" in one]


def test_few_places_leave_goals_open() -> None:
    """With a place that answers otherwise; of three places there is no interval."""
    assert build_result(made(bent=1.6)).headlines[0].state == "missed"
    few = build_result(made(places=3)).headlines[0]
    assert few.over == "3 positions: no interval below four"
    assert few.state == "undecided"


@pytest.mark.parametrize(
    ("asked", "words"),
    [
        (StudyRequest(rig="grbl-bench"), "expected a 'virtual' rig"),
        (StudyRequest(rig="virtul"), "did you mean 'virtual'"),
        (StudyRequest(options={"protocol": "deep-drag"}), "channels: without force"),
        (StudyRequest(scale=0.0), "expected above 0 and at most 1"),
    ],
)
def test_unusable_scene_is_refused(asked: StudyRequest, words: str) -> None:
    with pytest.raises(InputError, match=words) as why:
        load_scene(asked)
    assert "\n" not in str(why.value)


def test_other_gel_models_are_refused(mini: tuple[Path, Path], mini_run: Path) -> None:
    with pytest.raises(
        InputError, match=r"specimen.gel_model: 'linear'; a calibration needs .*'hyperelastic'"
    ):
        load_scene(StudyRequest(options={"protocol": str(mini[0])}))
    with pytest.raises(InputError, match=r"gel_model = 'linear'.*needs 'hyperelastic'"):
        run(StudyRequest(runs=(mini_run,)))


def test_recorded_runs_refuse_scale_and_rig(mini_run: Path, tmp_path: Path) -> None:
    for asked, words in (
        (StudyRequest(runs=(mini_run,), scale=0.1), "--scale: not valid with --from"),
        (StudyRequest(runs=(mini_run,), rig="virtual"), "--rig: not valid with --from"),
        (
            StudyRequest(runs=(mini_run,), options={"protocol": "twist"}),
            "--protocol: not valid with",
        ),
        (StudyRequest(runs=(tmp_path / "gone",)), "no such folder"),
    ):
        with pytest.raises(InputError, match=words):
            run(asked)


FEWEST_POINTS = 190
"""Five balls, two places, two depths, a grid of shear, and one at rest."""
ABOVE = 1.25


@cache
def whole() -> Protocol:
    return plan.load_protocol("force-calibration")[0]


def folded(protocol: Protocol) -> set[tuple[float, float]]:
    return {(abs(x), abs(y)) for x, y in protocol.positions_mm}


@pytest.mark.slow
@settings(max_examples=60, deadline=None)
@given(st.floats(1e-4, 1.0))
def test_scale_keeps_indenters_and_range(scale: float) -> None:
    thin = scale_protocol(whole(), scale)
    assert thin.indenters == whole().indenters
    assert len(folded(thin)) >= 2
    assert set(thin.positions_mm) <= set(whole().positions_mm)
    assert (thin.depths_mm[0], thin.depths_mm[-1]) == (0.4, 1.6)
    assert set(thin.depths_mm) <= set(whole().depths_mm)
    shears = [protocol.shear for protocol in (thin, whole())]
    assert len({shear and shear.at_depth_mm(1.6) for shear in shears}) == 1
    wanted = scale * count_points(whole())
    assert count_points(thin) >= FEWEST_POINTS
    if wanted > FEWEST_POINTS:
        assert 1 / ABOVE <= count_points(thin) / wanted <= ABOVE


def test_full_scale_is_the_papers() -> None:
    assert scale_protocol(whole(), 1.0) == whole()
    assert count_points(whole()) == 9 * (5 * 9 + 1) * 5 == 2070


def test_places_are_far_apart_mirrors_last() -> None:
    order = [whole().positions_mm[n] for n in order_places(whole().positions_mm)]
    assert order[:2] == [(0.0, 0.0), (6.0, 5.0)]
    assert {(abs(x), abs(y)) for x, y in order[:4]} == folded(whole())
    assert sorted(order) == sorted(whole().positions_mm)


@pytest.mark.parametrize("scale", [0.0, -0.1, 1.01, float("nan")])
def test_invalid_scale_is_refused(scale: float) -> None:
    with pytest.raises(InputError, match="at most 1"):
        scale_protocol(whole(), scale)


PROTOCOL = """
name = "two-places"
indenters = ["sphere:15"]
positions_mm = [[0.0, 0.0], [6.0, 5.0], [-6.0, 5.0]]
depths_mm = [0.5]
channels = ["image", "force", "shear"]
[shear]
amplitude_of_depth = 0.4
grid = true
first = "outward"
[capture]
settle_s = 0.2
[specimen]
gel_model = "hyperelastic"
"""


@pytest.fixture(scope="module")
def asked(tmp_path_factory: pytest.TempPathFactory) -> StudyRequest:
    protocol = tmp_path_factory.mktemp("protocol") / "two-places.toml"
    protocol.write_text(PROTOCOL)
    return StudyRequest(rig="virtual-coarse", seed=5, options={"protocol": str(protocol)})


@pytest.fixture(scope="module")
def simulated(asked: StudyRequest) -> dict[str, Any]:
    return json.loads(json.dumps(run(asked).data, allow_nan=False))


@pytest.mark.slow
def test_simulated_study_end_to_end(simulated: dict[str, Any]) -> None:
    # One at rest and nine stops of a grid of shear, at three places, two of them mirror images.
    assert simulated["n_points"] == 30
    best = simulated["tables"]["force-models"][0]
    assert (best["model"], best["component"]) == (simulated["best"], "normal")
    assert best["rmse_left_out_unseen"] < 0.1 * best["range"]
    assert best["rmse_left_out_unseen"] == best["rmse_left_out_position"], "there is one indenter"
    assert 1 < best["range"] < 5
    assert simulated["headlines"][0]["over"] == "2 positions: no interval below four"
    assert simulated["headlines"][0]["state"] == "undecided"
    told = simulated["settings"]
    assert told["friction"] == "0.5"
    assert "noise 0.01 N" in told["force sensor"]
    assert told["gel"].startswith("hyperelastic; cells below an indenter of ")
    # A light press on large cells, as the coarse rig has them: said, not hidden.
    assert re.search(
        r"error of the mesh may be \d+ times that of the tolerance, [\d.]+% of", told["gel"]
    )
    assert "mesh at 3 of 3 jobs" in told["gel's flags"]
    assert (simulated["simulated"], simulated["seed"]) == (True, 5)


@pytest.mark.slow
def test_recorded_run_gives_same_result(
    asked: StudyRequest, simulated: dict[str, Any], tmp_path: Path
) -> None:
    folder = tmp_path / "recorded"
    run_experiment(RunRequest(asked.options["protocol"], str(asked.rig), folder, seed=5))
    recorded = run(StudyRequest(runs=(folder,), seed=5)).data
    assert recorded["tables"] == simulated["tables"]
    assert recorded["runs"] == ["recorded"]
