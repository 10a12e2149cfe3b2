"""The pattern selection end to end, on a press of a millimetre; killed and gone on with."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from deltact_fab import cache, record
from deltact_fab.analysis.tracking_error.tally import ErrorTally
from deltact_fab.errors import InputError
from deltact_fab.patterns.series.job import recipes
from deltact_fab.report.result import StudyResult
from deltact_fab.study import pattern_selection
from deltact_fab.study.grid import KIND
from deltact_fab.study.pattern_errors import PatternErrors, PressErrors, PrintedPattern
from deltact_fab.study.pattern_scene import Selection
from deltact_fab.study.pattern_tables import rounds, verdict
from deltact_fab.study.request import StudyRequest

TWO = ("d0p1-r0p5", "d0p2-r0p1")


def asked(mini: tuple[Path, Path], **more: Any) -> StudyRequest:
    chosen = {"protocol": str(mini[0]), "pattern": TWO, "indenter": ()} | more
    return StudyRequest(scale=1.0, seed=3, rig=str(mini[1]), more=chosen)


@pytest.fixture(scope="module")
def small(mini: tuple[Path, Path]) -> StudyResult:
    """Two patterns under one indenter."""
    return pattern_selection.run(asked(mini, indenter=("sphere:10",)))


@pytest.mark.slow
def test_a_small_one_has_errors_cover_and_the_papers_values(small: StudyResult) -> None:
    assert small.simulated
    assert not small.missing
    rows = {row["name"]: row for row in small.data["patterns"]}
    assert set(rows) == set(TWO)
    assert rows["d0p1-r0p5"]["paper_error_mm"] == 0.11
    assert rows["d0p1-r0p5"]["rounds"] == [1, 2]
    for row in rows.values():
        for method, most_mm in (("paper", 0.2), ("fused", 0.02)):
            found = row["trackers"][method]
            assert 0 < found["at_dots_mm"]["value"] < most_mm
            assert 0 < found["off_dots_mm"]["value"] < most_mm
            assert 0.5 < found["coverage"] <= 1
            assert set(found["by_indenter"]) == {"sphere:10"}
            assert set(found["by_depth"]) == {"1"}
    json.dumps(small.data, allow_nan=False)


@pytest.mark.slow
def test_its_tables_and_charts_say_which_part_of_the_path_they_cover(small: StudyResult) -> None:
    patterns, indenters, depths = small.tables
    assert len(patterns.frame) == 2
    assert len(indenters.frame) == len(depths.frame) == 4
    covers = small.data["part"]
    for table in small.tables:
        assert (table.frame["shear_mm"] == covers["shear_mm"]).all()
        assert (table.frame["longest_step_mm"] == covers["longest_step_mm"]).all()
    assert patterns.shown is not None
    errors = [name for name in patterns.shown if name.endswith("_mm") or "coverage" in name]
    assert errors
    assert all("1 of 1 positions" in patterns.words[name] for name in errors)
    assert [figure.name for figure in small.figures] == [
        "paper-at-dots", "paper-off-dots", "fused-at-dots", "fused-off-dots",
    ]  # fmt: skip
    for figure in small.figures:
        assert "1 of 1 positions" in figure.caption
        assert len(figure.draw().axes) == 2


@pytest.mark.slow
def test_the_same_from_the_record_of_the_same_press(
    mini: tuple[Path, Path], mini_run: Path
) -> None:
    """A record has its own pattern, and here its truth: the stream's frames are micrometres off."""
    found = pattern_selection.run(StudyRequest(runs=(mini_run,)))
    (row,) = found.data["patterns"]
    held = record.open(mini_run).pattern["recipe"]
    assert (row["d_mm"], row["r"]) == (held["patch_mm"], held["r"])
    assert set(row["trackers"]["paper"]["by_indenter"]) == {"sphere:10", "4dots"}
    known = row["trackers"]["fused"]["at_dots_mm"]
    assert 0 < known["value"] < 0.02
    assert known["low"] <= known["value"] <= known["high"]


def test_two_runs_of_one_pattern_are_refused(mini_run: Path) -> None:
    with pytest.raises(InputError, match="expected one run per pattern") as caught:
        pattern_selection.run(StudyRequest(runs=(mini_run, mini_run)))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("more", "says"),
    [
        ({"pattern": ("d0p1-r0p7",)}, "--pattern: 'd0p1-r0p7'"),
        ({"indenter": ("sphere:15",)}, "--indenter: 'sphere:15'"),
    ],
)
def test_names_that_are_not_known_are_refused(
    mini: tuple[Path, Path], more: dict[str, Any], says: str
) -> None:
    with pytest.raises(InputError, match=says):
        pattern_selection.run(asked(mini, **more))


def test_a_press_is_one_job_and_an_odd_one_is_shared_by_two() -> None:
    jobs = Selection.of(StudyRequest()).jobs()
    assert [len(job.given["patterns"]) for job in jobs] == [17, 17, 17, 17, 9, 8]
    assert len({job.name for job in jobs}) == 6
    halves = {**jobs[4].given["patterns"], **jobs[5].given["patterns"]}
    assert halves == jobs[0].given["patterns"]
    costs = sorted((job.cost for job in jobs), reverse=True)
    shares = [0.0, 0.0]
    for cost in costs:
        shares[shares.index(min(shares))] += cost
    assert sum(costs) / max(shares) > 1.9


