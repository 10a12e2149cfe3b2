"""Solids: their closed forms, how they mate and stand together, what a bad number or kernel gives.

That no two pieces of a shipped design share volume is a row of `cad check`.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from closed_forms import held, mount_mm3
from closed_forms import volume_mm3 as closed_form_mm3
from solids import box, common_mm3, made, moved, of_group, rod

from deltact_fab.common.errors import InputError, RunFailed
from deltact_fab.fabricate.cad import feasibility, kernel, registry
from deltact_fab.fabricate.cad.assembly import assemble_sensor, places
from deltact_fab.fabricate.cad.build import build_part
from deltact_fab.fabricate.cad.check.built import BuiltDesign
from deltact_fab.fabricate.cad.check.together import shared_volumes
from deltact_fab.fabricate.cad.design import load_design
from deltact_fab.fabricate.cad.dimensions import Design
from deltact_fab.fabricate.cad.kernel import guarded, require
from deltact_fab.fabricate.cad.parts import mount

D = load_design()
INNER = ("light-holder", "camera", "camera-screw", "camera-holder", "cover", "screw")
MOUNTS = {
    "franka": load_design("franka"),
    "skin-44x40": load_design("skin-44x40"),
    "plate": load_design("deltact", ["mount.kind=plate"]),
    # Mount and tabs stand over the bosses, which are high here.
    "wide": load_design("screws-19mm", ["mount.width_mm=39", "table.width_mm=40"]),
    "wide franka": load_design("franka", ["screw.length_mm=12", "mount.width_mm=39"]),
}


@pytest.fixture(scope="module")
def cq():
    return require()


# Volumes.

WIDE = ("envelope.width_mm=90", "envelope.length_mm=90", "envelope.height_mm=60")


@pytest.mark.parametrize(
    ("names", "design", "changes"),
    [
        (INNER, "screws-19mm", ()),
        (INNER, "franka", ()),
        (INNER, "skin-44x40", ()),
        # The x wall holds the post; nothing in the window; a wide pocket.
        ("skin skin-frame", "deltact", (*WIDE, "frame.wall_x_mm=7", "shell.ledge_x_mm=0")),
        ("skin skin-frame", "deltact", (*WIDE, "skin.protrusion_mm=12", "optics.acrylic_mm=8")),
        ("skin skin-frame", "deltact", (*WIDE, "skin.thickness_mm=15", "frame.wall_y_mm=3.5",
                                        "frame.seat_y_mm=2", "skin.edge_fillet_mm=5.9")),
        ("skin skin-frame", "deltact", (*WIDE, "frame.wall_x_mm=3", "frame.seat_x_mm=1.5")),
        ("mold", "deltact", ("mold.columns=1", "mold.rows=1", "skin.edge_fillet_mm=5.9")),
        ("mold", "deltact", ("mold.columns=3", "mold.web_mm=12", "mold.pry_mm=4")),
        ("mold", "deltact", ("mold.seat_mm=0.6", "mold.fit_mm=0.3", "mold.pry_width_mm=38")),
        ("coupon-mold", "deltact", ("coupon.wells=12", "coupon.depth_mm=50")),
    ],
)  # fmt: skip
def test_other_dimensions_give_exact_volumes(names, design, changes):
    dims = load_design(design, changes)
    for name in names.split() if isinstance(names, str) else names:
        held(registry.find_part(name), dims)


@pytest.mark.parametrize("design", MOUNTS)
def test_mount_volume_has_closed_form(design, cq):
    dims = MOUNTS[design]
    assert mount.build(dims).val().Volume() == pytest.approx(mount_mm3(dims), rel=1e-6)


def test_default_volumes_are_pinned():
    def volume_mm3(part):
        low, high = closed_form_mm3(registry.find_part(part), D)
        assert low == high
        return low

    # Tube 39 x 40 x 14.5 of wall 1.5; posts 6.55 above bosses of 4.6; ledges; cable notch.
    bare = (39 * 40 - 36 * 37) * 14.5 + 4 * (5.05**2 - math.pi * 1.0**2) * 9.9
    bare += -4 * (6.75**2 - 5.25**2) * 4.6 + 2 * (25.9 * 2.8 + 26.9 * 2.3) * 1.5 - 17 * 2 * 1.5
    block = 20 * 20 * 10 - 2 * math.pi * 1.7**2 * 10
    tab = 14 * 30 * 6 - 2 * math.pi * 2.25**2 * 6 - 0.2 * 30 * 1.5 - 0.2 * 2 * 1.75 * 4.5
    assert volume_mm3("shell") == pytest.approx(bare + block, rel=1e-12)
    assert volume_mm3("testing-shell") == pytest.approx(bare + 2 * tab, rel=1e-12)
    assert volume_mm3("acrylic") == pytest.approx((35.8 * 36.8 - 4 * 5.05**2) * 2, rel=1e-12)


BOUGHT_BY_SIZE = ("light.strip_width_mm",)


def _scaled(factor):
    """The shipped design with every length times factor, but what is bought by size."""
    changes = [
        f"{section.name}.{f.name}={factor * getattr(record, f.name)!r}"
        for section in dataclasses.fields(D)
        for record in [getattr(D, section.name)]
        for f in dataclasses.fields(record)
        if f.name.endswith("_mm") and isinstance(getattr(record, f.name), float)
        and f"{section.name}.{f.name}" not in BOUGHT_BY_SIZE
    ]  # fmt: skip
    design = load_design("deltact", changes)
    feasibility.check_feasible(design)
    return design


@pytest.mark.parametrize(
    ("factor", "told"),
    [
        (0.7, r"coupon\.base_mm: .*1\.5 <= base_mm <= 50"),
        (0.9, "strip_width_mm <= depth of the channel: 8 <= 7.2 fails"),
        (3.0, r"tool\.clamp_mm: .*clamp_mm <= 6"),
    ],
)
def test_unbuildable_design_is_refused_early(factor, told):
    with pytest.raises(InputError, match=told):
        _scaled(factor)


@pytest.mark.slow
@pytest.mark.parametrize("factor", [1.0, 1.2])
def test_scaled_parts_have_their_volumes(factor, cq):
    design = _scaled(factor)
    for part in registry.design_parts():
        held(part, design)


# The kernel.


def test_broken_inequality_precedes_the_kernel():
    def no_kernel(_):
        raise AssertionError("the kernel ran")

    part = dataclasses.replace(registry.find_part("skin-frame"), build=no_kernel)
    with pytest.raises(InputError, match=r"room between the posts in x: 0 < -4\.1 fails"):
        build_part(part, load_design("deltact", ["shell.wall_mm=9"]))


def test_kernel_errors_give_one_line(cq):
    cube = cq.Solid.makeBox(10, 10, 10)

    def too_round():
        with guarded("skin"):
            cube.fillet(20.0, cube.Edges())

    with pytest.raises(RunFailed, match=r"^skin: the CAD kernel failed \(.+\)$"):
        too_round()


def test_gate_stops_silent_kernel_failures(cq):
    unit = ((0.0, 0.0, 0.0), (1.0, 1.0, 1.0))
    cube = cq.Solid.makeBox(1, 1, 1)
    assert kernel.gate("box", cube, unit)[1].volume_mm3 == pytest.approx(1.0)
    wrong = {
        "0 solids": cube.cut(cq.Solid.makeBox(2, 2, 2)),
        "2 solids": cq.Compound.makeCompound([cube, moved(cube, 3, 0, 0)]),
        "bounding box": moved(cube, 0.1, 0, 0),
        "2 shells": cq.Solid.makeBox(3, 3, 3).cut(box((1, 1, 1), (2, 2, 2))),
    }
    for says, shape in wrong.items():
        with pytest.raises(RunFailed, match=f"^box: .*{says}"):
            kernel.gate("box", shape, unit)


# How they mate.


def test_acrylic_is_the_papers_rectangle(cq):
    free = ["shell.ledge_x_mm=0", "frame.wall_x_mm=7", "envelope.width_mm=50"]
    thick = load_design("deltact", free)
    assert thick.acrylic_notch_mm == (0.0, 0.0)
    solid, found = build_part(registry.find_part("acrylic"), thick)
    assert len(solid.Faces()) == 6
    assert found.volume_mm3 == pytest.approx(35.8 * 36.8 * 2)


def test_acrylic_clears_posts_on_ledges(cq):
    plate = made("acrylic")
    (x, y), (outer_x, outer_y) = D.post_edge_mm, D.frame_outer_mm
    post = box((x, y, D.z_joint_mm), (outer_x / 2, outer_y / 2, D.z_ledge_mm))
    assert plate.distance(post) == pytest.approx(0.1)
    in_y, in_x = (2 * (2 * edge - 0.2) for edge in D.post_edge_mm)
    # On the frame's ledge in y; on the shell's all around, 2.2 mm of it in x.
    for by, part, mm2 in (
        (-0.1 - D.shell.ledge_drop_mm, "shell", 2.7 * in_y + 2.2 * in_x),
        (0.1, "skin-frame", 1.4 * in_y),
    ):
        assert common_mm3(moved(plate, 0, 0, by), made(part)) == pytest.approx(mm2 * 0.1, rel=1e-6)


def test_mount_holes_take_screw_heads(cq):
    """A washer from either end of a block's hole; of a flange, a head down to the counterbore."""
    for design in ("deltact", "franka"):
        m, shell = load_design(design).mount, made("shell", design)
        axes = mount.hole_axes(load_design(design))
        assert len(axes) == 2
        gap_mm = m.length_mm - m.flange_mm - 1e-3
        for (x, y, z), end in axes:
            heads = [
                ((x, y, z), end, m.thread.washer_mm, gap_mm),
                (end, (x, y, z), m.thread.washer_mm, gap_mm),
            ]
            if m.kind == "franka":
                floor = (x, y + m.counterbore_depth_mm - 1e-3, z)
                heads = [(floor, end, m.head_mm, gap_mm + m.counterbore_depth_mm - 1e-3)]
            for at, other, wide_mm, high_mm in heads:
                out = (cq.Vector(*at) - cq.Vector(*other)).normalized()
                head = cq.Solid.makeCylinder(wide_mm / 2, high_mm, cq.Vector(*at), out)
                assert common_mm3(head, shell) < 1e-9


