"""The bench's parts: bolt circles, the clocking flat, the LEDs' current."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from solids import common_mm3, made

from deltact_fab.fabricate.cad.check import arithmetic, together
from deltact_fab.fabricate.cad.check.built import BuiltDesign
from deltact_fab.fabricate.cad.design import IndenterList, ListedIndenter, load_design
from deltact_fab.fabricate.cad.fabrication import quantities
from deltact_fab.fabricate.cad.features import features_of
from deltact_fab.fabricate.cad.parts import light_holder
from deltact_fab.fabricate.cad.parts.on_stage import REAMING_MM
from deltact_fab.fabricate.cad.registry import find_part, list_parts
from deltact_fab.fabricate.cad.sensor_sections import LightDimensions

D = load_design()


def _axes(part, diameter_mm):
    """Axes along z of a part's holes of one diameter, each once."""
    return {
        (round(r.low_mm[0], 6), round(r.low_mm[1], 6))
        for r in features_of(made(part)).rounds
        if r.hole and r.axis == 2 and abs(2 * r.radius_mm - diameter_mm) < 1e-6
    }


def test_bench_holes_match_their_counterparts() -> None:
    tool, plate = D.tool, D.adapter
    for one, other, count in (
        (("tool-holder", tool.screw_hole_mm), ("nano17-adapter", plate.pilot_mm), 4),
        (
            ("tool-holder", tool.pin_mm + tool.pin_fit_mm),
            ("nano17-adapter", tool.pin_mm - REAMING_MM),
            1,
        ),
        (("testing-shell", D.table.hole_mm), ("stage-plate", D.stage_plate.thread_hole_mm), 4),
    ):
        assert len(_axes(*one) & _axes(*other)) == count, (one, other)
    # The sensor's own three screws, on a circle of 12.7 mm, the first at 90 degrees from +x.
    found = _axes("nano17-adapter", plate.bolt_hole_mm)
    assert len(found) == 3
    assert all(math.hypot(x, y) == pytest.approx(6.35, abs=1e-5) for x, y in found)
    assert any((x, y) == pytest.approx((0.0, 6.35), abs=1e-5) for x, y in found)


def test_stem_fits_one_orientation_only() -> None:
    from cadquery import Vector

    star, holder = find_part("star"), made("tool-holder")
    assert star.indenter is not None
    mouth = star.indenter.indenter.reach_mm + star.indenter.body.plate_mm
    seated = made("star").translate(Vector(0, 0, -mouth))
    assert common_mm3(seated, holder) == pytest.approx(0.0, abs=1e-9)
    for turn in (90, 180):
        assert common_mm3(seated.rotate(Vector(), Vector(0, 0, 1), turn), holder) > 1.0


def test_tight_and_loose_bores_fail() -> None:
    for value, name in (("0.05", "stem in the bore"), ("0.5", "rotated stem blocked")):
        rows = arithmetic.fits(load_design(changes=[f"tool.fit_mm={value}"]))
        assert [row for row in rows if name in row.value and row.failed]


def test_worst_currents_by_hand() -> None:
    light = D.light
    # 9.6 W/m x 25 mm / 12 V = 20 mA a cut, which its resistor of 3.15 V / 20 mA sets at 12 V; two
    # cuts in parallel. 12.6 - 8.25 V and 11.4 - 9.45 V remain over the resistors.
    ohm = 750 + 157.5 / 2
    assert light.most_ma == pytest.approx(4350 / ohm)
    assert light.least_ma == pytest.approx(1950 / ohm)
    assert light.cut_most_ma == pytest.approx(4350 / ohm / 2)
    assert light.resistor_most_w == pytest.approx((4.35 / ohm) ** 2 * 750)
    # 40 mA through 4.35 V take 108.75 ohm, of which the strip has 78.75.
    assert light.least_resistor_ohm == 30
    rows = {row.name: row for row in arithmetic.light(D)}
    assert all(not row.failed for row in rows.values())
    assert "light.strip_w_per_m" in rows["LED current"].basis


