"""The pattern selection: its questions on drawn figures, its budget, and all of it on one press."""

from __future__ import annotations

import json
import math
import pickle
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from deltact_fab.common.errors import InputError
from deltact_fab.fabricate.patterns.series import list_series
from deltact_fab.present.report.result import StudyResult
from deltact_fab.sensor.shapes.sensor import SkinDimensions
from deltact_fab.studies.study import pattern_selection
from deltact_fab.studies.study.grid import Grid, GridJob
from deltact_fab.studies.study.pattern_questions import (
    FIRST_LOOK,
    Question,
    next_look,
    paper_questions,
    press_means,
)
from deltact_fab.studies.study.pattern_selection import Selection, SelectionTrial
from deltact_fab.studies.study.press_jobs import seed_groups
from deltact_fab.studies.study.registry import StudyRequest

TWO = ("d0p1-r0p5", "d0p2-r0p1")
ENTRIES = list_series()
NAMES = [entry.name for entry in ENTRIES]


def asked(mini: tuple[Path, Path], **more: Any) -> StudyRequest:
    chosen = {"protocol": str(mini[0]), "pattern": TWO, "indenter": (), "cpu_minutes": 60.0} | more
    return StudyRequest(seed=3, rig=str(mini[1]), options=chosen)


@pytest.fixture(scope="module")
def small(mini: tuple[Path, Path]) -> StudyResult:
    """Two patterns under one indenter."""
    return pattern_selection.run(asked(mini, indenter=("sphere:10",)))


@pytest.mark.slow
def test_small_study_has_errors_and_paper(small: StudyResult) -> None:
    rows = {row["pattern"]: row for row in small.data["tables"]["patterns"]}
    assert set(rows) == {"d 0.1 r 0.5", "d 0.2 r 0.1"}
    assert (rows["d 0.1 r 0.5"]["paper"], rows["d 0.1 r 0.5"]["round"]) == ("0.11", "1 and 2")
    for row in rows.values():
        assert 0 < row["error_mm"] < 0.2
        assert row["realisations"] == FIRST_LOOK
    assert small.claims == ()  # two patterns are not a round
    json.dumps(small.data, allow_nan=False)
    assert len(small.figures[0].draw().axes) == 2


@pytest.mark.slow
def test_same_command_goes_on(mini: tuple[Path, Path], small: StudyResult) -> None:
    """Stored jobs cost nothing: the smallest budget has the result of the first call."""
    again = pattern_selection.run(asked(mini, indenter=("sphere:10",), cpu_minutes=1e-6))
    assert again.data["tables"] == small.data["tables"]
    assert "0.0 in this call" in again.settings["CPU time"]


@pytest.mark.parametrize(
    ("more", "says"),
    [
        ({"pattern": ("d0p1-r0p7",)}, "--pattern: 'd0p1-r0p7'"),
        ({"indenter": ("sphere:15",)}, "--indenter: 'sphere:15'"),
        ({"cpu_minutes": 0.0}, "--cpu-minutes: 0"),
        ({"cpu_minutes": math.nan}, "--cpu-minutes: nan"),
    ],
)
def test_bad_options_are_refused(mini: tuple[Path, Path], more: dict[str, Any], says: str) -> None:
    with pytest.raises(InputError, match=says):
        pattern_selection.run(asked(mini, **more))


def test_realisations_cover_every_pattern() -> None:
    scene = Selection.from_request(StudyRequest(seed=5))
    jobs = scene.jobs((7,), NAMES)
    assert len({job.name for job in jobs}) == len(jobs) == 5
    assert all([*job.arguments.patterns] == NAMES for job in jobs)
    assert seed_groups([3, 4, 5], 17) == [(3,), (4,), (5,)]
    assert seed_groups([3, 4, 5, 6], 8) == [(3, 4), (5, 6)]


