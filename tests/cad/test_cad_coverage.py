"""Coverage: what a drawing lacks is told, and nothing is lacking on ours."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from deltact_fab.cad import registry
from deltact_fab.cad.check import drawings
from deltact_fab.cad.check.built import BuiltDesign
from deltact_fab.cad.design import load_design
from deltact_fab.cad.drafting.coverage import coverage, variations
from deltact_fab.cad.drafting.dimensioning import Leader, Linear
from deltact_fab.cad.drafting.items import Callouts, z_of
from deltact_fab.cad.part import Part
from deltact_fab.cad.solid_gate import Expected

DESIGNS = ("deltact", "franka", "screws-16mm", "skin-30x34", "skin-44x40")
DRAWN = [part.name for part in registry.listed() if part.callouts is not None]


@pytest.mark.slow
@pytest.mark.parametrize("design", DESIGNS)
def test_every_drawing_says_each_dimension_once(design):
    dims = load_design(design)
    told = {name: coverage(registry.find(name), dims) for name in DRAWN}
    assert {name: found for name, found in told.items() if not found.complete} == {}
    (row,) = drawings.rows(BuiltDesign.make(dims))
    assert row.passed
    assert row.part == f"{len(DRAWN)} parts"


def test_a_mount_that_is_a_plate_is_as_high_as_the_shell():
    plate = load_design("deltact", ["mount.kind=plate"])
    assert coverage(registry.find("shell"), plate).complete


def test_the_numbers_of_a_part_are_followed():
    dims = load_design()
    followed = coverage(registry.find("cover"), dims).followed
    assert {"cover.floor_mm", "cover.slot_mm", "cover.lip_mm", "screw.thread"} <= set(followed)
    # A limit of the resin and the room that the shell leaves make no length of the cover.
    assert not {"cover.strain_limit", "cover.fit_mm"} & set(followed)
    star = coverage(registry.find("indenter-star"), dims).followed
    assert {"plate_mm", "reach_mm", "tip.inner_mm", "tip.notch_mm", "tip.edge_mm"} <= set(star)


def changed(name, change):
    """A part whose drawing says something else."""
    part = registry.find(name)

    def callouts(source):
        said = part.callouts(source)
        return replace(said, items=tuple(change(source, list(said.items))))

    return replace(part, callouts=callouts)


def without(name, which):
    return changed(name, lambda _, items: [item for item in items if not which(item)])


def also(name, item):
    return changed(name, lambda source, items: [*items, item(source)])


# The legs follow the slot, too.
SLOT = (" slot", " over both legs")


def test_a_length_left_out_is_told():
    dims = load_design()
    slot = without("cover", lambda i: isinstance(i, Linear) and i.after in SLOT)
    assert "cover.slot_mm" in coverage(slot, dims).unsaid
    (row,) = drawings.rows(BuiltDesign(dims, (slot,), {}))
    assert (row.part, row.passed) == ("cover", False)
    assert "not said: " in row.found
    assert "cover.slot_mm" in row.found
    # A hole's place changes neither volume nor size.
    pitch = without("shell", lambda i: isinstance(i, Linear) and i.view == "top"
                    and i.side == "right" and i.a[1] > 20)  # fmt: skip
    assert coverage(pitch, dims).unsaid == ("mount.hole_pitch_mm",)
    base = without("coupon-mold", lambda i: isinstance(i, Linear) and i.view == "left")
    assert coverage(base, dims).unsaid == ("coupon.base_mm",)


def test_keys_that_one_number_cannot_tell_apart_are_told():
    """Only the sum of floor and depth is said."""
    dims = load_design()

    def callouts(d):
        floor, depth = d.coupon.base_mm, d.coupon.depth_mm
        return Callouts((z_of("left", 0, floor + depth, "right"),), ())

    plain = Part("well", "", "", lambda _: None, one_well, sections=("coupon",), callouts=callouts)
    assert {"coupon.base_mm", "coupon.depth_mm"} <= set(coverage(plain, dims).followed)
    assert {"coupon.base_mm", "coupon.depth_mm"} <= set(coverage(plain, dims).unsaid)


def one_well(d):
    """A block of 20 x 20 with a square well of 10 x 10."""
    height = d.coupon.base_mm + d.coupon.depth_mm
    volume = 400 * height - 100 * d.coupon.depth_mm
    return Expected((volume, volume), ((0, 0, 0), (20, 20, height)), {})


def test_the_larger_of_two_equal_lengths_is_said_by_both():
    """On the corner between them a step forwards moves the one for some keys, for others not."""

    def callouts(d):
        seat, floor = d.mold.seat_mm - d.coupon.depth_mm, d.coupon.base_mm
        return Callouts((z_of("left", 0, seat, "right"), z_of("front", 0, floor, "right")), ())

    def larger(d):
        height = max(d.mold.seat_mm - d.coupon.depth_mm, d.coupon.base_mm)
        return Expected((400 * height,) * 2, ((0, 0, 0), (20, 20, height)), {})

    dims = load_design(changes=["mold.seat_mm=7", "coupon.base_mm=3", "coupon.depth_mm=4"])
    plain = Part("step", "", "", lambda _: None, larger, sections=("coupon", "mold"),
                 callouts=callouts)  # fmt: skip
    assert coverage(plain, dims).unsaid == ()

    def first_alone(d):
        return replace(callouts(d), items=callouts(d).items[:1])

    told = coverage(replace(plain, callouts=first_alone), dims).unsaid
    assert "coupon.base_mm" in told


def test_a_boss_as_high_as_the_pegs_is_said():
    dims = load_design(changes=["screw.length_mm=16", "screw.engagement_mm=4.1"])
    assert dims.z_boss_mm == pytest.approx(dims.z_floor_mm + dims.peg_length_mm)
    assert coverage(registry.find("cover"), dims).unsaid == ()


@pytest.mark.slow
def test_a_key_may_be_silent_with_a_reason():
    dims = load_design()
    slot = without("cover", lambda i: isinstance(i, Linear) and i.after in SLOT)

    def callouts(source):
        said = slot.callouts(source)
        return replace(
            said, silent={**said.silent, **dict.fromkeys(coverage(slot, dims).unsaid, "sawn")}
        )

    assert coverage(replace(slot, callouts=callouts), dims).complete


def test_a_length_said_twice_is_told():
    dims = load_design()
    again = also("acrylic", lambda d: z_of("left", d.z_joint_mm, d.z_ledge_mm, "left"))
    assert coverage(again, dims).twice == ("2 ±0.2 (front) and 2 (left)",)
    label = also(
        "coupon-mold", lambda d: Leader("top", (0, 0, 0), 0, f"R{d.coupon.diameter_mm / 2}")
    )
    assert coverage(label, dims).twice == ("15 of '4× Ø15 depth 4' (top) and 7.5 of 'R7.5' (top)",)


def test_equal_by_chance_is_not_the_same():
    dims = load_design()
    assert dims.mold.base_mm == dims.mold.seat_mm == 3
    assert coverage(registry.find("mold"), dims).twice == ()


def test_a_closed_chain_is_told_and_a_bracket_opens_it():
    dims = load_design()

    def whole(d):
        low, high = 0.0, d.mold_outer_mm[2]
        return z_of("left", low, high, "right")

    assert coverage(also("mold", whole), dims).chains == ("12 (left)",)
    bracketed = also("mold", lambda d: replace(whole(d), auxiliary=True))
    assert coverage(bracketed, dims).chains == ()


@pytest.mark.slow
@pytest.mark.parametrize("name", DRAWN)
def test_what_no_number_follows_changes_nothing_on_the_solid(name):
    """The check without a kernel compares volumes and sizes; here every corner is compared."""
    part, dims = registry.find(name), load_design()
    source = part.source(dims)
    followed = coverage(part, dims).followed
    before, volume_mm3 = corners(part.build(source))
    for key, other, step in variations(part, source):
        if key not in followed:
            after, other_mm3 = corners(part.build(other))
            assert after.shape == before.shape, key
            assert np.allclose(after, before, rtol=0, atol=0.1 * min(abs(step), 1e-3)), key
            assert other_mm3 == pytest.approx(volume_mm3, rel=1e-9), key


def corners(solid):
    """Corners (n, 3) from the lowest ones, wherever the part lies in the sensor; and its volume."""
    box = solid.BoundingBox()
    points = np.array([v.toTuple() for v in solid.Vertices()]) - (box.xmin, box.ymin, box.zmin)
    return points[np.lexsort(points.round(3).T)], solid.Volume()
