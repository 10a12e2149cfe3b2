"""What to order and to weigh: figures by hand."""

from __future__ import annotations

import csv
import io
from dataclasses import fields

import pytest
from hypothesis import given
from hypothesis import strategies as st

from deltact_fab.common.errors import InputError
from deltact_fab.fabricate.cad.design import load_cameras, load_design
from deltact_fab.fabricate.cad.dimensions import Design
from deltact_fab.fabricate.cad.fabrication import bom, quantities
from deltact_fab.fabricate.cad.fabrication.quantities import gaps
from deltact_fab.fabricate.cad.intent import Wish, find_design
from deltact_fab.fabricate.cad.registry import list_parts, parts_of_group
from deltact_fab.fabricate.cad.sensor_sections import LightDimensions
from deltact_fab.fabricate.cad.standards import E24_STEPS
from deltact_fab.paths import asset

DEFAULT = Design()


def of(lines, name):
    """The line of this part, or else the one that begins like this."""
    exact = [line for line in lines if line.part == name]
    (found,) = exact or [line for line in lines if line.part.startswith(name)]
    return found


def test_bom_scales_only_sensor_parts():
    lines = bom.bom_lines(DEFAULT, sensors=5)
    assert [line.item for line in lines] == list(range(1, len(lines) + 1))
    assert [line.part for line in lines][: len(list_parts())] == [
        part.name for part in list_parts()
    ]
    for part in parts_of_group("sensor"):
        assert of(lines, part.name).quantity == 5 * part.quantity + part.spares
    assert of(lines, "mold").quantity == 1
    assert of(lines, "led-strip").quantity == 5


def test_silicone_of_full_mold():
    a, b = (of(bom.bom_lines(DEFAULT), f"Solaris part {part}") for part in "AB")
    assert a.quantity == b.quantity
    # Density 1: grams are millilitres. 14.14 cm3 a skin was integrated by hand.
    assert a.quantity + b.quantity == pytest.approx(4 * 14.141 * 1.1, rel=1e-3)
    assert "7.8 g per skin" in a.note


def test_transparent_base_takes_a_cavity():
    full = of(bom.bom_lines(DEFAULT), "Solaris part A").quantity
    for sensors, fills in ((3, 1), (4, 2), (8, 3)):
        lines = bom.bom_lines(DEFAULT, sensors)
        assert of(lines, "Solaris part A").quantity == pytest.approx(fills * full)
        assert of(lines, "acrylic blank").quantity == sensors + 2  # one spare


def test_coat_batch_has_weighable_minimum():
    coat = quantities.coat_batch(DEFAULT, 1, waste=0.0)
    # Face 36 x 34 and sides 6 high, 0.3 mm of 1.07 g/cm3, 3 % of pigment.
    assert coat.a_g + coat.b_g == pytest.approx((36 * 34 + 140 * 6) * 0.3e-3 * 1.07)
    assert coat.pigment_g == pytest.approx(0.03 * (coat.a_g + coat.b_g))
    least = quantities.least_coat_batch(coat)
    assert least.a_g + least.b_g == pytest.approx(10)
    assert least.pigment_g == pytest.approx(0.3)
    many = quantities.coat_batch(DEFAULT, 30)
    assert quantities.least_coat_batch(many) == many


@given(total_ma=st.floats(0.05, 2000), supply_v=st.floats(10, 14), led_v=st.floats(1.5, 3.0))
def test_e24_resistor_never_exceeds_current(total_ma, supply_v, led_v):
    light = LightDimensions(supply_v=supply_v, led_v=led_v, strip_w_per_m=100)
    exact, sold = quantities.resistor_for_ohm(total_ma, light)
    own = light.strip_resistor_ohm / 2
    reached_ma = (supply_v - 3 * led_v) / (exact + own) * 1000
    assert reached_ma == pytest.approx(total_ma) or (exact == 0 and reached_ma < total_ma)
    assert exact * (1 - 1e-6) <= sold <= exact * 1.16
    mantissa = sold / 10 ** len(str(int(sold))) * 100 if sold >= 1 else None
    if mantissa is not None:
        assert min(abs(mantissa - step) for step in E24_STEPS) < 1e-6


def test_stock_screws_need_no_note():
    def told(*changes, design="deltact"):
        return of(bom.bom_lines(load_design(design, changes)), "screw").note

    paper = told(design="screws-19mm")
    assert "not stocked; the longest sold is 16 mm" in paper
    assert "M1.6 threaded rod with a nut as head" in paper
    assert told() == "M1.6 x 16, key 1.5 mm; 2 of them spare"
    assert "M1.6 x 14 is not stocked: cut one of 16 mm down" in told("screw.length_mm=14")


def test_notes_say_what_the_design_has():
    held = load_design(changes=["frame.wall_x_mm=6.6", "shell.ledge_x_mm=0"])
    for design, notched in ((DEFAULT, True), (held, False)):
        assert ("notched corners" in of(bom.bom_lines(design), "acrylic").note) == notched
        assert any("notched around them" in g["chosen"] for g in gaps(design)) == notched
    foam = of(bom.bom_lines(load_design(changes=["shell.cable_width_mm=16.5"]), 3), "black foam")
    assert foam.quantity == 3
    assert "16.5 x 2 mm cable notch" in foam.note


