"""Presses on drawn sensors: interpolated gels against their own solution, noise against images."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from deltact_fab.bench import VirtualConfig
from deltact_fab.common import find_file
from deltact_fab.common.errors import InputError
from deltact_fab.simulate import RunRequest
from deltact_fab.studies.study.stream import PressStream
from deltact_fab.studies.trial import figures
from deltact_fab.studies.trial.flows import add_noise, settled_stops, track_stops, true_shifts_mm
from deltact_fab.studies.trial.gels import DrawnPress, _lagrange
from deltact_fab.studies.trial.start import try_plan

POPULATION = """
[virtual.population]
modulus = 0.08
poisson = 0.004
thickness_mm = 0.2
sticker_mm = 0.2
camera_mm = 0.1
"""
PRESS = '{{indenter = "sphere:10", x_mm = {}, y_mm = {}, depth_mm = {}, shear_x_mm = {}{}}}'
FIT = [(2.0, 1.0, 0.8, 0.2), (-4.0, 3.0, 0.6, -0.2), (0.0, -3.0, 0.7, 0.1), (5.0, 0.0, 0.8, -0.1)]
TEST = [(3.0, -2.0, 0.7, 0.15), (-2.0, -1.0, 0.8, 0.1)]
KEYS = """
name = "tried"
channels = ["image", "force", "shear"]
press = [{}]
[capture]
rate_hz = 3.0
settle_s = 1.0
"""
PROMISE = """
[promise]
measure = "normal force"
unit = "N"
goal = 0.1
error = 0.05
interval = [0.01, 0.2]
chance = 0.9
"""


def write(folder: Path, promise: str = PROMISE, population: str = POPULATION) -> tuple[str, str]:
    """Write a plan and a rig with a coarse gel."""
    rows = [PRESS.format(*press, "") for press in FIT]
    rows += [PRESS.format(*press, ', role = "validate"') for press in TEST]
    plan, rig = folder / "tried.toml", folder / "sensors.toml"
    plan.write_text(KEYS.format(", ".join(rows)) + promise)
    text = find_file("protocols/rigs", "virtual").read_text()
    rig.write_text(text.replace("[virtual.gel]", "[virtual.gel]\nspacing_mm = 1.0") + population)
    return str(plan), str(rig)


def drawn(folder: Path, level: str = "linear") -> DrawnPress:
    request = RunRequest(*write(folder))
    assert isinstance(request.rig, VirtualConfig)
    return DrawnPress(
        request.protocol, "sphere-10/p1", request.design, request.rig, request.rig_path,
        level,  # type: ignore[arg-type]
    )  # fmt: skip


def test_quadratic_through_three_gels() -> None:
    nodes = [0.49, 0.482, 0.498]
    values = [3 * x**2 - x + 1 for x in nodes]
    for x in (0.475, 0.4885, 0.49, 0.499):
        weights = [*_lagrange(nodes, x)]
        assert np.dot(weights, values) == pytest.approx(3 * x**2 - x + 1, abs=1e-9)


@pytest.mark.slow
def test_interpolated_gel_equals_its_solution(tmp_path: Path) -> None:
    press = drawn(tmp_path)
    for number in (1, 4):
        between = press.on_sensor(number)
        solved = PressStream(
            between.protocol, press.press, press.sensor, press.rig, press.source,
            draw=press.draw(number),
        )  # fmt: skip
        moment = [*settled_stops(between)][-1]
        first, second = (stream.displacement_mm(moment) for stream in (between, solved))
        assert np.abs(first - second).max() < 2e-3
        np.testing.assert_allclose(
            between.wrench(moment), solved.wrench(moment), rtol=2e-3, atol=5e-3
        )


@pytest.mark.slow
def test_noise_is_that_of_the_images(tmp_path: Path) -> None:
    press = drawn(tmp_path)
    first, second = (press.on_sensor(number) for number in (1, 2))
    assert [*settled_stops(first).values()] == ["travel", "press", "shear"]
    recipe = RunRequest(*write(tmp_path)).recipe
    flows, true_mm = track_stops(first, recipe, 1), true_shifts_mm(first)
    again = add_noise(true_mm, flows, true_mm)
    for flow, same, mm in zip(flows, again, true_mm, strict=True):
        np.testing.assert_allclose(same.shift_mm, flow.shift_mm, atol=1e-6)
        assert same.known is flow.known
        inside = flow.shift_mm[flow.known] - mm[flow.known]
        assert np.sqrt((inside**2).sum(axis=1).mean()) < 0.02  # 0.4 px
    other = add_noise(true_shifts_mm(second), flows, true_mm)
    assert not np.allclose(other[1].shift_mm, flows[1].shift_mm, atol=1e-4)


@pytest.mark.slow
def test_trial_of_a_plan(tmp_path: Path) -> None:
    spoken: list[str] = []
    plan, rig = write(tmp_path)
    trial = try_plan(plan, rig, 12, say=spoken.append)
    assert spoken[0].startswith("6 presses on 12 sensors, ")
    assert len(trial.figures) == 12
    assert len(trial.images.by_images) == 10
    assert 0 < max(trial.figures.values()) < 0.5
    value, low, high = trial.images.ratio
    assert abs(value) < 0.3
    assert low < value < high
    again = try_plan(plan, rig, 12)
    assert again.figures == trial.figures


@pytest.mark.parametrize(
    ("promise", "population", "says"),
    [("", POPULATION, r"tried.toml: no \[promise\]"),
     (PROMISE, "", r"sensors.toml: no \[virtual.population\] that")],
)  # fmt: skip
def test_faulty_trial_is_refused(tmp_path: Path, promise: str, population: str, says: str) -> None:
    with pytest.raises(InputError, match=says):
        try_plan(*write(tmp_path, promise, population), 2)


@pytest.mark.slow
def test_trials_of_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A mean error on two sensors; a comparison of two a side, out of four."""
    monkeypatch.setattr(figures, "POOL_SIZE", 4)
    text = PROMISE.replace("normal force", "mean tracking error").replace('"N"', '"%"')
    plan, rig = write(tmp_path, text.replace("0.1\n", "80.0\n", 1))
    Path(plan).write_text(Path(plan).read_text().replace("rate_hz = 3.0\n", ""))
    trial = try_plan(plan, rig, 2)
    assert trial.trials == len(trial.figures) == trial.reached == 2
    assert all(0 < figure < 80 for figure in trial.figures.values())
    with pytest.raises(InputError, match="--gel hyperelastic: of a force calibration only"):
        try_plan(plan, rig, 2, gel="hyperelastic")
    named = Path(plan).read_text().replace("mean tracking error", "difference of tracking")
    Path(plan).write_text(f"{named}sensors = 2\n")
    compared = try_plan(plan, rig, 20)
    assert compared.trials == 20
    assert len(compared.figures) == 4
    assert compared.invented is not None
    assert compared.invented <= 10
    assert compared.reached >= compared.invented
