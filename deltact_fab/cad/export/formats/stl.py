"""Binary STL: 80 bytes of header, a count, 50 bytes a triangle."""

from __future__ import annotations

import numpy as np

from ...mesh import Mesh


def stl_bytes(mesh: Mesh, name: str) -> bytes:
    """The mesh as binary STL in millimetres."""
    corners = mesh.corners_mm
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(normal, axis=1, keepdims=True)
    # A sliver has no normal of its own; zero tells the reader to use the order of the corners.
    normal = np.divide(normal, length, out=np.zeros_like(normal), where=length > 0) + 0.0
    record = np.zeros(
        len(corners), dtype=[("normal", "<f4", 3), ("corner", "<f4", (3, 3)), ("flags", "<u2")]
    )
    record["normal"], record["corner"] = normal, corners
    header = f"deltact-fab {name}, millimetres".encode().ljust(80)[:80]
    return header + np.uint32(len(record)).astype("<u4").tobytes() + record.tobytes()
