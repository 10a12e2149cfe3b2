"""What the study of shapes makes of presses that were seen, and what it refuses."""

from __future__ import annotations

from typing import Any

import pytest

from deltact_fab.analysis.shape import PressShape
from deltact_fab.report.result import StudyResult
from deltact_fab.study.request import StudyRequest
from deltact_fab.study.shape import summary
from deltact_fab.study.shape.simulated import FORCE, OBJECTS, TWIST, presses_of, scene


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
    return summary.result(presses, [], None, "", left_out_n, simulated=True, seed=0, scale=1.0)


def test_a_depth_that_is_right_errs_by_nothing_and_meets_its_goals() -> None:
    contact, face, *_ = found(seen(sphere=0.0, cylinder=0.0, ring=0.0, hat=0.0)).headlines
    assert (contact.value, contact.low, contact.high) == (0, 0, 0)
    assert contact.over == "4 objects"
    assert contact.state == "met"
    assert face.state == "met"


def test_each_object_has_its_error_and_a_goal_that_the_interval_reaches_over_is_undecided() -> None:
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
    assert "the goal of 0.25 is undecided" in result.verdict[0]
    assert len(" ".join(result.verdict).split()) <= 80
    (table,) = result.data["tables"].values()
    assert [(row["indenter"], row["places"]) for row in table][2:] == [("ring", 3), ("hat", 3)]
    assert table[3]["depth_error_contact_mm"] == pytest.approx(0.4)


def test_the_force_is_held_against_the_sensor() -> None:
    presses = {
        f"p{k}": press("ring", found_normal_n=5.0 + off, normal_n=5.0, force_extrapolated=off == 1)
        for k, off in enumerate((0.1, -0.1, 0.1, 1))
    }
    head, beyond = found(presses, 0.06).headlines
    assert head.value == pytest.approx(0.1)
    assert head.goal == 0.2
    assert "0.06 N on a place of its ball left out" in head.remark
    assert beyond.value == pytest.approx(1)
    assert "beyond the calibrations" in beyond.what
    assert beyond.goal is None
    assert "+20 %" in beyond.remark


def test_the_scale_thins_places_and_no_object() -> None:
    whole, least = scene(StudyRequest()), scene(StudyRequest(scale=0.01))
    for name in OBJECTS:
        assert len(whole.protocols[name].positions_mm) == 3
        assert least.protocols[name].positions_mm == whole.protocols[name].positions_mm[:1]
        assert least.protocols[name].indenters == whole.protocols[name].indenters
        assert least.protocols[name].depths_mm == whole.protocols[name].depths_mm
    assert least.protocols[FORCE] == whole.protocols[FORCE]
    assert presses_of(whole, TWIST) == ["sphere-15/p1"]
    kinds = {one.partition("/")[0] for name in OBJECTS for one in presses_of(whole, name)}
    assert kinds == {"sphere-15", "cylinder", "ring", "hat"}
    # No object is the ball that depth and force are calibrated on.
    assert set(whole.protocols[FORCE].indenters) == set(whole.protocols["ball-press"].indenters)
    assert "sphere-10" not in kinds