def test_a_press_is_found_again_when_other_indenters_join() -> None:
    few = Selection.of(StudyRequest(more={"indenter": ("edges", "4dots")}))
    every = {job.name: job.key() for job in Selection.of(StudyRequest()).jobs()}
    assert [job.key() for job in few.jobs()] == [every["4dots/p1"], every["edges/p1"]]


def test_at_full_scale_the_gel_of_mirrored_positions_is_solved_once() -> None:
    scene = Selection.of(StudyRequest(scale=1.0))
    assert len(scene.jobs()) == 20
    assert len(scene.gel_jobs()) == 6  # the star has one mirror plane


def made_up(errors_mm: dict[str, tuple[float, ...]]) -> PatternErrors:
    """Errors of the paper's tracker at the dots, a value an indenter."""
    printed = [PrintedPattern.of(e) for e in recipes() if e.name in errors_mm]
    cells = []
    for p in printed:
        for k, value in enumerate(errors_mm[p.name]):
            tally = ErrorTally()
            tally.believed.take(1.0)
            tally.at_dots.take(np.full(4, value))
            tally.take_moving(np.full(4, value), np.ones(4, bool))
            rows = {"paper": np.array([[value, value, 1.0]])}
            steps = (f"i{k}/p1/d5.00/press",)
            cells.append(
                PressErrors(p.name, f"i{k}/p1", f"i{k}", {"paper": tally}, rows, steps, None, ())
            )
    return PatternErrors(printed, cells)


def test_the_papers_optimum_appears_where_it_is_the_least_of_both_rounds() -> None:
    errors = made_up(
        {
            "d0p1-r0p5": (0.1, 0.12, 0.11),
            "d0p2-r0p1": (0.2, 0.22, 0.21),
            "d0p075-r0p6": (0.05, 0.06, 0.07),
            "d0p05-r0p4": (0.4, 0.5, 0.6),
        }
    )
    first, *others = verdict(errors, "all of it")
    assert first.startswith("The paper's optimum appears")
    assert "d 0.075 r 0.6 is the best of its round (0.06 mm" in first
    assert any("d 0.075 r 0.6" in line for line in others)
    assert [title for title, _ in rounds(errors.printed)] == [
        "First round of the paper",
        "Second round of the paper",
    ]
    assert errors.best("paper", "at_dots") == errors.printed[1]
    assert not errors.beside(errors.printed[1], "paper", "at_dots")


def test_it_does_not_appear_where_another_is_less_and_says_if_indenters_disagree() -> None:
    errors = made_up(
        {
            "d0p1-r0p5": (0.2, 0.1, 0.3),
            "d0p2-r0p1": (0.1, 0.2, 0.1),
            "d0p075-r0p6": (0.5, 0.6, 0.7),
            "d0p05-r0p4": (0.1, 0.2, 0.3),
        }
    )
    first = verdict(errors, "all of it")[0]
    assert first.startswith("The paper's optimum does not appear")
    assert "d 0.2 r 0.1" in first
    assert first.count("which the indenters do not tell apart") == 1


def test_a_pattern_without_an_error_under_one_indenter_has_no_mean() -> None:
    errors = made_up({"d0p1-r0p5": (0.2, 0.1), "d0p2-r0p1": (0.3, 0.3)})
    del errors._joined["d0p1-r0p5", "i1", "paper"]
    assert errors.over_indenters("d0p1-r0p5", "paper", "at_dots") is None
    assert errors.best("paper", "at_dots") == errors.printed[1]


@pytest.mark.slow
def test_killed_and_gone_on_with_its_tables_are_those_of_an_undisturbed_one(
    mini: tuple[Path, Path], tmp_path: Path
) -> None:
    def command(folder: str) -> tuple[list[str], dict[str, str]]:
        patterns = [word for name in TWO for word in ("--pattern", name)]
        words = [
            sys.executable, "-m", "deltact_fab.cli.main", "study", "run", "pattern-selection",
            "--protocol", str(mini[0]), "--rig", str(mini[1]), "--scale", "1", *patterns,
            "--jobs", "1", "--out", str(tmp_path / folder),
        ]  # fmt: skip
        return words, os.environ | {cache.FOLDER_VARIABLE: str(tmp_path / f"{folder}-cache")}

    words, environment = command("killed")
    kept = tmp_path / "killed-cache" / KIND
    with subprocess.Popen(words, env=environment, stderr=subprocess.DEVNULL,
                          start_new_session=True) as running:  # fmt: skip
        # Until the first press is kept: its gel was another job, in the same store.
        until = time.monotonic() + 300
        while len(list(kept.glob("*.bin"))) < 3 and running.poll() is None:
            assert time.monotonic() < until
            time.sleep(0.05)
        assert running.poll() is None, "it ended before it could be killed"
        os.killpg(running.pid, signal.SIGKILL)
    assert not (tmp_path / "killed" / "result.json").exists()
    before = set(kept.glob("*.bin"))
    for folder in ("killed", "whole"):
        words, environment = command(folder)
        subprocess.run(words, env=environment, check=True, capture_output=True)
    assert before <= set(kept.glob("*.bin"))
    tables = sorted(path.name for path in (tmp_path / "whole").glob("*.csv"))
    assert {"depths.csv", "indenters.csv", "patterns.csv"} <= set(tables)
    for name in tables:
        texts = [(tmp_path / folder / name).read_bytes() for folder in ("killed", "whole")]
        assert texts[0] == texts[1]
