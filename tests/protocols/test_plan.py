"""Expansion: ids, order, legs, frames."""

from __future__ import annotations

import math

import pytest

from deltact_fab import catalog
from deltact_fab.errors import InputError
from deltact_fab.protocols import plan
from deltact_fab.protocols.plan import Protocol


def declare(**changes: object) -> Protocol:
    data: dict[str, object] = {
        "name": "t",
        "indenters": ["sphere:10"],
        "positions_mm": [[1.0, -2.0], [3.0, 0.0]],
        "depths_mm": [0.5, 1.0],
        "channels": ["image", "shear"],
        "shear": {"amplitude_mm": 2.0},
        "capture": {"mode": "sweep", "rate_hz": 2.0},
    }
    return catalog.validate(Protocol, data | changes, "t.toml")


def test_ids_are_unique_and_do_not_depend_on_what_comes_after() -> None:
    both = [s.id for s in plan.expand(declare())]
    first = [s.id for s in plan.expand(declare(positions_mm=[[1.0, -2.0]]))]
    assert len(set(both)) == len(both)
    assert both[: len(first)] == first


def test_path_is_connected_and_returns_to_the_centre_after_each_axis() -> None:
    steps = plan.expand(declare())
    shear = [s for s in steps if s.kind == "shear"]
    assert [s.id.rsplit("/", 1)[1] for s in shear[:6]] == [
        "shear-x+", "shear-x-", "shear-x0", "shear-y+", "shear-y-", "shear-y0",
    ]  # fmt: skip
    assert shear[0].target_mm == (3.0, -2.0, -0.5)
    assert shear[1].target_mm == (-1.0, -2.0, -0.5)
    assert shear[2].target_mm == (1.0, -2.0, -0.5)
    assert shear[3].target_mm == (1.0, 0.0, -0.5)


def test_sweep_frames_follow_from_length_feed_and_rate() -> None:
    leg = next(s for s in plan.expand(declare()) if s.id.endswith("shear-x-"))
    assert leg.frames == round(4.0 / (30.0 / 60) * 2.0)


def test_step_mode_reads_each_stop_once_after_settling() -> None:
    protocol = declare(
        capture={"mode": "step", "settle_s": 1.5}, shear={"amplitude_mm": 2.0, "points_per_side": 2}
    )
    press = [s for s in plan.expand(protocol) if s.press == "sphere-10/p1" and s.frames]
    # rest, after, and for two depths the press, 2 axes x (4 stops + the way back)
    assert len(press) == 2 + 2 * (1 + 2 * 5)
    assert {s.frames for s in press} == {1}
    assert {s.settle_s for s in press} == {1.5}
    offsets = [s.target_mm[0] - 1.0 for s in press if "shear-x" in s.id][:5]
    assert offsets == pytest.approx([1.0, 2.0, -1.0, -2.0, 0.0])


def test_outward_goes_away_from_the_centre_first() -> None:
    shear = {"amplitude_mm": 2.0, "first": "outward"}
    places = [[-1.0, 3.0], [0.0, -2.0]]
    sweep = plan.expand(declare(shear=shear, positions_mm=places, depths_mm=[1.0]))
    legs = [s.id.rsplit("/", 1)[1] for s in sweep if s.kind == "shear"]
    assert legs == [
        "shear-x-", "shear-x+", "shear-x0", "shear-y+", "shear-y-", "shear-y0",
        "shear-x+", "shear-x-", "shear-x0", "shear-y-", "shear-y+", "shear-y0",
    ]  # fmt: skip
    assert next(s for s in sweep if s.kind == "shear").target_mm == (-3.0, 3.0, -1.0)
    step = declare(shear=shear, positions_mm=places, capture={"mode": "step"})
    offsets = [s.target_mm[0] + 1.0 for s in plan.expand(step) if "shear-x" in s.id][:5]
    assert offsets == pytest.approx([-1.0, -2.0, 1.0, 2.0, 0.0])


def test_smoke_is_what_the_issue_asks_for() -> None:
    protocol, _ = plan.load("smoke")
    assert protocol.indenters == ("sphere:10", "4dots")
    assert protocol.depths_mm == (1.2,)
    assert protocol.specimen.friction == 0.5
    assert protocol.shear is not None
    assert protocol.shear.amplitude_mm == 3.0


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"depths_mm": [1.0, 0.5]}, ["depths_mm", "strictly increasing"]),
        ({"depths_mm": [math.nan]}, ["depths_mm.0", "finite"]),
        ({"indenters": ["sphere:ten"]}, ["indenters", "sphere:ten", "0.5 to 30"]),
        ({"channels": ["image"]}, ["channels", "needs 'shear'"]),
        ({"channels": ["dots"], "shear": None}, ["channels", "needs 'image'"]),
        ({"depth_mm": [1.0]}, ["depth_mm", "unknown key", "depths_mm"]),
        ({"capture": {"mode": "film"}}, ["capture.mode", "'sweep'", "'film'"]),
        ({"motion": {"clearance_mm": 0.1}}, ["motion", "approach_gap_mm"]),
        ({"specimen": {"serial": ""}}, ["specimen.serial", "1 character"]),
        ({"specimen": {"serial": "n" * 65}}, ["specimen.serial", "64 characters"]),
        ({"specimen": {"serial": "DT\n7"}}, ["specimen.serial", "printable"]),
        ({"specimen": {"serial": " 7"}}, ["specimen.serial", "no blank"]),
    ],
)
def test_bad_declarations_are_one_line_with_file_key_and_what_would_be_right(
    change: dict[str, object], words: list[str]
) -> None:
    with pytest.raises(InputError) as caught:
        declare(**change)
    line = str(caught.value)
    assert line.startswith("t.toml: ")
    assert "\n" not in line
    for word in words:
        assert word in line
