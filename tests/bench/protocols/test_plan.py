"""Expansion: ids, order, legs, frames."""

from __future__ import annotations

import itertools
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from deltact_fab.bench.protocols import plan
from deltact_fab.bench.protocols.motion import UNTOUCHED_STOP_MM, StageConfig
from deltact_fab.bench.protocols.plan import Protocol
from deltact_fab.common import catalog
from deltact_fab.common.errors import InputError


def declare(**changes: object) -> Protocol:
    data: dict[str, object] = {
        "name": "t",
        "indenters": ["sphere:10"],
        "positions_mm": [[1.0, -2.0], [3.0, 0.0]],
        "depths_mm": [0.5, 1.0],
        "channels": ["image", "shear"],
        "shear": {"amplitude_mm": 2.0},
        "capture": {"rate_hz": 2.0},
    }
    return catalog.validate(Protocol, data | changes, "t.toml")


def test_path_returns_to_centre_per_axis() -> None:
    steps = plan.expand_protocol(declare())
    shear = [s for s in steps if s.kind == "shear"]
    assert [s.id.rsplit("/", 1)[1] for s in shear[:6]] == [
        "shear-x+", "shear-x-", "shear-x0", "shear-y+", "shear-y-", "shear-y0",
    ]  # fmt: skip
    assert shear[0].target_mm == (3.0, -2.0, -0.5)
    assert shear[1].target_mm == (-1.0, -2.0, -0.5)
    assert shear[2].target_mm == (1.0, -2.0, -0.5)
    assert shear[3].target_mm == (1.0, 0.0, -0.5)


@pytest.mark.parametrize("air", [False, True])
def test_descents_to_untouched_face_are_slow(air: bool) -> None:
    usual = plan.expand_protocol(declare(), air)
    slow = {s.id: s for s in plan.expand_protocol(declare(), air, 150.0)}
    changed = [s.id for s in usual if slow[s.id].feed_mm_min != s.feed_mm_min]
    assert changed == ["sphere-10/change", *(["sphere-10/p1/rest"] if air else [])]
    assert {slow[id].feed_mm_min for id in changed} == {150.0}


@pytest.mark.parametrize(("accel", "late_mm"), [(50.0, 5.2), (100.0, 3.2), (1000.0, 1.4)])
def test_stop_takes_delay_and_braking(accel: float, late_mm: float) -> None:
    stage = catalog.validate(
        StageConfig,
        {
            "origin_machine_mm": [-60.0, -60.0, -40.0], "travel_mm": [120.0, 120.0, 60.0],
            "max_feed_mm_min": [1500.0, 1500.0, 1200.0], "acceleration_mm_s2": [accel] * 3,
        },
        "rig.toml",
    )  # fmt: skip
    assert stage.stopping_mm(1200.0) == pytest.approx(late_mm)
    assert stage.stopping_mm(stage.descent_feed_mm_min) == pytest.approx(UNTOUCHED_STOP_MM)
    assert stage.stop_force_n(8.0, 1200.0, 2.8) == pytest.approx(
        2.8 * ((8.0 / 2.8) ** (2 / 3) + late_mm) ** 1.5
    )


def test_stop_is_captured_once_after_settling() -> None:
    shear = {"amplitude_mm": 2.0, "points_per_side": 2}
    protocol = declare(capture={"settle_s": 1.5}, shear=shear)
    press = [s for s in plan.expand_protocol(protocol) if s.press == "sphere-10/p1" and s.frames]
    # rest, after, and for two depths the press and 2 axes x 4 stops
    assert len(press) == 2 + 2 * (1 + 2 * 4)
    assert {s.frames for s in press} == {1}
    assert {s.settle_s for s in press} == {1.5}
    assert [s.id for s in press if not s.settled] == ["sphere-10/p1/after"]
    offsets = [s.target_mm[0] - 1.0 for s in press if "shear-x" in s.id][:4]
    assert offsets == pytest.approx([1.0, 2.0, -1.0, -2.0])


def test_stop_kinds_have_own_settling_times() -> None:
    waits = {"rest": 0.5, "press": 5.0, "after": 3.0}
    legs = {
        s.id.rsplit("/", 1)[1]: s
        for s in plan.expand_protocol(declare(capture={"settle_s": waits}))
    }
    assert {name: (s.settle_s, s.settled) for name, s in legs.items() if s.frames} == {
        "rest": (0.5, True), "press": (5.0, True), "after": (3.0, False),
        **{f"shear-{axis}{side}": (0.0, False) for axis in "xy" for side in "+-"},
    }  # fmt: skip