def test_job_key_is_independent_of_process() -> None:
    job = Selection.from_request(StudyRequest()).jobs((0,), NAMES)[0]
    assert pickle.loads(pickle.dumps(job)).key() == job.key()
    changes: list[dict[str, Any]] = [
        {"patterns": {}}, {"method": "fused"}, {"seeds": (1,)},
        {"flat": "0"}, {"rig_file": "b.toml"}, {"camera": {"k1": 0.1}}, {"press": "star/p9"},
        {"sensor": replace(job.arguments.sensor, skin=SkinDimensions(thickness_mm=11.0))},
        {"protocol": job.arguments.protocol.model_copy(update={"depths_mm": (1.0,)})},
        {"rig": job.arguments.rig.model_copy(update={"force": None})},
    ]  # fmt: skip
    changed = [replace(job, arguments=replace(job.arguments, **change)) for change in changes]
    keys = [one.key()["arguments"] for one in (job, *changed)]
    assert len(set(keys)) == len(keys)


def test_mirrored_positions_are_solved_once() -> None:
    scene = Selection.from_request(StudyRequest(options={"protocol": "pattern-selection"}))
    assert len(scene.jobs((0,), NAMES)) == 20
    presses = scene.scene.gel(scene.name)
    stored = {presses.planned_press(path).solver.stored_as for path in presses.paths}
    assert len(stored) == 6  # the star has one mirror plane


def drawn(
    means_mm: Mapping[tuple[float, float], float], seed: int, spread: float = 0.05, units: int = 40
) -> dict[str, list[float]]:
    """Errors by pattern over units, 0.3 mm where none is given; half of the spread is common."""
    rng = np.random.default_rng(seed)
    common = rng.normal(0, spread, units)
    return {
        e.name: [*means_mm.get((e.recipe.patch_mm or 0, e.recipe.r or 0), 0.3)
                 * np.exp(common + rng.normal(0, spread, units))]
        for e in ENTRIES
    }  # fmt: skip


def answered(figures: dict[str, list[float]], most: int = 40) -> tuple[list[Question], int]:
    """Questions after as many looks as they need, and the tracked realisations of patterns."""
    questions, names, n = paper_questions(ENTRIES), set(NAMES), 0
    errors: dict[str, dict[int, float]] = {name: {} for name in NAMES}
    while names and next_look(n) <= most:
        units = range(n, next_look(n))
        for name in names:
            errors[name] |= {k: figures[name][k] for k in units}
        n = next_look(n)
        for question in questions:
            question.look(errors)
        names = set().union(*(question.patterns for question in questions))
    return questions, sum(map(len, errors.values()))


THEIRS = {(0.1, 0.5): 0.11, (0.075, 0.6): 0.08}


@pytest.mark.parametrize(
    ("means_mm", "says"),
    [
        (THEIRS | {(0.05, r): 0.6 for r in (0.4, 0.5, 0.6)}, ["met", "met", "met"]),
        (THEIRS | {(0.15, 0.3): 0.05, (0.05, 0.4): 0.02, (0.05, 0.5): 0.02},
         ["missed", "missed", "missed"]),
        (THEIRS | {(0.15, 0.3): 0.11, (0.1, 0.5): 0.11, (0.075, 0.6): 0.11},
         ["equal", "equal", "met"]),
    ],
)  # fmt: skip
def test_planted_best_is_found(
    means_mm: Mapping[tuple[float, float], float], says: list[str]
) -> None:
    questions, tracked = answered(drawn(means_mm, 1, spread=0.02))
    assert [question.state for question in questions] == says
    assert tracked < len(NAMES) * 6  # most patterns are dropped early
    claims = [question.claim(60.0, 40) for question in questions]
    assert sum(len(claim.sentence().split()) for claim in claims) <= 70
    assert all("{" not in claim.sentence() for claim in claims)
    assert all("jobs are missing" in claim.sentence(final=False) for claim in claims)
    new = [question.claim(60.0, 1).sentence() for question in paper_questions(ENTRIES)]
    assert all("2 realisations more, 2 CPU min, would tell the spread" in said for said in new)


def test_equal_patterns_are_named() -> None:
    question = answered(drawn(THEIRS | {(0.15, 0.3): 0.11}, 1, spread=0.02))[0][0]
    says = question.claim(0.0, 3).sentence()
    assert says.endswith("among the best of round 1, equal within 10% to d 0.15 r 0.3.")


