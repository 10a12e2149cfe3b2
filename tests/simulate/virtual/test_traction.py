"""The channel `traction`: what presses and shears the face at every frame adds up to its force."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from deltact_fab.bench.record.files import truth_file
from deltact_fab.bench.record.run import open_run
from deltact_fab.simulate.experiment.request import RunRequest
from deltact_fab.simulate.experiment.session import run_experiment

PROTOCOL = """
name = "tractions"
indenters = ["sphere:12"]
positions_mm = [[2.0, -1.0]]
depths_mm = [1.0]
channels = ["image", "force", "shear", "traction"]
[shear]
amplitude_mm = 0.8
axes = ["y"]
[capture]
settle_s = 0.2
[specimen]
gel_model = "{level}"
"""
RIG = """
kind = "virtual"
[stage]
origin_machine_mm = [-60.0, -60.0, -40.0]
travel_mm = [120.0, 120.0, 60.0]
max_feed_mm_min = [1500.0, 1500.0, 1200.0]
acceleration_mm_s2 = [50.0, 50.0, 50.0]
[virtual.force]
noise_n = 0.0
[virtual.gel]
spacing_mm = 0.5
press_increment_mm = 0.5
shear_increment_mm = 0.4
[virtual.gel.hyperelastic]
cell_mm = 2.0
"""


@pytest.mark.slow
@pytest.mark.parametrize("level", ["linear", "hyperelastic"])
def test_tractions_add_up_to_force(level: str, tmp_path: Path) -> None:
    protocol, rig = tmp_path / "p.toml", tmp_path / "quiet.toml"
    protocol.write_text(PROTOCOL.format(level=level))
    rig.write_text(RIG)
    run_experiment(RunRequest(str(protocol), str(rig), tmp_path / "run", seed=1))
    found = open_run(tmp_path / "run")
    truth, frames = found.truth(), found.frames()
    assert truth is not None
    pressed = frames[frames["z_mm"] < -0.1]
    assert len(pressed) >= 3
    for row in pressed.itertuples():
        x_mm, y_mm = truth.face_mm(row.frame_id)
        assert (x_mm[0], x_mm[-1], y_mm[-1]) == pytest.approx((-18, 18, 17), abs=0.51)
        traction = truth.traction_mpa(row.frame_id)
        force = np.trapezoid(np.trapezoid(traction, x_mm, axis=1), y_mm, axis=0)
        measured = np.array([row.fx_n, row.fy_n, row.fz_n])
        assert np.linalg.norm(force - measured) < 1e-3 * np.linalg.norm(measured)
        assert (traction[..., 2] <= 1e-6).all()  # it is pressed, nowhere pulled
    with np.load(found.folder / truth_file("sphere-12/p1")) as data:
        zones, area, stick = data["zone_map"], data["contact_area_mm2"], data["stick_area_mm2"]
        middle, x_mm, y_mm = data["centroid_mm"], data["x_mm"], data["y_mm"]
    assert zones.dtype == np.uint8
    assert zones.shape == (len(area), len(y_mm), len(x_mm))
    assert (area[0], zones[0].max(), tuple(middle[0])) == (0, 0, pytest.approx((2, -1), abs=0.01))
    counted_mm2 = (zones > 0).sum(axis=(1, 2)) * (x_mm[1] - x_mm[0]) * (y_mm[1] - y_mm[0])
    assert counted_mm2 == pytest.approx(area, rel=0.25, abs=0.5)
    assert (np.abs(middle[1:] - [2, -1]) < [0.3, 1.2]).all()
    assert ((stick >= 0) & (stick <= area)).all()
    assert (zones == 2).any()
    dragged = truth.traction_mpa(pressed["frame_id"].iloc[-1])
    assert np.abs(dragged[..., 1]).max() > 5 * np.abs(truth.traction_mpa(
        frames["frame_id"].iloc[0]
    )).max()  # fmt: skip
