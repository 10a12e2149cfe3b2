"""`cad check` without a fault: rays, axes and rows on solids whose figures are known."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from mutated import mutated

from deltact_fab.cad import check, rays
from deltact_fab.cad.check import electric, inequalities, printed, thickness, visibility
from deltact_fab.cad.check.built import MESH_MM, BuiltDesign
from deltact_fab.cad.check.row import Row, at, verified
from deltact_fab.cad.check.run import CHECKS
from deltact_fab.cad.design import load_design
from deltact_fab.cad.features import features_of, near
from deltact_fab.cad.kernel import require
from deltact_fab.cad.mesh import mesh_solid
from deltact_fab.cad.registry import find

VARIANTS = (
    "deltact", "screws-19mm", "skin-30x34", "skin-44x40", "franka", "fingertip-24x24",
    "large-60x50",
)  # fmt: skip


@pytest.fixture(scope="module")
def cq():
    return require()


def _walls(solid):
    return rays.Walls(solid, mesh_solid(solid, MESH_MM, "test"))


def _box(cq, size, corner=(0, 0, 0)):
    return cq.Solid.makeBox(*size, cq.Vector(*corner))


def _rod(cq, radius, height, at_mm=(0, 0, 0), way=(0, 0, 1)):
    return cq.Solid.makeCylinder(radius, height, cq.Vector(*at_mm), cq.Vector(*way))


# Rays against triangles.


def test_a_ray_meets_a_triangle_where_its_plane_is():
    rng = np.random.default_rng(3)
    corners = rng.uniform(-1, 1, (1, 3, 3))
    weights = rng.dirichlet((1, 1, 1), 200)
    points = weights @ corners[0]
    origins = rng.uniform(-5, 5, (200, 3))
    way = points - origins
    far, hit = rays.first_hit(origins, way, corners)
    # A direction of full length: the hit is at 1.
    assert np.allclose(far, 1.0, atol=1e-9)
    assert (hit == 0).all()
    outside = corners[0, 0] + 1.1 * (corners[0, 1] - corners[0, 0])
    miss, none = rays.first_hit(origins, outside - origins, corners)
    assert np.isinf(miss).all()
    assert (none == -1).all()
    behind, _ = rays.first_hit(origins, -way, corners)
    assert np.isinf(behind).all()


def test_rays_from_the_middle_of_a_sphere_go_its_radius_in_every_chunk(cq, monkeypatch):
    mesh = mesh_solid(cq.Solid.makeSphere(7.0, angleDegrees1=-90), 0.01, "ball")
    way = np.random.default_rng(5).normal(size=(500, 3))
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    far, hit = rays.first_hit(np.zeros((500, 3)), way, mesh.corners_mm)
    assert np.abs(far - 7.0).max() < 0.011
    assert (hit >= 0).all()
    monkeypatch.setattr(rays, "_PAIRS", 7 * len(mesh.triangles))
    again, _ = rays.first_hit(np.zeros((500, 3)), way, mesh.corners_mm)
    assert np.allclose(again, far, rtol=1e-12)


def test_the_nearest_of_several_surfaces_counts_and_the_own_one_does_not(cq):
    corners = mesh_solid(_box(cq, (4, 4, 4)), 0.1, "box").corners_mm
    start = np.array([[1.3, 1.1, 4.0], [1.3, 1.1, 9.0]])
    down = np.tile((0.0, 0.0, -1.0), (2, 1))
    far, _ = rays.first_hit(start, down, corners)
    assert far == pytest.approx([4.0, 5.0])


def test_samples_lie_on_their_triangles_and_spread_by_area(cq):
    corners = mesh_solid(_box(cq, (40, 20, 3)), 0.1, "box").corners_mm
    points, owner = rays.samples(corners)
    again, _ = rays.samples(corners)
    assert np.array_equal(points, again)
    normal = rays.normals(corners)[owner]
    assert np.abs(np.einsum("ij,ij->i", points - corners[owner, 0], normal)).max() < 1e-9
    top = points[points[:, 2] > 2.999]
    counts, _, _ = np.histogram2d(top[:, 0], top[:, 1], bins=(4, 2), range=((0, 40), (0, 20)))
    # 800 mm2 at a point for each 2.25 mm2, in eight fields of 44.
    assert 320 < len(top) < 400
    assert counts.min() > 30


# Walls.


@pytest.mark.parametrize("wall", [0.4, 1.5, 2.0])
def test_the_wall_of_a_box_is_what_it_was_made_with(cq, wall):
    hollow = _box(cq, (30, 20, 10)).cut(
        _box(cq, (30 - 2 * wall, 20 - 2 * wall, 10), (wall, wall, 3.0))
    )
    found = _walls(hollow).thinnest()
    assert found is not None
    assert found.thickness_mm == pytest.approx(wall, abs=1e-9)


def test_the_wall_beside_an_eccentric_hole(cq):
    """Between circles of 5 and 3 whose axes are 1.2 apart the wall is 0.8 at the thinnest."""
    tube = _rod(cq, 5, 8).cut(_rod(cq, 3, 10, (1.2, 0, -1)))
    found = _walls(tube).thinnest()
    assert found is not None
    # Never thinner than the truth, and no facet further off than 0.2 rad.
    assert 0.8 - 1e-9 <= found.thickness_mm < 0.8 * 1.01
    assert abs(found.at_mm[1]) < 1.0
    assert found.at_mm[0] > 4.0


def test_a_sharp_edge_is_no_wall_and_a_thin_plate_is(cq):
    wedge = cq.Workplane("XZ").polyline([(0, 0), (20, 0), (20, 12)]).close().extrude(9).val()
    assert _walls(wedge).thinnest().thickness_mm == pytest.approx(9.0)
    lean = math.radians(rays.OPPOSITE_DEG - 5)
    slim = [(0, 0), (20, 0), (20, 1 + 20 * math.tan(lean)), (0, 1)]
    found = _walls(cq.Workplane("XZ").polyline(slim).close().extrude(9).val()).thinnest()
    assert 1.0 * math.cos(lean) - 0.3 < found.thickness_mm < 1.5


def test_a_mask_leaves_out_what_is_not_asked_for(cq):
    step = _box(cq, (20, 10, 5)).fuse(_box(cq, (10, 10, 0.7), (20, 0, 0))).clean()
    walls = _walls(step)
    assert walls.thinnest().thickness_mm == pytest.approx(0.7)
    thick = walls.points_mm[:, 0] < 19.0
    assert walls.thinnest(thick).thickness_mm == pytest.approx(5.0)
    assert walls.thinnest(np.zeros_like(thick)) is None


def test_a_thin_place_far_from_any_corner_is_found(cq):
    plate = _box(cq, (60, 60, 6)).cut(_rod(cq, 2.0, 5.6, (33, 27, 0.4)))
    found = _walls(plate).thinnest()
    assert found.thickness_mm == pytest.approx(0.4)
    assert np.hypot(found.at_mm[0] - 33, found.at_mm[1] - 27) <= 2.0


# Axes.


def test_holes_and_shanks_are_told_apart_with_their_ends(cq):
    part = _box(cq, (20, 20, 6)).cut(_rod(cq, 1.5, 5, (5, 5, -1))).fuse(_rod(cq, 2, 9, (14, 14, 0)))
    holes = [c for c in features_of(part).rounds if c.hole]
    shanks = [c for c in features_of(part).rounds if not c.hole]
    assert [(c.radius_mm, c.low_mm[2], c.high_mm[2]) for c in holes] == [
        (1.5, pytest.approx(0.0), pytest.approx(4.0))
    ]
    assert [(c.radius_mm, c.low_mm[2], c.high_mm[2]) for c in shanks] == [
        (2.0, pytest.approx(6.0), pytest.approx(9.0))
    ]
    assert near(holes, 5.3, 5.4, 0.6) == holes
    assert near(holes, 5.3, 5.4, 0.4) == []


def test_a_hole_that_leans_shows_at_its_ends_and_one_across_is_none(cq):
    lean = math.radians(3)
    tilted = _rod(cq, 1, 30, (10 - 5 * math.sin(lean), 10, -5), (math.sin(lean), 0, math.cos(lean)))
    part = _box(cq, (20, 20, 10)).cut(tilted).cut(_rod(cq, 1, 30, (-1, 3, 5), (1, 0, 0)))
    (hole,) = (r for r in features_of(part).rounds if r.axis == 2)
    assert hole.hole
    assert hole.offset_mm(10, 10) > 10 * math.sin(lean) * 0.95


# Rows.


def test_a_verdict_names_what_nobody_measured():
    keys = ("camera.focal_length_mm", "camera.lens_height_mm")
    row = Row("view cone", "camera", "58 deg", "<= 90 deg", True, keys)
    assert row.verdict == "pass (unverified: focal length, lens height)"
    assert replace(row, passed=False).verdict == "FAIL"
    assert replace(row, rests_on=()).verdict == "pass"
    design = SimpleNamespace(unverified=lambda: ["a.b_mm", "mount.c_mm"])
    (row,) = verified([replace(row, rests_on=("mount.", "x.y", "a.b_mm"))], design)
    assert row.rests_on == ("mount.c_mm", "a.b_mm")
    assert at((-0.001, 2.0, -3.456)) == "(0.00, 2.00, -3.46)"


def test_measured_keys_are_no_longer_named():
    every = [key.partition(".")[::2] for key in load_design().unverified()]
    keys = {section: [key for of, key in every if of == section] for section, _ in every}
    assert {"focal_length_mm", "board_width_mm", "connector_width_mm"} <= set(keys["camera"])
    design = load_design("deltact", [f"{section}.measured={own}" for section, own in keys.items()])
    assert all(row.verdict == "pass" for row in inequalities.rows(design))
    open_rows = {row.part: row.verdict for row in inequalities.rows(load_design())}
    assert open_rows["camera-holder"] == "pass (unverified: camera board)"
    assert open_rows["mold"] == "pass"


def test_what_a_broken_inequality_leaves_undone_is_counted_in_one_line_without_the_kernel():
    rows = check.run(load_design("deltact", ["adapter.thickness_mm=4", "table.tab_mm=5"]))
    failed = [row for row in rows if row.verdict == "FAIL"]
    assert [row.part for row in failed] == ["nano17-adapter", "testing-shell"]
    assert failed[0].limit == "all hold: adapter.thickness_mm: 5 or more"
    (undone,) = (row for row in rows if row.verdict == "not run")
    assert undone.found == f"{len(CHECKS)} were not run: the inequalities of 2 parts fail"


def test_a_part_s_inequalities_are_one_row_with_the_closest():
    rows = {row.part: row for row in inequalities.rows(load_design())}
    assert rows["mold"].found.endswith("closest: fit_mm + pry_mm < web_mm / 2: 2.6 < 4")
    assert len(rows) == len(list(inequalities.rows(load_design())))


# What rests on numbers besides the solids: the same solids, another lens, strip or resin.


@pytest.fixture(scope="module")
def inner(cq):
    """The parts that camera and light are checked on."""
    from deltact_fab.cad.build import build_part
    from deltact_fab.cad.registry import find

    design = load_design()
    names = ("skin", "acrylic", "camera", "light-holder", "camera-holder", "cover", "shell")
    parts = [find(name) for name in (*names, "skin-frame")]
    return BuiltDesign(design, tuple(parts), {p.name: build_part(p, design)[0] for p in parts})


def _on(built, **sections):
    """The same solids under a design that differs."""
    changed = {
        name: replace(getattr(built.design, name), **values) for name, values in sections.items()
    }
    return BuiltDesign(replace(built.design, **changed), built.parts, dict(built.solids))


def test_the_view_by_snell_and_by_hand():
    rows = {row.check: row for row in visibility.view(load_design())}
    x, y, corner = (rows[f"view cone, {name}"] for name in ("x", "y", "corner"))
    # The facts give 58, 45 and 67 degrees for a gap of 3 and the paper's 675 mm2.
    assert [row.found.split()[2] for row in (x, y, corner)] == ["57.6", "45.1", "66.4"]
    assert x.limit.startswith("<= 94.4 deg at the 1280 x 720 crop")
    assert rows["view of the face"].found.endswith("54.6 % of the face")
    # 3 / 1.41 mm nearer than 3 + 2 / 1.49 + 12 / 1.41, an aperture of .87 / 2.8, pixels of 2.24 um.
    far, near_mm, f = 12.853, 10.725, 0.87
    blur_px = f**2 / 2.8 * (far - near_mm) / near_mm / (far - f) / 2.24e-3
    assert f"{blur_px:.2f} px at 10.7 mm" in rows["focus, middle, 3 mm deep"].found


def test_one_led_behind_the_middle_lights_by_the_fourth_power():
    """Of a view of one point's width the evenness is that of two distances, worked by hand."""
    design = load_design(changes=["light.led_count=1"])
    r = (design.strip_radius_mm + design.channel_inner_mm) / 2
    x, y = (side / 2 for side in design.optics.view_mm)
    h2 = design.z_light_mm**2
    at = [[h2 / ((a - 0) ** 2 + (b - r) ** 2 + h2) ** 2 for b in np.linspace(-y, y, 31)]
          for a in np.linspace(-x, x, 31)]  # fmt: skip
    assert electric.evenness(design) == pytest.approx(np.min(at) / np.mean(at), rel=1e-9)


