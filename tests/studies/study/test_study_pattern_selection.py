"""The pattern selection end to end, on a press of a millimetre; killed and gone on with."""

from __future__ import annotations

import json
import pickle
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from deltact_fab.bench.record.run import open_run
from deltact_fab.common.errors import InputError
from deltact_fab.estimate.analysis.tracking_error.tally import ErrorTally
from deltact_fab.fabricate.patterns.series import list_series
from deltact_fab.present.report.result import StudyResult
from deltact_fab.sensor.shapes.sensor import SkinDimensions
from deltact_fab.studies.study import pattern_selection
from deltact_fab.studies.study.pattern_errors import (
    COMPOSED_FLOW,
    SUMMED_FLOW,
    PatternErrors,
    PressErrors,
)
from deltact_fab.studies.study.pattern_selection import Selection
from deltact_fab.studies.study.pattern_tables import claims
from deltact_fab.studies.study.registry import StudyRequest

TWO = ("d0p1-r0p5", "d0p2-r0p1")


def asked(mini: tuple[Path, Path], **more: Any) -> StudyRequest:
    chosen = {"protocol": str(mini[0]), "pattern": TWO, "indenter": ()} | more
    return StudyRequest(scale=1.0, seed=3, rig=str(mini[1]), options=chosen)


@pytest.fixture(scope="module")
def small(mini: tuple[Path, Path]) -> StudyResult:
    """Two patterns under one indenter."""
    return pattern_selection.run(asked(mini, indenter=("sphere:10",)))


@pytest.mark.slow
def test_small_study_has_errors_and_paper(small: StudyResult) -> None:
    assert small.simulated
    assert not small.missing
    rows = {row["pattern"]: row for row in small.data["tables"]["patterns"]}
    assert set(rows) == {"d 0.1 r 0.5", "d 0.2 r 0.1"}
    assert (rows["d 0.1 r 0.5"]["paper"], rows["d 0.1 r 0.5"]["round"]) == ("0.11", "1 and 2")
    for row in rows.values():
        limits_mm = {"summed": 0.2, "composed": 0.1, "published": 0.2, "ours": 0.02}
        for name, most_mm in limits_mm.items():
            assert 0 < row[f"{name}_mm"] < most_mm
            assert 0 < row[f"{name}_off_mm"] < most_mm
            assert row[f"{name}_moving_mm"] >= row[f"{name}_mm"]
            assert 0 <= row[f"{name}_lost_frames"] <= 1
            assert 0 <= row[f"{name}_lost_pixels"] < 0.5
            assert 0.5 < row[f"{name}_coverage"] <= 1
    json.dumps(small.data, allow_nan=False)
    patterns, indenters, path = small.tables
    assert patterns.columns is not None
    assert set(patterns.columns) <= set(patterns.frame)
    assert len(indenters.frame) == 8
    assert {"depth_mm", "drag_from_mm", "drag_to_mm", "lost_pixels"} < set(path.frame)
    assert (path.frame["frames"] > 0).all()
    for figure in small.figures:
        assert "1 of 1 positions" in figure.caption
        assert len(figure.draw().axes) == 2
    assert len(" ".join(small.verdict).split()) <= 80


@pytest.mark.slow
def test_record_gives_the_same_errors(
    mini: tuple[Path, Path], mini_run: Path, tmp_path: Path
) -> None:
    """A record has its own pattern, and here its truth: the stream's frames are micrometres off."""
    found = pattern_selection.run(StudyRequest(runs=(mini_run,)))
    (row,) = found.data["tables"]["patterns"]
    held = open_run(mini_run).pattern["recipe"]
    assert row["pattern"] == f"d {held['patch_mm']:g} r {held['r']:g}"
    assert 0 < row["ours_mm"] < 0.02
    (by_tracker, *_) = found.data["tables"]["indenters"]
    assert {"sphere:10", "4dots"} < set(by_tracker)
    # Two runs of one pattern are replicates: together they say what each says.
    other = shutil.copytree(mini_run, tmp_path / "again")
    twice = pattern_selection.run(StudyRequest(runs=(mini_run, other)))
    (again,) = twice.data["tables"]["patterns"]
    assert again["ours_mm"] == pytest.approx(row["ours_mm"])


@pytest.mark.parametrize(
    ("more", "says"),
    [
        ({"pattern": ("d0p1-r0p7",)}, "--pattern: 'd0p1-r0p7'"),
        ({"indenter": ("sphere:15",)}, "--indenter: 'sphere:15'"),
    ],
)
def test_unknown_names_are_refused(
    mini: tuple[Path, Path], more: dict[str, Any], says: str
) -> None:
    with pytest.raises(InputError, match=says):
        pattern_selection.run(asked(mini, **more))


def test_presses_are_split_over_workers() -> None:
    scene = Selection.from_request(StudyRequest())
    for workers, parts in ((1, 5), (5, 5), (100, 17)):
        jobs = scene.jobs(workers)
        assert len({job.name for job in jobs}) == len(jobs) == 5 * parts
        first = [name for job in jobs[:parts] for name in job.arguments.patterns]
        assert sorted(first) == sorted(entry.name for entry in scene.entries)


