"""Pilots of figures on the virtual rig, and a planned mean beside what its run reached."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import t
from short_run import QUICK, ShortRun

from deltact_fab.bench.record.run import open_run
from deltact_fab.common import InputError
from deltact_fab.estimate import Comparison
from deltact_fab.present.report.page import plan_checks
from deltact_fab.simulate.experiment.request import RunRequest
from deltact_fab.simulate.experiment.session import run_experiment
from deltact_fab.studies.plan.mean import ASSUMED_FIGURES
from deltact_fab.studies.plan.pilot import Pilot

PROTOCOL = (
    """
name = "places"
channels = ["image", "force", "shear"]
press = [
    {{indenter = "sphere:6", depth_mm = 0.5, shear_x_mm = 0.2}},
    {{indenter = "sphere:6", depth_mm = 0.4, x_mm = 2.0, shear_y_mm = 0.2}},
    {{indenter = "sphere:6", depth_mm = 0.6, x_mm = -2.0, y_mm = 1.0, shear_x_mm = -0.2}},
    {{indenter = "sphere:6", depth_mm = 0.5, x_mm = 1.0, y_mm = -1.0, shear_x_mm = -0.2}},
]
"""
    + QUICK
)
POPULATION = "[virtual.population]\nmodulus = 0.1\nthickness_mm = 0.2\nlight = 0.1\n"
MEAN, PAIR = (
    {name: ASSUMED_FIGURES["tracking"][name] for name in names}
    for names in (("repeat", "place", "tip"), ("press", "sensor"))
)


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Runs of three sensors, the last with another pattern."""
    folders = []
    for number in (1, 2, 3):
        folder = tmp_path_factory.mktemp(f"sensor-{number}")
        text = PROTOCOL + ('pattern = "octave"\n' if number == 3 else "")
        files = ShortRun(folder, text, POPULATION)
        folders.append(folder / "run")
        rig = str(files.rig)
        run_experiment(RunRequest(str(files.protocol), rig, folders[-1], 3, sensor=number))
    return folders


def test_mean_pilot_has_one_tip(runs: list[Path]) -> None:
    pilot = Pilot.load_figures(runs[:1], "tracking", MEAN, 0, relative=True)
    assert pilot.components.basis == {
        "repeat": "pilot, 4 points",
        "place": "pilot, 4 places",
        "tip": "assumed (one tip in the pilot)",
    }
    figures = Comparison.run_figures(runs[:1], "tracking")[runs[0]]
    assert pilot.figure == pytest.approx(np.mean([*figures.values()]))
    assert pilot.tips == ("sphere:6",)
    prior = ASSUMED_FIGURES["tracking"]["tip"]
    assert pilot.components.interval("tip")[0] == pytest.approx(prior, rel=0.2)


def test_sensors_of_a_pilot_are_units(runs: list[Path]) -> None:
    pilot = Pilot.load_figures(runs, "tracking", PAIR, 0, relative=True)
    assert pilot.components.basis == {"press": "pilot, 12 points", "sensor": "pilot, 3 sensors"}
    one = Pilot.load_figures(runs[:1], "tracking", MEAN, 0, relative=False)
    assert one.components.interval("place")[0] > 0
    with pytest.raises(InputError, match="pilot: 4 points in contact; at least 6 are needed"):
        Pilot.load_figures(runs[:1], "tracking", PAIR, 0, relative=True)


def test_report_tells_a_planned_mean(runs: list[Path]) -> None:
    """Half width of Student's interval of four places, of the logarithms and of the figures."""
    figures = np.array([*Comparison.run_figures(runs[:1], "tracking")[runs[0]].values()])
    reach = t.ppf(0.975, 3) / 2
    widths = {
        "%": 100 * np.expm1(reach * np.log(figures).std(ddof=1)),
        "mm": reach * figures.std(ddof=1),
    }
    for unit, width in widths.items():
        for factor, status, result in ((1.5, "pass", "met."), (0.5, "warn", "missed.")):
            promise = {
                "measure": "mean tracking error", "unit": unit, "goal": factor * width,
                "error": width, "interval": [0.5 * width, 2 * width], "chance": 0.9,
                "digest": "",
            }  # fmt: skip
            check = planned_check(runs[0], promise)
            assert f"Reached: {width:.2g} {unit} over 4 places; the goal is {result}" in check[1]
            assert check[0] == status


def test_difference_waits_for_both_sides(runs: list[Path]) -> None:
    promise = {
        "measure": "difference of tracking", "unit": "%", "goal": 15, "error": 12,
        "interval": [8, 20], "chance": 0.8, "digest": "",
    }  # fmt: skip
    status, text = planned_check(runs[1], promise)
    assert status == "warn"
    assert text.endswith(
        "Reached: unknown; run `analyze compare --measure tracking` with the runs of both sides."
    )


def planned_check(folder: Path, promise: dict[str, object]) -> tuple[str, str]:
    """Status and text of a run's first check, had its protocol this promise."""
    run = open_run(folder)
    run.meta["protocol"]["promise"] = json.loads(json.dumps(promise))
    check = next(plan_checks(run))
    return check.status, str(check.value)