def test_undecided_question_has_a_price() -> None:
    """Twice as many realisations as the price says do decide it, in most draws."""
    means_mm = THEIRS | {(0.1, 0.3): 0.12}
    decided = []
    for seed in range(12):
        figures = drawn(means_mm, seed, spread=0.1, units=400)
        question = answered(figures, most=3)[0][0]
        claim = question.claim(60.0, 3)
        if claim.state == "undecided":
            assert claim.extra is not None
            assert f"more, {claim.extra:.2g} CPU min, would decide" in claim.sentence()
            later = answered(figures, most=2 * (3 + claim.extra))[0][0]
            decided.append(later.state != "undecided")
    assert len(decided) > 6
    assert sum(decided) > len(decided) / 2


def test_no_number_decides_wide_spread() -> None:
    question, rng = Question("it is", {}, ("a",), {"b": ("b",)}), np.random.default_rng(1)
    x, y = rng.normal(0, 9, (2, 4))
    y += 0.2 - np.mean(y - x)  # more than the margin, and far less than the spread
    errors = {name: {k: math.exp(v) for k, v in enumerate(values)}
              for name, values in (("a", x), ("b", y))}  # fmt: skip
    question.look(errors)
    assert "1000 realisations would not decide" in question.claim(60.0, 4).sentence()


@pytest.mark.parametrize("spread", [0.02, 0.2])
def test_same_patterns_have_no_winner(spread: float) -> None:
    """In 200 studies of equal patterns at most one question in twenty names a better one."""
    wrong = np.zeros(3)
    for seed in range(200):
        states = [q.state for q in answered(drawn({}, seed, spread), most=13)[0]]
        wrong += [state in ("met", "missed") for state in states]
    assert (wrong <= 200 / 20).all()


def test_untracked_pattern_is_worse() -> None:
    figures = drawn(THEIRS, 1, spread=0.02)
    figures["d0p2-r0p1"][1] = math.inf
    questions, _ = answered(figures)
    assert questions[0].outcomes["d 0.2 r 0.1"] == "worse"
    assert questions[0].state == "met"
    json.dumps([questions[0].claim(0.0, 3).as_dict(), questions[0].rows], allow_nan=False)
    figures["d0p1-r0p5"][1] = math.inf
    assert answered(figures)[0][0].state == "missed"


def test_part_of_a_round_answers_nothing() -> None:
    assert paper_questions([e for e in ENTRIES if e.name in TWO]) == []
    first = [e for e in ENTRIES if 1 in e.rounds]
    assert [q.claimed for q in paper_questions(first)] == [("d0p1-r0p5",)]


def test_press_without_figure_has_no_error() -> None:
    results: list[dict[str, Any]] = [
        {"figures": {4: {"x": {"e": 0.1}, "y": {"e": 0.1}}}},
        {"figures": {4: {"x": {"e": 0.3}, "y": {"e": None}}}},
    ]
    assert [*press_means(results, "e")] == [("x", 4, pytest.approx(0.2)), ("y", 4, math.inf)]


class CountedRequest(StudyRequest):
    """A request whose jobs are not run: each takes twice its declared cost."""

    def solve(self, jobs: Any) -> Grid:
        figures = drawn({}, 1, spread=0.1)
        return Grid(
            {job.name: {
                "figures": {seed: {n: {"mean_at_dots_mm": figures[n][seed]}
                                   for n in job.arguments.patterns}
                            for seed in job.arguments.seeds},
                "refused": [], "flags": {}, "cpu_s": 2 * job.cost,
            } for job in jobs},
            {}, 0, sum(2 * job.cost for job in jobs),
        )  # fmt: skip


def test_cpu_time_stays_within_budget(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(GridJob, "is_stored", False)
    selection = Selection.from_request(StudyRequest())
    whole_s = sum(job.cost for job in selection.jobs((0,), NAMES))
    for share, realisations in ((1.0, 1), (4.5, 2), (7.0, 3)):
        trial = SelectionTrial(selection, CountedRequest(), share * whole_s)
        trial.run()
        assert trial.realisations == realisations
        assert trial.spent_s <= max(share, 2.0) * whole_s  # the first is at its declared cost
        assert all(one.state == "undecided" and one.extra for one in trial.claims)
        assert trial.claims[0].unit_cpu_s == pytest.approx(
            2 * sum(job.cost for job in selection.jobs((0,), trial.questions[0].patterns))
        )
