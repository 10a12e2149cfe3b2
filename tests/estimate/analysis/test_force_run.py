"""`calibrate force` on recorded runs: a calibration, and what is refused in one line."""

from __future__ import annotations

import json
import shutil
import sqlite3
import tomllib
from collections.abc import Callable
from contextlib import closing
from dataclasses import replace
from functools import partial
from pathlib import Path

import pytest
from called import called

from deltact_fab.bench.record.run import open_run
from deltact_fab.bench.record.streams import FORCE_COLUMNS, pack, unpack
from deltact_fab.common.errors import InputError
from deltact_fab.estimate.analysis.force.calibrate import calibrate, transfer_calibration
from deltact_fab.estimate.analysis.force.reference import reference_change
from deltact_fab.estimate.analysis.force.result import unfitted_lines
from deltact_fab.estimate.analysis.relaxation import StraightPress
from deltact_fab.estimate.measure.force.calibration import load_force
from deltact_fab.estimate.measure.health import Health
from deltact_fab.estimate.measure.sensor_id import SensorModel
from deltact_fab.simulate.experiment.request import RunRequest
from deltact_fab.simulate.experiment.session import run_experiment

PROTOCOL = """
name = "presses"
indenters = ["sphere:10"]
positions_mm = [[0.5, -0.5], [-4.0, 3.0]]
depths_mm = [0.8]
channels = ["image", "force", "shear"]
[shear]
amplitude_mm = 0.5
grid = true
[capture]
settle_s = 0.5
[specimen]
serial = "A1"
"""


REFERENCES = """
name = "again"
indenters = ["sphere:10"]
positions_mm = [[3.0, 1.0]]
depths_mm = [0.4, 0.8]
repeats = 3
channels = ["force", "shear"]
[shear]
amplitude_mm = 0.5
axes = ["x"]
[reference]
every = 1
depth_mm = 0.8
[capture]
settle_s = 0.5
"""


def drifted(run: Path, percent: float) -> Path:
    """The run with a force sensor whose gain rises from press to press."""
    with closing(sqlite3.connect(run / "journal.sqlite")) as db, db:
        db.row_factory = sqlite3.Row
        total = db.execute("SELECT max(seq) FROM samples").fetchone()[0]
        for row in db.execute("SELECT * FROM samples WHERE stream = 'force'").fetchall():
            chunk = unpack(*(row[k] for k in ("stream", "origin_s", "n", "columns", "data")))
            first = f"SELECT min(seq) FROM samples WHERE press = '{row['press']}'"
            gain = 1 + percent / 100 * db.execute(first).fetchone()[0] / total
            values = {k: chunk.columns[k] * gain for k in FORCE_COLUMNS}
            packed = pack(replace(chunk, columns={**chunk.columns, **values}))
            update = "UPDATE samples SET columns = ?, data = ? WHERE seq = ? AND stream = 'force'"
            db.execute(update, (packed["columns"], packed["data"], row["seq"]))
    return run


@pytest.fixture
def references(
    made_once: Callable[[str, Callable[[Path], object]], Path], mini: tuple[Path, Path],
    tmp_path: Path,
) -> Path:  # fmt: skip
    """A run of force alone: three repeats of two depths with drags, among four references."""
    protocol = tmp_path / "again.toml"
    protocol.write_text(REFERENCES)
    request = partial(RunRequest, str(protocol), str(mini[1]), seed=3)
    return made_once("references", lambda out: run_experiment(request(out)))


def test_straight_press_ends_with_drag(references: Path) -> None:
    found = StraightPress.from_run(references, "sphere-10/p1r2")
    assert found.depth_mm.max() == pytest.approx(0.4, abs=0.01)
    assert found.dragged > len(found.depth_mm)


@pytest.mark.parametrize("percent", [0.0, 5.0])
def test_reference_presses_show_drift(references: Path, tmp_path: Path, percent: float) -> None:
    found = reference_change(
        [open_run(drifted(shutil.copytree(references, tmp_path / "run"), percent))]
    )
    assert found is not None
    assert found.over == "4 presses"
    assert found.low < percent < found.high
    assert found.high - found.low < 2
    (line,) = unfitted_lines({}, found)
    assert line.startswith(f"reference: normal force changed by {found.value:.2f} % [")


def test_runs_without_references_show_none(mini_run: Path) -> None:
    assert reference_change([open_run(mini_run)]) is None