def test_hold_after_press_and_filmed_retract() -> None:
    asked = {"rate_hz": 2.0, "hold": {"s": 6.0, "rate_hz": 1.5}, "retract": {"rate_hz": 4.0}}
    plain = [s for s in plan.expand_protocol(declare()) if s.press == "sphere-10/p1"]
    steps = [s for s in plan.expand_protocol(declare(capture=asked)) if s.press == "sphere-10/p1"]
    assert [s for s in steps if s.kind not in ("hold", "retract")] == [
        s for s in plain if s.kind != "retract"
    ]
    for press, hold in itertools.pairwise(steps):
        assert (press.kind == "press") == (hold.kind == "hold")
        if hold.kind == "hold":
            assert (hold.target_mm, hold.hold_s, hold.frames) == (press.target_mm, 6.0, 9)
            assert not hold.settled
    retract = steps[-2]
    assert retract.target_mm == (1.0, -2.0, 0.5)
    assert retract.frames == round(1.5 / 0.5 * 4.0)


def test_grid_expands_to_positions() -> None:
    grid = {"x": [-6.0, 6.0], "y": [1.0, 2.0], "n": [3, 2]}
    places = [[-6.0, 1.0], [0.0, 1.0], [6.0, 1.0], [-6.0, 2.0], [0.0, 2.0], [6.0, 2.0]]
    made = declare(positions_mm=[], grid=grid)
    assert made == declare(positions_mm=places)
    assert catalog.validate(Protocol, made.model_dump(mode="json"), "run.json") == made
    middle = declare(positions_mm=[], grid={"x": [-6.0, 5.0], "y": [1.0, 1.0], "n": [1, 1]})
    assert middle.positions_mm == ((-0.5, 1.0),)


@pytest.mark.parametrize(
    ("changes", "line"),
    [
        ({"positions_mm": []}, "t.toml: either positions_mm or grid is needed"),
        ({"grid": {"x": [0, 1], "y": [0, 1], "n": [2, 2]}}, "t.toml: either positions_mm or grid"),
        ({"grid": {"x": [1, 0], "y": [0, 1], "n": [2, 2]}}, "t.toml: grid: x: [1, 0] for 2; exp"),
        ({"grid": {"x": [0, 1], "y": [1, 1], "n": [2, 2]}}, "t.toml: grid: y: [1, 1] for 2; exp"),
        ({"capture": {"settle_s": {"prss": 1}}}, "t.toml: capture.settle_s.prss: must be"),
        ({"capture": {"settle_s": {"press": 601}}}, "capture.settle_s.press: 601; expected"),
        ({"capture": {"settle_s": 601}}, "601; expected 0 <= settle_s <= 600"),
        ({"capture": {"settle_s": {}}}, "t.toml: capture.settle_s: Dictionary should have"),
        ({"capture": {"settle_s": 1, "hold": {"s": 5}}}, "t.toml: capture.hold.rate_hz: missing"),
        ({"capture": {"settle_s": 1, "retract": 2}}, "t.toml: capture.retract: must be"),
    ],
)
def test_invalid_capture_is_one_line(changes: dict[str, object], line: str) -> None:
    with pytest.raises(InputError) as why:
        declare(**changes)
    assert line in str(why.value)
    assert "\n" not in str(why.value)


def test_filmed_press_ends_settled() -> None:
    both = plan.expand_protocol(declare(capture={"rate_hz": 2.0, "settle_s": 1.5}))
    sweep = plan.expand_protocol(declare())
    assert [(s.id, s.target_mm, s.frames) for s in both] == [
        (s.id, s.target_mm, s.frames) for s in sweep
    ]
    legs = {s.id.rsplit("/", 1)[1]: s for s in both if s.press == "sphere-10/p1"}
    leg, back = legs["shear-x-"], legs["shear-x0"]
    assert (leg.frames, leg.settled, leg.settle_s) == (16, True, 1.5)
    assert (back.frames, back.settled, back.settle_s) == (8, False, 0.0)
    assert [s.id for s in sweep if s.settled] == [f"sphere-10/p{n}/rest" for n in (1, 2)]


@given(st.integers(1, 6), st.floats(0.1, 3.0))
def test_shear_grid_visits_every_point(n: int, amplitude_mm: float) -> None:
    shear = {"amplitude_mm": amplitude_mm, "points_per_side": n, "grid": True}
    protocol = declare(shear=shear, positions_mm=[[1.0, -2.0]], depths_mm=[1.0])
    steps = [s for s in plan.expand_protocol(protocol) if s.kind in ("press", "shear")]
    assert len({s.id for s in steps}) == len(steps) == (2 * n + 1) ** 2 + 1
    ways = [math.dist(a.target_mm, b.target_mm) for a, b in itertools.pairwise(steps)]
    assert ways[:-1] == pytest.approx([amplitude_mm / n] * (len(steps) - 2))
    at = [
        tuple(
            round((p - c) * n / amplitude_mm) for p, c in zip(s.target_mm[:2], (1, -2), strict=True)
        )
        for s in steps
    ]
    assert set(at) == set(itertools.product(range(-n, n + 1), repeat=2))
    assert at[0] == at[-1] == (0, 0)


