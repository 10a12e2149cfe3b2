"""`cad check` without a fault: rays, features and rows on solids whose figures are known."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from solids import box, made, mutated

from deltact_fab.app.cli.old_keys import of_part
from deltact_fab.common.checks import Check
from deltact_fab.fabricate.cad import check, rays
from deltact_fab.fabricate.cad.check import SOLID_CHECKS, arithmetic, each_part, visibility
from deltact_fab.fabricate.cad.check.built import CHECK_MESH_MM, BuiltDesign
from deltact_fab.fabricate.cad.check.row import format_point, mark_unverified, shorten_key
from deltact_fab.fabricate.cad.design import load_design
from deltact_fab.fabricate.cad.features import features_of, rounds_near
from deltact_fab.fabricate.cad.kernel import require
from deltact_fab.fabricate.cad.mesh import mesh_solid
from deltact_fab.fabricate.cad.parts import cover, skin_frame
from deltact_fab.fabricate.cad.registry import find_part

D = load_design()


def _walls(solid):
    return rays.Walls(solid, mesh_solid(solid, CHECK_MESH_MM, "test"))


def _box(size, corner=(0, 0, 0)):
    return box(corner, np.add(corner, size))


def _rod(radius, height, at_mm=(0, 0, 0), way=(0, 0, 1)):
    """A cylinder along any axis."""
    cq = require()
    return cq.Solid.makeCylinder(radius, height, cq.Vector(*at_mm), cq.Vector(*way))


def _bar(corners):
    return require().Workplane("XZ").polyline(corners).close().extrude(9).val()


def _of(name, solid, design=D):
    return BuiltDesign(design, (find_part(name),), {name: solid})


# Rays against triangles.


def test_ray_hits_triangle_on_its_plane():
    rng = np.random.default_rng(3)
    corners = rng.uniform(-1, 1, (1, 3, 3))
    points = rng.dirichlet((1, 1, 1), 200) @ corners[0]
    origins = rng.uniform(-5, 5, (200, 3))
    far, hit = rays.Triangles(corners).first_hit(origins, points - origins)
    # A direction of full length: the hit is at 1.
    assert np.allclose(far, 1.0, atol=1e-9)
    assert (hit == 0).all()
    outside = corners[0, 0] + 1.1 * (corners[0, 1] - corners[0, 0])
    for way in (outside - origins, origins - points):
        assert np.isinf(rays.Triangles(corners).first_hit(origins, way)[0]).all()


def test_rays_from_sphere_centre_measure_radius(monkeypatch):
    mesh = mesh_solid(require().Solid.makeSphere(7.0, angleDegrees1=-90), 0.01, "ball")
    way = np.random.default_rng(5).normal(size=(500, 3))
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    far, _ = rays.Triangles(mesh.corners_mm).first_hit(np.zeros((500, 3)), way)
    assert np.abs(far - 7.0).max() < 0.011
    monkeypatch.setattr(rays, "_PAIRS_PER_BLOCK", 7 * len(mesh.triangles))
    again, _ = rays.Triangles(mesh.corners_mm).first_hit(np.zeros((500, 3)), way)
    assert np.allclose(again, far, rtol=1e-12)


# Walls.


def slim_wedge():
    lean = math.radians(rays.OPPOSITE_DEG - 5)
    return _bar([(0, 0), (20, 0), (20, 1 + 20 * math.tan(lean)), (0, 1)])


@pytest.mark.parametrize(
    ("make", "least_mm", "most_mm"),
    [
        (lambda: _box((30, 20, 10)).cut(_box((29.2, 19.2, 10), (0.4, 0.4, 3))), 0.4, 0.4),
        # Between circles of 5 and 3 whose axes are 1.2 apart; no facet is off by over 0.2 rad.
        (lambda: _rod(5, 8).cut(_rod(3, 10, (1.2, 0, -1))), 0.8, 0.808),
        # A sharp edge is no wall, and a plate that leans is one.
        (lambda: _bar([(0, 0), (20, 0), (20, 12)]), 9.0, 9.0),
        (slim_wedge, 0.6, 1.5),
        # Far from any corner.
        (lambda: _box((60, 60, 6)).cut(_rod(2.0, 5.6, (33, 27, 0.4))), 0.4, 0.4),
    ],
)
def test_thinnest_wall_matches_construction(make, least_mm, most_mm):
    found = _walls(make()).thinnest()
    assert found is not None
    assert least_mm - 1e-9 <= found[0] <= most_mm + 1e-9


def test_mask_excludes_points():
    step = _box((20, 10, 5)).fuse(_box((10, 10, 0.7), (20, 0, 0))).clean()
    walls = _walls(step)
    thick = walls.points_mm[:, 0] < 19.0
    assert walls.thinnest()[0] == pytest.approx(0.7)
    assert walls.thinnest(thick)[0] == pytest.approx(5.0)
    assert walls.thinnest(np.zeros_like(thick)) is None


# Features.


def test_holes_and_shanks_are_distinguished():
    part = _box((20, 20, 6)).cut(_rod(1.5, 5, (5, 5, -1))).fuse(_rod(2, 9, (14, 14, 0)))
    rounds = features_of(part).rounds
    found = [(c.hole, c.radius_mm, c.low_mm[2], c.high_mm[2]) for c in rounds]
    assert sorted(found) == [(False, 2.0, 6.0, 9.0), (True, 1.5, 0.0, 4.0)]
    holes = [c for c in rounds if c.hole]
    assert [rounds_near(holes, 5.3, 5.4, reach) for reach in (0.6, 0.4)] == [holes, []]


def test_leaning_and_crosswise_holes():
    lean = math.radians(3)
    tilted = _rod(1, 30, (10 - 5 * math.sin(lean), 10, -5), (math.sin(lean), 0, math.cos(lean)))
    part = _box((20, 20, 10)).cut(tilted).cut(_rod(1, 30, (-1, 3, 5), (1, 0, 0)))
    (hole,) = (r for r in features_of(part).rounds if r.axis == 2)
    assert hole.hole
    assert hole.offset_mm(10, 10) > 10 * math.sin(lean) * 0.95


# Rows.


def test_a_verdict_names_what_nobody_measured():
    keys = ("camera.focal_length_mm", "camera.lens_height_mm")
    row = Check("view-cone", "view cone", "camera", "58 deg", "<= 90 deg", "pass", keys)
    assert of_part(row)["verdict"] == "pass (unverified: focal length, lens height)"
    assert of_part(replace(row, status="fail"))["verdict"] == "FAIL"
    assert of_part(replace(row, basis=()))["verdict"] == "pass"
    design = SimpleNamespace(unverified=lambda: ["a.b_mm", "mount.c_mm"])
    (row,) = mark_unverified([replace(row, basis=("mount.", "x.y", "a.b_mm"))], design)
    assert row.basis == ("mount.c_mm", "a.b_mm")
    assert format_point((-0.001, 2.0, -3.456)) == "(0.00, 2.00, -3.46)"


def test_measured_keys_are_no_longer_named():
    every = [key.partition(".")[::2] for key in D.unverified()]
    keys = {section: [key for of, key in every if of == section] for section, _ in every}
    assert {"focal_length_mm", "board_width_mm", "connector_width_mm"} <= set(keys["camera"])
    design = load_design("deltact", [f"{section}.measured={own}" for section, own in keys.items()])
    assert all(row.basis == () for row in arithmetic.inequalities(design))
    rows = {row.subject: row for row in arithmetic.inequalities(D)}
    assert {shorten_key(key) for key in rows["camera-holder"].basis} == {"camera board"}
    assert rows["mold"].basis == ()
    assert rows["mold"].value.endswith("tightest: fit_mm + pry_mm < web_mm / 2: 2.6 < 4")


def test_broken_inequality_skips_checks_without_kernel():
    rows = check.check_design(load_design("deltact", ["adapter.thickness_mm=4", "table.tab_mm=5"]))
    failed = [row for row in rows if row.failed]
    assert [row.subject for row in failed] == ["nano17-adapter", "testing-shell"]
    assert failed[0].remedy == "adapter.thickness_mm: 5 or more"
    (undone,) = (row for row in rows if row.status == "not run")
    assert undone.value == f"{len(SOLID_CHECKS)} skipped: constraints fail, see above"


def test_invalid_solids_become_rows(monkeypatch):
    cq = require()
    both = cq.Compound.makeCompound([_box((9, 9, 9)), _box((5, 5, 5), (20, 0, 0))])
    for shape, count in ((both, 2), (_box((9, 9, 9)).Faces()[0], 0)):
        row = next(row for row in each_part.soundness(_of("coupon-mold", shape)) if row.failed)
        assert row.value == f"1/1 invalid: coupon-mold: {count} solids, expected one"
    # A builder that returns something else than its closed form.
    wrong = replace(cover.PARTS[0], build=skin_frame.build)
    found = {row.subject: row.value for row in each_part.soundness(BuiltDesign(D, (wrong,)))}
    assert found["sensor"].startswith("1/1 invalid: cover: bounding box ")


# What rests on numbers besides the solids: the same solids, another lens, strip or resin.


@pytest.fixture(scope="module")
def inner():
    """The parts that camera and light are checked on."""
    names = ("skin", "acrylic", "camera", "light-holder", "camera-holder", "shell", "skin-frame")
    parts = [find_part(name) for name in names]
    return BuiltDesign(D, tuple(parts), {name: made(name) for name in names})


def test_view_matches_snell_by_hand():
    rows = {row.name: row for row in visibility.view(D)}
    cone = [rows[f"view cone, {name}"] for name in ("x", "y", "corner")]
    # The facts give 58, 45 and 67 degrees for a gap of 3 and the paper's 675 mm2.
    assert [row.value.split()[2] for row in cone] == ["57.6", "45.1", "66.4"]
    assert cone[0].limit.startswith("<= 94.4 deg at the 1280 x 720 crop")
    assert rows["view of the face"].value.endswith("54.6 % of the face")
    # 3 / 1.41 mm nearer than 3 + 2 / 1.49 + 12 / 1.41, an aperture of 0.87 / 2.8, pixels 2.24 um.
    far, near_mm, f = 12.853, 10.725, 0.87
    blur_px = f**2 / 2.8 * (far - near_mm) / near_mm / (far - f) / 2.24e-3
    assert f"{blur_px:.2f} px at 10.7 mm" in rows["focus, middle, 3 mm deep"].value


def test_led_illuminance_falls_by_fourth_power():
    design = load_design(changes=["light.led_count=1", "light.leds_per_cut=1"])
    r = (design.strip_radius_mm + design.channel_inner_mm) / 2
    x, y = (side / 2 for side in design.optics.view_mm)
    h2 = design.z_light_mm**2
    at = [[h2 / (a**2 + (b - r) ** 2 + h2) ** 2 for b in np.linspace(-y, y, 31)]
          for a in np.linspace(-x, x, 31)]  # fmt: skip
    assert arithmetic.evenness(design) == pytest.approx(np.min(at) / np.mean(at), rel=1e-9)


def test_light_cone_passes_bore_or_fails(inner):
    (row,) = visibility.light_cone(inner)
    assert not row.failed
    assert row.value.startswith("96/96 rays, lens offset 0.45 mm in x and y; radius 6.88 mm at the")
    # Without air the silicone alone bends rays to 12.1 mm at most (facts, optics).
    low, joint = inner.box("camera")[0][2], inner.box("acrylic")[0][2]
    close = mutated(inner, {"camera": _rod(2.0, joint - low - 1e-9, (0, 0, low))})
    (row,) = visibility.light_cone(close)
    assert "refracted away" in row.value
    assert row.failed


def test_thin_webs_and_overlapping_holes_fail():
    plate = _box((40, 40, 6), (-20, -20, 0))
    for x, web in ((18.2, "0.3"), (9.0, "-1.0")):
        holes = plate.cut(_rod(1.5, 8, (x, 7, -1))).cut(_rod(1.5, 8, (7, 7, -1)))
        (row,) = each_part.walls(_of("stage-plate", holes))
        assert row.value.startswith(web)
        assert row.failed


@pytest.mark.parametrize(("side", "passes"), [(40, False), (20, True)])
def test_a_wide_ceiling_without_supports_fails(side, passes):
    room = _box((side, side, 15), (-side / 2, -side / 2, 0))
    table = _box((80, 80, 20), (-40, -40, 0)).cut(room)
    row = next(r for r in each_part.platform_contact(_of("cover", table)) if r.name == "ceilings")
    assert row.failed is not passes
    assert f"{side**2:.1f} mm2" in row.value
    assert abs(float(row.value.split("span up to ")[1].split()[0]) - side) < 2


@pytest.mark.slow
def test_peg_legs_are_not_cover_walls():
    """The mesh of this cover has a point of a leg 0.8 um above the floor."""
    changes = ["skin.width_mm=53.7", "skin.length_mm=41.5", "screw.length_mm=16"]
    built = BuiltDesign(load_design(changes=changes), (find_part("cover"),), {})
    assert [row.value[:8] for row in each_part.walls(built)] == ["1.500 mm", "0.600 mm"]