def test_what_no_ray_reaches_is_told(inner, cq):
    """Without air the silicone alone bends rays to 12.1 mm at most (facts, optics)."""
    low, joint = inner.box("camera")[0][2], inner.box("acrylic")[0][2]
    close = mutated(inner, {"camera": _rod(cq, 2.0, joint - low - 1e-9, (0, 0, low))})
    (cone,) = visibility.light_cone(close)
    assert "bent away" in cone.found
    assert not cone.passed


def test_a_web_of_0_3_mm_and_holes_that_meet_fail(cq):
    plate = _box(cq, (40, 40, 6), (-20, -20, 0))
    for x, web in ((18.2, "0.3"), (9.0, "-1.0")):
        holes = plate.cut(_rod(cq, 1.5, 8, (x, 7, -1))).cut(_rod(cq, 1.5, 8, (7, 7, -1)))
        built = BuiltDesign(load_design(), (find("stage-plate"),), {"stage-plate": holes})
        (row,) = thickness.rows(built)
        assert row.found.startswith(web)
        assert not row.passed


def test_a_ceiling_of_40_mm_without_supports_fails_and_one_of_20_passes(cq):
    for side, passes in ((40, False), (20, True)):
        table = _box(cq, (80, 80, 20), (-40, -40, 0)).cut(
            _box(cq, (side, side, 15), (-side / 2, -side / 2, 0))
        )
        built = BuiltDesign(load_design(), (find("cover"),), {"cover": table})
        row = next(row for row in printed.rows(built) if row.check == printed.CEILINGS)
        assert row.passed is passes
        assert f"{side**2:.1f} mm2" in row.found
        assert abs(float(row.found.split(", ")[1].split()[0]) - side) < 2


