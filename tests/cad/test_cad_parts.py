"""Solids: their closed forms, how they meet, and what a bad number or a bad kernel gives."""

from __future__ import annotations

import dataclasses
import math

import pytest
from closed_forms import held

from deltact_fab.cad import feasibility, registry, solid_gate
from deltact_fab.cad.build import build_part
from deltact_fab.cad.design import load_design
from deltact_fab.cad.dimensions import Design
from deltact_fab.cad.kernel import guarded, require
from deltact_fab.errors import InputError, RunFailed

DEFAULT = Design()
PAIR = tuple(registry.find(name) for name in ("skin", "skin-frame"))


@pytest.fixture(scope="session")
def cq():
    return require()


@pytest.fixture(scope="session")
def solids(cq):
    """The default skin and frame, gated."""
    return {part.name: build_part(part, DEFAULT)[0] for part in PAIR}


def test_skin_and_frame_share_no_volume_and_leave_no_gap(solids, cq):
    a, b = solids["skin"], solids["skin-frame"]
    assert a.intersect(b).Volume() < 1e-9
    # Between the skin's back and the frame's top only the pilot holes stay empty.
    (x, y), low, high = DEFAULT.frame_outer_mm, DEFAULT.z_ledge_mm, DEFAULT.z_front_mm
    slab = cq.Solid.makeBox(x, y, high - low, cq.Vector(-x / 2, -y / 2, low))
    pilot_top = DEFAULT.z_joint_mm + DEFAULT.screw.pilot_depth_mm
    holes = 4 * math.pi / 4 * DEFAULT.screw.row.pilot_mm**2 * (pilot_top - low)
    assert slab.cut(a, b).Volume() == pytest.approx(holes, rel=1e-6)


def test_pilot_holes_stand_on_the_posts_and_are_blind(solids, cq):
    frame = solids["skin-frame"]
    end = DEFAULT.z_joint_mm + DEFAULT.screw.pilot_depth_mm
    for x, y in DEFAULT.screw_centres_mm:
        assert not frame.isInside(cq.Vector(x, y, end - 0.01))
        assert frame.isInside(cq.Vector(x, y, end + 0.01))
        # A wall stands all around the hole, as thick as the shell's.
        beside = DEFAULT.screw.row.pilot_mm / 2 + DEFAULT.shell.wall_mm
        for dx, dy in ((1, 0), (-1, 0), (0, 1), (0, -1)):
            assert frame.isInside(cq.Vector(x + dx * beside, y + dy * beside, end - 0.01))


def test_the_acrylic_s_pocket_is_open_behind_and_ends_at_the_ledge(solids, cq):
    frame, z = solids["skin-frame"], DEFAULT.z_ledge_mm
    on_ledge = DEFAULT.skin.length_mm / 2 + DEFAULT.frame.seat_y_mm / 2
    for y in (on_ledge, -on_ledge):
        assert frame.isInside(cq.Vector(0, y, z + 0.01))
        assert not frame.isInside(cq.Vector(0, y, z - 0.01))


WIDE = ["envelope.width_mm=90", "envelope.length_mm=90", "envelope.height_mm=60"]


@pytest.mark.parametrize(
    "changes",
    [
        ["frame.wall_x_mm=7", "shell.ledge_x_mm=0"],  # the x wall holds the post
        ["skin.edge_fillet_mm=5.9", "optics.acrylic_mm=2.5"],
        ["skin.protrusion_mm=12", "optics.acrylic_mm=8"],  # nothing in the window
        ["skin.length_mm=60", "skin.edge_fillet_mm=0.3", "holder.head_clearance_mm=0.1"],
        ["skin.thickness_mm=15", "frame.wall_y_mm=3.5", "frame.seat_y_mm=2"],
        ["frame.wall_x_mm=3", "frame.seat_x_mm=1.5"],
    ],
    ids=["post in the wall", "large fillet", "all proud", "long", "thick", "wide pocket"],
)
def test_other_dimensions_pass_the_gate(changes, cq):
    dims = load_design("deltact", [*WIDE, *changes])
    for part in PAIR:
        held(part, dims)


def test_a_broken_inequality_is_told_before_the_kernel_runs():
    def no_kernel(_):
        raise AssertionError("the kernel ran")

    part = dataclasses.replace(PAIR[1], build=no_kernel)
    with pytest.raises(InputError, match=r"room between the posts in x: 0 < -4\.1 fails"):
        build_part(part, load_design("deltact", ["shell.wall_mm=9"]))


def test_what_the_kernel_raises_becomes_one_line(cq):
    box = cq.Solid.makeBox(10, 10, 10)

    def too_round():
        with guarded("skin"):
            box.fillet(20.0, box.Edges())

    with pytest.raises(RunFailed, match=r"^skin: the CAD kernel failed \(.+\)$"):
        too_round()


def test_the_gate_stops_what_the_kernel_returns_in_silence(cq):
    unit = ((0.0, 0.0, 0.0), (1.0, 1.0, 1.0))
    box = cq.Solid.makeBox(1, 1, 1)
    assert solid_gate.gate("box", box, unit)[1].volume_mm3 == pytest.approx(1.0)
    wrong = {
        "0 solids": box.cut(cq.Solid.makeBox(2, 2, 2)),
        "2 solids": cq.Compound.makeCompound([box, box.moved(cq.Location((3, 0, 0)))]),
        "bounding box": box.moved(cq.Location((0.1, 0, 0))),
        "2 shells": cq.Solid.makeBox(3, 3, 3).cut(cq.Solid.makeBox(1, 1, 1, cq.Vector(1, 1, 1))),
    }
    for says, shape in wrong.items():
        with pytest.raises(RunFailed, match=f"^box: .*{says}"):
            solid_gate.gate("box", shape, unit)


BOUGHT_BY_SIZE = ("light.strip_width_mm",)


def _scaled(factor):
    """The shipped design with every length times factor, but what is bought by size."""
    changes = [
        f"{section.name}.{f.name}={factor * getattr(record, f.name)!r}"
        for section in dataclasses.fields(DEFAULT)
        for record in [getattr(DEFAULT, section.name)]
        for f in dataclasses.fields(record)
        if f.name.endswith("_mm") and isinstance(getattr(record, f.name), float)
        and f"{section.name}.{f.name}" not in BOUGHT_BY_SIZE
    ]  # fmt: skip
    design = load_design("deltact", changes)
    feasibility.check(design)
    return design


@pytest.mark.parametrize(
    ("factor", "told"),
    [
        (0.7, r"coupon\.base_mm: .*; 1\.5 <= base_mm <= 50"),
        (0.9, "strip_width_mm <= depth of the channel: 8 <= 7.2 fails"),
        (3.0, r"tool\.clamp_mm: .*clamp_mm <= 6"),
    ],
)
def test_a_scaled_design_that_cannot_be_built_is_refused_before_the_kernel_runs(factor, told):
    with pytest.raises(InputError, match=told):
        _scaled(factor)


@pytest.mark.slow
@pytest.mark.parametrize("factor", [1.0, 1.2])
def test_every_part_of_a_scaled_design_has_its_volume(factor, cq):
    design = _scaled(factor)
    for part in registry.of_design():
        held(part, design)
