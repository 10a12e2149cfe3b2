"""Drags that hide a part of the pattern and show it again: what is sure is right, and it is most.

Short on the linear gel, to guard edits; whole, from an empty store, as evidence.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rig_text import VIRTUAL_STAGE

from deltact_fab.bench.record.run import open_run
from deltact_fab.estimate.analysis.force.dataset import gather_data
from deltact_fab.estimate.analysis.force.judge import fit_force
from deltact_fab.estimate.analysis.runs import view_of_run
from deltact_fab.estimate.analysis.shape.ball import calibrate_depth
from deltact_fab.estimate.analysis.tracking_error.follow import analyse_tracking
from deltact_fab.estimate.measure.pipeline.measurement import Measurement
from deltact_fab.simulate.experiment.request import RunRequest
from deltact_fab.simulate.experiment.session import run_experiment

SHORT = """
name = "short-deep-drag"
indenters = ["sphere:10"]
positions_mm = [[0.0, 0.0]]
depths_mm = [3.0]
channels = ["image", "shear"]
[shear]
amplitude_mm = 4.0
axes = ["x"]
[capture]
rate_hz = 1.0
[motion]
press_feed_mm_min = 30.0
shear_feed_mm_min = 30.0
[specimen]
gel_model = "linear"
"""
COARSE = f"""{VIRTUAL_STAGE}[force]
range_n = [50.0, 50.0, 70.0]
range_nmm = [500.0, 500.0, 500.0]
[virtual.gel]
spacing_mm = 0.5
press_increment_mm = 0.5
shear_increment_mm = 1.0
"""


def dragged(protocol: str, rig: str, out: Path, *methods: str) -> dict[str, dict[str, Any]]:
    """Figures by method of a protocol that is run and analysed."""
    run_experiment(RunRequest(protocol, rig, out, seed=0))
    with ThreadPoolExecutor(1) as executor:
        result = analyse_tracking(out, methods, executor)
    assert result.verdict.take == "fused"
    return {row["name"]: row for row in result.methods}


@pytest.mark.slow
def test_force_after_jump_right_or_flagged(tmp_path: Path) -> None:
    """The images of a run in order, then each fourth at once after the reference, three times."""
    protocol, rig = tmp_path / "short.toml", tmp_path / "coarse.toml"
    protocol.write_text(SHORT.replace('"shear"]', '"shear", "force"]'))
    rig.write_text(COARSE)
    run_experiment(RunRequest(str(protocol), str(rig), tmp_path / "run", seed=0))
    run = open_run(tmp_path / "run")
    force = fit_force(gather_data([run], ["inverse-placed"]), "inverse-placed")
    depth = calibrate_depth(run.folder).model
    measurement = Measurement(view_of_run(run), ("shape", "force"), [force, depth])
    images = [run.raw(file) for file in run.frames()["file"]]
    in_order, jumps = [measurement.update(image) for image in images], 0
    for k in range(8, len(images), 4):
        measurement.reset(images[0])
        tracked = _told(in_order[k])
        for _ in range(3):
            result = measurement.update(images[k])
            off = np.abs(_told(result) - tracked)
            wrong = bool((off > 0.05 * np.abs(tracked).max()).any())
            jumps += wrong
            assert not wrong or result.extrapolated or not result.trusted, (k, result)
    assert jumps > 0


def _told(result: Any) -> Any:
    """Depth, mm, and force, N, of one image."""
    return np.array([result.shape.depth.depth_mm.max(), *result.force.force_n])


@pytest.mark.slow
def test_a_short_deep_drag(tmp_path: Path) -> None:
    protocol, rig = tmp_path / "short.toml", tmp_path / "coarse.toml"
    protocol.write_text(SHORT)
    rig.write_text(COARSE)
    rows = dragged(str(protocol), str(rig), tmp_path / "run", "fused", "dis-medium")
    sure, composed = rows["fused"], rows["dis-medium"]
    assert sure["peak_true_mm"] > 3
    assert sure["mean_off_dots_mm"] <= 0.004
    assert sure["mean_confident_mm"] <= 0.003
    assert sure["coverage"] >= 0.95
    assert sure["confident_wrong_share"] <= 0.0005
    # Flow that is composed wanders off, and does not only lose what it cannot see.
    assert composed["mean_off_dots_mm"] > 2 * sure["mean_off_dots_mm"]
