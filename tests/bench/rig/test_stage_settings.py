"""A controller's settings against the rig file: every rule once, on the simulated controller."""

from __future__ import annotations

import math
from typing import Any

import pytest

from deltact_fab.bench.rig import config
from deltact_fab.bench.rig.stage.grbl import GrblStage
from deltact_fab.bench.rig.stage.settings import Limits, check_settings
from deltact_fab.common import catalog
from deltact_fab.common.errors import StageError
from deltact_fab.sensor.optics.camera import StageFrame
from deltact_fab.simulate.virtual import wire
from deltact_fab.simulate.virtual.clock import VirtualClock
from deltact_fab.simulate.virtual.controller import GrblController
from deltact_fab.simulate.virtual.grbl_lines import DEFAULTS_GRBL, grbl_settings

STAGE = {
    "origin_machine_mm": (-60.0, -60.0, -40.0),
    "travel_mm": (120.0, 120.0, 60.0),
    "max_feed_mm_min": (1500.0, 1500.0, 1200.0),
    "acceleration_mm_s2": (50.0, 50.0, 50.0),
}


class Built(GrblController):
    """A controller whose firmware was built with other options, or which says less."""

    options = ""
    unsaid = b"nothing"

    def take_output(self) -> list[tuple[int, bytes]]:
        said = [(t, d.replace(b"[OPT:V", b"[OPT:V%b" % self.options.encode()))
                for t, d in super().take_output()]  # fmt: skip
        return [(t, d) for t, d in said if not d.startswith(self.unsaid)]


def connected(
    settings: dict[int, float], options: str = "", unsaid: bytes = b"no", **file: object
) -> GrblStage:
    clock = VirtualClock()
    grbl = Built({1: 255, **settings}, clock)
    grbl.options, grbl.unsaid = options, unsaid
    trace: list[wire.WireExchange] = []
    link = wire.SerialLink(grbl, clock, trace=trace)
    stage = GrblStage.from_config(config.StageConfig(**{**STAGE, **file}), clock, link)  # type: ignore[arg-type]
    try:
        stage.connect()
    finally:
        sent = [d for _, who, d in trace if who == "host"]
        assert sent[:2] == [b"$I\n", b"$$\n"]  # nothing was changed, nothing moved
        assert sent[2:] in ([], [b"?"])
        assert stage.identity()["settings"]["$100"] == 800.0
    return stage


@pytest.mark.parametrize(
    ("settings", "said", "other"),
    [(*row, {}) for row in (
        ({10: 2}, r"\$10=2 \(status reports give the work position\); set \$10=1 or \$10=3"),
        ({13: 1}, r"\$13=1 \(status reports are in inches\); set \$13=0"),
        ({20: 0}, r"\$20=0 \(soft limits are off\); set \$20=1"),
        ({21: 0}, r"\$21=0 \(hard limits are off.*\); set \$21=1"),
        ({22: 0, 20: 1}, r"\$22=0 \(homing is off\); set \$22=1"),
        ({22: 9}, r"\$22=9 \(homing sets 0 where it ends.*\); set \$22=1 "),
        ({23: 4}, r"\$23=4 \(axes homing at the negative end: Z\).* set \$23=0"),
        ({3: 1}, r"\$3=1 \(reversed axes: X\), and the rig file says 0 \(none\).* set \$3=0"),
        ({27: 0}, r"\$27=0 mm; not > 0"),
        ({27: 2}, r"\$27=2 mm, and \[stage\] pull_off_mm is 1: .*set \$27=1, or pull_off_mm = 2"),
        ({32: 1}, r"\$32=1 \(laser or lathe mode\); set \$32=0"),
        ({122: 0}, r"\$122=0 mm/s2; not > 0"),
        ({111: 1000}, r"Y has 1000 mm/min \(\$111\); 1500 needed: set \$111=1500 if "),
        ({120: 0.5}, r"X has 0.5 mm/s2 \(\$120\); 50 needed: .* less in \[stage\] acceleration"),
        ({132: 45}, r"Z has 45 mm of travel \(\$132\); 60 needed: .* less in \[stage\] travel_mm"),
        ({21: 0, 3: 1, 32: 1}, r"\$21=0 .*\(and 2 more: see `rig check`\)$"),
    )] + [
        ({}, r"\[OPT:VZ\.\.\.\] .*HOMING_FORCE_SET_ORIGIN.*; flash", {"options": "Z"}),
        ({}, r"\[OPT:VL\.\.\.\] .*HOMING_INIT_LOCK.*; flash", {"options": "L"}),
        ({}, r"the answer to \$\$ lacks \$32$", {"unsaid": b"$32"}),
        ({}, r"\$3=0 .* the rig file says 5 \(X, Z\).* set \$3=5", {"direction_mask": 5}),
    ],
)  # fmt: skip
def test_each_violation_is_refused(
    settings: dict[int, float], said: str, other: dict[str, Any]
) -> None:
    with pytest.raises(StageError, match=said) as why:
        connected(settings, **other)
    assert "\n" not in str(why.value)