def test_slot_and_connector_at_minus_y(cq):
    ring, floor = made("light-holder"), D.z_board_front_mm + D.light.floor_mm
    between, half = -(D.light_radius_mm + D.strip_radius_mm) / 2, D.light.slot_mm / 2
    for x, y, z, solid in (
        (0.0, between, floor + 0.01, False),
        (half - 0.01, between, D.z_light_mm - 0.01, False),
        (half + 0.01, between, floor + 0.01, True),
        (0.0, between, floor - 0.01, True),
        (0.0, -between, floor + 1, True),
    ):
        assert ring.isInside(cq.Vector(x, y, z)) is solid
    cam, camera = D.camera, made("camera")
    assert camera.isInside(cq.Vector(cam.lens_diameter_mm / 2 - 0.01, 0, D.z_lens_mm - 0.01))
    deep = D.z_board_back_mm - cam.connector_height_mm + 0.01
    for beyond, inside in ((0.01, True), (cam.connector_length_mm + 0.01, False)):
        assert camera.isInside(cq.Vector(0, cam.board_bottom_mm + beyond, deep)) is inside
    half, top = D.holder_window_half_mm - 0.005, D.holder_window_top_mm - 0.005
    path = box((-half, -100, D.z_floor_mm), (half, top, D.z_floor_mm + D.holder.clearance_mm))
    assert common_mm3(made("camera-holder"), path) < 1e-9


