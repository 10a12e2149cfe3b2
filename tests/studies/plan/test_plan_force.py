"""Planned protocols: the file, its promise, what cannot be had, and bad input."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from deltact_fab.bench import load_protocol
from deltact_fab.common import InputError
from deltact_fab.sensor import GelMaterial, SkinDimensions
from deltact_fab.simulate import RunRequest
from deltact_fab.studies.plan import candidates, force
from deltact_fab.studies.plan.candidates import Candidate, GelFeatures
from deltact_fab.studies.plan.components import ASSUMED_ERRORS, ErrorComponents
from deltact_fab.studies.plan.exchange import force_regressors
from deltact_fab.studies.plan.force import ForcePlanner
from deltact_fab.studies.plan.pilot import Pilot
from deltact_fab.studies.plan.planner import PlanGoal, protocol_text
from deltact_fab.studies.plan.report import PlanReport, write_plan

GEL = GelFeatures(SkinDimensions(), GelMaterial(0.56, 0.49, 0.5), 1.0)


@pytest.fixture(scope="module")
def few_places() -> None:
    """Leave a few places, each of which takes seconds of solving."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(candidates, "FIT_PLACES", 4)
        patch.setattr(candidates, "VALIDATION_PLACES", 4)
        patch.setattr(force, "VALIDATION_PLACES", 4)
        yield


def planner(error_n: float = 0.5, time_s: float = 3600.0, **settings: object) -> ForcePlanner:
    goal = PlanGoal("night", "virtual", 4.0, error_n, "N", time_s, ("sphere:10",), **settings)
    return ForcePlanner(goal, Pilot(ErrorComponents.assume(0), {}))


@pytest.mark.slow
def test_plan_passes_check_and_repeats(few_places: None, tmp_path: Path) -> None:
    texts = []
    for name in ("a", "b", "c"):
        (tmp_path / name).mkdir()
        file = tmp_path / name / "night.toml"
        report = write_plan(
            file, "force", "virtual", 4.0, (0.5, "N"), 3600.0, tips=["sphere:10"],
            seed=int(name == "c"),
        )  # fmt: skip
        texts.append(file.read_bytes())
    assert texts[0] == texts[1] != texts[2]
    protocol, _ = load_protocol(str(file))
    request = RunRequest(str(file), "virtual", tmp_path)
    assert {row.status for row in request.checks()} == {"pass"}
    roles = [press.role for press in protocol.list_presses()]
    assert roles.count("validate") == report.as_dict()["counts"]["only to validate"] == 4
    assert roles.count("reference") >= 2
    assert len(roles) == report.as_dict()["estimate"]["presses"]
    assert request.estimate().seconds == report.as_dict()["estimate"]["seconds"] <= 3600


@pytest.mark.slow
def test_promise_names_its_plan(few_places: None, tmp_path: Path) -> None:
    plan = planner()
    promised = plan.promised(plan.design(4))
    file = tmp_path / "night.toml"
    file.write_text(protocol_text(promised, ["a comment"]))
    protocol, _ = load_protocol(str(file))
    assert protocol == promised
    assert protocol.promise is not None
    assert protocol.promise.digest == protocol.digest
    low, high = protocol.promise.interval
    assert low < protocol.promise.error < high
    assert [line.rpartition(": ")[2] for line in protocol.promise.rests_on] == ["assumed"] * 4
    file.write_text(file.read_text().replace("every = 8", "every = 7"))
    edited, _ = load_protocol(str(file))
    assert edited.promise is not None
    assert edited.digest != edited.promise.digest


def test_validation_places_are_not_fitted(few_places: None) -> None:
    plan = planner()
    design = plan.design(8)
    places: dict[str, set[tuple[float, ...]]] = {"fit": set(), "validate": set()}
    for press in design.protocol.press:
        places[press.role].add((abs(press.x_mm), abs(press.y_mm)))
    assert len(places["validate"]) == 4
    assert not places["fit"] & places["validate"]


def test_smaller_errors_need_fewer_presses(few_places: None) -> None:
    plan = planner(error_n=0.12)
    needed = []
    for factor in (0.2, 1.0):
        draws = np.tile(factor * np.array([*ASSUMED_ERRORS.values()]), (2000, 1))
        components = ErrorComponents(draws, dict.fromkeys(ASSUMED_ERRORS, "test"))
        plan.pilot = Pilot(components, {})
        needed.append(plan.plan()[0].counts["to fit"])
    assert needed[0] < needed[1]


def test_unreachable_goal_tells_the_nearest(few_places: None) -> None:
    plan = planner(error_n=0.001)
    design, longer = plan.plan()
    report = PlanReport(plan, design, longer)
    nearest = design.prediction.reached()
    assert design.prediction.chance(0.001) == 0.0
    assert design.prediction.chance(nearest) == pytest.approx(0.9, abs=0.01)
    assert longer is None
    line = next(line for line in report.lines if line.startswith("goal 0.001 N"))
    assert f"within 1 h 00 min; {nearest:.2g} N is; more presses change little" in line


def test_longer_plan_is_told_by_time(few_places: None) -> None:
    """A goal between what 4 and 16 presses meet, in the time of 4."""
    plan = planner()
    few, many = plan.design(4), plan.design(16)
    goal_n = (few.prediction.reached() + many.prediction.reached()) / 2
    short = planner(error_n=goal_n, time_s=few.estimate.seconds + 1)
    design, longer = short.plan()
    assert longer is not None
    assert design.estimate.seconds <= short.goal.time_s < longer.estimate.seconds
    assert longer.prediction.chance(goal_n) >= 0.9 > design.prediction.chance(goal_n)
    assert f"or {goal_n:g} N in " in PlanReport(short, design, longer).lines[-2]


