"""Solids: their closed forms, how they meet, and what a bad number or a bad kernel gives."""

from __future__ import annotations

import dataclasses
import math
import re

import numpy as np
import pytest
from closed_forms import held, indenter_mm3

from deltact_fab.cad import feasibility, registry, solid_gate
from deltact_fab.cad.build import build_part
from deltact_fab.cad.design import (
    IndenterBody,
    IndenterDimensions,
    IndenterList,
    load_design,
    load_indenters,
)
from deltact_fab.cad.dimensions import Design
from deltact_fab.cad.kernel import guarded, require
from deltact_fab.cad.parts import indenter as indenter_part
from deltact_fab.errors import InputError, RunFailed
from deltact_fab.shapes import EllipsoidTip, Indenter, PrismTip, RidgeTip, SphereTip
from deltact_fab.shapes.bounded import ShapeError
from deltact_fab.shapes.indenter import parse

DEFAULT = Design()
PAIR = tuple(registry.find(name) for name in ("skin", "skin-frame"))


@pytest.fixture(scope="session")
def cq():
    return require()


@pytest.fixture(scope="session")
def solids(cq):
    """The default skin and frame, gated."""
    return {part.name: build_part(part, DEFAULT)[0] for part in PAIR}


def test_the_shipped_design_is_the_paper_s():
    dims = load_design()
    assert dims == DEFAULT
    assert dims.frame_outer_mm == (39.0, 40.0)
    assert np.allclose(dims.screw_centres_mm[-1], (16.225, 16.725))


def test_a_design_file_with_a_wrong_key_is_one_line(tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text("[frame]\npost = 6.0\n")
    with pytest.raises(InputError, match=r"mine\.toml: frame\.post: unknown key"):
        load_design(str(path))


def test_an_indenter_list_names_its_file(tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text('[[indenter]]\nname = "cube:3"\n')
    with pytest.raises(InputError, match=r"mine\.toml: indenter 'cube:3': unknown"):
        load_indenters(str(path))
    for once, again in (("sphere:10", "sphere:10.0"), ("star", "star:9")):
        path.write_text(f'[[indenter]]\nname = "{once}"\n[[indenter]]\nname = "{again}"\n')
        with pytest.raises(InputError, match=f"'{once}': listed twice"):
            load_indenters(str(path))
    path.write_text("[body]\nshank_mm = 3.0\n")
    with pytest.raises(InputError, match=r"mine\.toml: body\.shank_mm: unknown key"):
        load_indenters(str(path))


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


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        (["shell.wall_mm=9"], r"room between the posts in x: 0 < -4\.1 fails"),
        (["frame.seat_y_mm=3"], r"pocket in y < half the frame in y: 20 < 20 fails"),
        (["screw.engagement_mm=7"], r"screw\.tip_clearance_mm <= frame height - shell\.wall_mm: 8"),
    ],
)
@pytest.mark.parametrize("part", PAIR, ids=lambda part: part.name)
def test_a_broken_inequality_is_told_before_the_kernel_runs(changes, says, part, monkeypatch):
    def no_kernel(*_):
        raise AssertionError("the kernel ran")

    monkeypatch.setattr(f"{part.build.__module__}.require", no_kernel)
    dims = load_design("deltact", changes)
    told = [f"{r.part}: {r.text} fails" for r in feasibility.rules(dims) if not r.holds]
    assert any(re.search(says, line) for line in told), told
    with pytest.raises(InputError, match=re.escape(told[0])):
        build_part(part, dims)


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


NONSENSE = {
    "a hole off the part": lambda w: _box(w).faces(">Z").workplane().center(20, 0).hole(2),
    "a wall thicker than the part": lambda w: _box(w).shell(-25),
    "a side that is NaN": lambda w: _box(w, math.nan),
    "a fillet at its limit": lambda w: _box(w).edges().fillet(5.0),
    "a fillet of 1e-7": lambda w: _box(w).edges().fillet(1e-7),
}


def _box(workplane, side_mm=10.0):
    return workplane.box(side_mm, side_mm, side_mm)


@pytest.mark.parametrize("make", NONSENSE.values(), ids=NONSENSE)
def test_guard_and_gate_refuse_what_the_kernel_makes_of_nonsense(cq, make):
    """A builder's way: the kernel raises, or returns something that only the gate can tell."""
    wanted = (-5.0, -5.0, 0.0), (5.0, 5.0, 9.0)
    with pytest.raises(RunFailed, match=r"^trial"), guarded("trial"):
        solid_gate.gate("trial", make(cq.Workplane()).val(), wanted)


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


