"""Presses as pure jobs: the whole run's own images, and the study's figures are a record's."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest

from deltact_fab import experiment
from deltact_fab.study.force_calibration import run
from deltact_fab.study.request import StudyRequest

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
    return StudyRequest(rig="virtual-coarse", seed=5, more={"protocol": str(protocol)})


@pytest.fixture(scope="module")
def simulated(asked: StudyRequest) -> dict[str, Any]:
    return json.loads(json.dumps(run(asked).data, allow_nan=False))


@pytest.mark.slow
def test_the_study_is_simulated_judged_and_told(simulated: dict[str, Any]) -> None:
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
def test_a_recorded_run_of_the_protocol_says_the_same(
    asked: StudyRequest, simulated: dict[str, Any], tmp_path: Path
) -> None:
    folder = tmp_path / "recorded"
    experiment.run(experiment.RunRequest(asked.more["protocol"], str(asked.rig), folder, seed=5))
    recorded = run(StudyRequest(runs=(folder,), seed=5)).data
    assert recorded["tables"] == simulated["tables"]
    assert recorded["runs"] == ["recorded"]
