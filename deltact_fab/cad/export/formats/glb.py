"""Binary glTF 2.0: parts as they are looked at, one node and one material each.

The numbers are those of the CAD frame, in millimetres; each node turns z up into y up and scales
to metres, as glTF wants both.
"""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ....aliases import Point
from ...mesh import Mesh

# x to x, y to -z, z to y, all in metres.
_ROOT = np.array([(0.001, 0, 0, 0), (0, 0, 0.001, 0), (0, -0.001, 0, 0), (0, 0, 0, 1)])
ORIGIN = ((0.0, 0.0, 0.0),)


def drawn(mesh: Mesh, name: str, colour: tuple[float, float, float, float]) -> Any:
    """A mesh as a trimesh.Trimesh in millimetres; colour: sRGB and opacity.

    A point stands once for each CAD face that meets there, so that faces are smooth and edges
    sharp. Its normal is the mean over that face, weighted by the angle.
    """
    import trimesh
    from trimesh.visual.material import PBRMaterial

    key = mesh.face[:, None] * len(mesh.vertices_mm) + mesh.triangles
    at, index = np.unique(key.ravel(), return_inverse=True)
    *shade, opacity = colour
    # glTF's factors are linear light.
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in shade]
    material = PBRMaterial(
        name=name,
        baseColorFactor=[*linear, opacity],
        metallicFactor=0.0,
        roughnessFactor=0.6,
        alphaMode="BLEND" if opacity < 1 else None,
    )
    return trimesh.Trimesh(
        mesh.vertices_mm[at % len(mesh.vertices_mm)], index.reshape(-1, 3),
        process=False,
        visual=trimesh.visual.TextureVisuals(material=material),
    )  # fmt: skip


def glb_bytes(bodies: Mapping[str, tuple[Any, Sequence[Point]]]) -> bytes:
    """A GLB of bodies by name in the order given, each with the places of its copies in mm."""
    import trimesh
    from trimesh.exchange.gltf import export_glb

    scene = trimesh.Scene()
    for name, (body, places_mm) in bodies.items():
        scene.geometry[name] = body
        for copy, place in enumerate(places_mm, start=1):
            called = name if len(places_mm) == 1 else f"{name}-{copy}"
            where = _ROOT @ trimesh.transformations.translation_matrix(place)
            scene.graph.update(called, matrix=where, geometry=name)
    return bytes(export_glb(scene, include_normals=True))


def read_part(data: bytes) -> Any:
    """The one body of a GLB that glb_bytes wrote."""
    import trimesh

    scene = trimesh.load_scene(io.BytesIO(data), file_type="glb", process=False)
    (body,) = scene.geometry.values()
    body.metadata.clear()  # else it is written, too
    return body
