"""Plans of a mean error and of a comparison: closed forms, files, and what cannot be had."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import chi2, t
from statsmodels.stats.power import TTestIndPower

from deltact_fab.bench import load_protocol
from deltact_fab.common import InputError
from deltact_fab.estimate.analysis.intervals import Interval
from deltact_fab.paths import shipped_folder
from deltact_fab.studies.plan.compare import CHANCE_GAIN, ComparePlanner
from deltact_fab.studies.plan.components import COMPONENT_DRAWS, ErrorComponents
from deltact_fab.studies.plan.mean import ASSUMED_FIGURES, MeanPlanner
from deltact_fab.studies.plan.pilot import Pilot
from deltact_fab.studies.plan.planner import PlanGoal
from deltact_fab.studies.plan.report import PlanReport, write_plan

GOAL = PlanGoal("night", "virtual", 4.0, 10.0, "%", 3600.0, ("sphere:10", "sphere:15"))


def certain(figure: float | None = None, **components: float) -> Pilot:
    """A pilot whose components have no uncertainty."""
    draws = np.tile([*components.values()], (COMPONENT_DRAWS, 1))
    return Pilot(ErrorComponents(draws, dict.fromkeys(components, "test")), {}, figure=figure)


def mean_planner(goal: PlanGoal = GOAL, figure: float | None = None) -> MeanPlanner:
    return MeanPlanner(goal, certain(figure, repeat=0.04, place=0.2, tip=0.1), "tracking")


def compare_planner(
    sensor: float, press: float, sensors: int | None = None, size: float = 15.0
) -> ComparePlanner:
    pilot = certain(press=press, sensor=sensor)
    return ComparePlanner(replace(GOAL, size=size), pilot, "tracking", sensors)


@pytest.mark.parametrize("places", [4, 10, 40])
def test_half_width_is_that_of_student(places: int) -> None:
    """h^2 = t^2 (place^2 + repeat^2 / tips) / n on average; its chance is that of chi-square."""
    prediction = mean_planner().predict(places)
    mean_square = t.ppf(0.975, places - 1) ** 2 * (0.2**2 + 0.04**2 / 2) / places
    widths = np.log1p(prediction.figures / 100)
    assert np.mean(widths**2) == pytest.approx(mean_square, rel=0.05)
    limit = math.log1p(0.15) ** 2 / mean_square * (places - 1)
    assert prediction.chance(15.0) == pytest.approx(chi2.cdf(limit, places - 1), abs=0.025)


def test_half_width_is_that_of_intervals() -> None:
    """Drawn figures of six places by two tips, through the interval that a report takes."""
    rng, widths = np.random.default_rng(3), []
    places = np.repeat(np.arange(6), 2)
    for _ in range(800):
        figures = 0.2 * rng.standard_normal(6)[places] + 0.04 * rng.standard_normal(12)
        interval = Interval.mean(figures + [0.0, 0.3] * 6, places, "place")
        widths.append((interval.high - interval.low) / 2)
    predicted = np.log1p(mean_planner().predict(6).figures / 100)
    for share in (0.1, 0.5, 0.9):
        drawn = np.quantile(widths, share)
        assert np.quantile(predicted, share) == pytest.approx(drawn, rel=0.08)


def test_millimetres_scale_with_the_figure() -> None:
    goal = replace(GOAL, unit="mm", size=0.0001)
    planner = mean_planner(goal, 0.002)
    shares = np.log1p(mean_planner().predict(8).figures / 100)
    assert planner.predict(8).figures == pytest.approx(0.002 * shares)
    assert planner.basis()[-1] == "mean 0.002 mm: pilot"
    # An assumed mean is uncertain too.
    assumed = mean_planner(goal)
    ratios = [high / low for low, high in (p.predict(8).interval for p in (assumed, planner))]
    assert ratios[0] > 2 * ratios[1]
    assert assumed.basis()[-1].endswith("mm: assumed")


def test_presses_are_balanced() -> None:
    """Every tip at each place; depths and quadrants equally often in each four places."""
    presses = mean_planner().design(8).protocol.press
    places = {(press.x_mm, press.y_mm) for press in presses}
    assert len(places) == 8
    assert len({(p.x_mm, p.y_mm, p.indenter) for p in presses}) == len(presses) == 16
    depths = [p.depth_mm for p in presses if p.indenter == "sphere:10"]
    assert sorted(map(depths.count, set(depths))) == [2, 2, 2, 2]
    assert len({(x > 0, y > 0) for x, y in places}) == 4


def test_unreachable_mean_tells_the_nearest() -> None:
    planner = mean_planner(replace(GOAL, size=0.5))
    design, longer = planner.plan()
    line = PlanReport(planner, design, longer).lines[5]
    nearest = design.prediction.reached()
    assert line.startswith("goal 0.5 %: not with chance 0.9 within 1 h 00 min; ")
    assert f"; {nearest:.2g} % is" in line
    assert design.estimate.seconds <= 3600
    assert design.prediction.chance(nearest) == pytest.approx(0.9, abs=0.01)
    with pytest.raises(InputError, match=r"--time 30 s: the smallest plan, 8 presses at 4 places"):
        mean_planner(replace(GOAL, time_s=30.0)).plan()


@pytest.mark.parametrize("sensors", [5, 10, 20])
def test_chance_is_that_of_statsmodels(sensors: int) -> None:
    """Welch's test loses little of Student's power, the less the more sensors."""
    planner = compare_planner(0.1, 0.0, sensors)
    effect = math.log1p(0.15) / 0.1
    power = TTestIndPower().power(effect, sensors, 0.05)
    assert planner.chance(sensors, 1) == pytest.approx(power, abs=0.15 / sensors)
    prediction = planner.predict(1)
    assert prediction.chance(prediction.reached()) == pytest.approx(0.8, abs=1e-3)
    assert prediction.error == pytest.approx(prediction.reached(), rel=1e-3)  # as it is certain


def test_sensors_are_the_fewest() -> None:
    planner = compare_planner(0.1, 0.05)
    presses = planner.enough_presses(planner.sensors)
    assert planner.chance(planner.sensors, presses) >= 0.8
    fewer = planner.sensors - 1
    assert planner.chance(fewer, planner.enough_presses(fewer)) < 0.8


def test_presses_beyond_change_nothing() -> None:
    assert compare_planner(0.1, 0.0, 5).enough_presses(5) == 1
    planner = compare_planner(0.1, 0.1, 5)
    count = planner.enough_presses(5)
    endless = planner.chance(5, math.inf)
    assert planner.chance(5, count) >= endless - CHANCE_GAIN > planner.chance(5, count - 1)


def test_few_sensors_tell_the_nearest() -> None:
    planner = compare_planner(0.1, 0.05, 3)
    design, _ = planner.plan()
    lines = PlanReport(planner, design).lines
    found = design.prediction.reached()
    assert f"goal 15 %: not with chance 0.8 by 3 sensors a side; {found:.2g} % is, or 15 % by " in (
        "\n".join(lines)
    )
    assert f"chance to find 15 % by sensors a side: 3: {planner.chance(3, 2):.2f}, 5: " in lines[-2]
    quick = replace(planner.goal, time_s=150.0)
    short, _ = ComparePlanner(quick, planner.pilot, "tracking", 3, 24).plan()
    assert short.estimate.seconds <= 150
    assert 1 <= sum(short.counts.values()) < 24


@pytest.mark.slow
def test_sides_differ_in_the_pattern(tmp_path: Path) -> None:
    texts = []
    for name in ("a", "b", "c"):
        (tmp_path / name).mkdir()
        report = write_plan(
            tmp_path / name / "pair.toml", "tracking", "virtual", 4.0, (20.0, "%"), 3600.0,
            patterns=("octave", "recommended"), tips=["sphere:10"], seed=int(name == "c"),
        )  # fmt: skip
        texts.append([file.read_bytes() for file in report.files])
    assert texts[0] == texts[1]
    assert all(x != y for x, y in zip(texts[0], texts[2], strict=True))
    first, second = (load_protocol(str(file))[0] for file in report.files)
    assert (first.name, second.name) == ("pair-octave", "pair-recommended")
    assert first.list_presses() == second.list_presses()
    assert first.specimen.model_copy(update={"pattern": "recommended"}) == second.specimen
    for side in (first, second):
        assert side.promise is not None
        assert side.promise.digest == side.digest
        assert "sensors a side" in side.promise.rests_on[0]


@pytest.mark.slow
def test_mean_plan_repeats(tmp_path: Path) -> None:
    texts = []
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        report = write_plan(
            tmp_path / name / "night.toml", "depth", "virtual", 4.0, (50.0, "%"), 3600.0,
            tips=["sphere:10"],
        )  # fmt: skip
        texts.append(report.files[0].read_bytes())
    assert texts[0] == texts[1]
    promise = load_protocol(str(report.files[0]))[0].promise
    assert promise is not None
    assert promise.measure == "mean depth error"
    assert promise.interval[0] < promise.error < promise.interval[1]
    assert all(line.endswith(": assumed") for line in promise.rests_on)


def test_contradicting_goals_are_refused(tmp_path: Path) -> None:
    file, rest = tmp_path / "x.toml", ("virtual", 4.0)
    with pytest.raises(InputError, match=r"--difference 0\.1N: tracking is in mm; or use %"):
        write_plan(file, "tracking", *rest, (0.1, "N"), 60.0, patterns=("octave", "dense"))
    with pytest.raises(InputError, match="octave and octave: two sides of one name"):
        write_plan(file, "tracking", *rest, (10, "%"), 60.0, patterns=("octave", "octave"))
    (tmp_path / "x-dense.toml").write_text("")
    with pytest.raises(InputError, match=r"x-dense.toml: already exists"):
        write_plan(file, "tracking", *rest, (10, "%"), 60.0, patterns=("octave", "dense"))
    rigs = shipped_folder("protocols") / "rigs"
    camera = f'[camera]\nsource = 0\nmodel = "{rigs}/cameras/fisheye.toml"\n'
    (tmp_path / "bench.toml").write_text((rigs / "grbl-bench.toml").read_text() + camera)
    goal = replace(GOAL, rig=str(tmp_path / "bench.toml"))
    pilot = Pilot(ErrorComponents.assume(0, ASSUMED_FIGURES["depth"]), {})
    with pytest.raises(
        InputError, match=r"bench.toml: no truth of the depth; a virtual rig has it"
    ):
        MeanPlanner(goal, pilot, "depth")
