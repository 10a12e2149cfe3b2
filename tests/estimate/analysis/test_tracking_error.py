"""Tracking error: the figures are what their names say, and the issue's bounds hold."""

from __future__ import annotations

import json
import shutil
import warnings
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
from called import called, count_calls
from numpy.typing import NDArray

from deltact_fab.bench.record.run import open_run
from deltact_fab.common.errors import InputError
from deltact_fab.estimate.analysis.tracking_error.follow import (
    TrackingPlan,
    analyse_press,
    analyse_tracking,
)
from deltact_fab.estimate.analysis.tracking_error.result import TrackingResult
from deltact_fab.estimate.analysis.tracking_error.tally import DOT_MARGIN_PX, MOVING_MM, TrueFrame
from deltact_fab.estimate.measure.flow.tracker import FlowTracker


@pytest.fixture(scope="module")
def result(tracked: TrackingResult) -> TrackingResult:
    return tracked


@pytest.mark.slow
def test_default_method_and_dots_meet_bounds(mini_run: Path) -> None:
    with ThreadPoolExecutor(1) as executor:
        found = analyse_tracking(mini_run, ("fused", "dis-medium"), executor)
    best = found.methods[0]
    assert best["mean_off_dots_mm"] <= 0.004
    assert best["mean_confident_mm"] <= 0.003
    assert best["coverage"] >= 0.95
    assert best["confident_wrong_share"] <= 0.0005
    assert best["peak_true_mm"] > 0.5
    assert found.dots is not None
    assert found.dots["mean_vs_truth_mm"] <= 0.01
    json.dumps(found.as_dict(), allow_nan=False)
    assert all(None not in row.values() and row["ms_per_frame"] > 0 for row in found.methods)


def test_all_indenters_together_are_their_parts(result: TrackingResult) -> None:
    for method in result.methods:
        parts = [r for r in result.by_indenter if r["name"] == method["name"]]
        assert {p["indenter"] for p in parts} == {"sphere:10", "4dots"}
        assert sum(p["n_moving_px"] for p in parts) == method["n_moving_px"]
        weighted = sum(p["n_moving_px"] * p["mean_off_dots_mm"] for p in parts)
        assert weighted / method["n_moving_px"] == pytest.approx(method["mean_off_dots_mm"])


def test_one_frame_recounted_by_hand(mini_run: Path, result: TrackingResult) -> None:
    run = open_run(mini_run)
    truth = run.truth()
    assert truth is not None
    press = run.frames()
    press = press[press["press"] == "sphere-10/p1"]
    tracker = FlowTracker("dis-fast")
    for row in press.itertuples():
        seen = tracker.update(run.image(str(row.file)))
        if str(row.step_id).endswith("shear-x+"):
            break
    true = truth.flow_px(str(row.frame_id))
    length_mm = np.hypot(true[..., 0], true[..., 1]) * 0.0378
    y, x = np.mgrid[: true.shape[0], : true.shape[1]]
    off = np.ones(true.shape[:2], bool)
    for dot in run.camera.rest_px(run.dots_mm()):
        off &= np.hypot(x - dot[0], y - dot[1]) > 0.3 / 0.0378 + DOT_MARGIN_PX + 1
    # What leaves the view cannot be found in it.
    stays = (np.abs(x + true[..., 0] - 398.5) <= 398.5) & (
        np.abs(y + true[..., 1] - 292.5) <= 292.5
    )
    moving = off & stays & (length_mm >= MOVING_MM)
    error_mm = np.linalg.norm(seen.flow_px - true, axis=-1) * 0.0378
    by_hand = float(error_mm[moving].mean())
    table = result.frames
    reported = table[(table["frame_id"] == row.frame_id) & (table["method"] == "dis-fast")]
    # The product draws its discs with whole pixels, so the masks differ at their rims.
    assert reported["mean_off_dots_mm"].iloc[0] == pytest.approx(by_hand, rel=0.03)
    assert reported["n_moving_px"].iloc[0] == pytest.approx(moving.sum(), rel=0.05)
    sure = moving & seen.confident
    assert reported["coverage"].iloc[0] == pytest.approx(sure.sum() / moving.sum(), abs=0.005)
    assert reported["mean_confident_mm"].iloc[0] == pytest.approx(error_mm[sure].mean(), rel=0.03)


def shelf(seen: NDArray[np.bool_]) -> TrueFrame:
    """A face whose columns up to 19 have moved 8 px to the right, over the next ones."""
    flow = np.zeros((10, 60, 2))
    flow[:, :20, 0] = 8.0
    return TrueFrame.from_flow(flow, 0.04 * flow, seen, 0.04)


def test_self_occluded_pixels_are_not_counted() -> None:
    frame = shelf(np.ones((10, 60), bool))
    # Columns 12 to 19 lie over 20 to 27 now: which of the two is seen, the flow does not tell.
    assert (np.flatnonzero(frame.moving[5]) == np.arange(12)).all()


def test_pixels_outside_the_image_are_ignored() -> None:
    seen = np.ones((10, 60), bool)
    seen[:, :3] = seen[:, 15:17] = seen[:, 50:] = False
    frame = shelf(seen)
    # Columns 7 and 8 land on 15 and 16.
    assert (np.flatnonzero(frame.moving[5]) == [3, 4, 5, 6, 9, 10, 11]).all()


