"""Triangle meshes of solids: closed, with their measured deviation from the surface."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deltact_fab.common import RunFailed

from .kernel import Extent

MESH_ANGLE_RAD = 0.2  # by hand: smaller makes round parts smoother and files larger
# By hand: above the spacing of float32 at 100 mm (7.6e-6), far below any tolerance.
MERGE_MM = 1e-5
MAX_HALVINGS = 3  # by hand: the kernel oversteps by a factor of two; more only delays a refusal
_REFINED_TRIANGLES = 64  # by hand: fewer may miss the largest deviation, more take longer


@dataclass(frozen=True)
class Mesh:
    """A closed triangle mesh as it is written.

    vertices_mm: (n, 3) float32. triangles: (m, 3) indices, counter-clockwise from outside.
    face: (m,) index of the CAD face a triangle came from.
    deviation_mm: largest measured distance from the triangles to the solid's surface.
    """

    vertices_mm: NDArray[np.float32]
    triangles: NDArray[np.int64]
    face: NDArray[np.int64]
    deviation_mm: float

    @property
    def corners_mm(self) -> NDArray[np.float64]:
        """Corners of the triangles, (m, 3, 3): triangle, corner, axis."""
        return self.vertices_mm.astype(np.float64)[self.triangles]

    @property
    def box_mm(self) -> Extent:
        """Lowest and highest corner of the vertices."""
        points = self.vertices_mm.astype(float)
        return tuple(points.min(axis=0).tolist()), tuple(points.max(axis=0).tolist())

    @property
    def volume_mm3(self) -> float:
        """Enclosed volume by the divergence theorem; positive when the faces look outwards."""
        a, b, c = np.moveaxis(self.corners_mm, 1, 0)
        return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6)


def mesh_solid(solid: Any, tolerance_mm: float, part: str) -> Mesh:
    """Mesh a cadquery Solid so that its measured deviation is at most tolerance_mm.

    The kernel oversteps the deflection it is given by up to a factor of two, so the request is
    halved until the measurement holds. Raises RunFailed when the mesh is open or it never holds.
    """
    request_mm = tolerance_mm
    for _ in range(MAX_HALVINGS + 1):
        mesh = mesh_once(solid, request_mm)
        if not is_closed(mesh.triangles):
            raise RunFailed(f"{part}: the mesh at {request_mm:g} mm is not closed")
        if mesh.deviation_mm <= tolerance_mm:
            return mesh
        request_mm /= 2
    raise RunFailed(
        f"{part}: the mesh deviates {mesh.deviation_mm:.3g} mm from the surface, "
        f"tolerance {tolerance_mm:g} mm"
    )


def is_closed(triangles: NDArray[np.int64]) -> bool:
    """True when every directed edge occurs once and so does its opposite."""
    edges = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    forward = np.unique(edges, axis=0)
    backward = np.unique(edges[:, ::-1], axis=0)
    return len(triangles) > 0 and len(forward) == len(edges) and np.array_equal(forward, backward)


def mesh_once(solid: Any, request_mm: float) -> Mesh:
    """Mesh once with the requested deflection and measure it; it may overstep or be open."""
    from OCP.BRep import BRep_Tool
    from OCP.BRepMesh import BRepMesh_IncrementalMesh
    from OCP.BRepTools import BRepTools
    from OCP.ShapeAnalysis import ShapeAnalysis_Surface
    from OCP.TopAbs import TopAbs_REVERSED
    from OCP.TopLoc import TopLoc_Location

    # A mesh left by an earlier, finer call would be returned in place of this one.
    BRepTools.Clean_s(solid.wrapped)
    BRepMesh_IncrementalMesh(solid.wrapped, request_mm, False, MESH_ANGLE_RAD, False)
    points, triangles, face_of = [], [], []
    surfaces: list[Any] = []
    offset = 0
    for face in solid.Faces():
        place = TopLoc_Location()
        part = BRep_Tool.Triangulation_s(face.wrapped, place)
        if part is None:
            raise RunFailed("the CAD kernel left a face without triangles")
        move = place.Transformation()
        nodes = [part.Node(i).Transformed(move) for i in range(1, part.NbNodes() + 1)]
        points.append(np.array([(p.X(), p.Y(), p.Z()) for p in nodes]))
        corners = np.array([part.Triangle(i).Get() for i in range(1, part.NbTriangles() + 1)])
        if face.wrapped.Orientation() == TopAbs_REVERSED:
            corners = corners[:, ::-1]
        triangles.append(corners - 1 + offset)
        face_of.append(np.full(len(corners), len(surfaces)))
        surfaces.append(ShapeAnalysis_Surface(BRep_Tool.Surface_s(face.wrapped)))
        offset += len(nodes)
    vertices, joined = _merge(np.concatenate(points))
    corner = joined[np.concatenate(triangles)]
    distinct = np.all(corner != np.roll(corner, 1, axis=1), axis=1)
    corner, face_index = corner[distinct], np.concatenate(face_of)[distinct]
    deviation = _deviation_mm(vertices.astype(np.float64)[corner], face_index, surfaces)
    return Mesh(vertices, corner, face_index, deviation)


def _merge(points_mm: NDArray[np.float64]) -> tuple[NDArray[np.float32], NDArray[np.int64]]:
    """Join points closer than MERGE_MM: vertices (n, 3) and, for each point, its vertex."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import cKDTree

    pairs = cKDTree(points_mm).query_pairs(MERGE_MM, output_type="ndarray")
    n = len(points_mm)
    links = coo_array((np.ones(len(pairs), np.int8), (pairs[:, 0], pairs[:, 1])), shape=(n, n))
    count, label = connected_components(links, directed=False)
    first = np.full(count, n, np.int64)
    np.minimum.at(first, label, np.arange(n))
    # +0.0 turns -0.0, which depends on rounding alone, into 0.0
    return (points_mm[first] + 0.0).astype(np.float32), label.astype(np.int64)