def test_runs_that_cannot_be_used(mini_run: Path, tmp_path: Path) -> None:
    roles = tmp_path / "roles"
    shutil.copytree(mini_run, roles)
    meta = json.loads((roles / "run.json").read_text())
    meta["presses"] = [{"name": "4dots/p1", "role": "validate"}]
    (roles / "run.json").write_text(json.dumps(meta))

    def refused(*runs: Path, models: tuple[str, ...] = ()) -> str:
        with pytest.raises(InputError) as why:
            calibrate(runs, models)
        return str(why.value)

    assert "no such folder" in refused(tmp_path / "gone")
    assert "given twice" in refused(mini_run, mini_run)
    assert "did you mean 'sums'" in refused(mini_run, models=("summs",))
    assert "paper needs at least 9 points, got 8" in refused(mini_run, models=("sums",))
    assert "sums needs at least 7 points, got 4" in refused(roles, models=("sums",))
    for key, value, said in (
        ("design", "deltact-two", "another sensor than"),
        ("gel_model", "block", "gel differs from"),
    ):
        other = tmp_path / key
        shutil.copytree(mini_run, other)
        meta = json.loads((other / "run.json").read_text())
        meta["protocol"]["specimen"][key] = value
        (other / "run.json").write_text(json.dumps(meta))
        assert said in refused(mini_run, other)
    numb = tmp_path / "numb"
    shutil.copytree(mini_run, numb)
    with closing(sqlite3.connect(numb / "journal.sqlite")) as db, db:
        db.execute("DELETE FROM samples WHERE stream = 'force'")
    assert "no force recorded" in refused(numb)
    torn = tmp_path / "calibration.toml"
    torn.write_text('schema = 1\nkind = "for')
    with pytest.raises(InputError, match="not valid TOML"):
        transfer_calibration([mini_run], torn)


@pytest.mark.slow
def test_calibration_is_fitted_saved_and_transferred(
    mini: tuple[Path, Path], tmp_path: Path
) -> None:
    protocol, run, out = tmp_path / "presses.toml", tmp_path / "run", tmp_path / "out"
    protocol.write_text(PROTOCOL)
    run_experiment(RunRequest(str(protocol), str(mini[1]), run, seed=3))
    done = called("calibrate", "force", run, "--out", out, "--model", "sums", "--json")
    assert done.returncode == 0, done.stderr
    told = json.loads(done.stdout)
    # One at rest and nine stops that settle, at each of two places; one ball, one run.
    assert (told["n_points"], told["n_presses"]) == (20, 2)
    assert set(told["models"]) == {"sums", "paper"}
    for of in told["models"].values():
        assert {"normal", "shear_x", "torque_z"} <= set(of)
        assert of["normal"]["rmse_left_out_unseen_n"] > 0
        assert of["normal"]["rmse_left_out_run_n"] is None
        assert of["shear_x"]["range_n"] > 1
    assert told["simulated"] is True
    assert any("linear gel" in line for line in told["left_out"])
    assert "says nothing of other tips; at least 4 places are needed" in told["verdict"]
    assert told["intervals"]["normal"]["over"] == "2 positions: no interval below four"
    assert json.loads((out / "force.json").read_text()) == told
    assert len((out / "force.csv").read_text().splitlines()) == 21

    kept = load_force(out / "calibration.toml")
    assert kept.head.sensor.serial == "A1"
    assert kept.head.made.seed == 3
    assert kept.model.features == told["best"]
    opened = open_run(run)
    rest = kept.view(SensorModel()).rest
    assert rest is not None
    assert Health.compare(rest, opened.image(opened.frames()["file"].iloc[-1]), opened.camera).fit

    # A second fit tracks nothing: all images but the one at rest may go.
    files = opened.frames()["file"]
    for file in files[1:]:
        (run / file).unlink()
    again = called("calibrate", "force", run, "--out", tmp_path / "again", "--model", "sums")
    assert again.returncode == 0, again.stderr
    assert again.stdout.startswith(f"Use {told['best']}: normal force to ")
    one, two = (
        tomllib.loads((p / "calibration.toml").read_text()) for p in (out, tmp_path / "again")
    )
    assert one == two
    assert {p.suffix for p in (tmp_path / "again").iterdir()} == {
        ".svg", ".json", ".csv", ".toml", ".png",
    }  # fmt: skip

    moved = called(
        "analyze",
        "force",
        run,
        "--transfer",
        out / "calibration.toml",
        "-o",
        tmp_path / "moved.toml",
    )
    assert moved.returncode == 0, moved.stderr
    assert moved.stdout.startswith("transferred by 2 presses: pressure x ")
    carried = load_force(tmp_path / "moved.toml")
    assert carried.transfer["of"] == ["run"]
    assert carried.transfer["pressure"] == pytest.approx(1, abs=0.1)
