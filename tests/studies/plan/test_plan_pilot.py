"""A pilot on the virtual rig tells modulus, components and settling, which a plan rests on."""

from __future__ import annotations

from pathlib import Path

import pytest

from deltact_fab.simulate import RunRequest, run_experiment
from deltact_fab.studies.plan.pilot import Pilot

PILOT = """
name = "pilot"
channels = ["image", "force", "shear"]
press = [
    {indenter = "sphere:10", depth_mm = 1.2, shear_x_mm = 0.3, shear_y_mm = 0.2},
    {indenter = "sphere:10", x_mm = 6.0, y_mm = 3.0, depth_mm = 0.8, shear_x_mm = -0.3},
    {indenter = "sphere:10", x_mm = -4.0, y_mm = 5.0, depth_mm = 1.5, shear_y_mm = -0.2},
    {indenter = "sphere:10", x_mm = 6.0, y_mm = 3.0, depth_mm = 1.3, shear_y_mm = 0.3},
]
[reference]
every = 2
depth_mm = 1.0
[capture]
rate_hz = 2.0
settle_s = 1.0
"""


@pytest.mark.slow
def test_pilot_tells_the_sensor(tmp_path: Path) -> None:
    file = tmp_path / "pilot.toml"
    file.write_text(PILOT)
    run_experiment(RunRequest(str(file), "virtual", tmp_path / "run"))
    pilot = Pilot.load([tmp_path / "run"], 0)
    assert pilot.tips == ("sphere:10",)
    assert pilot.presses == 4
    assert pilot.modulus_mpa == pytest.approx(0.56, rel=0.05)
    assert pilot.components.basis == {
        "repeat": "pilot, 8 points",
        "place": "pilot, 3 places",
        "tip": "assumed (one tip in the pilot)",
        "drift": "assumed",  # three reference presses give no interval
    }
    # A linear gel, whose model is nearly exact: less than assumed, by three places only.
    assert pilot.components.interval("place")[0] < 0.02
    assert pilot.components.interval("repeat")[0] < 0.05
    # It neither creeps nor drifts.
    assert pilot.prony is None or sum(g for g, _ in pilot.prony) < 0.01
    assert any("simulated with a linear gel" in line for line in pilot.lines)


def test_no_pilot_assumes_everything() -> None:
    pilot = Pilot.load([], 0)
    assert set(pilot.components.basis.values()) == {"assumed"}
    assert pilot.modulus_mpa is pilot.prony is None