def test_bent_leg_passes_its_hole():
    cover, (x, y), reach = D.cover, D.peg_at_mm, D.cover.hole_mm
    peg = box((x - reach, y - reach, D.z_floor_mm),
              (x + reach, y + reach, D.z_floor_mm + 2 * D.peg_length_mm))  # fmt: skip
    legs = sorted(made("cover").intersect(peg).Solids(), key=lambda leg: leg.Center().x)
    left, right = legs
    left, right = moved(left, cover.lip_mm, 0, 0), moved(right, -cover.lip_mm, 0, 0)
    hole = rod(cover.hole_mm / 2 + 1e-6, -60, 0, x, y)
    assert left.cut(hole).Volume() < 1e-9
    assert right.cut(hole).Volume() < 1e-9
    assert common_mm3(left, right) < 1e-9
    assert left.cut(rod(cover.hole_mm / 2 - 0.01, -60, 0, x, y)).Volume() > 1e-4
    # Eight crescents, at most lip_mm wide, catch the holder beyond its play.
    lifted = moved(made("camera-holder"), 0, 0, cover.peg_play_mm + 0.05)
    assert common_mm3(made("cover"), lifted) > 8 * 0.05 * cover.lip_mm


# The sensor put together.


def hull(placed):
    boxes = np.array([kernel.bounding_box(piece.solid) for piece in placed])
    return boxes[:, 0].min(axis=0), boxes[:, 1].max(axis=0)