def _underside_mm(solid, x_mm, y_mm):
    """Lowest z at which a ray along +z from below meets the solid, inf for a miss."""
    from OCP.gp import gp_Dir, gp_Lin, gp_Pnt
    from OCP.IntCurvesFace import IntCurvesFace_ShapeIntersector

    ray = IntCurvesFace_ShapeIntersector()
    ray.Load(solid.wrapped, 1e-9)
    low = np.full(len(x_mm), np.inf)
    for i, (x, y) in enumerate(zip(x_mm, y_mm, strict=True)):
        ray.Perform(gp_Lin(gp_Pnt(x, y, -10.0), gp_Dir(0, 0, 1)), 0.0, 200.0)
        hits = [ray.Pnt(k).Z() for k in range(1, ray.NbPnt() + 1)]
        low[i] = min(hits, default=np.inf)
    return low


UNEVEN = Indenter("uneven", (SphereTip(-3.0, 0.0, 2.0), SphereTip(0.5, 1.0, 3.0)))
# Off the axis, and not of the default proportions.
MIXED = Indenter(
    "mixed",
    (
        RidgeTip(-4.0, 1.0, 0.5, 0.8, 3.0, flank_deg=50.0),
        EllipsoidTip(0.0, -2.5, 2.0, 2.4),
        PrismTip(4.8, 2.0, 3, 2.5, 1.1, 0.4, 0.9, 0.35),
    ),
)
NAMES = (
    *("sphere:10", "sphere:4", "sphere:22", "4dots", "2dots", "edges", "ellipsoid", "hexprism"),
    *("star", "4dots:5", "edges:5", "edges:20", "ellipsoid:20", "hexprism:5", "star:5", "star:20"),
)


@pytest.mark.parametrize("shape", [*map(parse, NAMES), UNEVEN, MIXED], ids=lambda shape: shape.name)
def test_the_underside_is_the_height_field(shape, cq):
    dims = IndenterDimensions(shape, IndenterBody())
    solid, found = solid_gate.gate(shape.slug, indenter_part.build(dims), indenter_part.box(dims))
    low, high = indenter_mm3(dims)
    assert low * (1 - 1e-6) <= found.volume_mm3 <= high * (1 + 1e-6)
    assert shape is UNEVEN or low == high
    rng = np.random.default_rng(11)
    hx, hy = indenter_part.plate_half_mm(dims)
    x, y = rng.uniform(-1.05 * hx, 1.05 * hx, 600), rng.uniform(-1.05 * hy, 1.05 * hy, 600)
    field, found = shape.height_mm(x, y), _underside_mm(solid, x, y)
    tips = np.isfinite(field)
    assert 50 < tips.sum() < 600
    assert np.abs(found[tips] - field[tips]).max() < 1e-6
    assert found[~tips].min() > dims.plate_z_mm - 1e-9
    assert dims.plate_z_mm == shape.reach_mm


def test_the_body_s_numbers_reach_the_solid(cq):
    known = IndenterList(IndenterBody(plate_mm=2.5))
    _, found = build_part(registry.find("sphere:10", known), DEFAULT)
    assert found.box_mm[1][2] == pytest.approx(12.0 + 2.5 + 20.0)


def test_a_tip_longer_than_its_free_length_is_told_before_the_kernel_runs():
    with pytest.raises(ShapeError, match=r"equator_mm < reach_mm: 13 < 12 fails"):
        IndenterDimensions(Indenter("short", (SphereTip(0, 0, 13.0),)), IndenterBody())


@pytest.mark.parametrize("name", ["4dots", "2dots", "edges", "ellipsoid", "hexprism", "star"])
def test_the_plate_covers_the_tips(name, cq):
    dims = IndenterDimensions(parse(name), IndenterBody())
    solid = indenter_part.build(dims)
    hx, hy = dims.indenter.footprint_half_mm
    x, y = (v.ravel() for v in np.meshgrid(np.linspace(-hx, hx, 21), np.linspace(-hy, hy, 21)))
    below = np.isfinite(dims.indenter.height_mm(x, y))
    middle = dims.plate_z_mm + dims.body.plate_mm / 2
    assert all(
        solid.isInside(cq.Vector(a, b, middle), 1e-6)
        for a, b in zip(x[below], y[below], strict=True)
        if abs(a) < hx and abs(b) < hy
    )
