"""Acrylic, shell, mounts and testing shell: closed forms, what they leave free, what is refused."""

from __future__ import annotations

import itertools
import math

import pytest
from closed_forms import mount_mm3
from closed_forms import volume_mm3 as closed_form_mm3

from deltact_fab.cad import registry
from deltact_fab.cad.build import build_part
from deltact_fab.cad.design import load_design
from deltact_fab.cad.kernel import require
from deltact_fab.cad.parts import mount

SHELLS = ("shell", "testing-shell")
DESIGNS = {
    "deltact": load_design(),
    "screws-19mm": load_design("screws-19mm"),
    "skin-44x40": load_design("skin-44x40"),
    "franka": load_design("franka"),
    "plate": load_design("deltact", ["mount.kind=plate"]),
    # Mount and tabs stand over the bosses, which are high here.
    "wide": load_design("screws-19mm", ["mount.width_mm=39", "table.width_mm=40"]),
    "wide franka": load_design("franka", ["screw.length_mm=12", "mount.width_mm=39"]),
}  # fmt: skip
DEFAULT = DESIGNS["deltact"]


@pytest.fixture(scope="module")
def cq():
    return require()


@pytest.fixture(scope="module")
def built(cq):
    """A gated solid of a design by name, built once."""
    made = {}

    def solid(design: str, part: str):
        if (design, part) not in made:
            made[design, part] = build_part(registry.find(part), DESIGNS[design])[0]
        return made[design, part]

    return solid


def box(cq, low, high):
    return cq.Solid.makeBox(*(b - a for a, b in zip(low, high, strict=True)), cq.Vector(*low))


def cylinder(cq, diameter_mm, start, end):
    axis = cq.Vector(*end) - cq.Vector(*start)
    return cq.Solid.makeCylinder(diameter_mm / 2, axis.Length, cq.Vector(*start), axis.normalized())


@pytest.mark.parametrize("design", ["deltact", pytest.param("wide", marks=pytest.mark.slow)])
def test_every_variant_passes_the_gate_and_overlaps_nothing(design, built):
    names = ("skin", "skin-frame", "acrylic", *SHELLS)
    for a, b in itertools.combinations(names, 2):
        if (a, b) != SHELLS:
            common_mm3 = built(design, a).intersect(built(design, b)).Volume()
            assert common_mm3 < 1e-9, (a, b)


@pytest.mark.parametrize("design", DESIGNS)
def test_the_mount_alone_has_its_closed_form(design, cq):
    dims = DESIGNS[design]
    assert mount.build(dims).val().Volume() == pytest.approx(mount_mm3(dims), rel=1e-6)


def test_volumes_of_the_default_pinned_by_hand():
    def volume_mm3(part):
        low, high = closed_form_mm3(registry.find(part), DEFAULT)
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


def test_acrylic_is_the_paper_s_rectangle_where_the_walls_hold_the_posts(cq):
    free = ["shell.ledge_x_mm=0", "frame.wall_x_mm=7", "envelope.width_mm=50"]
    thick = load_design("deltact", free)
    assert thick.acrylic_notch_mm == (0.0, 0.0)
    solid, found = build_part(registry.find("acrylic"), thick)
    assert len(solid.Faces()) == 6
    assert found.volume_mm3 == pytest.approx(35.8 * 36.8 * 2)


def test_acrylic_keeps_its_fit_from_the_posts_and_lies_on_both_ledges(built, cq):
    plate = built("deltact", "acrylic")
    x, y = DEFAULT.post_edge_mm
    outer_x, outer_y = DEFAULT.frame_outer_mm
    post = box(cq, (x, y, DEFAULT.z_joint_mm), (outer_x / 2, outer_y / 2, DEFAULT.z_ledge_mm))
    assert plate.distance(post) == pytest.approx(0.1)
    down = plate.moved(cq.Location((0, 0, -0.1 - DEFAULT.shell.ledge_drop_mm)))
    up = plate.moved(cq.Location((0, 0, 0.1)))
    in_y, in_x = (2 * (2 * edge - 0.2) for edge in DEFAULT.post_edge_mm)
    # On the frame's ledge in y; on the shell's all around, 2.2 mm of it in x.
    for moved, part, mm2 in (
        (down, "shell", 2.7 * in_y + 2.2 * in_x),
        (up, "skin-frame", 1.4 * in_y),
    ):
        common_mm3 = moved.intersect(built("deltact", part)).Volume()
        assert common_mm3 == pytest.approx(mm2 * 0.1, rel=1e-6)


