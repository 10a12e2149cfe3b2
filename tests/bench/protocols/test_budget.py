"""What a protocol takes is refused before anything moves: time, disk, frames a second, feeds."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest
from click.testing import CliRunner

from deltact_fab.app.cli.main import main
from deltact_fab.bench.protocols import limits, plan
from deltact_fab.bench.protocols.plan import Protocol
from deltact_fab.bench.rig import config
from deltact_fab.common.checks import Check
from deltact_fab.common.errors import InputError
from deltact_fab.simulate.experiment.request import RunRequest
from deltact_fab.simulate.experiment.session import run_experiment
from deltact_fab.simulate.preflight.rule import budget_checks

SMOKE = plan.load_protocol("smoke")[0]


def declare(**changes: object) -> Protocol:
    """Smoke with some tables' keys changed."""
    data = SMOKE.model_dump()
    for name, value in changes.items():
        data[name] = {**data[name], **value} if isinstance(value, dict) else value
    return Protocol.model_validate(data)


def rows(protocol: Protocol, out: Path, **more: object) -> dict[str, Check]:
    box = config.load_rig("virtual")[0].stage
    estimate = limits.RunEstimate.from_protocol(protocol, 1280 * 720, box)
    arguments: dict[str, object] = {"held_hz": 50.0, **more}
    found = budget_checks(protocol, plan.expand_protocol(protocol), estimate, out, **arguments)  # type: ignore[arg-type]
    return {row.name: row for row in found}


def test_feeds_beyond_firmware_are_refused(tmp_path: Path) -> None:
    assert not rows(declare(motion={"press_feed_mm_min": 1.0}), tmp_path)["least feed"].failed
    found = rows(declare(motion={"press_feed_mm_min": 0.99}), tmp_path)["least feed"]
    assert found.failed
    assert (found.sign, found.limit) == (">=", 1.0)
    with pytest.raises(InputError, match=r"p\.toml: least feed: feed \(mm/min\) 0\.99 < 1 at"):
        Check.require([found], "p.toml")


def test_days_warn_and_months_fail(tmp_path: Path) -> None:
    hour = declare(capture={"settle_s": 600.0})
    steps, estimate = (
        plan.expand_protocol(hour),
        limits.RunEstimate.from_protocol(hour, 1, config.load_rig("virtual")[0].stage),
    )
    for days, ok, warns in ((0.9, True, False), (2, True, True), (31, False, False)):
        taken = replace(estimate, seconds=days * 86400)
        found = budget_checks(hour, steps, taken, tmp_path, None)[1]
        assert (not found.failed, found.status == "warn") == (ok, warns), days
        assert found.value == pytest.approx(24 * days)


def test_run_folders_disk_is_checked(tmp_path: Path) -> None:
    found = rows(SMOKE, tmp_path / "run")["disk"]
    assert str(tmp_path) in found.basis[0]
    box = config.load_rig("virtual")[0].stage
    huge = replace(limits.RunEstimate.from_protocol(SMOKE, 1, box), disk_mb=3.5e9)
    found = budget_checks(SMOKE, plan.expand_protocol(SMOKE), huge, tmp_path, None)[2]
    assert found.failed
    assert found.value > found.limit
    there = budget_checks(SMOKE, plan.expand_protocol(SMOKE), huge, tmp_path, None, kept_mb=3.5e9)[
        2
    ]
    assert there.value == 0.0  # what a run that goes on has already is not needed again


def test_a_rate_that_cannot_be_kept(tmp_path: Path) -> None:
    fast = declare(capture={"rate_hz": 51.0})
    assert rows(fast, tmp_path)["camera rate"].failed
    waits = rows(fast, tmp_path, wall_clock=False)["camera rate"]
    assert waits.status == "warn"
    assert "camera rate" not in rows(fast, tmp_path, held_hz=None)


def test_check_lists_and_run_refuses(tmp_path: Path) -> None:
    text = plan.load_protocol("smoke")[1].read_text()
    slow = tmp_path / "slow.toml"
    slow.write_text(text.replace("press_feed_mm_min = 30.0", "press_feed_mm_min = 0.5"))
    done = CliRunner().invoke(main, ["protocol", "check", str(slow), "--air", "--json"])
    assert done.exit_code == 1
    found = {row["name"]: row["ok"] for row in json.loads(done.stdout)}
    assert not found["least feed"]
    assert {"time", "disk", "camera rate"} <= found.keys()
    with pytest.raises(InputError, match="least feed"):
        run_experiment(RunRequest(str(slow), "virtual", tmp_path / "run"))
    assert not (tmp_path / "run").exists()
