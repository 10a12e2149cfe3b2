"""What the guard would stop is known before anything moves."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from deltact_fab.bench.protocols import plan
from deltact_fab.bench.rig import config
from deltact_fab.bench.rig.force.guard import GuardLimits
from deltact_fab.common import catalog
from deltact_fab.common.checks import Check
from deltact_fab.common.errors import InputError
from deltact_fab.fabricate.cad.design import load_design
from deltact_fab.simulate.experiment.request import RunRequest
from deltact_fab.simulate.preflight.peaks import Peak, predict_peaks
from deltact_fab.simulate.preflight.rule import ForceLimits, force_checks, limits_of, stop_checks

SENSOR = load_design("deltact")
KEYS = ("[guard] force_n", "the guard, 0.8 of [force] range_nmm")


@pytest.fixture(scope="module")
def peaks() -> list[Peak]:
    found = predict_peaks(plan.load_protocol("smoke")[0], SENSOR, (0.0, 0.0, 0.0))
    assert found is not None
    return found


def limits(guard: GuardLimits, simulated: bool = False) -> ForceLimits:
    return ForceLimits(
        simulated=simulated,
        source="my-bench.toml",
        stage_n=(60.0, 60.0, 60.0),
        has_sensor=True,
        sensor_n=(25.0, 25.0, 35.0),
        sensor_nmm=(250.0, 250.0, 250.0),
        origin_mm=(0.0, 0.0, 0.0),
        guard=guard,
        guard_keys=KEYS,
    )


def over(peaks: list[Peak], limits: ForceLimits) -> list[Check]:
    return [row for row in force_checks(peaks, limits) if row.status == "warn" or row.failed]


def test_certain_guard_trip_is_refused(peaks: list[Peak]) -> None:
    normal_n = max(p.normal_n for p in peaks)
    assert over(peaks, limits(GuardLimits((20.0, 20.0, 28.0), (200.0,) * 3))) == []

    near = limits(GuardLimits((20.0, 20.0, 1.5 * normal_n), (200.0,) * 3))
    (row,) = over(peaks, near)
    assert (row.name, row.failed, row.value > row.limit) == ("guard", False, True)
    assert "normal force with twice the modulus, [guard] force_n (N)" in row.reason

    tight = limits(GuardLimits((20.0, 20.0, 0.9 * normal_n), (200.0,) * 3))
    (row,) = over(peaks, tight)
    assert row.failed
    assert row.subject.startswith("normal force as predicted, [guard] force_n (N)")
    with pytest.raises(InputError, match=r"guard: normal force as predicted, \[guard\]"):
        Check.require([row], "bench.toml")
    (row,) = over(peaks, replace(tight, simulated=True))
    assert not row.failed


def test_every_guard_limit_is_compared(peaks: list[Peak]) -> None:
    for guard, words in (
        (GuardLimits((20.0, 0.1, 28.0)), "tangential force"),
        (GuardLimits((20.0, 20.0, 28.0), resultant_n=1.0), "[guard] resultant_n"),
        (GuardLimits((20.0, 20.0, 28.0), (1e-3,) * 3), "0.8 of [force] range_nmm"),
    ):
        lines = [row.reason for row in over(peaks, limits(guard)) if row.failed]
        assert lines
        assert any(words in line for line in lines)
        assert not any("\n" in line for line in lines)


def test_only_a_real_rig_has_guard(tmp_path: Path) -> None:
    smoke = plan.load_protocol("smoke")[0]
    virtual = config.load_rig("virtual")[0]
    assert limits_of(virtual, "virtual.toml", smoke).guard is None
    rig = tmp_path / "bench.toml"
    text = catalog.find_file("protocols/rigs", "virtual").read_text().partition("[virtual.")[0]
    text = text.replace('kind = "virtual"', 'kind = "grbl"').replace(
        "[stage]", '[stage]\nport = "/dev/null"'
    )
    text += '[force.netft]\nhost = "192.0.2.1"\n'
    rig.write_text(text)
    armed = limits_of(config.load_rig(str(rig))[0], "bench.toml", smoke)
    assert armed.guard == GuardLimits((20.0, 20.0, 28.0), (200.0, 200.0, 200.0))
    assert armed.guard_keys[0] == "the guard, 0.8 of [force] range_n"
    rig.write_text(text + "[guard]\nforce_n = 2.0\n")
    found = limits_of(config.load_rig(str(rig))[0], "bench.toml", smoke)
    assert found.guard is not None
    assert found.guard_keys[0] == "[guard] force_n"
    _, rows = RunRequest("smoke", str(rig)).forces() or ([], [])
    assert any("[guard] force_n" in row.subject for row in rows if row.failed)
    rig.write_text(text + "[guard]\nforce_n = 30.0\n")
    with pytest.raises(InputError, match=r"bench.toml: guard: the limit 30 of Fx"):
        RunRequest("smoke", str(rig)).forces()


@pytest.mark.parametrize(
    ("trip_n", "range_n", "press", "approach"),
    [(2.0, 90.0, "pass", "pass"), (5.0, 70.0, "pass", "warn"), (60.0, 60.2, "fail", "warn")],
)
def test_late_stop_is_held_against_ranges(
    peaks: list[Peak], trip_n: float, range_n: float, press: str, approach: str
) -> None:
    protocol = plan.load_protocol("smoke")[0]
    steps = [
        replace(step, feed_mm_min=1200.0) if step.kind == "approach" else step
        for step in plan.expand_protocol(protocol)
    ]
    stage = config.load_rig("virtual")[0].stage
    stage = stage.model_copy(update={"acceleration_mm_s2": (100.0,) * 3})
    guarded = replace(limits(GuardLimits((trip_n,) * 3)), sensor_n=(range_n,) * 3, stage_n=None)
    rows = {row.id: row for row in stop_checks(peaks, steps, stage, guarded)}
    assert (rows["stop.press"].status, rows["stop.approach"].status) == (press, approach)
    assert "approach at 1200 mm/min stopped 3.20 mm late" in rows["stop.approach"].reason
    assert stop_checks(peaks, steps, stage, replace(guarded, guard=None)) == []
