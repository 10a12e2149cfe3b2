"""Meshes as other programs read them."""

from __future__ import annotations

from typing import Any

import lib3mf
import manifold3d
import numpy as np


def closed_mm3(vertices, triangles) -> float:
    """Volume as manifold3d sees it, which takes only a closed, oriented mesh."""
    mesh = manifold3d.Mesh(
        vert_properties=np.asarray(vertices, np.float32), tri_verts=np.asarray(triangles, np.uint32)
    )
    body = manifold3d.Manifold(mesh)
    assert body.status() == manifold3d.Error.NoError
    return body.volume()


def of_3mf(data: bytes) -> tuple[Any, Any, np.ndarray, np.ndarray]:
    """Model, its one body, vertices (n, 3) and triangles; lib3mf is strict and has no warning."""
    model = lib3mf.get_wrapper().CreateModel()
    reader = model.QueryReader("3mf")
    reader.SetStrictModeActive(True)
    reader.ReadFromBuffer(data)
    assert reader.GetWarningCount() == 0
    objects = model.GetMeshObjects()
    assert objects.MoveNext()
    body = objects.GetCurrentMeshObject()
    assert not objects.MoveNext()
    assert body.IsManifoldAndOriented()
    vertices = np.array([list(v.Coordinates) for v in body.GetVertices()], np.float32)
    return model, body, vertices, np.array([list(t.Indices) for t in body.GetTriangleIndices()])
