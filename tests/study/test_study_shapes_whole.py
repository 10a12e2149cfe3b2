"""The study of shapes from protocols to figures, on few presses of a coarse gel."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from deltact_fab.catalog import shipped_dir
from deltact_fab.study import registry
from deltact_fab.study.request import StudyRequest

# What is thinned of the shipped protocols; those of the working folder are found first.
FEWER = {
    "shapes": {
        'indenters = ["sphere:15", "cylinder", "ring"]': 'indenters = ["sphere:15"]',
        "[0.6, 1.2, 1.8]": "[1.2]",
    },
    "shapes-hat": {"[1.2, 2.2, 3.2]": "[3.2]"},
    "ball-press": {"[0.6, 1.2, 1.8]": "[1.2]"},
    "force-calibration-small": {
        "[0.8, 1.5]": "[1.0]",
        "[[1.5, -1.0], [-5.0, 3.5], [5.5, 4.5]]": "[[1.5, -1.0], [-5.0, 3.5]]",
    },
    "twist": {"grid = true": 'axes = ["y"]'},
}


@pytest.mark.slow
def test_the_study_is_whole_and_done_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "protocols").mkdir()
    for name, pairs in FEWER.items():
        text = (shipped_dir("protocols") / f"{name}.toml").read_text()
        for shipped, fewer in pairs.items():
            assert shipped in text, f"{name}: {shipped}"
            text = text.replace(shipped, fewer)
        (tmp_path / "protocols" / f"{name}.toml").write_text(text)
    monkeypatch.chdir(tmp_path)
    asked = StudyRequest(scale=0.3, rig="virtual-coarse", seed=2)
    found = registry.run("shapes", asked)
    assert found.missing == ()
    assert found.simulated
    assert [figure.name for figure in found.figures] == [
        "shapes-gallery", "shapes-depth-error", "force-distribution",
    ]  # fmt: skip
    for figure in found.figures:
        assert figure.draw().axes
    ball, hat = found.data["frames"]
    assert (ball["indenter"], hat["indenter"]) == ("sphere:15", "hat")
    # A ball is told well, right below the eye too; its force by a calibration on another ball.
    assert ball["depth_error_contact_mm"] < 0.1
    assert ball["peak_depth_mm"] == pytest.approx(ball["true_peak_depth_mm"], rel=0.1)
    assert ball["area_mm2"] == pytest.approx(ball["true_area_mm2"], rel=0.2)
    assert ball["found_normal_n"] == pytest.approx(ball["normal_n"], rel=0.1)
    assert ball["pressure_error"] < 0.3
    twisted = max(found.data["twist"], key=lambda row: abs(row["shear_y_n"]))
    assert abs(twisted["shear_y_n"]) > 1
    assert twisted["found_shear_y_n"] == pytest.approx(twisted["shear_y_n"], rel=0.2)
    assert len(" ".join(found.verdict).split()) <= 80
    assert "factor of 2" in " ".join(found.notes)
    assert "of 1.1 to 2.1 mm" in found.settings["gel"]

    said: list[str] = []
    again = registry.run(
        "shapes", StudyRequest(scale=0.3, rig="virtual-coarse", seed=2, say=said.append)
    )
    assert said == []  # nothing was to do
    assert json.dumps(again.data) == json.dumps(found.data)
    assert np.isfinite(found.headlines[0].value)
