"""Light holder, camera, camera holder, cover and screws: their shapes, and how they mate."""

from __future__ import annotations

import math

import pytest
from closed_forms import held

from deltact_fab.cad import registry
from deltact_fab.cad.build import build_part
from deltact_fab.cad.design import load_design
from deltact_fab.cad.kernel import require

INNER = ("light-holder", "camera", "camera-screw", "camera-holder", "cover", "screw")


@pytest.fixture(scope="module")
def cq():
    return require()


@pytest.fixture(scope="module")
def design():
    return load_design()


@pytest.fixture(scope="module")
def solids(cq, design):
    """The inner parts of the default design, gated."""
    return {name: build_part(registry.find(name), design)[0] for name in INNER}


def cylinder(cq, radius_mm, low_mm, high_mm, at=(0.0, 0.0)):
    return cq.Solid.makeCylinder(
        radius_mm, high_mm - low_mm, cq.Vector(*at, low_mm), cq.Vector(0, 0, 1)
    )


def common_mm3(a, b):
    return a.intersect(b).Volume()


def section_mm2(cq, solid, z_mm, thin_mm=1e-3):
    """Area of the solid at a height, by a thin slab."""
    box = cq.Solid.makeBox(200, 200, thin_mm, cq.Vector(-100, -100, z_mm - thin_mm / 2))
    return common_mm3(solid, box) / thin_mm


# Every part.


@pytest.mark.parametrize("name", ["deltact", "screws-19mm", "franka", "skin-44x40"])
def test_every_part_has_an_exact_volume(name):
    design = load_design(name)
    for part in INNER:
        held(registry.find(part), design)


# Light holder.


def test_the_channel_is_open_in_front_and_the_slot_at_minus_y(cq, design, solids):
    ring, floor = solids["light-holder"], design.z_board_front_mm + design.light.floor_mm
    radius, strip = design.light_radius_mm, design.strip_radius_mm
    walls_mm2 = math.pi * (radius**2 - strip**2)
    walls_mm2 += math.pi * (design.channel_inner_mm**2 - design.light_bore_mm**2)
    for z in (floor + 0.1, design.z_light_mm - 0.1):
        slot_mm2 = walls_mm2 - section_mm2(cq, ring, z)
        # The wall is 1.5 thick and a slot of 3 mm barely sees its curve.
        assert slot_mm2 == pytest.approx(design.light.slot_mm * design.light.wall_mm, rel=0.01)
    between = -(radius + strip) / 2
    half = design.light.slot_mm / 2
    for x, z, solid in (
        (0.0, floor + 0.01, False),
        (half - 0.01, design.z_light_mm - 0.01, False),
        (half + 0.01, floor + 0.01, True),
        (0.0, floor - 0.01, True),
    ):
        assert ring.isInside(cq.Vector(x, between, z)) is solid
    assert ring.isInside(cq.Vector(0, -design.channel_inner_mm + 0.01, floor + 1))
    assert ring.isInside(cq.Vector(0, -between, floor + 1))


def test_the_heads_stand_free_in_the_floor(cq, design, solids):
    ring, low = solids["light-holder"], design.z_board_front_mm
    row, clearance = design.holder.row, design.holder.head_clearance_mm
    for at in design.camera_screw_centres_mm:
        free = cylinder(
            cq, row.head_mm / 2 + clearance - 1e-3, low, low + design.light.floor_mm - 1e-3, at
        )
        wider = cylinder(cq, row.head_mm / 2 + clearance + 0.01, low, low + 0.1, at)
        higher = cylinder(cq, row.head_mm / 2, low, low + design.light.floor_mm + 0.1, at)
        assert common_mm3(ring, free) < 1e-9
        assert common_mm3(ring, wider) > 1e-4
        assert common_mm3(ring, higher) > 1e-2


# Camera and its holder.


def test_screws_find_the_holes_of_board_and_holder(cq, design, solids):
    hole, pilot = design.camera.hole_mm / 2, design.holder.row.pilot_mm / 2
    front, back = design.z_board_front_mm, design.z_board_back_mm
    for at in design.camera_screw_centres_mm:
        through = cylinder(cq, hole - 1e-3, back, front, at)
        assert common_mm3(solids["camera"], through) < 1e-9
        grip = cylinder(cq, pilot - 1e-3, design.z_floor_mm, back, at)
        assert common_mm3(solids["camera-holder"], grip) < 1e-9
        wall = cylinder(cq, pilot + design.holder.wall_mm, design.z_floor_mm, back, at)
        ring_mm2 = math.pi * ((pilot + design.holder.wall_mm) ** 2 - pilot**2)
        assert common_mm3(solids["camera-holder"], wall) == pytest.approx(
            ring_mm2 * design.holder.clearance_mm, rel=1e-6
        )