def overlaps(design, solids):
    """Common volume of every pair of the sensor's pieces whose boxes meet."""
    built = BuiltDesign(design, tuple(registry.list_parts()), dict(solids))
    parts = [part for part in built.parts if part.group == "sensor"]
    return list(shared_volumes(built, places(design, parts)))


def grips_mm3(design: Design):
    """What a screw shares with its pilot on purpose: the ring over the length that grips."""
    screw, holder = design.screw.row, design.holder.row
    grip_mm = design.holder.screw_length_mm - design.camera.board_mm
    return {
        (one, other): math.pi / 4 * (row.thread_mm**2 - row.pilot_mm**2) * length_mm
        for one, other, row, length_mm in (
            ("screw", "skin-frame", screw, design.screw.engagement_mm),
            ("camera-holder", "camera-screw", holder, grip_mm),
        )
    }


@pytest.mark.parametrize(
    ("name", "changes"),
    [
        ("deltact", ()),
        pytest.param("franka", (), marks=pytest.mark.slow),
        # Threads that grip over other lengths than the defaults'.
        pytest.param("deltact", ("screw.engagement_mm=5.2", "holder.screw_length_mm=3.8",
                                 "holder.clearance_mm=3.1"), marks=pytest.mark.slow),
    ],
)  # fmt: skip
def test_pieces_overlap_only_in_threads(name, changes):
    design = load_design(name, changes)
    solids = {p.name: made(p.name, name, *changes) for p in registry.parts_of_group("sensor")}
    placed = assemble_sensor(design, solids=solids)
    assert len(placed) == 8 + 2 + 4
    low, high = hull(placed)
    assert high - low == pytest.approx(design.outer_mm, abs=1e-5)
    assert high[2] == pytest.approx(0.0, abs=1e-5)
    found, wanted = overlaps(design, solids), grips_mm3(design)
    pairs = [pair[:2] for pair in found]
    assert [pairs.count(pair) for pair in wanted] == [4, 2]
    assert [one for one in found if abs(one[2] - wanted.get(one[:2], 0.0)) > 1e-9] == []


@pytest.mark.slow
def test_misplaced_part_reports_overlap_volume():
    """The acrylic 0.5 mm too far in front: it meets skin and frame over its whole plan."""
    solids = of_group("sensor")
    shifted = {**solids, "acrylic": moved(solids["acrylic"], 0, 0, 0.5)}
    found = {(a, b): v for a, b, v in overlaps(D, shifted) if v > 1e-9}
    assert set(found) == {("acrylic", "skin"), ("acrylic", "skin-frame"), *grips_mm3(D)}
    plan_mm2 = solids["acrylic"].Volume() / D.optics.acrylic_mm
    into = found["acrylic", "skin"] + found["acrylic", "skin-frame"]
    assert into == pytest.approx(0.5 * plan_mm2, rel=1e-6)


def test_exploding_shifts_each_part():
    put, half, whole = (assemble_sensor(D, at, solids=of_group("sensor")) for at in (0.0, 0.5, 1.0))
    for a, b, c in zip(put, half, whole, strict=True):
        assert (a.part, a.index) == (b.part, b.index) == (c.part, c.index)
        rise = a.part.explode_mm
        assert np.subtract(c.shift_mm, a.shift_mm) == pytest.approx((0, 0, rise))
        way = np.subtract(*map(kernel.bounding_box, (b.solid, a.solid)))
        assert way == pytest.approx(np.tile((0, 0, rise / 2), (2, 1)), abs=1e-5)
    screws = [piece for piece in put if piece.part.name == "screw"]
    assert [piece.shift_mm[:2] for piece in screws] == D.screw_centres_mm


def test_given_solids_are_not_rebuilt():
    names = ("cover", "camera-holder")
    given = {"cover": made("cover")}
    placed = assemble_sensor(D, parts=[registry.find_part(name) for name in names], solids=given)
    kept = [piece.solid.wrapped.IsPartner(made(name).wrapped)
            for piece, name in zip(placed, names, strict=True)]  # fmt: skip
    assert kept == [True, False]
