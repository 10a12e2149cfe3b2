"""The bench's parts: bolt circles, the clocking flat, stray light, the LEDs' current."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from deltact_fab.cad.build import build_part
from deltact_fab.cad.check import bench, electric, fits, stray
from deltact_fab.cad.check.built import Built
from deltact_fab.cad.design import load_design
from deltact_fab.cad.drafting.coverage import coverage
from deltact_fab.cad.registry import find, of_group

NAMES = ("tool-holder", "nano17-adapter", "stage-plate")


@pytest.fixture(scope="module")
def built() -> Built:
    pytest.importorskip("cadquery")
    design = load_design()
    parts = tuple(find(name) for name in (*NAMES, "testing-shell"))
    return Built(design, parts, {part.name: build_part(part, design)[0] for part in parts})


def test_every_hole_of_the_bench_has_its_counterpart(built: Built) -> None:
    assert all(row.passed for row in bench.rows(built))


@pytest.mark.parametrize(
    ("part", "change"),
    [("nano17-adapter", "tool.bolt_circle_mm=24.4"), ("stage-plate", "table.hole_pitch_mm=17.5")],
)
def test_another_hole_pattern_on_one_side_fails(built: Built, part: str, change: str) -> None:
    other = build_part(find(part), load_design(changes=[change]))[0]
    rows = list(bench.rows(built.replaced({part: other})))
    assert any(not row.passed and part in row.part for row in rows)


def test_a_wrong_sensor_circle_fails(built: Built) -> None:
    other = build_part(
        find("nano17-adapter"), load_design(changes=["adapter.bolt_circle_mm=12.5"])
    )[0]
    *_, row = bench.rows(built.replaced({"nano17-adapter": other}))
    assert not row.passed


def test_the_stem_enters_the_holder_with_its_flat_at_plus_x_only(built: Built) -> None:
    from cadquery import Vector

    star = find("star")
    solid = build_part(star, built.design)[0]
    holder = built.solid("tool-holder")
    assert star.indenter is not None
    mouth = star.indenter.plate_z_mm + star.indenter.body.plate_mm
    seated = solid.translate(Vector(0, 0, -mouth))
    assert seated.intersect(holder).Volume() == pytest.approx(0.0, abs=1e-9)
    for turn in (90, 180):
        turned = seated.rotate(Vector(), Vector(0, 0, 1), turn)
        assert turned.intersect(holder).Volume() > 1.0


def test_a_tight_bore_and_a_loose_one_fail_their_rows() -> None:
    for value, name in (("0.05", "stem in the bore"), ("0.5", "turned stem stays out")):
        rows = fits.rows(load_design(changes=[f"tool.fit_mm={value}"]))
        assert [row for row in rows if name in row.found and not row.passed]


@pytest.mark.parametrize("name", NAMES)
def test_the_drawing_says_each_length_once(name: str) -> None:
    found = coverage(find(name), load_design())
    assert not (found.unsaid)
    assert not (found.twice)
    assert not (found.chains)


def test_worst_current_by_hand() -> None:
    # (5.25 - 2.75) V / 750 ohm = 3.333 mA, over five LEDs of three chips.
    assert electric.worst_ma(load_design()) == pytest.approx(2.5 / 0.75 / 15)
    assert all(row.passed for row in electric.rows(load_design()))
    bright = load_design(changes=["light.resistor_ohm=20", "light.led_count=1"])
    assert math.isclose(electric.worst_ma(bright), 2500 / 20 / 3)
    assert not any(row.passed for row in electric.rows(bright))


@pytest.mark.slow
def test_light_through_the_notch_needs_foam() -> None:
    pytest.importorskip("cadquery")
    design = load_design()
    parts = tuple(of_group("sensor"))
    built = Built(design, parts, {part.name: build_part(part, design)[0] for part in parts})
    (row,) = stray.rows(built)
    assert row.passed
    assert not row.found.startswith("0 of")
    bare = replace(built, design=load_design(changes=["shell.cable_foam_mm=0"]))
    (row,) = stray.rows(bare)
    assert not row.passed
