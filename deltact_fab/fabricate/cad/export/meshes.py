"""Closed meshes for slicers as binary STL and 3MF (core specification 1.3), for viewers as GLB.

STL: 80 bytes of header, a count, 50 bytes per triangle. 3MF: a zip of three files; ids start at 1,
vertices are shared, the archive has a fixed date, so that lib3mf reads it in its strict mode and
the bytes are reproducible. Both are in millimetres. GLB: one node and one material per part; its
vertices are in millimetres in the CAD frame, and each node rotates z up to y up and scales to
metres, as glTF requires.
"""

from __future__ import annotations

import io
import zipfile
from collections.abc import Mapping, Sequence
from typing import Any
from xml.sax.saxutils import escape, quoteattr

import numpy as np

from deltact_fab.common import Point
from deltact_fab.version import PACKAGE_VERSION

from ..mesh import Mesh
from ..rays import normals

# x to x, y to -z, z to y, all in metres.
_GLTF_ROOT = np.array([(0.001, 0, 0, 0), (0, 0, 0.001, 0), (0, -0.001, 0, 0), (0, 0, 0, 1)])
AT_ORIGIN = ((0.0, 0.0, 0.0),)  # exact: one copy in its own frame
_ZIP_DATE = (1980, 1, 1, 0, 0, 0)  # earliest date of the zip format
_CORE_NAMESPACE = "http://schemas.microsoft.com/3dmanufacturing/core/2015/02"
_MODEL_TYPE = "application/vnd.ms-package.3dmanufacturing-3dmodel+xml"
_CONTENT_TYPES = f"""<?xml version="1.0" encoding="UTF-8"?>
<Types xmlns="http://schemas.openxmlformats.org/package/2006/content-types">
<Default Extension="rels" ContentType="application/vnd.openxmlformats-package.relationships+xml"/>
<Default Extension="model" ContentType="{_MODEL_TYPE}"/>
</Types>
"""
_PACKAGE_RELATIONS = """<?xml version="1.0" encoding="UTF-8"?>
<Relationships xmlns="http://schemas.openxmlformats.org/package/2006/relationships">
<Relationship Target="/3D/3dmodel.model" Id="rel1" \
Type="http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"/>
</Relationships>
"""


def stl_bytes(mesh: Mesh, name: str) -> bytes:
    """Return the mesh as binary STL in millimetres."""
    corners = mesh.corners_mm
    record = np.zeros(
        len(corners), dtype=[("normal", "<f4", 3), ("corner", "<f4", (3, 3)), ("flags", "<u2")]
    )
    # A sliver has no normal; readers take zero as "use the order of the corners".
    record["normal"], record["corner"] = normals(corners) + 0.0, corners
    header = f"deltact-fab {name}, millimetres".encode().ljust(80)[:80]
    return header + np.uint32(len(record)).astype("<u4").tobytes() + record.tobytes()


def threemf_bytes(
    mesh: Mesh, name: str, material: str, colour: tuple[float, float, float, float]
) -> bytes:
    """Return the mesh as a 3MF archive: one object, one base material, one item.

    The vertices keep their coordinates; the item moves them into the positive octant, as the
    specification requires. colour: sRGB and opacity, 0 to 1.
    """
    vertices = "\n".join(
        f'<vertex x="{x:.9g}" y="{y:.9g}" z="{z:.9g}"/>' for x, y, z in mesh.vertices_mm.tolist()
    )
    triangles = "\n".join(
        f'<triangle v1="{a}" v2="{b}" v3="{c}"/>' for a, b, c in mesh.triangles.tolist()
    )
    x, y, z = (0.0 - mesh.vertices_mm.min(axis=0).astype(float)).tolist()
    shade = "#" + "".join(f"{round(255 * c):02X}" for c in colour)
    model = f"""<?xml version="1.0" encoding="UTF-8"?>
<model unit="millimeter" xml:lang="en" xmlns="{_CORE_NAMESPACE}">
<metadata name="Title">{escape(name)}</metadata>
<metadata name="Application">deltact-fab {PACKAGE_VERSION}</metadata>
<resources>
<basematerials id="1"><base name={quoteattr(material)} displaycolor="{shade}"/></basematerials>
<object id="2" type="model" name={quoteattr(name)} pid="1" pindex="0">
<mesh>
<vertices>
{vertices}
</vertices>
<triangles>
{triangles}
</triangles>
</mesh>
</object>
</resources>
<build>
<item objectid="2" transform="1 0 0 0 1 0 0 0 1 {x:.9g} {y:.9g} {z:.9g}"/>
</build>
</model>
"""
    archive = io.BytesIO()
    with zipfile.ZipFile(archive, "w") as zipped:
        for path, text in (
            ("[Content_Types].xml", _CONTENT_TYPES),
            ("_rels/.rels", _PACKAGE_RELATIONS),
            ("3D/3dmodel.model", model),
        ):
            entry = zipfile.ZipInfo(path, _ZIP_DATE)
            entry.create_system = 3  # independent of the platform
            entry.external_attr = 0o644 << 16
            zipped.writestr(entry, text.encode(), zipfile.ZIP_DEFLATED, 6)
    return archive.getvalue()


def shaded_mesh(mesh: Mesh, name: str, colour: tuple[float, float, float, float]) -> Any:
    """Return a mesh as a trimesh.Trimesh in millimetres; colour: sRGB and opacity.

    A vertex is repeated for each CAD face that meets there, so that faces are smooth and edges
    sharp. Its normal is the angle-weighted mean over that face.
    """
    import trimesh
    from trimesh.visual.material import PBRMaterial

    key = mesh.face[:, None] * len(mesh.vertices_mm) + mesh.triangles
    vertices, index = np.unique(key.ravel(), return_inverse=True)
    *shade, opacity = colour
    # glTF's factors are linear (sRGB transfer function, IEC 61966-2-1).
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in shade]
    material = PBRMaterial(
        name=name,
        baseColorFactor=[*linear, opacity],
        metallicFactor=0.0,
        roughnessFactor=0.6,
        alphaMode="BLEND" if opacity < 1 else None,
    )
    return trimesh.Trimesh(
        mesh.vertices_mm[vertices % len(mesh.vertices_mm)], index.reshape(-1, 3),
        process=False,
        visual=trimesh.visual.TextureVisuals(material=material),
    )  # fmt: skip


def glb_bytes(bodies: Mapping[str, tuple[Any, Sequence[Point]]]) -> bytes:
    """Return a GLB of bodies by name, in order, each with the positions of its copies in mm."""
    import trimesh
    from trimesh.exchange.gltf import export_glb

    scene = trimesh.Scene()
    for name, (body, places_mm) in bodies.items():
        scene.geometry[name] = body
        for copy, place in enumerate(places_mm, start=1):
            node = name if len(places_mm) == 1 else f"{name}-{copy}"
            transform = _GLTF_ROOT @ trimesh.transformations.translation_matrix(place)
            scene.graph.update(node, matrix=transform, geometry=name)
    return bytes(export_glb(scene, include_normals=True))


def read_part(data: bytes) -> Any:
    """Return the one body of a GLB written by glb_bytes."""
    import trimesh

    scene = trimesh.load_scene(io.BytesIO(data), file_type="glb", process=False)
    (body,) = scene.geometry.values()
    body.metadata.clear()  # would be written, too
    return body