def test_strip_sets_its_resistors() -> None:
    # A 5 V strip that is cut at every LED: 4.8 W/m x 16.67 mm / 5 V = 16 mA through 2.05 V.
    strip = "leds_per_m=60", "leds_per_cut=1", "supply_v=5", "strip_w_per_m=4.8", "led_count=5"
    light = load_design(changes=[f"light.{change}" for change in strip]).light
    own = 2050 / 16
    assert light.most_ma == pytest.approx(2500 / (750 + own / 5))
    assert light.least_resistor_ohm == 6.2  # 80 mA through 2.5 V, less 25.6 ohm
    assert light.total_ma == pytest.approx(2050 / (750 + own / 5))
    assert quantities.resistor_for_ohm(20, light) == (pytest.approx(102.5 - own / 5), 82)


def test_only_whole_cuts_light() -> None:
    for count, refused in ((6, False), (7, True), (8, True), (9, False)):
        light = replace(D.light, led_count=count)
        rules = {rule.id: rule for rule in light_holder.rules(replace(D, light=light))}
        assert rules["whole-cuts"].failed == refused


def test_cuts_surround_the_lens_evenly() -> None:
    for name, cuts in (("deltact", 2), ("skin-44x40", 4)):
        turns = np.degrees(light_holder.led_turns(load_design(name)))
        middles = turns.reshape(cuts, 3).mean(axis=1)
        assert np.diff(middles) == pytest.approx(360 / cuts)
        # None over the wire slot at -y.
        assert abs((turns + 90 + 180) % 360 - 180).min() > 15


@pytest.mark.parametrize(
    ("changes", "fails"),
    [
        # 4.35 V / (20 + 157.5) ohm = 24.5 mA of 20 in one cut.
        (("resistor_ohm=20", "led_count=3"), {"LED current", "even light"}),
        # 4.35 V / (20 + 157.5 / 2) ohm = 44 mA: 38.8 mW.
        (("resistor_ohm=20", "resistor_rating_w=0.07"), {"LED current", "LED resistor"}),
        (("supply_rating_ma=5.2",), {"LED supply"}),
        # Dark at the lower end.
        (("led_v=4.6",), {"LED current, least"}),
    ],
)
def test_led_current_heat_and_supply_limits(changes: tuple[str, ...], fails: set[str]) -> None:
    rows = arithmetic.light(load_design(changes=[f"light.{change}" for change in changes]))
    assert {row.name for row in rows if row.failed} == fails


def test_led_wider_than_pitch_is_refused() -> None:
    rules = light_holder.strip_rules(load_design(changes=["light.led_width_mm=7.9"]))
    assert [rule.failed for rule in rules] == [False, False]
    wide = replace(D, light=LightDimensions(leds_per_m=360))
    assert [rule.failed for rule in light_holder.strip_rules(wide)] == [True, False]


class Boxed(BuiltDesign):
    """Boxes by their closed forms, and nothing shares room: no solid is built."""

    def fact(self, what, names, compute, given=None):
        part = self.part(names[0])
        return part.box(part.source(self.design)) if what == "box" else 0.0


@pytest.mark.parametrize(("depth_mm", "holds"), [(5.0, True), (7.5, False)])
def test_bench_reaches_with_shortest_indenter(tmp_path, monkeypatch, depth_mm, holds):
    short = '[shape.short]\ntips = [{kind = "ball", radius_mm = 2.0}]\nreach_mm = 8.0\n'
    (tmp_path / "indenters.toml").write_text(short)
    monkeypatch.chdir(tmp_path)
    indenters = IndenterList(indenter=(ListedIndenter("sphere:10"), ListedIndenter("short")))
    design = load_design(changes=[f"plate.depth_mm={depth_mm}"])
    rows = together.bench(Boxed(design, tuple(list_parts(indenters, design))))
    (reach,) = (row for row in rows if row.id == "bench-reach")
    assert f">= {8.0 - depth_mm:.1f} mm above the face (indenter-short)" in str(reach.value)
    assert reach.failed != holds