def test_job_key_is_independent_of_process() -> None:
    job, other = Selection.from_request(StudyRequest()).jobs()[:2]
    assert pickle.loads(pickle.dumps(job)).key() == job.key()
    assert job.arguments.press == other.arguments.press
    changes: list[dict[str, Any]] = [
        {"patterns": other.arguments.patterns}, {"methods": ("fused",)}, {"seed": 1},
        {"flat": "0"}, {"rig_file": "b.toml"}, {"camera": {"k1": 0.1}}, {"press": "star/p9"},
        {"sensor": replace(job.arguments.sensor, skin=SkinDimensions(thickness_mm=11.0))},
        {"protocol": job.arguments.protocol.model_copy(update={"depths_mm": (1.0,)})},
        {"rig": job.arguments.rig.model_copy(update={"force": None})},
    ]  # fmt: skip
    changed = [replace(job, arguments=replace(job.arguments, **change)) for change in changes]
    keys = [one.key()["arguments"] for one in (job, *changed)]
    assert len(set(keys)) == len(keys)


def test_mirrored_positions_are_solved_once() -> None:
    scene = Selection.from_request(StudyRequest(scale=1.0))
    assert len(scene.jobs()) == 100
    presses = scene.scene.gel(scene.name)
    stored = {presses.planned_press(path).solver.stored_as for path in presses.paths}
    assert len(stored) == 6  # the star has one mirror plane


INDENTERS = tuple(f"i{k}" for k in range(5))


def made_up(
    errors_mm: dict[tuple[float, float], float], composed: float = 1.0, spread: float = 0.05
) -> PatternErrors:
    """Errors of the paper's tracker at the dots by (d, r), 0.3 mm where none is given.

    composed: times the error of the given patterns when flows are composed.
    """
    rng = np.random.default_rng(1)
    printed = list_series()
    cells = []
    for p in printed:
        at = p.recipe.patch_mm, p.recipe.r
        mean = errors_mm.get(at, 0.3)
        for indenter, times in zip(INDENTERS, 1 + spread * rng.uniform(-1, 1, 5), strict=True):
            tallies = {}
            for method, share in ((SUMMED_FLOW, 1.0), (COMPOSED_FLOW, composed)):
                value = mean * times * (share if at in errors_mm else 1.0)
                tally = tallies[method] = ErrorTally()
                tally.confident_share.add(1.0)
                tally.lost_share.add(0.0)
                tally.at_dots.add(np.full(4, value))
                tally.at_moving_dots.add(np.full(4, value))
                tally.add_moving(np.full(4, value), np.ones(4, bool))
            cells.append(
                PressErrors(
                    p.name, f"{indenter}/p1", indenter, tallies, {}, np.zeros((0, 2)), None, ()
                )
            )
    return PatternErrors(printed, cells)


THEIRS = {(0.1, 0.5): 0.11, (0.075, 0.6): 0.08}


@pytest.mark.parametrize(
    ("errors", "says"),
    [
        (made_up(THEIRS), ["met", "met", "met"]),
        (made_up(THEIRS | {(0.15, 0.3): 0.05, (0.05, 0.4): 0.02}), ["missed", "missed", "missed"]),
        # Both are less, and indenters disagree.
        (made_up(THEIRS | {(0.15, 0.3): 0.1, (0.05, 0.4): 0.07}, spread=0.9), ["undecided"] * 3),
        # By one reading of the paper only.
        (made_up(THEIRS, composed=5.0), ["undecided"] * 3),
        (made_up(THEIRS | {(0.05, r): 0.6 for r in (0.4, 0.5, 0.6)}), ["met", "met", "met"]),
    ],
)
def test_claim_needs_both_readings(errors: PatternErrors, says: list[str]) -> None:
    found = claims(errors)
    assert [one.state() for one in found] == says
    assert [one.state(final=False) for one in found] == ["undecided"] * 3


def test_two_patterns_are_not_a_round() -> None:
    """The paper's optimum once appeared in green from two patterns of the series."""
    whole = made_up(THEIRS)
    two = [p for p in whole.printed if p.name in TWO]
    errors = PatternErrors(two, [cell for cell in whole.cells if cell.pattern in TWO])
    assert [one.state() for one in claims(errors)] == ["undecided"] * len(claims(errors))


def test_missing_indenter_error_has_no_mean() -> None:
    errors = made_up({(0.1, 0.5): 0.01})
    best = errors.best(SUMMED_FLOW, "at_dots", errors.printed)
    assert best is not None
    assert best.name == "d0p1-r0p5"
    del errors._joined["d0p1-r0p5", "i1", SUMMED_FLOW]
    assert errors.mean("d0p1-r0p5", SUMMED_FLOW, "at_dots") is None
    assert errors.best(SUMMED_FLOW, "at_dots", errors.printed) != best


def test_frames_are_grouped_by_drag() -> None:
    path = np.array([[2.5, 0.0], [5.0, 0.0], [5.0, 0.5], [5.0, 1.0], [5.0, 2.0]])
    rows = {SUMMED_FLOW: np.full((5, 3), 0.1)}
    cell = PressErrors("x", "i/p1", "i", {}, rows, path, None, ())
    found = PatternErrors((), [cell]).along_path("x", SUMMED_FLOW)
    assert [(row["depth_mm"], row["drag_to_mm"], row["frames"]) for row in found] == [
        (5.0, 0.0, 1), (5.0, 1.0, 2), (5.0, 2.0, 1)
    ]  # fmt: skip