def test_the_lens_stands_on_the_axis_and_connector_and_cable_at_minus_y(cq, design, solids):
    cam, camera = design.camera, solids["camera"]
    lens = section_mm2(cq, camera, design.z_lens_mm - 1)
    assert lens == pytest.approx(math.pi / 4 * cam.lens_diameter_mm**2, rel=1e-6)
    assert camera.isInside(cq.Vector(cam.lens_diameter_mm / 2 - 0.01, 0, design.z_lens_mm - 0.01))
    deep = design.z_board_back_mm - cam.connector_height_mm + 0.01
    for beyond, inside in ((0.01, True), (cam.connector_length_mm + 0.01, False)):
        at = cq.Vector(0, cam.board_bottom_mm + beyond, deep)
        assert camera.isInside(at) is inside
    half, top = design.holder_window_half_mm, design.holder_window_top_mm
    path = cq.Solid.makeBox(
        2 * half - 0.01, top + 100, design.holder.clearance_mm,
        cq.Vector(-half + 0.005, -100.005, design.z_floor_mm),
    )  # fmt: skip
    assert common_mm3(solids["camera-holder"], path) < 1e-9


# Cover: the snap fit.


@pytest.fixture(scope="module")
def legs(cq, design, solids):
    """The two legs of the peg at +x, +y, cut off at the floor: at -x and at +x of the slot."""
    (x, y), reach = design.peg_at_mm, design.cover.hole_mm
    box = cq.Solid.makeBox(
        2 * reach, 2 * reach, 2 * design.peg_length_mm,
        cq.Vector(x - reach, y - reach, design.z_floor_mm),
    )  # fmt: skip
    found = sorted(solids["cover"].intersect(box).Solids(), key=lambda leg: leg.Center().x)
    assert len(found) == 2
    return found


def test_a_leg_bent_by_the_lip_passes_its_hole_and_misses_the_other(cq, design, legs):
    cover = design.cover
    left, right = (
        leg.moved(cq.Location((side * cover.lip_mm, 0, 0)))
        for leg, side in zip(legs, (1, -1), strict=True)
    )
    hole = cylinder(cq, cover.hole_mm / 2 + 1e-6, -60, 0, design.peg_at_mm)
    for leg in (left, right):
        assert leg.cut(hole).Volume() < 1e-9
    assert common_mm3(left, right) < 1e-9
    tight = cylinder(cq, cover.hole_mm / 2 - 0.01, -60, 0, design.peg_at_mm)
    assert left.cut(tight).Volume() > 1e-4


def test_the_lips_catch_the_holder_beyond_their_play(cq, design, solids):
    cover, holder = solids["cover"], solids["camera-holder"]
    assert common_mm3(cover, holder) < 1e-9
    lifted = holder.moved(cq.Location((0, 0, design.cover.peg_play_mm + 0.05)))
    # Eight crescents, at most lip_mm wide, catch it.
    assert common_mm3(cover, lifted) > 8 * 0.05 * design.cover.lip_mm
    top = design.z_floor_mm + design.peg_length_mm
    assert section_mm2(cq, cover, top - 0.01) < section_mm2(cq, cover, top - 0.2)


def test_heads_sink_into_the_bosses_and_bear_on_a_full_wall(cq, design, solids):
    cover, row = solids["cover"], design.screw.row
    for at in design.screw_centres_mm:
        bore = cylinder(cq, row.bore_mm / 2 - 1e-3, design.z_back_mm - 1, design.z_head_mm, at)
        shank = cylinder(cq, row.clearance_mm / 2 - 1e-3, design.z_back_mm, 0, at)
        assert common_mm3(cover, bore) < 1e-9
        assert common_mm3(cover, shank) < 1e-9
        seat = cylinder(cq, row.head_mm / 2, design.z_head_mm, design.z_boss_mm, at)
        ring_mm2 = math.pi / 4 * (row.head_mm**2 - row.clearance_mm**2)
        assert common_mm3(cover, seat) == pytest.approx(ring_mm2 * design.shell.wall_mm, rel=1e-6)


# Screws.


def test_a_key_fits_the_socket_and_a_blade_the_slot(cq, design, solids):
    row, back = design.screw.row, design.z_head_mm - design.screw.row.head_height_mm
    across, depth = row.socket_mm - 2e-3, row.head_height_mm / 2
    key = cq.Workplane().workplane(offset=back - 5).polygon(6, across, circumscribed=True)
    key = key.extrude(5 + depth - 1e-3).val()
    assert common_mm3(solids["screw"], key) < 1e-9
    assert common_mm3(solids["screw"], key.moved(cq.Location((0, 0, 0.1)))) > 0.1
    row, top = design.holder.row, design.z_board_front_mm + design.holder.row.head_height_mm
    blade = cq.Solid.makeBox(
        row.slot_mm - 2e-3, 10, 5,
        cq.Vector(-row.slot_mm / 2 + 1e-3, -5, top - row.slot_depth_mm + 1e-3),
    )  # fmt: skip
    assert common_mm3(solids["camera-screw"], blade) < 1e-9
    turned = blade.rotate(cq.Vector(), cq.Vector(0, 0, 1), 10)
    assert common_mm3(solids["camera-screw"], turned) > 1e-3
