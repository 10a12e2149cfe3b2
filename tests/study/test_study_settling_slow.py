"""The settling study against the relaxing gel at finite strain, and whole from a recorded run."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from deltact_fab import experiment
from deltact_fab.analysis.relaxation import Series
from deltact_fab.protocols import plan
from deltact_fab.rig.simulator import FiniteGelConfig, GelConfig
from deltact_fab.shapes import SkinDimensions
from deltact_fab.study import registry
from deltact_fab.study.request import StudyRequest
from deltact_fab.study.settling import fading, job_of
from deltact_fab.study.settling_stops import size
from deltact_fab.virtual.paths import poses
from deltact_fab.virtual.presses import Presses

pytestmark = pytest.mark.slow

SERIES = ((0.1, 0.5), (0.08, 4.0))
GEL = Series(*zip(*SERIES, strict=True))
COARSE = GelConfig(hyperelastic=FiniteGelConfig(most_unknowns=3000))


def test_the_relaxing_gel_fades_as_the_closed_form_says_and_its_face_stands_still() -> None:
    """What the page says of large strain and slip, which the linear gel has not."""
    whole, _ = plan.load("settling")
    lone = {"depths_mm": (1.6,), "channels": whole.channels | {"image"}}
    lone["capture"] = whole.capture.model_copy(update={"settle_s": 40.0})
    lone["specimen"] = whole.specimen.model_copy(update={"prony": SERIES})
    protocol = whole.model_copy(update=lone)
    presses = Presses(protocol, SkinDimensions(), COARSE)
    path = presses.paths[0]
    knots = presses.of(path).solver.solve_all()
    planned = poses(path, presses.increments, presses.relaxing_s)
    force = np.array([knot.force_n for knot in knots]) * presses.modulus_mpa
    ends = [n for n, pose in enumerate(planned) if pose.part == 1.0]
    job = job_of("", protocol)
    stops = fading(job.work(job.given), GEL)
    for stop, start, to in zip(stops, ends, ends[1:], strict=False):
        rests = [start, *(n for n in range(start + 1, to) if planned[n].part == 0.0)]
        steady = force[rests[-1]]
        wait_s = np.cumsum([planned[n].seconds for n in rests]) - planned[start].seconds
        solved = size(force[rests] - steady, stop.kind) / size(steady, stop.kind)
        told = np.interp(wait_s, stop.wait_s, stop.excess_n) / stop.steady_n
        within = 0.012 if stop.kind == "press" else 0.25 * told[0]
        assert np.abs(solved - told).max() < within
        moved = [knots[n].displacement_mm - knots[start].displacement_mm for n in rests[1:]]
        assert 0 < np.abs(np.array(moved)[..., :2]).max() < 0.01


def test_a_recorded_run_gives_back_the_gel_that_it_was_recorded_on(tmp_path: Path) -> None:
    _, source = plan.load("settling")
    lines = source.read_text().splitlines()
    new = {"depths_mm": "depths_mm = [1.6]", "settle_s": "settle_s = 15.0",
           "prony": f"prony = {[list(pair) for pair in SERIES]}"}  # fmt: skip
    text = [next((to for key, to in new.items() if line.startswith(f"{key} =")), line)
            for line in lines]  # fmt: skip
    protocol = tmp_path / "short.toml"
    protocol.write_text("\n".join(text) + "\n")
    experiment.run(experiment.RunRequest(str(protocol), "virtual-coarse", tmp_path / "run", seed=1))
    own = registry.run("settling", StudyRequest(runs=(tmp_path / "run",), more={"prony": ()}))
    assert own.missing == ()
    assert own.simulated
    told = own.data["prony"]
    assert len(told) == 2
    for (g, tau), (true_g, true_tau) in zip(told, SERIES, strict=True):
        assert g == pytest.approx(true_g, rel=0.15)
        assert tau == pytest.approx(true_tau, rel=0.2)
    assert own.data["rms_n"] < 0.008  # straight lines between a rest's knots: .012 of a branch
    whole, _ = plan.load("settling")
    job = job_of("", whole.model_copy(update={"depths_mm": (1.6,)}))
    rows = own.data["tables"]["waits"]
    for row, true in zip(rows, fading(job.work(job.given), GEL), strict=True):
        assert row["stop"] == true.name
        assert row["wait_2_percent_s"] == pytest.approx(true.wait(2), rel=0.15)
    names = {row["protocol"] for row in own.data["tables"]["protocols"]}
    assert {"force-calibration", "ball-press", "settling, as recorded"} <= names
    assert len(" ".join(own.verdict).split()) <= 80
    json.dumps(own.data, allow_nan=False)
    for drawn in own.figures:
        assert drawn.draw().axes
