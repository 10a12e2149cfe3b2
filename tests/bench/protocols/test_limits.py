"""Static checks: each one passes at its bound, fails past it, and names the step."""

from __future__ import annotations

import pytest

from deltact_fab.bench.protocols import limits, plan
from deltact_fab.bench.protocols.motion import StageConfig
from deltact_fab.bench.protocols.plan import Protocol, Step
from deltact_fab.common.checks import Check
from deltact_fab.common.errors import InputError
from deltact_fab.sensor.shapes.sensor import SensorDimensions, SkinDimensions

SENSOR = SensorDimensions()
BOX = StageConfig(
    origin_machine_mm=(-60.0, -60.0, -40.0), travel_mm=(120.0, 120.0, 60.0),
    max_feed_mm_min=(1500.0,) * 3, acceleration_mm_s2=(50.0,) * 3,
)  # fmt: skip


def protocol(**changes: object) -> Protocol:
    smoke, _ = plan.load_protocol("smoke")
    return Protocol.model_validate(smoke.model_dump() | changes)


def row(rows: list[Check], what: str) -> Check:
    return next(r for r in rows if what in r.subject)


@pytest.mark.parametrize(("depth", "ok"), [(11.0, True), (11.001, False)])
def test_depth_against_the_gel(depth: float, ok: bool) -> None:
    rows = limits.check_limits(protocol(depths_mm=[depth], indenters=["sphere:22"]), SENSOR, BOX)
    found = row(rows, "depth (mm)")
    assert found.failed is not ok
    assert found.limit == 11.0


@pytest.mark.parametrize(("depth", "ok"), [(12.0, True), (12.001, False)])
def test_depth_against_the_tip(depth: float, ok: bool) -> None:
    """Tips and shanks are 12 mm long; a thicker gel would let them be pressed further."""
    thick = SensorDimensions(SkinDimensions(thickness_mm=20.0))
    rows = limits.check_limits(protocol(depths_mm=[depth]), thick, BOX)
    assert not row(rows, "depth (mm)").failed
    found = row(rows, "free length")
    assert found.failed is not ok
    assert found.basis[0].startswith("sphere-10/")  # all are equally long: the first


@pytest.mark.parametrize(("x", "ok"), [(10.0, True), (10.001, False)])
def test_footprint_and_shear_stay_on_skin(x: float, ok: bool) -> None:
    moved = protocol(positions_mm=[[x, 0.0]], indenters=["sphere:10"])
    assert (
        row(limits.check_limits(moved, SENSOR, BOX), "reach in x").failed is not ok
    )  # 10 + 3 + 5 = 18


def test_travel_in_the_machine_frame() -> None:
    high = BOX.model_copy(update={"origin_machine_mm": (-60.0, -60.0, -19.0)})
    found = row(limits.check_limits(protocol(), SENSOR, high), "machine z")
    assert found.failed  # parked 20 mm above a face that is 19 mm below the top
    low = BOX.model_copy(update={"origin_machine_mm": (-60.0, -60.0, -59.1)})
    assert row(limits.check_limits(protocol(), SENSOR, low), "machine -z").failed


def test_travel_includes_stage_rotation() -> None:
    turned = BOX.model_copy(update={"origin_machine_mm": (-2.0, -60.0, -40.0), "angle_deg": 90.0})
    rows = limits.check_limits(protocol(), SENSOR, turned)
    assert row(rows, "machine x").failed  # shear in -y becomes +x there: 3 > 2


def test_sideways_below_clearance_is_refused() -> None:
    smoke = protocol()
    steps = plan.expand_protocol(smoke)
    bad = Step("x/low", "x", "sphere:10", "travel", (5.0, 0.0, 1.0), 600.0)
    found = row(limits.check_limits(smoke, SENSOR, BOX, [steps[0], bad]), "sideways")
    assert found.failed
    assert found.basis[0] == "x/low"
    assert found.value == pytest.approx(4.0)


def test_require_names_value_limit_and_step() -> None:
    rows = limits.check_limits(protocol(depths_mm=[11.5], indenters=["sphere:22"]), SENSOR, BOX)
    with pytest.raises(InputError, match=r"p\.toml: depth in the gel: .*11\.5 > 11 at sphere"):
        Check.require(rows, "p.toml")


def test_estimate_counts_frames_time_and_disk() -> None:
    estimate = limits.RunEstimate.from_protocol(protocol(), 798 * 586, BOX)
    steps = plan.expand_protocol(protocol())
    assert estimate.frames == sum(s.frames for s in steps)
    shear_s = 2 * 24 / (30 / 60)
    assert shear_s < estimate.seconds < shear_s + 75
    blind = protocol(channels=["force", "shear"])
    without = limits.RunEstimate.from_protocol(blind, 798 * 586, BOX)
    assert without.disk_mb < estimate.disk_mb / 40
    silent = limits.RunEstimate.from_protocol(protocol(channels=["image", "shear"]), 798 * 586, BOX)
    assert estimate.disk_mb - silent.disk_mb == pytest.approx(0.014 * estimate.seconds)