def test_hal_unlocked_at_start_is_refused() -> None:
    said = ["[OPT:V,15,128]", "[FIRMWARE:grblHAL]"]
    (row,) = check_settings({**DEFAULTS_GRBL, 1: 255, 22: 1}, said, None)
    assert (row.id, row.status) == ("stage.lock", "fail")
    assert str(row.value).startswith("$22=1 (not locked at start")
    assert "set $22=5" in row.value
    assert not check_settings({**DEFAULTS_GRBL, 1: 255, 22: 5}, said, None)


def test_declared_direction_masks_are_accepted() -> None:
    assert not connected({3: 5, 23: 3}, direction_mask=5, homing_direction_mask=3).setting_checks


def test_faster_controller_accepted_travel_of_file() -> None:
    stage = connected({110: 6000, 120: 500, 132: 200})
    assert not stage.setting_checks
    stage.home()
    with pytest.raises(Exception, match=r"target Z -60\.500 mm .* outside of -60 \.\. -1"):
        stage.start_move((0.0, 0.0, -20.5), 600.0)


def test_motors_off_at_rest_are_warned() -> None:
    (row,) = connected({1: 25}).setting_checks
    assert row.status == "warn"
    assert row.value.endswith("set $1=255 unless the screws are self-locking")


@pytest.mark.parametrize("name", catalog.catalogue_names("protocols/rigs"))
def test_shipped_rigs_pass(name: str) -> None:
    stage = config.load_rig(name)[0].stage
    own = grbl_settings(stage.travel_mm, stage.max_feed_mm_min, stage.acceleration_mm_s2)
    assert {row.status for row in check_settings(own, [], stage)} == {"warn"}  # of motors that rest


# A position's time: when the controller read it, not when the host came to hear of it.

FRAME = StageFrame((-60.0, -50.0, -40.0), angle_deg=30.0, tilt_deg=(0.5, -1.0))
ROUNDING_MM = 0.002  # half a step and half a digit of the report, on three axes


@pytest.mark.parametrize("baud", [9600, 115200, 1_000_000])
def test_pose_in_motion_matches_its_time(baud: int) -> None:
    clock = VirtualClock(1234.5)
    grbl = GrblController(None, clock)
    link = wire.SerialLink(grbl, clock, baud=baud)
    stage = GrblStage(link, clock, FRAME, baud=baud)
    stage.connect()
    stage.home()
    stage.start_move((0.0, 0.0, 5.0), 1200.0)
    before_ns = 0
    for _ in range(30):
        clock.sleep_s(0.0713)
        t_ns, position_mm = stage.timed_position()
        assert before_ns < t_ns < clock.now_ns()
        before_ns = t_ns
        truth_mm = FRAME.to_sensor_mm(grbl.position_mm(t_ns / 1e9))
        assert math.dist(position_mm, truth_mm) < ROUNDING_MM
    assert stage.identity()["pose_within_s"] < 1e-6  # nothing else is on the wire
    stage.stop()


@pytest.mark.parametrize("way", [(1.0, 0.0, 0.0), (-1.0, 0.0, 0.0), (0.0, 0.0, -1.0)])
def test_excessive_feed_refused_in_any_direction(way: tuple[float, float, float]) -> None:
    limits = Limits(
        grbl_settings(STAGE["travel_mm"], STAGE["max_feed_mm_min"], STAGE["acceleration_mm_s2"])
    )
    assert "its limit is 1" in limits.feed_refusal(way, 1600.0)
    assert limits.feed_refusal(way, 1100.0) == ""
