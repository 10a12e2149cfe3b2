"""The settling study: waits of a run's stops by the relaxation that fits them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from deltact_fab.bench.protocols import plan
from deltact_fab.common import catalog
from deltact_fab.common.errors import InputError
from deltact_fab.estimate.analysis.relaxation import (
    BIN_S,
    ForceHistory,
    ForceRest,
    RelaxationFit,
    Series,
)
from deltact_fab.simulate.experiment.request import RunRequest
from deltact_fab.simulate.experiment.session import run_experiment
from deltact_fab.studies.study import registry
from deltact_fab.studies.study.registry import StudyRequest
from deltact_fab.studies.study.settling import ForceDecay

SHARE, TIME_S, STEADY_N = 0.1, 2.0, 7.0


def pressed_at_once(share: float = SHARE) -> ForceDecay:
    """A press of no duration, which a series of one branch leaves all of its share."""
    t_s = np.arange(0.0, 20.0, BIN_S)
    force = np.zeros((len(t_s), 3))
    force[1:, 2] = -STEADY_N * (1 + share * np.exp(-(t_s[1:] - t_s[1]) / TIME_S))
    rest = ForceRest(ForceHistory("p1", t_s, force), "p1/press", "press", 1.6, slice(1, len(t_s)))
    fitted = RelaxationFit(Series((share,), (TIME_S,)), 0.0, np.zeros((0, 3)), (), 0.0)
    return ForceDecay.from_rest(rest, np.array([0.0, 0.0, -STEADY_N]), fitted)


def test_wait_follows_the_exponential() -> None:
    stop = pressed_at_once()
    row = stop.row()
    assert row["steady_n"] == STEADY_N
    assert row["at_once_percent"] == pytest.approx(100 * SHARE, rel=0.01)
    assert row["wait_2_percent_s"] == pytest.approx(TIME_S * np.log(SHARE / 0.02), rel=0.02)
    assert row["wait_5_percent_s"] < row["wait_2_percent_s"] < row["wait_1_percent_s"]
    assert np.interp(1.0, stop.measured_s, stop.measured_n) == pytest.approx(
        np.interp(1.0, stop.wait_s, stop.excess_n), rel=0.02
    )
    assert pressed_at_once(0.01).settle_time_s(2) == 0


def test_missing_run_names_the_protocol() -> None:
    with pytest.raises(InputError, match="--from: missing; record the protocol 'settling'"):
        registry.run_study("settling", StudyRequest())


@pytest.mark.slow
def test_recorded_run_recovers_its_gel(tmp_path: Path) -> None:
    series = ((0.1, 0.5), (0.08, 4.0))
    whole, _ = plan.load_protocol("settling")
    changed = whole.model_copy(
        update={
            "depths_mm": (1.6,),
            "capture": whole.capture.model_copy(update={"settle_s": 15.0}),
            "specimen": whole.specimen.model_copy(update={"prony": series}),
        }
    )
    protocol = tmp_path / "short.toml"
    protocol.write_text(catalog.toml_text(changed.model_dump(mode="json", exclude_none=True)))
    run_experiment(RunRequest(str(protocol), "virtual-coarse", tmp_path / "run", seed=1))
    own = registry.run_study("settling", StudyRequest(runs=(tmp_path / "run",)))
    assert own.simulated
    assert len(own.data["prony"]) == 2
    for (g, tau), (true_g, true_tau) in zip(own.data["prony"], series, strict=True):
        assert g == pytest.approx(true_g, rel=0.15)
        assert tau == pytest.approx(true_tau, rel=0.2)
    assert own.data["rms_n"] < 0.008  # straight lines between a rest's knots: 0.012 of a branch
    # The gel's own force at rest is the truth of each wait.
    for stop in own.data["tables"]["waits"]:
        assert 0 < stop["wait_2_percent_s"] < 15
    assert len(" ".join(own.verdict).split()) <= 80
    for drawn in own.figures:
        assert drawn.draw().axes
