"""What `cad show` tells of a part."""

from __future__ import annotations

import json
from dataclasses import asdict

import pytest

from deltact_fab.cad.design import load_design
from deltact_fab.cad.dimensions import Design
from deltact_fab.cad.feasibility import rules as all_rules
from deltact_fab.cad.registry import find, listed
from deltact_fab.cad.show import describe, equation, properties

DEFAULT = load_design()


def test_every_derived_length_is_shown_with_some_part():
    known = {name for name, _ in properties(Design)}
    told = {name for part in listed() for name in part.derived}
    assert told == known, "list a new property of Design in show.DERIVED"


def test_every_rule_is_told_with_some_part():
    told = {rule.text for part in listed() for rule in describe(part, DEFAULT).rules}
    assert {rule.text for rule in all_rules(DEFAULT)} <= told


@pytest.mark.parametrize("part", listed(), ids=lambda part: part.name)
def test_every_part_is_described_in_full(part):
    told = describe(part, DEFAULT)
    json.dumps(asdict(told), allow_nan=False)
    assert told.dimensions
    assert all(d.meaning for d in told.dimensions), [
        d.key for d in told.dimensions if not d.meaning
    ]
    assert all(d.equation for d in told.derived)
    assert all(rule.holds for rule in told.rules)
    assert [title for title, _, _ in told.tables()][:2] == ["", "Dimensions"]
    for _, columns, rows in told.tables():
        assert all(len(row) == len(columns) for row in rows)


def test_values_and_limits_are_the_design_s():
    told = {d.key: d for d in describe(find("shell"), load_design("skin-44x40")).dimensions}
    assert told["skin.width_mm"].value == 44
    assert (told["skin.width_mm"].low, told["skin.width_mm"].high) == (5, 200)
    derived = {d.key: d for d in describe(find("shell"), load_design("skin-44x40")).derived}
    assert derived["frame_outer_mm"].value == (47, 46)
    assert derived["frame_outer_mm"].equation == "Outer sides of the frame = skin + 2 walls"


def test_a_broken_rule_is_shown_and_not_raised():
    small = load_design(changes=["camera.hole_edge_mm=0.5"])
    broken = [rule for rule in describe(find("camera"), small).rules if not rule.holds]
    assert any("hole_edge_mm" in rule.text for rule in broken)
    assert all(rule.margin is None or rule.margin <= 0 for rule in broken)
    rows = {title: rows for title, _, rows in describe(find("camera"), small).tables()}["Rules"]
    assert "FAILS" in [verdict for _, verdict, _ in rows]


def test_an_indenter_of_any_size():
    told = {d.key: d.value for d in describe(find("sphere:12.5"), DEFAULT).dimensions}
    assert told["tip.radius_mm"] == 6.25
    derived = {d.key: d.value for d in describe(find("sphere:12.5"), DEFAULT).derived}
    assert derived["footprint_half_mm"] == (6.25, 6.25)
    assert derived["height_mm"] == told["reach_mm"] + told["plate_mm"] + told["stem_length_mm"]
    dots = {d.key for d in describe(find("4dots"), DEFAULT).dimensions}
    assert {"tip1.x_mm", "tip4.radius_mm"} <= dots


@pytest.mark.parametrize(
    ("docstring", "left"),
    [
        ("Length of strip = count x pitch: 83.3.", "Length of strip = count x pitch"),
        ("Axis = (outer - post) / 2: (16.3, 16.8).", "Axis = (outer - post) / 2"),
        ("Volume of one skin: block - edges.\n\nMore.", "Volume of one skin: block - edges"),
    ],
)  # fmt: skip
def test_an_equation_carries_no_default_value(docstring, left):
    assert equation(docstring) == left
