"""What `cad show` tells of a part."""

from __future__ import annotations

import json
from dataclasses import asdict

import pytest

from deltact_fab.fabricate.cad.design import load_design
from deltact_fab.fabricate.cad.registry import find_part, list_parts

DEFAULT = load_design()


@pytest.mark.parametrize("part", list_parts(), ids=lambda part: part.name)
def test_every_part_is_described_in_full(part):
    told = list(part.dimensions(DEFAULT))
    json.dumps([asdict(d) for d in told], allow_nan=False)
    assert told
    assert all(d.meaning for d in told), [d.key for d in told if not d.meaning]


def test_values_and_limits_match_design():
    told = {d.key: d for d in find_part("shell").dimensions(load_design("skin-44x40"))}
    assert told["skin.width_mm"].row[:3] == ("skin.width_mm", "44", "5 to 200")
    assert (told["skin.width_mm"].low, told["skin.width_mm"].high) == (5, 200)
    camera = {d.row[0] for d in find_part("camera").dimensions(DEFAULT)}
    assert "camera.focal_length_mm (unverified)" in camera


def test_an_indenter_of_any_size():
    told = {d.key: d.value for d in find_part("sphere:12.5").dimensions(DEFAULT)}
    assert told["tip1"]["radius_mm"] == 6.25
    assert "tip4" in {d.key for d in find_part("4dots").dimensions(DEFAULT)}
