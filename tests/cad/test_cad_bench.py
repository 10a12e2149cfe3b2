"""The bench's parts: bolt circles, the clocking flat, stray light, the LEDs' current."""

from __future__ import annotations

import io
import itertools
import math
from dataclasses import replace
from typing import Any

import pytest
import shapely
from mutated import mutated

from deltact_fab.cad.build import build_part
from deltact_fab.cad.check import bench, electric, fits, stray_light
from deltact_fab.cad.check.built import BuiltDesign
from deltact_fab.cad.check.row import Row
from deltact_fab.cad.design import load_design
from deltact_fab.cad.drafting.page import Polylines, Text, meet
from deltact_fab.cad.drafting.wiring import wiring
from deltact_fab.cad.export.formats import dxf
from deltact_fab.cad.fabrication import quantities
from deltact_fab.cad.parts import led_strip
from deltact_fab.cad.registry import find, of_group
from deltact_fab.cad.sensor_sections import LightDimensions

NAMES = ("tool-holder", "nano17-adapter", "stage-plate")


@pytest.fixture(scope="module")
def built() -> BuiltDesign:
    pytest.importorskip("cadquery")
    design = load_design()
    parts = tuple(find(name) for name in (*NAMES, "testing-shell"))
    return BuiltDesign(design, parts, {part.name: build_part(part, design)[0] for part in parts})


def test_every_hole_of_the_bench_has_its_counterpart(built: BuiltDesign) -> None:
    assert all(row.passed for row in bench.rows(built))


@pytest.mark.parametrize(
    ("part", "change"),
    [("nano17-adapter", "tool.bolt_circle_mm=24.4"), ("stage-plate", "table.hole_pitch_mm=17.5")],
)
def test_another_hole_pattern_on_one_side_fails(built: BuiltDesign, part: str, change: str) -> None:
    other = build_part(find(part), load_design(changes=[change]))[0]
    rows = list(bench.rows(mutated(built, {part: other})))
    assert any(not row.passed and part in row.part for row in rows)


def test_the_stem_enters_the_holder_with_its_flat_at_plus_x_only(built: BuiltDesign) -> None:
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


def _electric(*changes: str) -> dict[str, Row]:
    return {row.check: row for row in electric.rows(load_design(changes=changes))}


def test_worst_currents_by_hand() -> None:
    light = load_design().light
    # (5.25 - 2.75) V and (4.75 - 3.15) V over 750 ohm; five LEDs of three chips.
    assert light.most_ma == pytest.approx(2.5 / 0.75)
    assert light.least_ma == pytest.approx(1.6 / 0.75)
    assert light.chip_most_ma == pytest.approx(2.5 / 0.75 / 15)
    assert light.resistor_most_w == pytest.approx(2.5**2 / 750)
    # 300 mA through 2.5 V take 8.33 ohm.
    assert light.least_resistor_ohm == 9.1
    assert all(row.passed for row in _electric().values())
    assert "light.led_limit_ma" in _electric()[electric.CURRENT].rests_on


def test_the_strip_s_own_resistors_are_in_parallel() -> None:
    light = load_design(changes=["light.strip_resistor_ohm=150"]).light
    assert light.most_ma == pytest.approx(2500 / (750 + 150 / 5))
    assert light.least_resistor_ohm == 0
    assert light.total_ma == pytest.approx(2050 / 780)
    assert quantities.resistor_for_ohm(20, light) == (pytest.approx(102.5 - 30), 75)


@pytest.mark.parametrize(
    ("changes", "fails"),
    [
        # 2.5 V / 20 ohm = 125 mA: 41.7 mA a chip, 312 mW.
        (("resistor_ohm=20", "led_count=1"), {electric.CURRENT, electric.HEAT, electric.EVEN}),
        (("resistor_ohm=20",), {electric.HEAT}),
        (("resistor_ohm=20", "resistor_rating_w=1", "supply_rating_ma=124"), {electric.SUPPLY}),
        # Dark at the lower end.
        (("led_v=4.6",), {electric.DARK}),
    ],
)
def test_too_bright_too_hot_too_much_and_dark(changes: tuple[str, ...], fails: set[str]) -> None:
    rows = _electric(*(f"light.{change}" for change in changes))
    assert {name for name, row in rows.items() if not row.passed} == fails


