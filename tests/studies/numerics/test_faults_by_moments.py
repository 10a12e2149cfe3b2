"""One fault at one moment, and that the judge of it sees what is wrong."""

from __future__ import annotations

import dataclasses
import os
import shutil
import sqlite3
import tomllib
from pathlib import Path

import pytest

from deltact_fab.bench.protocols.plan import Protocol
from deltact_fab.bench.rig import config
from deltact_fab.simulate import FaultBench, FaultScenario
from deltact_fab.studies.numerics.faults.kinds import FAULT_KINDS, FaultKind
from deltact_fab.studies.numerics.faults.rehearsal import FaultMatrix, FaultOutcome

pytestmark = pytest.mark.skipif(os.name != "posix", reason="needs POSIX limits and locks")
PRESS, TRAVEL, DRAG = "d1.50/press", "rest", "d1.50/shear-x+"
TEXT = """
name = "bench"
indenters = ["sphere:6"]
positions_mm = [[-6.0, -5.0], [6.0, 5.0]]
depths_mm = [1.5]
channels = ["image", "force", "shear"]
[shear]
amplitude_mm = 1.0
axes = ["x"]
[capture]
settle_s = 0.1
[motion]
clearance_mm = 1.0
park_mm = 4.0
travel_feed_mm_min = 600.0
press_feed_mm_min = 60.0
shear_feed_mm_min = 60.0
"""
PROTOCOL, RIG = Protocol.model_validate(tomllib.loads(TEXT)), config.load_rig("grbl-bench")[0]
SCENARIO = FaultScenario.from_protocol(PROTOCOL, TEXT.encode(), RIG)


@pytest.fixture(scope="module")
def matrix(tmp_path_factory: pytest.TempPathFactory) -> FaultMatrix:
    return FaultMatrix(tmp_path_factory.mktemp("bench"), SCENARIO)


def fault(name: str) -> FaultKind:
    return next(f for f in FAULT_KINDS if f.name == name)


def cell(matrix: FaultMatrix, of: FaultKind, moment: str) -> FaultOutcome:
    return matrix.run_cell(of, moment, matrix.folder / "cell")


@pytest.mark.parametrize(
    ("name", "moment"),
    [("false alarm", TRAVEL), ("force over the limit", PRESS),
     pytest.param("force frozen", TRAVEL, marks=pytest.mark.slow),
     pytest.param("force values frozen", PRESS, marks=pytest.mark.slow), ("scale stuck", PRESS),
     pytest.param("doubled ok", DRAG, marks=pytest.mark.slow),
     pytest.param("disk full", DRAG, marks=pytest.mark.slow)],
)  # fmt: skip
def test_fault_meets_its_requirements(matrix: FaultMatrix, name: str, moment: str) -> None:
    assert cell(matrix, fault(name), moment).wrong == ""


@pytest.mark.parametrize("kind", FAULT_KINDS, ids=lambda kind: kind.name)
def test_every_fault_can_strike(kind: FaultKind) -> None:
    kind.strike(FaultBench(SCENARIO), 9.0)


def test_continued_motion_is_detected(matrix: FaultMatrix) -> None:
    """A cable that is out, judged as if a byte could reach the board."""
    strict = dataclasses.replace(fault("unplugged for good"), carries=True)
    assert "mm of travel, " in cell(matrix, strict, TRAVEL).wrong


def test_unexpected_outcomes_are_detected(matrix: FaultMatrix) -> None:
    other = dataclasses.replace(fault("limit switch"), says=("a word that nobody says",))
    assert cell(matrix, other, PRESS).wrong == "an error other than the fault's"
    never = dataclasses.replace(fault("doubled ok"), success=False)
    assert cell(matrix, never, PRESS).wrong == "success, expected an error"


def test_lost_record_rows_are_detected(matrix: FaultMatrix, tmp_path: Path) -> None:
    run = tmp_path / "run"
    shutil.copytree(matrix.folder / "undisturbed", run)
    assert matrix.difference(run) == ""
    assert matrix.lost_row(run, matrix.committed) == ""
    image = next((run / "images").iterdir())
    kept = image.read_bytes()
    image.write_bytes(kept[:-1] + b"?")
    assert "differs from the undisturbed run's" in matrix.difference(run)
    image.write_bytes(kept)
    with sqlite3.connect(run / "journal.sqlite") as db:
        db.execute("DELETE FROM frames WHERE frame_id LIKE '%/p1/rest#001'")
    db.close()
    lost = matrix.lost_row(run, matrix.committed)
    assert lost.endswith("is lost or changed: sphere-6/p1/rest#001")
    assert matrix.difference(run) == "frames differ from the undisturbed run's"
