"""Each format as its own reader sees it: trimesh, manifold3d, lib3mf, ezdxf, the kernel itself."""

from __future__ import annotations

import io
import math
import zipfile

import ezdxf
import lib3mf
import numpy as np
import pytest
import trimesh
from readers import closed_mm3, of_3mf

from deltact_fab.common.errors import RunFailed
from deltact_fab.fabricate.cad import registry
from deltact_fab.fabricate.cad.build import build_part
from deltact_fab.fabricate.cad.design import load_design
from deltact_fab.fabricate.cad.export import dxf, meshes, step
from deltact_fab.fabricate.cad.kernel import require
from deltact_fab.fabricate.cad.mesh import mesh_solid

DESIGN = load_design()
TOLERANCE_MM = 0.02
NAMES = ("skin", "acrylic", "indenter-sphere-10")
PLACES = ((1.0, 2.0, 3.0), (-4.0, 0.0, 0.0))


@pytest.fixture(scope="module")
def parts():
    """name: (part, solid, measured, mesh)."""
    made = {}
    for name in NAMES:
        part = registry.find_part(name)
        solid, measured = build_part(part, DESIGN)
        made[name] = (part, solid, measured, mesh_solid(solid, TOLERANCE_MM, name))
    return made


@pytest.mark.parametrize("name", ["skin", "indenter-sphere-10"])
def test_stl_is_closed(parts, name):
    part, _, measured, mesh = parts[name]
    data = meshes.stl_bytes(mesh, part.name)
    assert data[:80].rstrip() == f"deltact-fab {name}, millimetres".encode()
    read = trimesh.load(io.BytesIO(data), file_type="stl")
    assert read.is_watertight
    assert read.is_winding_consistent
    assert len(read.faces) == len(mesh.triangles)
    slack_mm3 = measured.area_mm2 * mesh.deviation_mm + 1e-6 * measured.volume_mm3
    assert read.volume == pytest.approx(measured.volume_mm3, abs=slack_mm3)
    assert closed_mm3(read.vertices, read.faces) == pytest.approx(read.volume, rel=1e-5)


def test_3mf_passes_lib3mf_strict_mode(parts):
    part, _, measured, mesh = parts["indenter-sphere-10"]
    data = meshes.threemf_bytes(mesh, part.name, part.material, part.colour)
    model, body, vertices, triangles = of_3mf(data)
    assert model.GetUnit() == lib3mf.ModelUnit.MilliMeter
    assert model.GetMetaDataGroup().GetMetaDataByKey("", "Title").GetValue() == part.name
    assert body.GetName() == part.name
    assert np.array_equal(vertices, mesh.vertices_mm)
    assert closed_mm3(vertices, triangles) == pytest.approx(mesh.volume_mm3, rel=1e-5)
    # As it stands on the printer: in the positive octant, touching its sides.
    items = model.GetBuildItems()
    assert items.MoveNext()
    move = np.array(items.GetCurrent().GetObjectTransform().Fields, float).reshape(4, 3)
    assert np.array_equal(move[:3], np.eye(3))
    assert np.allclose(vertices.min(axis=0) + move[3], 0, atol=1e-6)
    assert np.allclose(np.ptp(vertices, axis=0), np.subtract(*measured.box_mm[::-1]), atol=0.02)


def test_3mf_escapes_material_without_date(parts):
    mesh = parts["acrylic"][3]
    data = meshes.threemf_bytes(mesh, "a<b", 'PMMA "clear" & <hard>', (1.0, 0.5, 0.0, 0.25))
    groups = of_3mf(data)[0].GetBaseMaterialGroups()
    assert groups.MoveNext()
    group = groups.GetCurrentBaseMaterialGroup()
    assert group.GetName(1) == 'PMMA "clear" & <hard>'
    shown = group.GetDisplayColor(1)
    assert (shown.Red, shown.Green, shown.Blue, shown.Alpha) == (255, 128, 0, 64)
    with zipfile.ZipFile(io.BytesIO(data)) as zipped:
        names = [entry.filename for entry in zipped.infolist()]
        assert names == ["[Content_Types].xml", "_rels/.rels", "3D/3dmodel.model"]
        assert {entry.date_time for entry in zipped.infolist()} == {(1980, 1, 1, 0, 0, 0)}


def test_glb_units_axes_and_colours(parts):
    part, _, measured, mesh = parts["skin"]
    shaded = meshes.shaded_mesh(mesh, "skin", part.colour)
    data = meshes.glb_bytes({"skin": (shaded, meshes.AT_ORIGIN)})
    scene = trimesh.load(io.BytesIO(data), file_type="glb")
    (x0, y0, z0), (x1, y1, z1) = (np.array(corner) / 1000 for corner in measured.box_mm)
    # z of the CAD frame is y here, y is -z.
    assert np.allclose(scene.bounds, [(x0, z0, -y1), (x1, z1, -y0)], atol=1e-8)
    assert scene.to_mesh().volume == pytest.approx(mesh.volume_mm3 * 1e-9, rel=1e-4)
    material = scene.geometry["skin"].visual.material
    assert material.alphaMode == "BLEND"
    linear = (0.3424, 0.6038, 0.8276, part.colour[3])
    assert material.baseColorFactor / 255 == pytest.approx(linear, abs=3e-3)


