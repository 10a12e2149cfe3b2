"""The shipped protocols of the force calibration are what they say."""

from __future__ import annotations

import collections

import pytest

from deltact_fab.bench.protocols import limits, plan
from deltact_fab.bench.rig import config
from deltact_fab.fabricate.cad.design import load_design
from deltact_fab.sensor.shapes.indenter import parse_indenter
from deltact_fab.simulate.virtual.presses import Presses

NAMES = ("force-calibration", "force-calibration-small", "twist", "ball-press")


@pytest.mark.parametrize("name", NAMES)
def test_calibration_protocols_pass_every_check(name: str) -> None:
    protocol, _ = plan.load_protocol(name)
    rig, _ = config.load_rig("virtual")
    rows = limits.check_limits(protocol, load_design(protocol.specimen.design), rig.stage)
    assert [row for row in rows if row.status != "pass"] == []
    assert protocol.specimen.gel_model == "hyperelastic"


def test_full_calibration_has_papers_points() -> None:
    steps = plan.expand_protocol(plan.load_protocol("force-calibration")[0])
    settled = collections.Counter(s.press for s in steps if s.settled)
    assert len(settled) == 9 * 5
    assert set(settled.values()) == {46}  # one at rest, and 5 depths x 9 offsets
    assert settled.total() == 2070


def test_four_of_nine_positions_solved() -> None:
    protocol, _ = plan.load_protocol("force-calibration")
    rig, _ = config.load_rig("virtual")
    assert rig.kind == "virtual"
    presses = Presses(protocol, load_design("deltact").skin, rig.virtual.gel)
    solved = {presses.planned_press(path).solver.stored_as for path in presses.paths}
    assert len(presses.paths) == 45
    assert len(solved) == 20


def test_twist_pulls_both_ways_around_centre() -> None:
    protocol, _ = plan.load_protocol("twist")
    (ball,) = protocol.indenters
    (depth,) = protocol.depths_mm
    steps = plan.expand_protocol(protocol)
    for number, (x, y) in enumerate(protocol.positions_mm, start=1):
        arms = [
            (x * (s.target_mm[1] - y) - y * (s.target_mm[0] - x)) / (x * x + y * y) ** 0.5
            for s in steps
            if s.press.endswith(f"/p{number}") and s.kind == "shear"
        ]
        most = 2**0.5 * 0.4 * depth
        assert max(arms) > 0.95 * most
        assert min(arms) < -0.95 * most
    assert parse_indenter(ball).name == "sphere:15"
