"""Drift biases an ordered design's depth coefficient, not a random one's; references remove it."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from rig_text import VIRTUAL_STAGE

from deltact_fab.bench.record.run import Run, open_run
from deltact_fab.simulate.experiment.request import RunRequest
from deltact_fab.simulate.experiment.session import run_experiment

DEPTHS_MM = [0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0]
PROTOCOL = """
name = "depths"
order = "{order}"
channels = ["force"]
press = [{presses}]
[reference]
every = 6
depth_mm = 0.6
[capture]
settle_s = 1.0
"""
RIG = f"""{VIRTUAL_STAGE}[force]
range_n = [25.0, 25.0, 35.0]
range_nmm = [250.0, 250.0, 250.0]
[virtual.force]
noise_n = 0.0
[virtual.gel]
spacing_mm = 0.5
"""
DRIFT = """[virtual.drift]
force_gain_per_h = 0.356
"""  # 5 % over the 506 s of the run


def recorded(folder: Path, order: str, tables: str) -> Run:
    """24 presses, each depth three times in a row, or in random order."""
    folder.mkdir()
    presses = [f'{{indenter = "sphere:10", depth_mm = {d}}}' for d in DEPTHS_MM for _ in range(3)]
    (folder / "t.toml").write_text(PROTOCOL.format(order=order, presses=", ".join(presses)))
    (folder / "rig.toml").write_text(RIG + tables)
    files = str(folder / "t.toml"), str(folder / "rig.toml")
    run_experiment(RunRequest(*files, folder / "run"))
    return open_run(folder / "run")


def exponent(run: Run, corrected: bool = False) -> tuple[float, float]:
    """Exponent of force over depth, and its standard error; corrected: by the reference presses."""
    frames, roles = run.frames(), run.press_roles()
    frames = frames[frames["settled"] & (frames["z_mm"] < 0)]
    force_n, time_s = -frames["fz_n"].to_numpy(), frames["t_s"].to_numpy()
    reference = np.array([roles[press] == "reference" for press in frames["press"]])
    if corrected:
        force_n = force_n / np.interp(time_s, time_s[reference], force_n[reference])
    depth, force = np.log(-frames["z_mm"].to_numpy()[~reference]), np.log(force_n[~reference])
    design = np.stack([np.ones_like(depth), depth], axis=1)
    coefficients, residual = np.linalg.lstsq(design, force, rcond=None)[:2]
    spread = np.sum((depth - depth.mean()) ** 2)
    return coefficients[1], math.sqrt(residual[0] / (len(depth) - 2) / spread)


@pytest.mark.slow
def test_random_order_takes_drift_out(tmp_path: Path) -> None:
    true, _ = exponent(recorded(tmp_path / "steady", "file", ""))
    ordered = recorded(tmp_path / "ordered", "file", DRIFT)
    value, error = exponent(ordered)
    assert value - true == pytest.approx(0.035, abs=0.002)
    assert value - true > 5 * error  # an interval that misses the truth by far
    randomized = recorded(tmp_path / "random", "random", DRIFT)
    value, error = exponent(randomized)
    assert abs(value - true) < 2 * error
    assert abs(value - true) < 0.01
    for run in (ordered, randomized):
        assert exponent(run, corrected=True)[0] == pytest.approx(true, abs=1e-4)