@pytest.mark.slow
def test_dot_error_remains_without_truth(mini_run: Path, tmp_path: Path) -> None:
    """A real rig has no truth folder; nothing may be invented for it."""
    shutil.copytree(mini_run, tmp_path / "r", ignore=shutil.ignore_patterns("truth", "analysis"))
    with ThreadPoolExecutor(1) as executor:
        bare = analyse_tracking(tmp_path / "r", ["dis-fast"], executor)
    (row,) = bare.methods
    assert row["mean_at_dots_mm"] > 0
    for key in ("mean_off_dots_mm", "peak_true_mm", "coverage", "confident_wrong_share"):
        assert row[key] is None, key
    assert row["n_moving_px"] == 0
    assert bare.dots is not None
    assert bare.dots["mean_vs_truth_mm"] is None
    assert bare.left_out == ["error against truth: not available on a real rig"]
    verdict = bare.verdict
    assert verdict.error == "mean_at_dots_mm"
    assert verdict.trusted == (row["confident_share"] >= 0.8 and row["trusted_share"] >= 0.95)
    assert "of the image" in verdict.line


def test_result_round_trips_through_files(result: TrackingResult, tmp_path: Path) -> None:
    result.save(tmp_path / "a")
    again = TrackingResult.load(tmp_path / "a")
    assert again.as_dict() == result.as_dict()
    assert list(again.frames.columns) == list(result.frames.columns)
    with pytest.raises(InputError, match="no readable tracking analysis"):
        TrackingResult.load(tmp_path / "b")
    old = result.as_dict() | {"format": 1}
    (tmp_path / "a" / "tracking.json").write_text(json.dumps(old))
    assert TrackingResult.load(tmp_path / "a").as_dict() == result.as_dict()
    table = result.frames.assign(method="paper")
    table.to_csv(tmp_path / "a" / "tracking.csv")
    with pytest.raises(InputError, match="its 'paper' is what 'farneback/summed' is now"):
        TrackingResult.load(tmp_path / "a")


@pytest.mark.parametrize(
    ("name", "says"), [("dis", "flow method 'dis'"), ("farneback/sum", "flow reference 'sum'")]
)
def test_unknown_methods_are_refused_first(mini_run: Path, name: str, says: str) -> None:
    with pytest.raises(InputError, match=says):
        analyse_tracking(mini_run, [name])


OLD_NAMES = {
    "farneback-paper": "farneback",
    "farneback-paper/composed": "farneback/composed",
    "paper/composed": "farneback/composed",
    "paper": None,
}


@pytest.mark.parametrize("old", OLD_NAMES)
def test_old_names_are_read_with_notice(mini_run: Path, old: str) -> None:
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        plan = TrackingPlan.for_run(open_run(mini_run), [old])
    assert plan.methods == (OLD_NAMES[old] or old,)
    said = f"method {old!r} is now {OLD_NAMES[old]!r}; the old name goes in 0.5"
    assert [str(one.message) for one in told] == ([said] if OLD_NAMES[old] else [])


def test_command_tells_old_and_valid_names(mini_run: Path) -> None:
    asked = ("--method", "farneback-paper", "--method", "x")
    with warnings.catch_warnings():
        warnings.simplefilter("always")
        done = called("analyze", "tracking", mini_run, *asked)
    assert done.stderr.splitlines() == [
        "warning: method 'farneback-paper' is now 'farneback'; the old name goes in 0.5",
        "deltact-fab: flow method 'x': unknown; "
        "valid: dis-fast, dis-medium, farneback, fused, paper",
    ]


BOTH_TOTALS = ("farneback/summed", "farneback/composed")


@pytest.mark.parametrize(
    ("methods", "updates", "farneback"),
    [(None, 2, 0), (BOTH_TOTALS, 2, 1), (BOTH_TOTALS[:1] * 2, 1, 1)],
)
def test_each_flow_is_computed_once(
    mini_run: Path, methods: tuple[str, ...] | None, updates: int, farneback: int
) -> None:
    """By default the recommended tracker and the paper's, and no other."""
    run = open_run(mini_run)
    plan, n = TrackingPlan.for_run(run, methods), len(run.frames("4dots/p1"))
    _, calls = count_calls(lambda: analyse_press(str(mini_run), "4dots/p1", plan))
    assert calls["flow/tracker.py update"] == updates * n
    assert calls["~ <calcOpticalFlowFarneback>"] == farneback * (n - 1)


def test_a_run_without_images_is_refused(mini_run: Path, tmp_path: Path) -> None:
    import sqlite3

    shutil.copytree(mini_run, tmp_path / "r", ignore=shutil.ignore_patterns("images", "truth"))
    with closing(sqlite3.connect(tmp_path / "r" / "journal.sqlite")) as db, db:
        db.execute("UPDATE frames SET file = NULL")
    with pytest.raises(InputError, match="no images recorded"):
        analyse_tracking(tmp_path / "r", ["dis-fast"])


def test_an_unfinished_run_is_not_analysed(mini_run: Path, tmp_path: Path) -> None:
    ignore = shutil.ignore_patterns("images", "truth", "summary.json")
    shutil.copytree(mini_run, tmp_path / "r", ignore=ignore)
    with pytest.raises(InputError, match=r"not finished; continue with `run --resume`"):
        analyse_tracking(tmp_path / "r")
