"""Binary glTF 2.0: parts as they are looked at, one node and one material each.

The numbers are those of the CAD frame, in millimetres; each node turns z up into y up and scales
to metres, as glTF wants both.
"""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ....aliases import Point
from ...mesh import Mesh

# x to x, y to -z, z to y, all in metres.
_ROOT = np.array([(0.001, 0, 0, 0), (0, 0, 0.001, 0), (0, -0.001, 0, 0), (0, 0, 0, 1)])


@dataclass(frozen=True)
class GlbPart:
    """One part as it is drawn: its triangles, colour and places.

    points_mm, normals: (n, 3) float32; a point stands once for each CAD face that meets there, so
    that faces are smooth and edges sharp. triangles: (m, 3) uint32.
    colour: sRGB and opacity. places_mm: where its origin goes, one a copy.
    """

    name: str
    points_mm: NDArray[np.float32]
    normals: NDArray[np.float32]
    triangles: NDArray[np.uint32]
    colour: tuple[float, float, float, float]
    places_mm: tuple[Point, ...] = ((0.0, 0.0, 0.0),)


def drawn(mesh: Mesh, name: str, colour: tuple[float, float, float, float]) -> GlbPart:
    """A mesh with a normal at every corner: the mean over its CAD face, weighted by the angle."""
    corners = mesh.corners_mm
    ahead = np.roll(corners, -1, axis=1) - corners
    back = np.roll(corners, 1, axis=1) - corners
    cross = np.cross(ahead, back)
    sine = np.linalg.norm(cross, axis=2)
    angle = np.arctan2(sine, np.einsum("mcx,mcx->mc", ahead, back))
    unit = np.divide(cross, sine[:, :, None], out=np.zeros_like(cross), where=sine[:, :, None] > 0)
    key = mesh.face[:, None] * len(mesh.vertices_mm) + mesh.triangles
    at, index = np.unique(key.ravel(), return_inverse=True)
    normals = np.zeros((len(at), 3))
    np.add.at(normals, index.ravel(), (unit * angle[:, :, None]).reshape(-1, 3))
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    # A point of slivers alone has no direction, and glTF wants one.
    normals = np.where(length > 0, normals / np.where(length > 0, length, 1), (0.0, 0.0, 1.0)) + 0.0
    return GlbPart(
        name,
        mesh.vertices_mm[at % len(mesh.vertices_mm)],
        normals.astype(np.float32),
        index.reshape(-1, 3).astype(np.uint32),
        colour,
    )


def glb_bytes(parts: Sequence[GlbPart]) -> bytes:
    """A GLB of parts in the order given."""
    import trimesh
    from trimesh.exchange.gltf import export_glb

    scene = trimesh.Scene()
    for part in parts:
        body = trimesh.Trimesh(
            part.points_mm, part.triangles, vertex_normals=part.normals, process=False,
            visual=trimesh.visual.TextureVisuals(material=_material(part)),
        )  # fmt: skip
        scene.geometry[part.name] = body
        for copy, place in enumerate(part.places_mm, start=1):
            called = part.name if len(part.places_mm) == 1 else f"{part.name}-{copy}"
            where = _ROOT @ trimesh.transformations.translation_matrix(place)
            scene.graph.update(called, matrix=where, geometry=part.name)
    return bytes(export_glb(scene, include_normals=True))


def read_part(
    data: bytes, colour: tuple[float, float, float, float], places_mm: Sequence[Point]
) -> GlbPart:
    """The one part of a GLB that glb_bytes wrote, to be put in several places."""
    import trimesh

    scene = trimesh.load(io.BytesIO(data), file_type="glb", process=False)
    ((name, body),) = scene.geometry.items()
    return GlbPart(
        name,
        np.asarray(body.vertices, np.float32),
        np.asarray(body.vertex_normals, np.float32),
        np.asarray(body.faces, np.uint32),
        colour,
        tuple(places_mm),
    )


def _material(part: GlbPart) -> Any:
    from trimesh.visual.material import PBRMaterial

    *shade, opacity = part.colour
    # glTF's factors are linear light; the registry's colours are sRGB.
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in shade]
    return PBRMaterial(
        name=part.name,
        baseColorFactor=[*linear, opacity],
        metallicFactor=0.0,
        roughnessFactor=0.6,
        alphaMode="BLEND" if opacity < 1 else None,
    )
