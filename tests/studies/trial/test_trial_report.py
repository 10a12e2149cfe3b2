"""Verdicts of a trial: goal reached as often as promised, noise that stands for images."""

from __future__ import annotations

import numpy as np
import pytest

from deltact_fab.bench.protocols.tables import Promise
from deltact_fab.common import validate
from deltact_fab.common.errors import InputError
from deltact_fab.studies.trial.figures import compare_drawn
from deltact_fab.studies.trial.report import ImageCheck, TrialReport, share_interval
from deltact_fab.studies.trial.start import try_plan


def report(reached: int, chance: float, ratio: float = 1.0, failed: int = 0) -> TrialReport:
    """100 sensors, with errors of 0.05 N where the goal of 0.1 N is reached, else of 0.2 N."""
    promise = validate(Promise, {
        "measure": "normal force", "unit": "N", "goal": 0.1, "error": 0.06,
        "interval": [0.04, 0.12], "chance": chance,
    }, "promise")  # fmt: skip
    figures = [0.05] * reached + [0.2] * (100 - reached - failed)
    rng = np.random.default_rng(0)
    images = 0.05 * np.exp(0.02 * rng.standard_normal(10))
    noise = ratio * images * np.exp(0.02 * rng.standard_normal(10))
    return TrialReport(
        "night", promise, reached, 100, "sensors", dict(enumerate(figures, start=1)),
        {100 - k: "too few" for k in range(failed)}, ImageCheck(images.tolist(), noise.tolist()),
    )  # fmt: skip


@pytest.mark.parametrize(
    ("reached", "chance", "kept"),
    [(84, 0.86, True), (50, 0.86, False), (99, 0.86, False), (100, 1.0, True), (0, 0.02, True)],
)
def test_promise_beside_share_reached(reached: int, chance: float, kept: bool) -> None:
    trial = report(reached, chance)
    assert trial.as_promised == kept
    assert ("NOT as promised" in trial.lines[0]) != kept
    assert trial.as_dict()["as_promised"] == kept
    assert f"by {reached} of 100 sensors" in trial.lines[0]


def test_sensor_without_error_misses_goal() -> None:
    trial = report(60, 0.6, failed=40)
    assert "by 60 of 100 sensors" in trial.lines[0]
    assert trial.lines[-1].endswith(": too few")


def test_interval_of_share_is_exact() -> None:
    low, high = share_interval(95, 100)  # Clopper and Pearson, tables: 0.887 to 0.984
    assert (low, high) == (pytest.approx(0.887, abs=5e-4), pytest.approx(0.984, abs=5e-4))


@pytest.mark.parametrize(("ratio", "equal"), [(1.0, True), (1.05, True), (1.2, False)])
def test_noise_beside_images(ratio: float, equal: bool) -> None:
    trial = report(90, 0.9, ratio)
    assert trial.images is not None
    assert trial.images.equal is equal
    assert trial.images.ratio[0] == pytest.approx(ratio - 1, abs=0.03)
    assert ("equal within 10%: yes" in trial.lines[2]) == equal
    assert ("equal within 10%: NO" in trial.lines[2]) == (not equal)


def test_few_sensors_show_nothing() -> None:
    line = ImageCheck([0.02, 0.05], [0.03, 0.04]).line
    assert line.endswith("equal within 10%: not shown")


def test_sensors_in_promised_interval() -> None:
    trial = report(84, 0.86)
    assert trial.in_interval == trial.as_dict()["in_interval"] == 84


def test_planted_difference_between_drawn_sides() -> None:
    pool = np.exp(0.1 * np.random.default_rng(1).standard_normal(60))
    found, invented = compare_drawn(pool, 5, 1.5, 200, True)
    assert found >= 195
    assert invented <= 16
    assert compare_drawn(pool, 5, 1.0, 200, True)[0] <= 16
    found, invented = compare_drawn(pool, 5, 0.5, 200, False)
    assert found >= 190
    with pytest.raises(InputError, match="60 sensors with a figure; two sides need 62"):
        compare_drawn(pool, 31, 1.5, 1, True)


def test_protocol_without_promise_is_refused() -> None:
    with pytest.raises(InputError, match=r"no \[promise\]; write a plan with `protocol plan`"):
        try_plan("smoke", "virtual", 2)