@pytest.mark.parametrize(
    ("design", "part"),
    [("deltact", "shell"), ("wide franka", "shell"), ("wide", "testing-shell")],
)
def test_bosses_of_the_cover_have_their_fit_all_around(design, part, built, cq):
    dims, shell = DESIGNS[design], built(design, part)
    x, y = (side / 2 for side in dims.frame_outer_mm)
    for sx, sy in itertools.product((-1, 1), repeat=2):
        for slack, clash in ((dims.cover.fit_mm - 1e-4, False), (dims.cover.fit_mm + 1e-2, True)):
            inner = dims.post_mm + slack
            corners = [(sx * (x + slack), sy * (y + slack)), (sx * (x - inner), sy * (y - inner))]
            low, high = (tuple(map(f, *corners)) for f in (min, max))
            boss = box(cq, (*low, dims.z_floor_mm), (*high, dims.z_boss_mm))
            assert (boss.intersect(shell).Volume() > 1e-9) == clash


@pytest.mark.parametrize("part", SHELLS)
def test_screws_pass_the_posts_and_grip_beyond_them(part, built, cq):
    row = DEFAULT.screw.row
    for x, y in DEFAULT.screw_centres_mm:
        ends = (x, y, DEFAULT.z_boss_mm - 0.5), (x, y, DEFAULT.z_joint_mm + 0.5)
        free = cylinder(cq, row.clearance_mm - 1e-3, *ends)
        assert free.intersect(built("deltact", part)).Volume() < 1e-9
        wall = cylinder(cq, row.clearance_mm + 2 * DEFAULT.shell.wall_mm, *ends)
        area_mm2 = math.pi / 4 * ((row.clearance_mm + 3) ** 2 - row.clearance_mm**2)
        found_mm3 = wall.intersect(built("deltact", part)).Volume()
        assert found_mm3 == pytest.approx(area_mm2 * 9.9, rel=1e-6)


def test_the_cover_s_floor_is_clear_of_the_tabs_and_the_back_is_one_plane(built, cq):
    for name in ("deltact", "wide"):
        dims, shell = DESIGNS[name], built(name, "testing-shell")
        x, y = (side / 2 for side in dims.frame_outer_mm)
        floor = box(cq, (-x, -y, dims.z_back_mm), (x, y, dims.z_floor_mm))
        assert floor.distance(shell) == 0  # the shell stands on it
        below = shell.intersect(
            box(cq, (-90, -90, dims.z_back_mm), (90, 90, dims.z_floor_mm - 1e-3))
        )
        assert floor.distance(below) == pytest.approx(dims.cover.fit_mm)
        assert shell.BoundingBox().zmin == pytest.approx(dims.z_back_mm, abs=1e-6)


def test_every_hole_of_mount_and_tabs_is_open_and_takes_its_head(built, cq):
    """A cylinder on the axis meets nothing; nor does a washer from either end of a block's hole.

    Of a flange neither does a head from the shell's side down to the counterbore's floor.
    """
    for name in ("deltact", "franka", "wide franka", "skin-44x40"):
        dims, shell = DESIGNS[name], built(name, "shell")
        axes = mount.hole_axes(dims)
        assert len(axes) == 2
        gap_mm = dims.mount.length_mm - dims.mount.flange_mm
        for start, end in axes:
            assert (
                cylinder(cq, dims.mount.hole_mm - 1e-3, start, end).intersect(shell).Volume() < 1e-9
            )
            if dims.mount.kind == "franka":
                back, floor = start[1] - gap_mm, start[1] + dims.mount.counterbore_depth_mm
                room = [(start[0], y, start[2]) for y in (back + 1e-3, floor - 1e-3)]
                head = cylinder(cq, dims.mount.head_mm, *room)
                assert head.intersect(shell).Volume() < 1e-9
                continue
            for at, other in ((start, end), (end, start)):
                out = (cq.Vector(*at) - cq.Vector(*other)).normalized() * (gap_mm - 1e-3)
                tip = (cq.Vector(*at) + out).toTuple()
                head = cylinder(cq, dims.mount.washer_mm, at, tip)
                assert head.intersect(shell).Volume() < 1e-9
    table = DEFAULT.table
    for sx, sy in itertools.product((-1, 1), repeat=2):
        x, y = sx * (39 / 2 + table.tab_mm / 2), sy * table.hole_pitch_mm / 2
        hole = cylinder(cq, table.hole_mm - 1e-3, (x, y, -31.0), (x, y, 0.0))
        assert hole.intersect(built("deltact", "testing-shell")).Volume() < 1e-9
