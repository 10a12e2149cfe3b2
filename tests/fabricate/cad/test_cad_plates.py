"""As printed: parts lie on the platform as their field says."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh
from closed_forms import segment_mm2
from solids import box, made, rod

from deltact_fab.fabricate.cad import registry
from deltact_fab.fabricate.cad.build import build_part
from deltact_fab.fabricate.cad.check.built import BuiltDesign
from deltact_fab.fabricate.cad.check.each_part import platform_contact
from deltact_fab.fabricate.cad.design import load_design
from deltact_fab.fabricate.cad.export import export_parts
from deltact_fab.fabricate.cad.mesh import mesh_solid
from deltact_fab.fabricate.cad.overhangs import MIN_CONTACT_MM2, find_contact, lay_on_platform
from deltact_fab.fabricate.cad.part import PrintPose
from deltact_fab.fabricate.cad.suction import CELL_MM, MAX_CUP_MM2, find_cups

DESIGN = load_design()
NAMES = ("light-holder", "cover", "skin-frame", "coupon-mold", "acrylic", "sphere:22", "star")
TOLERANCE_MM = 0.1


@pytest.fixture(scope="module")
def exported(tmp_path_factory):
    """(folder, manifest entries by file)."""
    folder = tmp_path_factory.mktemp("printed")
    parts = registry.select_parts(NAMES)
    export_parts(DESIGN, parts, ("stl",), TOLERANCE_MM, folder, cached=False, jobs=1)
    entries = json.loads((folder / "manifest.json").read_text())["files"]
    return folder, {Path(entry["file"]).name: entry for entry in entries}


@pytest.mark.parametrize("down", ["-z", "+z"])
@pytest.mark.parametrize("tilt_deg", [0, 30, 90])
def test_named_side_faces_the_platform(down, tilt_deg):
    turn = np.array(PrintPose(down, "side", tilt_deg, "outside" if tilt_deg else "").turn)
    assert np.allclose(turn @ turn.T, np.eye(3), atol=1e-15)
    assert np.linalg.det(turn) == pytest.approx(1)
    side = np.zeros(3)
    side["xyz".index(down[1])] = 1 if down[0] == "+" else -1
    angle = np.radians(tilt_deg)
    assert np.allclose(turn @ side, (0, np.sin(angle), -np.cos(angle)))


def test_files_stand_as_manifest_says(exported):
    folder, entries = exported
    for part in registry.select_parts(NAMES):
        entry = entries[f"{part.name}.stl"]
        mesh, box = trimesh.load(folder / entry["file"]), np.array(part.box(part.source(DESIGN)))
        assert np.allclose(mesh.bounds, entry["bounding_box_mm"], atol=1e-5)
        if not part.printed:
            assert entry["turned"] is None
            assert np.allclose(mesh.bounds, box, atol=0.2)
            continue
        low, high = mesh.bounds
        assert low[2] == 0
        assert np.allclose(low[:2], -high[:2], atol=1e-5)
        assert np.allclose(entry["turned"], part.pose.turn)
        own = np.linalg.inv(np.array(entry["turned"])) @ mesh.vertices.T
        assert np.allclose(np.ptp(own, axis=1), box[1] - box[0], atol=0.2)


def test_sphere_on_its_tip_fails():
    part = registry.find_part("sphere:10")
    built = BuiltDesign(DESIGN, (part,), {part.name: build_part(part, DESIGN)[0]})
    contact, ceilings, suction = platform_contact(built)
    assert suction.value == "no cup"
    assert not contact.failed
    # The stem's end with its flat, and the plate's ring around the stem.
    stem_mm2, plate_mm2 = 9 * np.pi - segment_mm2(2.2, 3.0), 25 * np.pi
    assert float(contact.value.split()[0]) == pytest.approx(stem_mm2, abs=0.2)
    assert float(ceilings.value.split()[0]) == pytest.approx(plate_mm2 - stem_mm2, abs=0.3)
    assert "lowest at 20.0 mm, span up to 2.0 mm, on supports" in ceilings.value
    tip_down = replace(part, pose=PrintPose())
    built = BuiltDesign(DESIGN, (tip_down,), {part.name: build_part(part, DESIGN)[0]})
    assert next(iter(platform_contact(built))).failed


def test_tilted_shell_has_no_ceilings():
    """Which is what the tilt is for."""
    part = registry.find_part("shell")
    mesh = mesh_solid(build_part(part, DESIGN)[0], TOLERANCE_MM, part.name)
    flat = find_contact(lay_on_platform(mesh, replace(part.pose, tilt_deg=0.0)))
    assert flat.ceilings_mm2 > 100
    assert flat.contact_mm2 > MIN_CONTACT_MM2
    tilted = find_contact(lay_on_platform(mesh, part.pose))
    assert (tilted.ceilings_mm2, tilted.contact_mm2) == (0, 0)


POCKET = box((-10, -8, 2), (10, 8, 10))
CUP = box((-12, -10, 0), (12, 10, 10)).cut(POCKET)


@pytest.mark.parametrize(
    ("solid", "down", "on_supports", "sealed_mm2"),
    [
        (CUP, "-z", False, [320]),  # the film closes it
        (CUP, "-z", True, [320]),
        (CUP, "+z", False, [320]),  # the platform does
        (CUP, "+z", True, []),
        (CUP.cut(box((-12, -1, 2), (0, 1, 4))), "-z", False, []),  # a vent at its floor
        (CUP.cut(box((-12, -1, 6), (0, 1, 10))), "-z", False, [320]),  # it comes too late
        (CUP.cut(box((-12, -1, 6), (0, 1, 10))), "+z", False, []),
        (CUP.cut(box((-1, -1, 0), (1, 1, 2))), "-z", True, []),
        (CUP.cut(box((-1, -1, 0), (1, 1, 2))), "-z", False, [320]),
        (CUP.fuse(box((-1, -10, 0), (1, 10, 10))), "-z", False, [144, 144]),
        (rod(8, 0, 10).cut(rod(5, 0, 10)), "-z", False, [25 * np.pi]),
        (box((-5, -5, 0), (5, 5, 5)), "-z", False, []),
    ],
)
def test_cups_where_resin_cannot_flow_in(solid, down, on_supports, sealed_mm2):
    mesh = lay_on_platform(mesh_solid(solid, 0.05, "cup"), PrintPose(down))
    rim_mm2 = 80 * CELL_MM / 2  # half a cell around
    assert find_cups(mesh, on_supports) == pytest.approx(sealed_mm2, abs=rim_mm2)


@pytest.mark.parametrize(
    ("name", "flat_mm2"),
    [("mold", 4 * 39.2 * 40.2), ("coupon-mold", 4 * 176.7), ("light-holder", 320.5)],
)
def test_poses_open_what_would_be_cups(name, flat_mm2):
    """Lying straight on the platform each of them fails, as printed none has a cup."""
    part = registry.find_part(name)
    lying = replace(part, pose=PrintPose())
    for posed, fails in ((lying, True), (part, False)):
        built = BuiltDesign(DESIGN, (posed,), {name: made(name)})
        row = next(r for r in platform_contact(built) if r.id == f"suction.{name}")
        assert row.failed == fails
    mesh = mesh_solid(made(name), TOLERANCE_MM, name)
    assert sum(find_cups(lay_on_platform(mesh, lying.pose), False)) == pytest.approx(
        flat_mm2, rel=0.05
    )
    assert find_cups(lay_on_platform(mesh, part.pose), part.pose.on_supports) == []
    assert flat_mm2 > MAX_CUP_MM2


def test_part_on_edge_needs_no_supports():
    pose = registry.find_part("mold").pose
    assert pose.instructions == "edge at -y down, straight on the platform, no supports"
    assert "tilted by 20°, supports under the floor" in registry.find_part("light-holder").making
