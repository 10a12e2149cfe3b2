"""Comparisons of recorded runs: units, drift, notes, and the command."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from short_run import QUICK, ShortRun

from deltact_fab.app.cli.analyze import compare
from deltact_fab.bench.record.run import open_run
from deltact_fab.common.errors import InputError
from deltact_fab.estimate.analysis import press_figures as figures
from deltact_fab.estimate.analysis.comparison import Comparison
from deltact_fab.estimate.analysis.force.dataset import gather_data
from deltact_fab.estimate.analysis.tracking_error.follow import TrackingPlan, analyse_press
from deltact_fab.simulate.experiment.request import RunRequest
from deltact_fab.simulate.experiment.session import run_experiment

PROTOCOL = (
    """
name = "few"
channels = ["image", "force", "shear"]
press = [
    {{indenter = "sphere:6", depth_mm = 0.5, shear_x_mm = 0.2}},
    {{indenter = "sphere:6", depth_mm = 0.4, x_mm = 2.0, shear_y_mm = 0.2}},
    {{indenter = "sphere:6", depth_mm = 0.6, x_mm = -2.0, y_mm = 1.0, shear_x_mm = -0.2}},
]
[reference]
every = 1
depth_mm = 0.4
"""
    + QUICK
)
POPULATION = "[virtual.population]\nmodulus = 0.1\nthickness_mm = 0.2\nlight = 0.1\n"
Lab = Callable[[int, str | None], Path]
Runs = dict[int, Path]


def compared(*sides: list[Path], **words: Any) -> Comparison:
    """The comparison, in this process."""
    with ThreadPoolExecutor(1) as executor:
        return Comparison.from_runs(*sides, executor=executor, **words)


def record(folder: Path, sensor: int, drift: str = "") -> Path:
    """A finished run; the pattern of odd sensors is another one."""
    folder.mkdir()
    pattern = 'pattern = "octave"\n' if sensor % 2 else ""
    files = ShortRun(folder, PROTOCOL + pattern, POPULATION + drift)
    request = RunRequest(str(files.protocol), str(files.rig), folder / "run", 3, sensor=sensor)
    run_experiment(request)
    return folder / "run"


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> Runs:
    folder = tmp_path_factory.mktemp("compared")
    return {number: record(folder / str(number), number) for number in range(4)}


@pytest.fixture
def lab(runs: Runs, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Lab:
    """Makes copies of runs as if recorded on a bench, of sensors with a serial number."""
    monkeypatch.chdir(tmp_path)

    def make(number: int, serial: str | None) -> Path:
        out = tmp_path / f"{number} {serial}"
        shutil.copytree(runs[number], out, dirs_exist_ok=True)
        shutil.rmtree(out / "truth")
        meta = json.loads((out / "run.json").read_text())
        meta["simulated"] = False
        meta["protocol"]["specimen"]["serial"] = serial
        (out / "run.json").write_text(json.dumps(meta))
        return out

    return make


def test_nominal_sensor_is_no_unit(mini_run: Path, tmp_path: Path) -> None:
    (tmp_path / "copy").symlink_to(mini_run)
    shutil.copytree(mini_run, tmp_path / "b", ignore=shutil.ignore_patterns("images"))
    with pytest.raises(InputError, match="nominal sensor, which is no unit"):
        compared([mini_run], [tmp_path / "b"])
    with pytest.raises(InputError, match="twice; give each run once"):
        compared([mini_run], [tmp_path / "copy"])


def test_choices_are_those_of_analysis() -> None:
    (choice,) = (p.type for p in compare.params if p.name == "measure")
    assert [*choice.choices] == [*figures.COMPARED_MEASURES]  # type: ignore[attr-defined]


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (["--margin", "3"], "must be a positive number with"),
        (["--margin", "-3%"], "must be a positive number with"),
        (["--margin", "3mm", "--measure", "time"], "time is in ms"),
        (["--measure", "luck"], "is not one of"),
    ],
)
def test_bad_margin_is_one_line(words: list[str], text: str) -> None:
    result = CliRunner().invoke(compare, ["--a", "x", "--b", "y", *words])
    assert result.exit_code != 0
    assert text in f"{result.output} {result.exception}"


@pytest.mark.slow
def test_units_are_sensors(runs: Runs) -> None:
    found = compared([runs[0], runs[2]], [runs[1], runs[3]], method="dis-fast")
    assert (found.a.label, found.b.label) == ("dense-with-dots", "octave")
    assert [row["unit"] for row in found.rows] == [f"sensor {k}" for k in (0, 2, 1, 3)]
    assert {row["presses"] for row in found.rows} == {3}  # no reference presses
    assert found.difference.counts == (2, 2)
    assert "over 2 and 2 sensors" in found.line
    # The figures are those of the tracking analysis, but for the drift of the references.
    plan = TrackingPlan.for_run(open_run(runs[0]), ["dis-fast"])
    for press, figure in found.a.presses["sensor 0"].items():
        tally = analyse_press(str(runs[0]), press, plan).tallies["dis-fast"]
        assert figure == pytest.approx(tally.figures()["mean_off_dots_mm"], rel=0.3)


@pytest.mark.slow
@pytest.mark.parametrize("measure", ["time", "depth", "noise", "force"])
def test_each_measure_has_figures(measure: str, runs: Runs) -> None:
    found = compared([runs[0], runs[2]], [runs[1], runs[3]], measure=measure)
    assert all(0 < row["figure"] < 100 for row in found.rows)
    low, high = found.difference.interval()
    assert low < found.difference.value < high
    assert found.as_dict()["verdict"] == found.line


@pytest.mark.slow
def test_single_units_answer_for_themselves(runs: Runs) -> None:
    found = compared([runs[0]], [runs[1]], measure="noise")
    assert found.noun == "press"
    assert found.difference.paired
    assert "dense-with-dots (sensor 0) - octave (sensor 1)" in found.line
    assert any("about sensor 0, sensor 1 only" in note for note in found.notes)


@pytest.mark.slow
def test_real_runs_need_serial_and_truth(lab: Lab) -> None:
    with pytest.raises(InputError, match=r"no specimen\.serial"):
        compared([lab(0, None)], [lab(1, "B1")])
    with pytest.raises(InputError, match="no truth of the depth"):
        compared([lab(0, "A1")], [lab(1, "B1")], measure="depth")


@pytest.mark.slow
def test_runs_of_a_sensor_are_pooled(lab: Lab) -> None:
    sides = [[lab(0, "A1"), lab(2, "A1")], [lab(1, "B1"), lab(3, "B2")]]
    with pytest.raises(InputError, match="1 and 2 units"):
        compared(*sides, measure="noise")
    assert compared(*sides, measure="noise", unit="mounting").difference.counts == (2, 2)


@pytest.mark.slow
def test_gel_batches_come_from_ledgers(lab: Lab) -> None:
    sides = [[lab(0, "A1"), lab(2, "A2")], [lab(1, "B1"), lab(3, "B2")]]
    Path("sensors").mkdir()
    for serial, batch in (("A1", "7"), ("A2", "7"), ("B1", "8")):
        Path("sensors", f"{serial}.toml").write_text(f'gel_batch = "{batch}"\n')
    notes = compared(*sides, measure="noise").notes
    assert any("all sensors of a are of gel batch 7" in note for note in notes)
    assert not any("sensors of b" in note for note in notes)
    with pytest.raises(InputError, match=r"B2\.toml: gel_batch: needed by --unit gel"):
        compared(*sides, measure="noise", unit="gel")
    Path("sensors", "B2.toml").write_text('gel_batch = "8"\n')
    found = compared(*sides, measure="noise", unit="gel")
    assert [(row["unit"], row["presses"]) for row in found.rows] == [("7", 6), ("8", 6)]


@pytest.mark.slow
def test_order_of_real_runs_is_noted(lab: Lab) -> None:
    """Runs were recorded from 0 to 3: one side first, or in turn."""

    def noted(a: tuple[int, int], b: tuple[int, int]) -> bool:
        sides = [[lab(k, f"S{k}") for k in side] for side in (a, b)]
        return any("began first" in note for note in compared(*sides, measure="noise").notes)

    assert noted((0, 1), (2, 3))
    assert not noted((0, 2), (1, 3))


@pytest.mark.slow
def test_references_take_drift_out(runs: Runs) -> None:
    """Figures that grow by 30 % over the run become equal; an uncertain change stays."""
    run = open_run(runs[0])
    shares = figures.press_shares(run)
    steady = figures._without_change(run, {p: 0.02 * (1 + 0.3 * s) for p, s in shares.items()})
    assert len(steady) == 3
    assert max(steady.values()) / min(steady.values()) < 1.01
    rng = np.random.default_rng(1)
    noisy = {press: float(rng.lognormal(0.0, 0.5)) for press in shares}
    assert figures._without_change(run, noisy).items() <= noisy.items()


@pytest.mark.slow
def test_drift_of_force_is_taken_out(runs: Runs, tmp_path: Path) -> None:
    """A sensor that loses gain in the run measures the forces of one that does not."""
    drifting = record(tmp_path / "drift", 0, "[virtual.drift]\nforce_gain_per_h = -24.0\n")
    steady_n, as_is_n, corrected_n = (
        figures.force_data(open_run(run), correct).wrench[:, 2]
        for run, correct in ((runs[0], False), (drifting, False), (drifting, True))
    )
    pressed = np.abs(steady_n) > 0.1
    ratios = [n[pressed] / steady_n[pressed] for n in (as_is_n, corrected_n)]
    spread = [float(np.std(ratio)) for ratio in ratios]
    assert spread[0] > 0.02
    assert spread[1] < 0.3 * spread[0]
    assert len(gather_data([open_run(drifting)], ("paper",)).points) == len(steady_n)


@pytest.mark.slow
def test_command_takes_runs_of_shell(runs: Runs, tmp_path: Path) -> None:
    """`--a RUN RUN` as a shell expands it."""
    words = ["--a", str(runs[0]), str(runs[2]), "--b", str(runs[1]), str(runs[3])]
    more = ["--measure", "noise", "--out", str(tmp_path / "out"), "--json"]
    result = CliRunner().invoke(compare, [*words, *more])
    assert result.exit_code == 0, result.output
    data = json.loads(result.stdout)
    assert [row["side"] for row in data["figures"]] == ["dense-with-dots"] * 2 + ["octave"] * 2
    assert json.loads((tmp_path / "out" / "comparison.json").read_text()) == data