def test_glb_assembly_positions_every_copy(parts):
    alone = {}
    for name, (part, _, _, mesh) in parts.items():
        shaded = meshes.shaded_mesh(mesh, name, part.colour)
        alone[name] = meshes.glb_bytes({name: (shaded, meshes.AT_ORIGIN)})
    plate, ball = (meshes.read_part(alone[name]) for name in ("acrylic", "indenter-sphere-10"))
    whole = meshes.glb_bytes(
        {"acrylic": (plate, meshes.AT_ORIGIN), "indenter-sphere-10": (ball, PLACES)}
    )
    scene = trimesh.load(io.BytesIO(whole), file_type="glb")
    names = {"acrylic", "indenter-sphere-10-1", "indenter-sphere-10-2"}
    assert set(scene.graph.nodes_geometry) == names
    assert len(scene.geometry) == 2
    tip = parts["indenter-sphere-10"][3]
    lowest = tip.vertices_mm[tip.vertices_mm[:, 2].argmin()]
    for copy, place in enumerate(PLACES, start=1):
        transform, geometry = scene.graph[f"indenter-sphere-10-{copy}"]
        points = trimesh.transform_points(scene.geometry[geometry].vertices, transform) * 1000
        x, y, z = np.add(lowest, place)
        assert np.isclose(points, (x, z, -y), atol=1e-4).all(axis=1).any()
    # The same closed mesh as in the other formats, once points are joined by place again.
    joined, index = np.unique(ball.vertices, axis=0, return_inverse=True)
    assert len(joined) == len(tip.vertices_mm)
    assert closed_mm3(joined, index.reshape(-1)[ball.faces]) == pytest.approx(
        tip.volume_mm3, rel=1e-5
    )


def test_glb_smooth_faces_and_sharp_edges(parts):
    mesh = parts["indenter-sphere-10"][3]
    read = meshes.shaded_mesh(mesh, "x", (1, 1, 1, 1))
    points, normals = read.vertices, read.vertex_normals
    ball = (points[:, 2] < 4.9) & (np.linalg.norm(points - (0, 0, 5), axis=1) < 5.01)
    assert ball.sum() > 100
    radial = (points[ball] - (0, 0, 5)) / 5
    assert np.abs(normals[ball] - radial).max() < 0.05
    top = np.isclose(points[:, 2], points[:, 2].max())
    assert {tuple(n) for n in normals[top & (normals[:, 2] > 0.5)].round(6)} == {(0.0, 0.0, 1.0)}
    rim = normals[top & (normals[:, 2] < 0.5)]
    assert len(rim) > 10
    assert np.abs(rim[:, 2]).max() < 1e-3


def test_dxf_outline_units_and_layer(parts):
    _, solid, measured, _ = parts["acrylic"]
    document = ezdxf.read(io.StringIO(dxf.dxf_bytes(solid, "acrylic").decode()))
    assert document.header["$INSUNITS"] == 4
    assert not document.audit().errors
    entities = list(document.modelspace())
    assert {entity.dxf.layer for entity in entities} == {"CUT"}
    (outline,) = entities
    assert outline.dxftype() == "LWPOLYLINE"
    assert outline.closed
    assert len(outline) == 12
    loops = _loops(entities)
    thickness_mm = measured.box_mm[1][2] - measured.box_mm[0][2]
    assert _area_mm2(loops[0]) * thickness_mm == pytest.approx(measured.volume_mm3, rel=1e-9)
    points = np.array([start for start, _, _ in loops[0]])
    assert np.allclose(points.max(axis=0), DESIGN.acrylic_half_mm, atol=1e-9)
    assert np.allclose(points.min(axis=0), np.negative(DESIGN.acrylic_half_mm), atol=1e-9)


def test_dxf_turns_arcs_the_right_way():
    cq = require()
    plate = cq.Workplane().workplane(offset=7).rect(30, 20).extrude(3).edges("|Z").fillet(4)
    plate = plate.faces(">Z").workplane().pushPoints([(5, 0)]).hole(6)
    plate = plate.faces(">Z").workplane().moveTo(-8, 0).slot2D(10, 4, 90).cutThruAll()
    document = ezdxf.read(io.StringIO(dxf.dxf_bytes(plate.val(), "plate").decode()))
    entities = list(document.modelspace())
    assert {(entity.dxftype(), entity.closed) for entity in entities} == {("LWPOLYLINE", True)}
    # Sides and corners, the hole as two half circles, the slot.
    assert sorted(len(entity) for entity in entities) == [2, 4, 8]
    areas = sorted(_area_mm2(loop) for loop in _loops(entities))
    slot_mm2 = 4 * 6 + math.pi * 4
    outline_mm2 = 30 * 20 - (4 - math.pi) * 16
    assert areas == pytest.approx([9 * math.pi, slot_mm2, outline_mm2], rel=1e-9)
    # Half a kerf into what falls out: holes smaller, the outline larger.
    wider = ezdxf.read(io.StringIO(dxf.dxf_bytes(plate.val(), "plate", 0.1).decode()))
    hole, slot, outline = sorted(_area_mm2(loop) for loop in _loops(wider.modelspace()))
    assert hole == pytest.approx(2.9**2 * math.pi, rel=1e-9)
    assert slot < slot_mm2
    assert outline > outline_mm2