def _deviation_mm(
    corners_mm: NDArray[np.float64], face: NDArray[np.int64], surfaces: list[Any]
) -> float:
    """Largest distance from the triangles (m, 3, 3) to the surface of their own CAD face.

    Four samples of every triangle (edge middles, centroid), then a grid of 45 on the worst ones.
    """

    def measure(index: NDArray[np.int64], weights: NDArray[np.float64]) -> NDArray[np.float64]:
        samples = np.einsum("sc,mcx->msx", weights, corners_mm[index])
        gaps = np.empty(samples.shape[:2])
        for number in np.unique(face[index]):
            on = face[index] == number
            gaps[on] = _gaps_mm(samples[on].reshape(-1, 3), surfaces[number]).reshape(on.sum(), -1)
        return gaps.max(axis=1)

    coarse = np.array([[0.5, 0.5, 0], [0, 0.5, 0.5], [0.5, 0, 0.5], [1 / 3, 1 / 3, 1 / 3]])
    coarse_mm = measure(np.arange(len(face)), coarse)
    n = 8
    fine = np.array([(i, j, n - i - j) for i in range(n + 1) for j in range(n + 1 - i)]) / n
    worst = np.argsort(-coarse_mm, kind="stable")[:_REFINED_TRIANGLES]
    return float(max(coarse_mm.max(), measure(worst, fine).max()))


def _gaps_mm(points_mm: NDArray[np.float64], surface: Any) -> NDArray[np.float64]:
    """Return the distances of points (n, 3) from a surface: of planes and cylinders in closed form,
    a hundred times faster than the kernel's search.
    """
    from OCP.GeomAbs import GeomAbs_Cylinder, GeomAbs_Plane
    from OCP.GeomAdaptor import GeomAdaptor_Surface
    from OCP.gp import gp_Pnt

    shape = GeomAdaptor_Surface(surface.Surface())
    kind = shape.GetType()
    if kind in (GeomAbs_Plane, GeomAbs_Cylinder):
        figure = shape.Plane() if kind == GeomAbs_Plane else shape.Cylinder()
        place, axis = figure.Location(), figure.Axis().Direction()
        along = np.array((axis.X(), axis.Y(), axis.Z()))
        offset = points_mm - (place.X(), place.Y(), place.Z())
        height = offset @ along
        if kind == GeomAbs_Plane:
            return np.abs(height)
        radius_mm = np.linalg.norm(offset - height[:, None] * along, axis=1)
        return np.asarray(np.abs(radius_mm - figure.Radius()))
    gaps = np.empty(len(points_mm))
    for row, (x, y, z) in enumerate(points_mm.tolist()):
        surface.ValueOfUV(gp_Pnt(x, y, z), 1e-7)
        gaps[row] = surface.Gap()
    return gaps
