"""The sensor put together: its size, what its pieces share, and the exploded view."""

from __future__ import annotations

import math

import numpy as np
import pytest
from threads import thread_overlap_mm3

from deltact_fab.cad import registry
from deltact_fab.cad.assembly import assemble, places
from deltact_fab.cad.build import build_part
from deltact_fab.cad.check.built import BuiltDesign
from deltact_fab.cad.check.pairs import shared
from deltact_fab.cad.design import load_design
from deltact_fab.cad.kernel import require
from deltact_fab.cad.solid_gate import bounding_box

# What else is shipped passes "interference" of test_cad_single_numbers.
DESIGNS = {
    "deltact": [],
    "franka": [],
    # Threads that grip over other lengths than the defaults'.
    "deltact with other threads": [
        "screw.engagement_mm=5.2", "holder.screw_length_mm=3.8", "holder.clearance_mm=3.1",
    ],
}  # fmt: skip


@pytest.fixture(scope="module")
def cq():
    return require()


@pytest.fixture(scope="module")
def design():
    return load_design()


@pytest.fixture(scope="module")
def solids(cq, design):
    """Every sensor part of the default design, gated, where its builder makes it."""
    return {part.name: build_part(part, design)[0] for part in registry.of_group("sensor")}


def hull(placed):
    boxes = np.array([bounding_box(piece.solid) for piece in placed])
    return boxes[:, 0].min(axis=0), boxes[:, 1].max(axis=0)


def overlaps(design, solids):
    """Names and common volume of every pair of the sensor's pieces whose boxes meet."""
    built = BuiltDesign(design, tuple(registry.listed()), dict(solids or {}))
    parts = [part for part in built.parts if part.group == "sensor"]
    return list(shared(built, places(design, parts)))


def test_every_piece_that_is_counted_has_a_place(design):
    for part in registry.listed():
        if part.group == "sensor":
            assert len(set(part.places(design))) == part.quantity
    assert registry.find("screw").places(design)[-1] == pytest.approx((16.225, 16.725, 0.0))
    assert registry.find("camera-screw").places(design)[0] == pytest.approx((-10.5, 12.331, 0.0))
    assert registry.find("shell").places(design) == [(0.0, 0.0, 0.0)]


@pytest.mark.slow
@pytest.mark.parametrize("name", DESIGNS)
def test_pieces_share_nothing_but_the_threads_and_fill_the_envelope(cq, name):
    design = load_design(name.split()[0], DESIGNS[name])
    placed = assemble(design)
    low, high = hull(placed)
    assert high - low == pytest.approx(design.outer_mm, abs=1e-5)
    assert high[2] == pytest.approx(0.0, abs=1e-5)
    threads = thread_overlap_mm3(design)
    shared = overlaps(design, None)
    assert [pair[:2] for pair in shared].count(("screw", "skin-frame")) == 4
    assert [pair[:2] for pair in shared].count(("camera-holder", "camera-screw")) == 2
    wrong = [
        (a, b, volume_mm3)
        for a, b, volume_mm3 in shared
        if abs(volume_mm3 - threads.get((a, b), 0.0)) > 1e-9
    ]
    assert wrong == []


def test_the_default_sensor_is_the_paper_s(design, solids):
    placed = assemble(design, solids=solids)
    assert len(placed) == 8 + 2 + 4
    low, high = hull(placed)
    assert high - low == pytest.approx((39, 60, 30), abs=1e-5)
    engaged = math.pi / 4 * (1.6**2 - 1.35**2) * 4.6
    assert thread_overlap_mm3(design)["screw", "skin-frame"] == pytest.approx(engaged, rel=1e-12)


def test_exploding_moves_each_part_by_its_own_shift(cq, design, solids):
    put = assemble(design, solids=solids)
    half, whole = (assemble(design, at, solids=solids) for at in (0.5, 1.0))
    for a, b, c in zip(put, half, whole, strict=True):
        assert (a.part, a.index) == (b.part, b.index) == (c.part, c.index)
        rise = a.part.explode_mm
        assert np.subtract(c.shift_mm, a.shift_mm) == pytest.approx((0, 0, rise))
        moved = np.subtract(bounding_box(b.solid), bounding_box(a.solid))
        assert moved == pytest.approx(np.tile((0, 0, rise / 2), (2, 1)), abs=1e-5)
    screws = [piece for piece in put if piece.part.name == "screw"]
    assert [piece.index for piece in screws] == [0, 1, 2, 3]
    assert [piece.shift_mm[:2] for piece in screws] == design.screw_centres_mm


def test_a_part_out_of_place_is_found_with_its_volume(cq, design, solids):
    # The acrylic 0.5 mm too far in front: it meets skin and frame over its whole plan.
    shifted = {**solids, "acrylic": solids["acrylic"].moved(cq.Location((0, 0, 0.5)))}
    found = {(a, b): v for a, b, v in overlaps(design, shifted) if v > 1e-9}
    assert set(found) == {
        ("acrylic", "skin"), ("acrylic", "skin-frame"), ("screw", "skin-frame"),
        ("camera-holder", "camera-screw"),
    }  # fmt: skip
    plan_mm2 = solids["acrylic"].Volume() / design.optics.acrylic_mm
    into = found["acrylic", "skin"] + found["acrylic", "skin-frame"]
    assert into == pytest.approx(0.5 * plan_mm2, rel=1e-6)


def test_parts_are_built_only_where_no_solid_is_given(cq, design, solids):
    parts = [registry.find("cover"), registry.find("camera-holder")]
    placed = assemble(design, parts=parts, solids={"cover": solids["cover"]})
    assert [piece.part.name for piece in placed] == ["cover", "camera-holder"]
    given = [solids[piece.part.name].wrapped for piece in placed]
    assert placed[0].solid.wrapped.IsPartner(given[0])
    assert not placed[1].solid.wrapped.IsPartner(given[1])