@pytest.mark.parametrize(
    ("changes", "sensors", "ampere", "takes"),
    [
        # (12.6 - 8.25) V / 829 ohm = 5 mA, and so on; twice that, rounded up to what is sold.
        ([], 1, "0.1 A", "5 mA"),
        (["light.resistor_ohm=30"], 10, "1 A", "400 mA"),
        (["light.resistor_ohm=30"], 149, "12 A", "5960 mA"),
    ],
)
def test_the_supply_follows_from_the_current(changes, sensors, ampere, takes):
    supply = of(bom.bom_lines(load_design(changes=changes), sensors), "supply")
    assert supply.material == f"plug supply, regulated ± 5 %, {ampere} or more"
    assert f"draw at most {takes}" in supply.note
    assert "pin of the Jetson" not in supply.note  # 12 V


DESIGNS = [
    *("deltact", "franka", "fingertip-24x24", "large-60x50", "screws-19mm", "skin-44x40"),
    Wish.parse("44x40"), Wish.parse("60x50", camera="innomaker-u20cam"),
    Wish.parse("36x34", gel_mm=6.0, holes="circle 50 4xM5"),
]  # fmt: skip


@pytest.mark.parametrize("design", DESIGNS, ids=str)
def test_every_bought_line_can_be_quoted(design):
    found = load_design(design) if isinstance(design, str) else find_design(design, DEFAULT)
    bought = [line for line in bom.bom_lines(found) if line.source is not None]
    assert len(bought) > 50
    for line in bought:
        assert line.material, line.part
        assert line.quantity > 0, line.part
        assert line.source.orderable or line.source.search, line.part
        assert "not " not in str(line.source)[:4], line.part


# Words of the guide for what its reader needs to have, and what its measurements need.
NAMED = (
    "drill", "solder", "level", "brush", "needle", "blade", "cup", "tape", "gloves", "goggles",
    "isopropanol", "lacquer", "vacuum", "epoxy", "lamp", "cloth", "driver", "key", "foam",
)  # fmt: skip
IMPLIED = ("caliper", "multimeter", "balance", "scanner", "printer", "ruler", "abrasive")


def test_tools_of_the_guide_are_listed():
    guide = asset("templates/guide.html").read_text().lower()
    assert [tool for tool in NAMED if tool not in guide] == []
    bought = [line for line in bom.bom_lines(DEFAULT) if line.source is not None]
    text = " ".join(f"{line.part} {line.material}" for line in bought).lower()
    assert [tool for tool in (*NAMED, *IMPLIED) if tool not in text] == []


def test_csv_matches_bom_lines():
    lines = bom.bom_lines(DEFAULT)
    rows = list(csv.DictReader(io.StringIO(lines.csv())))
    assert list(rows[0])[:8] == [f.name for f in fields(bom.BomLine)][:8]
    for row, line in zip(rows, lines, strict=True):
        assert row["order_number"] == (line.source.order_number if line.source else "")
        assert row["part"] == line.part
        assert row["note"] == line.note
        assert float(row["quantity"]) == pytest.approx(line.quantity, rel=1e-5)


@pytest.mark.slow
def test_bought_lines_have_order_numbers():
    listed = bom.load_bought().bought
    sold = [name for name in load_cameras() if name != "rpi-camera-3"]  # it focuses too far off
    cameras = [find_design(Wish.parse("36x34", camera=name), DEFAULT) for name in sold]
    named = ("large-60x50", "fingertip-24x24")
    designs = [DEFAULT, *map(load_design, named), *cameras]
    asked = {(line.part, line.source) for design in designs for line in bom.bom_lines(design)}
    assert all(source is None or source.order_number for _, source in asked)
    known = {part: source for part, source in asked if source and source.order_number[0] != "n"}
    assert known["camera-screw"].order_number == "SFE-M2-3"
    # Of every line that is listed there is one to order; M2 screws go with faces of 46 to 50 mm.
    assert {one.line for one in listed} <= {part for part, _ in asked}
    (other,) = [s for p, s in asked if p == "camera" and s.order_number == "B0152"]
    assert other.maker == "Arducam"


def test_zero_sensors_or_broken_rule_refused():
    with pytest.raises(InputError, match="sensors 0: expected 1 or more"):
        bom.bom_lines(DEFAULT, 0)
    with pytest.raises(InputError, match="fails"):
        bom.bom_lines(load_design(changes=["skin.width_mm=24", "skin.length_mm=24"]))


def test_gaps_use_figures_of_the_design():
    text = " ".join(" ".join(g.values()) for g in gaps(DEFAULT))
    for figure in ("-59 %", "640 mm²", "0.0380", "2.7 mA", "83 %", "82 ohm", "39 x 60 x 30 mm"):
        assert figure in text
    assert "M1.6 x 16 is stocked" in gaps(DEFAULT)[0]["chosen"]
    bright = gaps(load_design(changes=["light.resistor_ohm=120"]))
    assert any("2.7 mA" in g["found"] and "120 ohm: 16 mA" in g["chosen"] for g in bright)
