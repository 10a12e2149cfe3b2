"""Binary glTF 2.0: parts as they are looked at, one node and one material each.

The numbers are those of the CAD frame, in millimetres; the root node turns z up into y up and
scales to metres, as glTF wants both.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ....aliases import Point
from ....version import VERSION
from ...mesh import Mesh

_MAGIC, _JSON, _BINARY = 0x46546C67, 0x4E4F534A, 0x004E4942
_FLOAT, _UNSIGNED = 5126, 5125
_POINTS, _INDICES = 34962, 34963
# Column by column: x to x, y to -z, z to y, all in metres.
_ROOT = (0.001, 0, 0, 0, 0, 0, -0.001, 0, 0, 0.001, 0, 0, 0, 0, 0, 1)


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


def glb_bytes(parts: Sequence[GlbPart], name: str) -> bytes:
    """A GLB of parts in the order given, all under one node called `name`."""
    binary = bytearray()
    views: list[dict[str, Any]] = []
    accessors: list[dict[str, Any]] = []
    nodes: list[dict[str, Any]] = [{"name": name, "matrix": list(_ROOT), "children": []}]

    def add(array: NDArray[Any], kind: str, target: int, **limits: list[float]) -> int:
        views.append(
            {"buffer": 0, "byteOffset": len(binary), "byteLength": array.nbytes, "target": target}
        )
        binary.extend(array.astype(array.dtype.newbyteorder("<")).tobytes())
        number = _FLOAT if array.dtype.kind == "f" else _UNSIGNED
        count = array.size if kind == "SCALAR" else len(array)
        accessors.append(
            {"bufferView": len(views) - 1, "componentType": number, "count": count, "type": kind}
            | limits
        )
        return len(accessors) - 1

    meshes = []
    for number, part in enumerate(parts):
        low, high = part.points_mm.min(axis=0).tolist(), part.points_mm.max(axis=0).tolist()
        primitive = {
            "attributes": {
                "POSITION": add(part.points_mm, "VEC3", _POINTS, min=low, max=high),
                "NORMAL": add(part.normals, "VEC3", _POINTS),
            },
            "indices": add(part.triangles, "SCALAR", _INDICES),
            "material": number,
        }
        meshes.append({"name": part.name, "primitives": [primitive]})
        for copy, place in enumerate(part.places_mm, start=1):
            called = part.name if len(part.places_mm) == 1 else f"{part.name}-{copy}"
            node: dict[str, Any] = {"name": called, "mesh": number}
            if any(place):
                node["translation"] = [float(c) for c in place]
            nodes[0]["children"].append(len(nodes))
            nodes.append(node)
    document = {
        "asset": {"version": "2.0", "generator": f"deltact-fab {VERSION}"},
        "scene": 0,
        "scenes": [{"name": name, "nodes": [0]}],
        "nodes": nodes,
        "meshes": meshes,
        "materials": [_material(part) for part in parts],
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{"byteLength": len(binary)}],
    }
    text = json.dumps(document, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    # Every array is of four-byte numbers, so the binary chunk needs no padding.
    chunks = struct.pack("<II", len(text), _JSON) + text
    chunks += struct.pack("<II", len(binary), _BINARY) + bytes(binary)
    return struct.pack("<III", _MAGIC, 2, 12 + len(chunks)) + chunks


def read_part(data: bytes, places_mm: Sequence[Point]) -> GlbPart:
    """The one part of a GLB that glb_bytes wrote, to be put in several places."""
    (length,) = struct.unpack_from("<I", data, 12)
    document = json.loads(data[20 : 20 + length])
    binary = data[28 + length :]

    def read(number: int, width: int) -> NDArray[Any]:
        accessor = document["accessors"][number]
        view = document["bufferViews"][accessor["bufferView"]]
        dtype = "<f4" if accessor["componentType"] == _FLOAT else "<u4"
        part = binary[view["byteOffset"] : view["byteOffset"] + view["byteLength"]]
        return np.frombuffer(part, dtype).reshape(-1, width)

    mesh = document["meshes"][0]
    (primitive,) = mesh["primitives"]
    colour = document["materials"][0]["extras"]["srgb"]
    return GlbPart(
        mesh["name"],
        read(primitive["attributes"]["POSITION"], 3),
        read(primitive["attributes"]["NORMAL"], 3),
        read(primitive["indices"], 3),
        tuple(colour),
        tuple(places_mm),
    )


def _material(part: GlbPart) -> dict[str, Any]:
    *shade, opacity = part.colour
    # glTF's factors are linear light; the registry's colours are sRGB.
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in shade]
    material: dict[str, Any] = {
        "name": part.name,
        "pbrMetallicRoughness": {
            "baseColorFactor": [round(c, 6) for c in linear] + [opacity],
            "metallicFactor": 0.0,
            "roughnessFactor": 0.6,
        },
        "extras": {"srgb": list(part.colour)},
    }
    return material | ({"alphaMode": "BLEND"} if opacity < 1 else {})
