"""The settling study whole: on the viscous gel, and from a run that was recorded on it."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from deltact_fab import experiment
from deltact_fab.protocols import plan
from deltact_fab.study import registry
from deltact_fab.study.request import StudyRequest

pytestmark = pytest.mark.slow

SERIES = ((0.1, 0.5), (0.08, 4.0))


@pytest.fixture(scope="module")
def found():
    typed = tuple(f"{g}:{tau}" for g, tau in SERIES)
    return registry.run("settling", StudyRequest(scale=0.3, more={"prony": typed}))


def test_the_gel_fades_as_the_closed_form_says_and_the_face_stands_still(found) -> None:
    assert found.missing == ()
    assert found.simulated
    # Friction and large strain are in the one and not in the other.
    assert found.data["closed_form_off_percent"] < 3.0
    assert 0 < found.data["moved_um"] < 10.0
    waits, protocols = (found.data["tables"][name] for name in ("waits", "protocols"))
    assert [stop["kind"] for stop in waits] == ["press", "shear", "shear"]
    for stop in waits:
        assert 5 < stop["at_once_percent"] < 100 * 2 * sum(g for g, _ in SERIES)
        five, two, one = (stop[f"wait_{p}_percent_s"] for p in (5, 2, 1))
        assert five < two < one < 40
    names = {row["protocol"] for row in protocols}
    assert len(" ".join(found.verdict).split()) <= 80
    assert {"force-calibration", "ball-press"} <= names
    json.dumps(found.data, allow_nan=False)
    for drawn in found.figures:
        assert drawn.draw().axes


def test_a_recorded_run_gives_back_the_gel_that_it_was_recorded_on(found, tmp_path: Path) -> None:
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
    assert own.simulated
    told, true = own.data["prony"], SERIES
    assert len(told) == 2
    for (g, tau), (true_g, true_tau) in zip(told, true, strict=True):
        assert g == pytest.approx(true_g, rel=0.15)
        assert tau == pytest.approx(true_tau, rel=0.2)
    assert own.data["rms_n"] < 0.008  # straight lines between a rest's knots: .012 of a branch
    both = (one.data["tables"]["waits"] for one in (own, found))
    for mine, solved in zip(*both, strict=True):
        # There the stop before was rested out, here it rested 15 s; and a drag's own force has a
        # little more than the closed form says, which the fit takes for all forces alike.
        within = 0.15 if mine["kind"] == "press" else 0.25
        assert mine["wait_2_percent_s"] == pytest.approx(solved["wait_2_percent_s"], rel=within)
