"""The mold and the coupon mold: their closed forms, what the mold casts, and what it lets go."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from closed_forms import held
from solids import common_mm3, moved

from deltact_fab.fabricate.cad import registry
from deltact_fab.fabricate.cad.design import load_design
from deltact_fab.fabricate.cad.dimensions import Design
from deltact_fab.fabricate.cad.features import features_of
from deltact_fab.fabricate.cad.kernel import require
from deltact_fab.fabricate.cad.mesh import mesh_solid
from deltact_fab.fabricate.cad.parts import coupons, mold, skin_frame

DEFAULT = Design()


def changed(*changes: str) -> Design:
    return load_design("deltact", changes)


VARIANTS = {
    "uneven": changed("mold.columns=3", "mold.rows=1", "mold.web_mm=12", "mold.pry_mm=4"),
    "large fillet": changed("skin.edge_fillet_mm=5.9"),
}


@pytest.fixture(scope="module")
def cq() -> Any:
    return require()


def cast(cq: Any, design: Design, at: tuple[float, float]) -> tuple[Any, Any]:
    """What fills one cavity with its frame in place up to the ledge, and the skin put there.

    The frame's blind holes open away from the silicone and are plugged here.
    """

    def put(solid: Any) -> Any:
        """Touched face down onto the cavity's floor."""
        turned = solid.rotate(cq.Vector(0, 0, 0), cq.Vector(1, 0, 0), 180)
        return turned.moved(cq.Location((*at, design.mold.base_mm)))

    w, h, t = design.skin.width_mm, design.skin.length_mm, design.skin.thickness_mm
    corner = cq.Vector(at[0] - w / 2, at[1] - h / 2, design.mold.base_mm)
    block = cq.Solid.makeBox(w, h, t, corner)
    frame = put(skin_frame.build(design))
    row, depth_mm = design.screw.row, design.screw.pilot_depth_mm
    plugs = [
        put(cq.Solid.makeCylinder(row.pilot_mm / 2, depth_mm, cq.Vector(x, y, design.z_joint_mm)))
        for x, y in design.screw_centres_mm
    ]
    return block.cut(mold.build(design), frame, *plugs), put(skin_frame.skin_build(design))


@pytest.mark.parametrize("name", ["uneven", "large fillet"])
def test_mold_and_frame_cast_skin(name: str, cq: Any) -> None:
    """V(cavity) + V(frame window) = V(skin), on the solids and with their shapes."""
    design = VARIANTS[name]
    for at in (mold.centres_mm(design)[0], mold.centres_mm(design)[-1]):
        filled, wanted = cast(cq, design, at)
        assert filled.isValid()
        assert filled.Volume() == pytest.approx(wanted.Volume(), rel=1e-9)
        assert filled.cut(wanted).Volume() < 1e-6
        assert wanted.cut(filled).Volume() < 1e-6


def test_frame_clears_its_seat(cq: Any) -> None:
    solid, base, fit = mold.build(DEFAULT), DEFAULT.mold.base_mm, DEFAULT.mold.fit_mm
    frame = skin_frame.build(DEFAULT).rotate(cq.Vector(0, 0, 0), cq.Vector(1, 0, 0), 180)
    for x, y in mold.centres_mm(DEFAULT):
        placed = moved(frame, x, y, base)
        assert placed.BoundingBox().zmin == pytest.approx(base + DEFAULT.skin.protrusion_mm)
        for shift in (0.9 * fit, -0.9 * fit):
            assert common_mm3(solid, moved(placed, shift, shift, 0)) < 1e-9
        assert common_mm3(solid, moved(placed, 1.1 * fit, 0, 0)) > 0.1
        assert common_mm3(solid, moved(placed, 0, 0, -0.1)) > 0.1


def test_only_the_underside_faces_down(cq: Any) -> None:
    def looks_down(solid: Any) -> list[float]:
        """Heights of the triangles that look downwards."""
        corners = mesh_solid(solid, 0.5, "mold").corners_mm
        normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        return sorted(set(corners[normal[:, 2] < -1e-6][:, :, 2].ravel().round(9).tolist()))

    assert looks_down(mold.build(VARIANTS["large fillet"])) == [0.0]
    assert looks_down(coupons.well_build(DEFAULT)) == [0.0]
    # A groove in the wall of the cavity whose wall stands at x = 5.5.
    undercut = mold.build(DEFAULT).cut(cq.Solid.makeBox(3, 3, 1, cq.Vector(4, 20, 6)))
    assert looks_down(undercut) == [0.0, 7.0]


def test_coupon_mold_holds_its_wells() -> None:
    design = changed("coupon.wells=12", "coupon.wall_mm=1.5", "coupon.depth_mm=50")
    solid, found = held(registry.find_part("coupon-mold"), design)
    x, y, z = np.multiply((2, 2, 1), coupons.well_box(design)[1])
    per_well = (x * y * z - found.volume_mm3) / design.coupon.wells
    assert per_well == pytest.approx(coupons.well_volume_mm3(design), rel=1e-6)
    # The outermost wells keep the wall.
    floors = [f for f in solid.Faces() if abs(f.Center().z - design.coupon.base_mm) < 1e-9]
    ends = sorted(f.Center().x for f in floors)
    assert ends[0] == pytest.approx(-ends[-1])
    edge = x / 2 - ends[-1] - design.coupon.diameter_mm / 2
    assert edge == pytest.approx(design.coupon.wall_mm)


def test_coupon_holes_grow_along_x(cq: Any) -> None:
    coupon, solid = DEFAULT.fit_coupon, held(registry.find_part("fit-coupon"), DEFAULT)[0]
    rounds = sorted((r for r in features_of(solid).rounds if r.hole), key=lambda r: r.low_mm)
    assert [2 * r.radius_mm for r in rounds] == pytest.approx(coupon.sizes_mm)
    for i, hole in enumerate(rounds):
        x = coupon.pitch_mm * (i + 0.5) - coupon.outer_mm[0] / 2
        assert hole.low_mm[:2] == pytest.approx((x, coupon.slot_mm / 2))
        assert not solid.isInside(cq.Vector(x, -coupon.outer_mm[1] / 2 + 0.1, coupon.base_mm / 2))