@given(
    st.floats(0, 6), st.floats(0, 6), st.booleans(), st.booleans(), st.booleans(), st.integers(1, 3)
)
def test_outward_paths_mirror_their_positions(
    x: float, y: float, left: bool, down: bool, grid: bool, n: int
) -> None:
    shear = {"amplitude_of_depth": 0.4, "points_per_side": n, "grid": grid, "first": "outward"}
    signs = (-1 if left else 1, -1 if down else 1, 1)

    def way(at: tuple[float, float]) -> list[tuple[float, ...]]:
        return [
            s.target_mm for s in plan.expand_protocol(declare(shear=shear, positions_mm=[at]))[1:]
        ]

    image = way((signs[0] * x, signs[1] * y))
    for mine, its in zip(way((x, y)), image, strict=True):
        # A place on the plane is its own image: from there all go to + first.
        for axis, c in enumerate((x, y)):
            sign = signs[axis] if c > 0 else 1
            assert its[axis] == sign * mine[axis]
        assert its[2] == mine[2]


def test_outward_drags_away_from_centre_first() -> None:
    shear = {"amplitude_mm": 2.0, "first": "outward"}
    places = [[-1.0, 3.0], [0.0, -2.0]]
    sweep = plan.expand_protocol(declare(shear=shear, positions_mm=places, depths_mm=[1.0]))
    legs = [s.id.rsplit("/", 1)[1] for s in sweep if s.kind == "shear"]
    assert legs == [
        "shear-x-", "shear-x+", "shear-x0", "shear-y+", "shear-y-", "shear-y0",
        "shear-x+", "shear-x-", "shear-x0", "shear-y-", "shear-y+", "shear-y0",
    ]  # fmt: skip
    assert next(s for s in sweep if s.kind == "shear").target_mm == (-3.0, 3.0, -1.0)
    step = declare(shear=shear | {"points_per_side": 2}, positions_mm=places)
    offsets = [s.target_mm[0] + 1.0 for s in plan.expand_protocol(step) if "shear-x" in s.id][:5]
    assert offsets == pytest.approx([-1.0, -2.0, 1.0, 2.0, 0.0])


def test_stored_channels_are_sorted() -> None:
    protocol, _ = plan.load_protocol("smoke")
    assert len(protocol.channels) > 1
    told = [protocol.model_copy(update={"channels": order}).model_dump(mode="json")["channels"]
            for order in itertools.permutations(protocol.channels)]  # fmt: skip
    assert all(channels == sorted(protocol.channels) for channels in told)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"depths_mm": [1.0, 0.5]}, ["depths_mm", "strictly increasing"]),
        ({"depths_mm": [math.nan]}, ["depths_mm.0", "nan; expected 0.001"]),
        ({"indenters": ["sphere:ten"]}, ["indenters", "sphere:ten", "0.5 to 30"]),
        ({"channels": ["image"]}, ["channels", "needs 'shear'"]),
        ({"channels": ["dots"], "shear": None}, ["channels", "needs 'image'"]),
        ({"depth_mm": [1.0]}, ["depth_mm", "unknown key", "depths_mm"]),
        ({"capture": {"mode": "sweep"}}, ["capture.mode", "unknown key", "rate_hz", "settle_s"]),
        ({"capture": {}}, ["capture", "rate_hz", "settle_s"]),
        ({"capture": {"settle_s": -1}}, ["capture.settle_s", "-1; expected 0"]),
        ({"shear": {"axes": ["x"]}}, ["shear", "amplitude_mm or amplitude_of_depth"]),
        ({"shear": {"amplitude_mm": 1, "amplitude_of_depth": 1}}, ["either"]),
        ({"shear": {"amplitude_mm": 1, "grid": True, "axes": ["y"]}}, ["axes", "both x and y"]),
        ({"motion": {"clearance_mm": 0.1}}, ["motion", "approach_gap_mm"]),
        ({"specimen": {"serial": ""}}, ["specimen.serial", "1 character"]),
        ({"specimen": {"serial": "n" * 65}}, ["specimen.serial", "64 characters"]),
        ({"specimen": {"serial": "DT\n7"}}, ["specimen.serial", "printable"]),
        ({"specimen": {"serial": " 7"}}, ["specimen.serial", "without blanks"]),
    ],
)
def test_invalid_protocols_give_one_line(change: dict[str, object], words: list[str]) -> None:
    with pytest.raises(InputError) as caught:
        declare(**change)
    line = str(caught.value)
    assert line.startswith("t.toml: ")
    assert "\n" not in line
    for word in words:
        assert word in line
