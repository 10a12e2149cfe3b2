"""What the study of shapes makes of presses that were seen, and what it refuses."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from deltact_fab.estimate.analysis.shape.press import PressShape
from deltact_fab.paths import shipped_folder
from deltact_fab.present.report.result import StudyResult
from deltact_fab.studies.study import registry, shapes
from deltact_fab.studies.study.registry import StudyRequest
from deltact_fab.studies.study.shapes import FORCE_SMALL, OBJECT_SETS, TWIST_PRESS, load_scene


def press(name: str, error_mm: float | None = None, **more: Any) -> PressShape:
    """A frame at rest and one that presses 1.5 mm, its depth off by so much; None: no truth."""
    row: dict[str, Any] = {
        "press": f"{name}/p1", "indenter": name, "frame_id": "1", "kind": "press",
        "tip_depth_mm": 1.5, "peak_depth_mm": 1.5, "area_mm2": 20.0, "extrapolated": False, **more,
    }  # fmt: skip
    if error_mm is not None:
        row |= {
            "depth_error_contact_mm": error_mm, "depth_error_face_mm": error_mm / 10,
            "zero_error_contact_mm": 1.0, "true_peak_depth_mm": 1.5 + error_mm,
            "relative_correlation": 0.5, "depth_correlation": 0.9, "true_area_mm2": 20.0,
        }  # fmt: skip
    return PressShape([{**row, "tip_depth_mm": 0.0}, row], None, None, None)


def seen(**errors: float | None) -> dict[str, PressShape]:
    return {
        f"{name} {place}": press(name, error, x_mm=float(place))
        for name, error in errors.items()
        for place in range(3)
    }


def found(presses: dict[str, PressShape], left_out_n: float | None = None) -> StudyResult:
    return shapes.build_result(presses, [], None, "", left_out_n, simulated=True, seed=0, scale=1.0)


def test_exact_depth_meets_its_goals() -> None:
    contact, face, *_ = found(seen(sphere=0.0, cylinder=0.0, ring=0.0, hat=0.0)).headlines
    assert (contact.value, contact.low, contact.high) == (0, 0, 0)
    assert contact.over == "4 objects"
    assert contact.state == "met"
    assert face.state == "met"


def test_goal_inside_interval_is_undecided() -> None:
    result = found(seen(sphere=0.1, cylinder=0.1, ring=0.1, hat=0.4))
    by = {head.what.partition(":")[0]: head for head in result.headlines}
    assert by["ring"].value == pytest.approx(0.1)
    assert by["hat"].over == "3 places: no interval below four"
    whole = result.headlines[0]
    assert whole.value == pytest.approx(0.175)
    assert whole.low is not None
    assert whole.high is not None
    assert 0 < whole.low < 0.25 < whole.high
    assert whole.state == "undecided"
    assert "goal 0.25: undecided" in result.verdict[0]
    assert len(" ".join(result.verdict).split()) <= 80
    (table,) = result.data["tables"].values()
    assert [(row["indenter"], row["places"]) for row in table][2:] == [("ring", 3), ("hat", 3)]
    assert table[3]["depth_error_contact_mm"] == pytest.approx(0.4)


def test_force_is_compared_with_sensor() -> None:
    presses = {
        f"p{k}": press("ring", found_normal_n=5.0 + off, normal_n=5.0, force_extrapolated=off == 1)
        for k, off in enumerate((0.1, -0.1, 0.1, 1))
    }
    head, beyond = found(presses, 0.06).headlines
    assert head.value == pytest.approx(0.1)
    assert head.goal == 0.2
    assert "0.06 N on an unseen position of its ball" in head.remark
    assert beyond.value == pytest.approx(1)
    assert "beyond the calibrations" in beyond.what
    assert beyond.goal is None
    assert "+20 %" in beyond.remark


def test_scale_reduces_places_not_objects() -> None:
    whole, least = load_scene(StudyRequest()), load_scene(StudyRequest(scale=0.01))
    for name in OBJECT_SETS:
        assert len(whole.protocols[name].positions_mm) == 3
        assert least.protocols[name].positions_mm == whole.protocols[name].positions_mm[:1]
        assert least.protocols[name].indenters == whole.protocols[name].indenters
        assert least.protocols[name].depths_mm == whole.protocols[name].depths_mm
    assert least.protocols[FORCE_SMALL] == whole.protocols[FORCE_SMALL]
    assert whole.presses(TWIST_PRESS) == ["sphere-15/p1"]
    kinds = {one.partition("/")[0] for name in OBJECT_SETS for one in whole.presses(name)}
    assert kinds == {"sphere-15", "cylinder", "ring", "hat"}
    # No object is the ball that depth and force are calibrated on.
    force, ball = whole.protocols[FORCE_SMALL], whole.protocols["ball-press"]
    assert set(force.indenters) == set(ball.indenters)
    assert "sphere-10" not in kinds


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
def test_study_is_complete_and_cached(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "protocols").mkdir()
    for name, pairs in FEWER.items():
        text = (shipped_folder("protocols") / f"{name}.toml").read_text()
        for shipped, fewer in pairs.items():
            assert shipped in text, f"{name}: {shipped}"
            text = text.replace(shipped, fewer)
        (tmp_path / "protocols" / f"{name}.toml").write_text(text)
    monkeypatch.chdir(tmp_path)
    asked = StudyRequest(scale=0.3, rig="virtual-coarse", seed=2)
    found = registry.run_study("shapes", asked)
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
    again = registry.run_study(
        "shapes", StudyRequest(scale=0.3, rig="virtual-coarse", seed=2, say=said.append)
    )
    assert said == []  # nothing was to do
    assert json.dumps(again.data) == json.dumps(found.data)
    assert np.isfinite(found.headlines[0].value)
