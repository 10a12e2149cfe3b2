"""The matrix of faults by moments: its quick cells, and that it sees what is wrong."""

from __future__ import annotations

import dataclasses
import os
import shutil
import sqlite3
from pathlib import Path

import pytest

from deltact_fab.numerics.engines import bench
from deltact_fab.numerics.faults.cell import Matrix
from deltact_fab.numerics.faults.disk import Disk, small_disk
from deltact_fab.numerics.faults.kinds import FAULTS, MOMENTS, PRESS, TRAVEL, WRITING, FaultKind
from deltact_fab.numerics.stability import judge

pytestmark = pytest.mark.skipif(os.name != "posix", reason="needs POSIX limits and locks")


@pytest.fixture(scope="module")
def scratch(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("bench")


@pytest.fixture(scope="module")
def matrix(scratch: Path) -> Matrix:
    return bench.matrix(scratch)


def fault(name: str) -> FaultKind:
    return next(f for f in FAULTS if f.name == name)


def test_every_fault_is_struck_at_every_moment_at_which_it_can_be() -> None:
    assert len(FAULTS) >= 20
    assert all(set(f.at) <= set(MOMENTS) and len(f.at) >= 5 for f in FAULTS)
    names = [case.name for case in bench.cases(False)]
    assert len(names) == len(set(names)) >= 130
    assert sum(name.startswith("kill -9") for name in names) == 20


@pytest.mark.slow
def test_the_moments_are_in_their_order(matrix: Matrix) -> None:
    assert list(matrix.at_s) == list(MOMENTS)
    at_s = [matrix.at_s[moment] for moment in MOMENTS[:-1]]
    assert at_s == sorted(at_s)


@pytest.mark.parametrize("case", bench.cases(True), ids=lambda case: case.name)
def test_no_quick_cell_is_wrong(case: bench.Case, matrix: Matrix, scratch: Path) -> None:
    row = judge(case, scratch)
    assert row["outcome"] in ("right", "refused"), row


def test_a_carriage_that_goes_on_is_found(matrix: Matrix) -> None:
    """A cable that is out, judged as if a byte could reach the board."""
    strict = dataclasses.replace(fault("unplugged for good"), carries=True)
    cell = matrix.cell(strict, TRAVEL, Disk(matrix.folder, False))
    assert "mm of travel, 0.87 allowed" in cell.wrong
    assert cell.says.startswith("WRONG: error")


def test_another_error_and_a_success_that_was_not_due_are_found(matrix: Matrix) -> None:
    disk = Disk(matrix.folder, False)
    other = dataclasses.replace(fault("limit switch"), says=("a word that nobody says",))
    assert matrix.cell(other, PRESS, disk).wrong == "another error than the fault's"
    never = dataclasses.replace(fault("doubled ok"), success=False)
    assert matrix.cell(never, PRESS, disk).wrong == "success, and an error was due"


def test_a_full_disk(matrix: Matrix, tmp_path: Path) -> None:
    with small_disk(tmp_path / "disk") as disk:
        cell = matrix.cell(fault("disk full"), WRITING, disk)
    assert cell.wrong == ""
    assert "images/" in cell.outcome


def test_a_record_that_lost_something_is_found(matrix: Matrix, tmp_path: Path) -> None:
    run = tmp_path / "run"
    shutil.copytree(matrix.folder / "undisturbed", run)
    assert matrix.wrong(run) == ""
    assert matrix.lost(run, matrix.committed) == ""
    image = next((run / "images").iterdir())
    kept = image.read_bytes()
    image.write_bytes(kept[:-1] + b"?")
    assert "differs from the undisturbed run's" in matrix.wrong(run)
    image.write_bytes(kept)
    with sqlite3.connect(run / "journal.sqlite") as db:
        db.execute("DELETE FROM frames WHERE frame_id LIKE '%/p1/rest#001'")
    db.close()
    assert matrix.lost(run, matrix.committed).endswith("is lost or changed: sphere-6/p1/rest#001")
    assert matrix.wrong(run) == "frames differ from the undisturbed run's"


@pytest.mark.slow
def test_a_run_that_is_killed_ends_as_the_undisturbed_one(matrix: Matrix, scratch: Path) -> None:
    for case in [c for c in bench.cases(False) if c.name.startswith("kill")][:3]:
        assert judge(case, scratch)["outcome"] == "right"