@pytest.mark.slow
def test_range_beyond_the_gel_is_told(few_places: None) -> None:
    plan = planner()
    design = plan.design(4)
    assert plan.largest_force_n == pytest.approx(4.0, rel=0.05)
    assert not any(line.startswith("range ") for line in PlanReport(plan, design).lines)
    goal = PlanGoal("night", "virtual", 300.0, 0.5, "N", 3600.0, ("sphere:10",))
    plan = ForcePlanner(goal, plan.pilot)
    line = next(line for line in PlanReport(plan, design).lines if line.startswith("range "))
    assert f"range 300 N: not with these tips on this gel; {plan.largest_force_n:.2g} N is" in line
    assert 10 < plan.largest_force_n < 30


def test_time_too_short_is_refused(few_places: None) -> None:
    with pytest.raises(InputError, match=r"--time 30 s: the smallest plan, 4 to fit, .*takes "):
        planner(time_s=30.0).plan()


def test_contradicting_options_are_refused(tmp_path: Path) -> None:
    goal = PlanGoal("night", "virtual", 4.0, 0.1, "N", 3600.0, ("sphere:10", "sphere:15"))
    assumed = ErrorComponents.assume(0)
    unattended = PlanGoal(**{**vars(goal), "unattended": True})
    with pytest.raises(InputError, match="--tip: sphere:10, sphere:15; --unattended needs one"):
        ForcePlanner(unattended, Pilot(assumed, {}))
    other = PlanGoal(**{**vars(goal), "specimen": {"design": "mine"}})
    with pytest.raises(InputError, match="--design: 'mine'; the pilot's is 'deltact'"):
        ForcePlanner(other, Pilot(assumed, {"design": "deltact"}))
    with pytest.raises(
        InputError, match=r"--serial A9: no sensors.A9.toml; `rig sensors --new A9`"
    ):
        write_plan(
            tmp_path / "x.toml", "force", "virtual", 4, (0.1, "N"), 3600, specimen={"serial": "A9"}
        )
    (tmp_path / "y.toml").write_text("")
    with pytest.raises(InputError, match=r"y.toml: already exists"):
        write_plan(tmp_path / "y.toml", "force", "virtual", 4, (0.1, "N"), 3600)
    with pytest.raises(InputError, match=r"--range 0.01 N: sphere:10 reaches it .*; at least 0"):
        GEL.largest_depth_mm("sphere:10", 0.01)


def test_ledger_counts_presses(
    few_places: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("sensors").mkdir()
    event = 'date = "2026-01-01T00:00:00Z", presses = 214, simulated = true'
    Path("sensors/A1.toml").write_text(f'[events]\n"run abc" = {{{event}}}\n')
    report = write_plan(
        Path("night.toml"), "force", "virtual", 4.0, (0.5, "N"), 3600.0, tips=["sphere:10"],
        specimen={"serial": "A1"}, unattended=True,
    )  # fmt: skip
    total = 214 + report.as_dict()["estimate"]["presses"]
    assert f"; A1 has 214 presses, then {total}" in report.lines[1]
    assert "sphere:10 only (nobody changes tips)" in report.lines[0]
    assert load_protocol("night.toml")[0].specimen.serial == "A1"


def test_features_are_those_of_the_traction() -> None:
    """Force times squared distance, against the centre of the observed traction's pressure."""
    press = Candidate("sphere:10", (6.0, 4.0), 0.8, (0.2, -0.1), 0)
    rows, prior_mm2 = force_regressors(GEL.features(press)[None])
    assert rows.shape == (1, 2, 3, 2)
    assert prior_mm2 == 130.0
    ratio = rows[0, 0, :, 1] / rows[0, 0, :, 0]
    assert ratio == pytest.approx(np.full(3, 6.0**2 + 4.0**2), rel=0.01)
    # The drag's force follows it, and the friction bounds it.
    fx, fy, fz = rows[0, 1, :, 0]
    assert fx > 0 > fy
    assert np.hypot(fx, fy) < 0.5 * abs(fz)


def test_mirrored_press_mirrors_its_force() -> None:
    press = Candidate("sphere:10", (6.0, 4.0), 0.8, (0.2, -0.1), 0)
    direct, mirrored = (GEL.features(press.mirrored(k))[:, :3] for k in (0, 2))
    assert mirrored == pytest.approx(direct * [1, -1, 1], abs=1e-9)
    assert press.mirrored(2).as_dict()["shear_y_mm"] == 0.1


def test_depth_follows_the_range() -> None:
    """The depth of a range presses with it; a range beyond the gel's stops at its margin."""
    depth_mm = GEL.largest_depth_mm("sphere:10", 4.0)
    force_n = -GEL.wrenches("sphere:10", [(0, 0, 0), (0, 0, -depth_mm)])[0, 2]
    assert force_n == pytest.approx(4.0, rel=0.02)
    assert GEL.largest_depth_mm("sphere:10", 1e4) == pytest.approx(3.0)
    # The contact of a small ball reaches its rim before that.
    assert 2.0 < GEL.largest_depth_mm("sphere:6", 1e4) < 2.7