def test_the_light_cone_goes_through_the_holder_s_bore(inner):
    (row,) = visibility.light_cone(inner)
    assert (
        row.found
        == "96 of 96 reach it, 0.45 mm off in x and y; radius 6.88 mm at the acrylic, bore 10.10 mm"
    )
    assert row.passed


@pytest.mark.slow
@pytest.mark.parametrize("name", VARIANTS)
def test_the_shipped_designs_pass(name):
    told = []
    rows = check.run(load_design(name), lambda *what: told.append(what))
    assert {(row.check, row.part): row.found for row in rows if not row.passed} == {}
    assert [done for done, _, _ in told] == list(range(len(told)))
    assert told[-1] == (told[-1][1], told[-1][1], "done")
    assert any(row.verdict.startswith("pass (unverified: ") for row in rows)


@pytest.mark.slow
def test_the_foot_of_a_peg_s_leg_is_no_wall_of_the_cover(cq):
    """The mesh of this cover has a point of a leg .8 um above the floor."""
    changes = ["skin.width_mm=53.7", "skin.length_mm=41.5", "screw.length_mm=16"]
    built = BuiltDesign(load_design(changes=changes), (find("cover"),), {})
    assert [row.found[:8] for row in thickness.rows(built)] == ["1.500 mm", "0.600 mm"]