def test_the_strip_s_dxf_is_its_outline_and_the_ring() -> None:
    ezdxf = pytest.importorskip("ezdxf")
    design = load_design()
    strip = find("led-strip")
    assert strip.flat is not None
    data = dxf.flat_bytes(strip.flat(design))
    assert data == dxf.flat_bytes(strip.flat(design))
    document = ezdxf.read(io.StringIO(data.decode()))
    assert document.header["$INSUNITS"] == 4
    layers: dict[str, list[Any]] = {}
    for line in document.modelspace():
        layers.setdefault(line.dxf.layer, []).append(line)
    assert set(layers) == {"CUT", "LED", "MARK", "RING"}
    assert all(line.closed for name in ("CUT", "LED", "RING") for line in layers[name])
    (outline,) = layers["CUT"]
    xs, ys = zip(*((x, y) for x, y, *_ in outline), strict=True)
    assert max(xs) - min(xs) == pytest.approx(5 * 1000 / 60)
    assert max(ys) - min(ys) == pytest.approx(8.0)
    at = [sum(x for x, *_ in led) / 4 for led in layers["LED"]]
    assert [b - a for a, b in itertools.pairwise(at)] == pytest.approx([1000 / 60] * 4)
    assert sum(at) == pytest.approx(0.0, abs=1e-9)
    # On the ring: four circles, the slot, and LEDs between diffuser and wall, clear of the slot.
    circles, (_, *leds) = layers["RING"][:4], layers["RING"][4:]
    up = circles[0][0][1]
    assert len(leds) == 5
    for led in leds:
        away = [math.hypot(x, y - up) for x, y, *_ in led]
        assert design.channel_inner_mm < min(away)
        assert max(away) <= design.strip_radius_mm
        assert not any(abs(x) < design.light.slot_mm / 2 and y < up for x, y, *_ in led)


def test_a_led_wider_than_its_piece_of_strip_is_refused() -> None:
    rules = led_strip.rules(load_design(changes=["light.led_width_mm=7.9"]))
    assert [rule.holds for rule in rules] == [True, True]
    wide = replace(load_design(), light=LightDimensions(leds_per_m=240))
    assert [rule.holds for rule in led_strip.rules(wide)] == [False, True]


@pytest.mark.parametrize(
    "changes",
    [
        (),
        ("light.led_count=1",),
        ("light.led_count=9", "light.leds_per_m=120", "light.strip_resistor_ohm=1500.5"),
        ("light.supply_v=4.75", "light.resistor_ohm=1234.5", "light.wire_mm=1250.5"),
    ],
)
def test_no_text_of_the_wiring_drawing_is_struck_or_leaves_the_sheet(
    changes: tuple[str, ...],
) -> None:
    page = wiring(load_design(changes=changes))
    boxes = [mark.box for mark in page.marks if isinstance(mark, Text)]
    assert not [pair for pair in itertools.combinations(boxes, 2) if meet(*pair)]
    assert all(x0 > 10 and x1 < 287 and y0 > 10 and y1 < 200 for x0, y0, x1, y1 in boxes)
    for mark in page.marks:
        if isinstance(mark, Polylines):
            for line in mark.lines:
                ends = [*line, line[0]] if mark.closed else line
                drawn = shapely.LineString(ends)
                assert not [box for box in boxes if drawn.crosses(shapely.box(*box))], mark.style


def test_the_wiring_drawing_says_the_design_s_numbers() -> None:
    svg = wiring(load_design(changes=["light.resistor_ohm=470", "drawing.revision=C"])).svg()
    for said in ("R 470 ohm", "5 V ± 5 %", "red, 0.08 mm²", "17 × 2 mm", ">C<", "LED 5"):
        assert said in svg


@pytest.mark.slow
def test_light_through_the_notch_needs_foam() -> None:
    pytest.importorskip("cadquery")
    design = load_design()
    parts = tuple(of_group("sensor"))
    solids = {part.name: build_part(part, design)[0] for part in parts}
    (row,) = stray_light.rows(BuiltDesign(design, parts, solids))
    assert row.passed
    # The ring stands before lens and view; beside it a little of the plate's rim is lit.
    assert "0 to the lens, 0 to the plate in view, 4 to its rim" in row.found
    bare = load_design(changes=["shell.cable_foam_mm=0"])
    (row,) = stray_light.rows(BuiltDesign(bare, parts, solids))
    assert not row.passed
