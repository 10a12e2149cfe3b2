"""A grid: kept, gone on with, told apart, and never taken for whole when it is not."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import tiny_study

from deltact_fab.common import cache
from deltact_fab.common.errors import InputError, RunFailed
from deltact_fab.studies.study import grid as engine
from deltact_fab.studies.study.grid import Grid, GridJob, JobPace, seed_of
from deltact_fab.studies.study.registry import StudyRequest


@pytest.fixture(autouse=True)
def done(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A store of its own, and the folder where a job leaves a file when it is done."""
    monkeypatch.setenv("DELTACT_FAB_CACHE", str(tmp_path / "store"))
    (tmp_path / "done").mkdir()
    monkeypatch.setenv(tiny_study.DONE, str(tmp_path / "done"))
    return tmp_path / "done"


def solve(jobs: list[GridJob], say: Callable[[str], None] = lambda text: None) -> Grid:
    """On threads, which start at once."""
    with ThreadPoolExecutor(2) as threads:
        return engine.solve(jobs, threads, say=say)


def entries() -> list[Path]:
    return sorted(engine.STUDY_STORE.folder.glob("*.bin"))


def same(one: Grid, other: Grid) -> bool:
    return list(one.results) == list(other.results) and all(
        a.keys() == b.keys()
        and all(np.array_equal(a[k], b[k], equal_nan=k == "nan") for k in a.keys() - {"cpu_s"})
        for a, b in zip(one.results.values(), other.results.values(), strict=True)
    )


def test_stored_results_are_not_recomputed(done: Path) -> None:
    said: list[str] = []
    first = solve(tiny_study.jobs_of(7, 3), say=said.append)
    again = solve(tiny_study.jobs_of(7, 3), say=said.append)
    assert said == ["0 of 3 jobs stored, 3 to do"]
    assert (first.n_cached, again.n_cached, len(list(done.iterdir()))) == (0, 3, 3)
    assert same(first, again)
    value = first["job-1"]
    assert value["draws"].shape == (4, 2)
    assert value["draws"].dtype == np.float64
    assert value["pair"] == (1, 2)
    assert math.isnan(value["nan"])


def test_seed_and_arguments_change_the_key(done: Path) -> None:
    solve(tiny_study.jobs_of(7, 2))
    assert solve(tiny_study.jobs_of(8, 2)).n_cached == 0
    assert solve(tiny_study.jobs_of(7, 3)).n_cached == 2


def test_non_plain_arguments_are_refused_early() -> None:
    job = tiny_study.jobs_of(1, 1)[0]
    with pytest.raises(TypeError, match="job-0"):
        solve([replace(job, arguments={"path": Path()})])


@pytest.mark.parametrize("harm", ["cut", "bit", "empty", "other"])
def test_damaged_entry_is_recomputed(harm: str, done: Path) -> None:
    whole = solve(tiny_study.jobs_of(7, 2))
    one, other = entries()
    data = one.read_bytes()
    harmed = {
        "cut": data[: len(data) // 2],
        "bit": data[:-30] + bytes([data[-30] ^ 1]) + data[-29:],
        "empty": b"",
        "other": other.read_bytes(),
    }
    one.write_bytes(harmed[harm])
    again = solve(tiny_study.jobs_of(7, 2))
    assert (again.n_cached, len(list(done.iterdir()))) == (1, 3)
    assert same(whole, again)
    assert solve(tiny_study.jobs_of(7, 2)).n_cached == 2


def test_failure_ends_only_its_job(done: Path) -> None:
    said: list[str] = []
    grid = solve(tiny_study.jobs_of(7, 4, fails="job-2"), say=said.append)
    assert said[1:] == ["failed: job-2: it did not converge"]
    assert grid.missing == {"job-2": "it did not converge"}
    assert list(grid.results) == ["job-0", "job-1", "job-3"]
    assert grid["job-3"]["mean"] == grid.results["job-3"]["mean"]
    with pytest.raises(RunFailed, match="job-2: no result"):
        grid["job-2"]
    with pytest.raises(KeyError):
        grid["job-9"]
    # It is tried again, and then the grid is whole.
    later = solve(tiny_study.jobs_of(7, 4))
    assert (later.missing, later.n_cached, len(later.results)) == ({}, 3, 4)
    failing = tiny_study.jobs_of(7, 4, fails="job-2")
    assert [solve(failing).missing for _ in range(2)] == [{"job-2": "it did not converge"}] * 2


def test_bug_is_raised_with_its_job() -> None:
    with pytest.raises(KeyError) as why:
        solve([GridJob("wrong", tiny_study.draw, {}), *tiny_study.jobs_of(7, 1)])
    assert why.value.__notes__ == ["in the job wrong"]


def test_failing_store_is_reported_once(tmp_path: Path) -> None:
    cache.cache_folder().parent.mkdir(exist_ok=True)
    cache.cache_folder().write_text("no folder")
    said: list[str] = []
    assert len(solve(tiny_study.jobs_of(7, 3), say=said.append).results) == 3
    assert [line for line in said if "cannot store results" in line] == said[1:]
    assert len(said) == 2


def test_missing_jobs_are_in_the_result(monkeypatch: pytest.MonkeyPatch) -> None:
    from deltact_fab.studies.study import registry

    monkeypatch.setattr(registry, "STUDIES", dict(registry.STUDIES))
    monkeypatch.setitem(registry.STUDIES, "tiny", registry.Study("tiny_study", "Tiny."))
    monkeypatch.setitem(sys.modules, "deltact_fab.studies.study.tiny_study", tiny_study)
    more = {"count": 3, "seconds": 0.0, "fails": "job-1", "partial": True}
    assert registry.run_study("tiny", StudyRequest(options=more)).missing == ("job-1",)
    with pytest.raises(RunFailed, match="job-1: no result"):
        registry.run_study("tiny", StudyRequest(options={**more, "partial": False}))
    with pytest.raises(InputError, match="did you mean 'tiny'"):
        registry.run_study("tinny", StudyRequest())


def test_longest_jobs_start_first() -> None:
    jobs = [
        replace(job, cost=cost)
        for job, cost in zip(tiny_study.jobs_of(7, 3), (1.0, 3.0, 2.0), strict=True)
    ]
    heard: list[str] = []
    with ThreadPoolExecutor(1) as one:
        engine.solve(jobs, one, progress=lambda done, of, what: heard.append(what.split(",")[0]))
    assert [name for name in heard if name] == ["job-1", "job-2", "job-0"]


def test_seeds_depend_on_study_and_name() -> None:
    names = [f"sphere:{d}/p{n}" for d in range(40) for n in range(50)]
    found = [seed_of(3, name) for name in names]
    assert len(set(found)) == len(names)
    assert found == [seed_of(3, name) for name in names]
    assert not set(found) & {seed_of(4, name) for name in names}
    assert all(0 <= seed < 2**48 for seed in found)
    # A change of numpy or of ours would make other draws of the same seed, and throw all away.
    assert seed_of(3, "sphere:10/p1") == 249821586942346


def test_remaining_time_follows_job_costs(monkeypatch: pytest.MonkeyPatch) -> None:
    now = [100.0]
    monkeypatch.setattr(engine.time, "monotonic", lambda: now[0])
    pace = JobPace([30.0, 10.0, 10.0, 10.0], 2)
    assert (pace.beforehand, pace.time_left()) == ("about 30 s", "")
    now[0] += 8
    pace.done_cost += 10
    assert pace.time_left() == "about 40 s left"
    assert JobPace([0.0] * 20, 2).beforehand == ""
    assert JobPace([60.0, 600.0], 2).beforehand == "about 10 min 00 s"  # the longest