def _loops(entities):
    """Each polyline as (start, end, bulge) of its sides."""
    loops = []
    for entity in entities:
        points = entity.get_points("xyb")
        ends = zip(points, points[1:] + points[:1], strict=True)
        loops.append([(a[:2], b[:2], a[2]) for a, b in ends])
    return loops


def _area_mm2(loop):
    """Shoelace and the segments between chords and arcs."""
    total = 0.0
    for (x0, y0), (x1, y1), bulge in loop:
        total += (x0 * y1 - x1 * y0) / 2
        if bulge:
            sweep = 4 * math.atan(abs(bulge))
            radius = math.dist((x0, y0), (x1, y1)) / (2 * math.sin(sweep / 2))
            total += math.copysign(radius**2 * (sweep - math.sin(sweep)) / 2, bulge)
    return abs(total)


def test_dxf_refuses_uncuttable_solids(parts):
    cq = require()
    bevelled = cq.Workplane().box(20, 10, 4).faces(">Z").chamfer(1).val()
    with pytest.raises(RunFailed, match=r"bevelled: not a plate: outline x thickness is 576"):
        dxf.dxf_bytes(bevelled, "bevelled")
    with pytest.raises(RunFailed, match="flat faces point up; expected one"):
        dxf.dxf_bytes(parts["indenter-sphere-10"][1], "ball")
    oval = cq.Workplane().ellipse(9, 5).extrude(2).val()
    with pytest.raises(RunFailed, match="oval: edge of type ELLIPSE; expected lines and arcs"):
        dxf.dxf_bytes(oval, "oval")


def test_step_assembly_names_every_copy(parts, tmp_path):
    cq = require()
    solids = {name: parts[name][1] for name in NAMES}
    pieces = [("acrylic", solids["acrylic"], [(0.0, 0.0, 0.0)]),
              ("ball", solids["indenter-sphere-10"], PLACES)]  # fmt: skip
    data = step.assembly_bytes(pieces, "assembly")
    (tmp_path / "a.step").write_bytes(data)
    solids = cq.importers.importStep(str(tmp_path / "a.step")).solids().vals()
    ball = parts["indenter-sphere-10"][2]
    assert sorted(s.Volume() for s in solids) == pytest.approx(
        sorted([parts["acrylic"][2].volume_mm3] + 2 * [ball.volume_mm3]), rel=1e-6
    )
    lowest = sorted(s.BoundingBox().zmin for s in solids if s.Volume() < 2000)
    assert lowest == pytest.approx([0.0, 3.0], abs=1e-6)
    text = data.decode()
    for name in ("assembly", "acrylic", "ball"):
        assert text.count(f"PRODUCT('{name}','{name}'") == 1
    for number, use in enumerate(("acrylic-1", "ball-1", "ball-2"), start=1):
        assert f"NEXT_ASSEMBLY_USAGE_OCCURRENCE('{number}','{use}'" in text


def test_repeated_writes_give_same_bytes(parts):
    """The kernel counts products, uses and files over the life of the process."""
    _, solid, _, mesh = parts["acrylic"]
    white = 1, 1, 1, 1
    for write in (
        lambda: step.part_bytes(solid, "acrylic"),
        lambda: step.assembly_bytes([("acrylic", solid, PLACES)], "assembly"),
        lambda: dxf.dxf_bytes(solid, "acrylic"),
        lambda: meshes.threemf_bytes(mesh, "acrylic", "PMMA", white),
        lambda: meshes.glb_bytes({"a": (meshes.shaded_mesh(mesh, "a", white), meshes.AT_ORIGIN)}),
        lambda: meshes.stl_bytes(mesh, "acrylic"),
    ):
        assert write() == write()


def test_step_ignores_foreign_kernel_settings(parts):
    from OCP.Interface import Interface_Static

    solid = parts["skin"][1]
    before = step.part_bytes(solid, "skin"), step.assembly_bytes([("skin", solid, PLACES)], "a")
    assert b"PRODUCT('skin','skin'" in before[0]
    assert b"1970-01-01T00:00:00" in before[0]
    Interface_Static.SetIVal_s("write.surfacecurve.mode", 0)
    Interface_Static.SetIVal_s("write.precision.mode", 1)
    Interface_Static.SetIVal_s("write.stepcaf.subshapes.name", 1)
    Interface_Static.SetCVal_s("write.step.unit", "INCH")
    after = step.part_bytes(solid, "skin"), step.assembly_bytes([("skin", solid, PLACES)], "a")
    assert before == after
