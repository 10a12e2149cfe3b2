"""Ray casting on triangles, many rays at a time, and on exact surfaces, one at a time.

outside   p        thickness: from a point p of the surface along -n to the first surface
----------o-----   behind it that faces the other way.
  solid   |
----------v-----
"""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deltact_fab.common import Field, Point

from .mesh import Mesh

Wall = tuple[float, Point]  # how thick in mm, inwards along -normal, and where
# By hand: faces of a wall are antiparallel to within this; larger takes edges for thin walls.
OPPOSITE_DEG = 30.0
SAMPLE_SPACING_MM = 1.5  # by hand: larger misses small thin spots, smaller takes longer
MAX_AREA_SAMPLES = 4000  # by hand, besides four in each triangle: more take longer
EXTRA_EXACT_RAYS = 24  # by hand, after the thinnest by mesh: fewer may miss the true minimum
MAX_EXACT_RAYS = 2000  # by hand: more take longer on parts of many facets
FACET_GAP_MM = 1e-4  # by hand: above rounding; larger ends the search early
REACHES_MM = (2.0, 8.0, math.inf)  # by hand: search ranges, the next if no wall is found
RAY_CELL_MM = 8.0  # by hand: near rays share a block; smaller ones leave blocks of few rays
RAYS_PER_BLOCK = 128  # by hand: larger blocks overlap more triangles, smaller ones loop longer
RAY_START_MM = 1e-4  # by hand: ignores the start surface; larger misses thinner walls
# By hand, rays x triangles at once: fits the processor's cache, and is small enough (times six,
# 2^18) for OpenBLAS to stay on one thread; several wait for each other on a busy machine.
_PAIRS_PER_BLOCK = 40_000
_CORNER_INSET = 0.02  # by hand, share of a triangle: smaller puts samples on its edges


class Triangles:
    """Triangles prepared for rays.

    corners_mm: (m, 3, 3) triangle, corner, axis.

    Moeller and Trumbore (1997), written with the moment o x d as three matrix products.
    """

    def __init__(self, corners_mm: Field) -> None:
        a = corners_mm[:, 0]
        e1, e2 = corners_mm[:, 1] - a, corners_mm[:, 2] - a
        self._normal = np.cross(e1, e2)
        self._side_u = np.concatenate([-np.cross(e2, a), e2], axis=1)
        self._side_v = np.concatenate([np.cross(e1, a), -e1], axis=1)
        self._plane = np.einsum("ij,ij->i", a, self._normal)
        self._least_det = 1e-9 * np.maximum(np.linalg.norm(self._normal, axis=1), 1e-12)

    def first_hit(
        self, origins_mm: Field, directions: Field, start_mm: float = RAY_START_MM,
        chosen: NDArray[np.int64] | None = None,
    ) -> tuple[Field, NDArray[np.int64]]:  # fmt: skip
        """Return the first hit of rays: distance (n,) in ray lengths, triangle (n,).

        origins_mm, directions: (n, 3). A miss is inf, -1. Hits nearer than start_mm do not count.
        Edges belong to both of their triangles. chosen: indices of the triangles to test; None:
        all.
        """
        pick = slice(None) if chosen is None else chosen
        normal, side_u, side_v = self._normal[pick].T, self._side_u[pick].T, self._side_v[pick].T
        plane, least_det = self._plane[pick], self._least_det[pick]
        distance = np.full(len(origins_mm), np.inf)
        index = np.full(len(origins_mm), -1, np.int64)
        moments = np.concatenate([directions, np.cross(origins_mm, directions)], axis=1)
        step = max(1, _PAIRS_PER_BLOCK // max(1, len(plane)))
        for low in range(0, len(origins_mm) if len(plane) else 0, step):
            ray, o = moments[low : low + step], origins_mm[low : low + step]
            det = -(ray[:, :3] @ normal)
            with np.errstate(divide="ignore", invalid="ignore"):
                u, v = (ray @ side_u) / det, (ray @ side_v) / det
                t = (o @ normal - plane) / det
                inside = (u >= -1e-9) & (v >= -1e-9) & (u + v <= 1 + 1e-9)
                inside &= (np.abs(det) > least_det) & (t > start_mm)
            t = np.where(inside, t, np.inf)
            nearest = np.argmin(t, axis=1)
            nearest_t = t[np.arange(len(o)), nearest]
            distance[low : low + step] = nearest_t
            index[low : low + step] = np.where(np.isfinite(nearest_t), nearest, -1)
        if chosen is not None:
            index[index >= 0] = chosen[index[index >= 0]]
        return distance, index


def samples(corners_mm: Field) -> tuple[Field, NDArray[np.int64]]:
    """Return points on triangles (n, 3) and the triangle of each (n,), reproducibly.

    Each triangle has its centroid and a point near each corner; large ones more, by area.
    """
    area = np.linalg.norm(np.cross(*np.moveaxis(_edges(corners_mm), 1, 0)), axis=1) / 2
    spacing_mm = max(SAMPLE_SPACING_MM, math.sqrt(area.sum() / MAX_AREA_SAMPLES))
    i = _CORNER_INSET / 2
    fixed = np.array([(1 / 3,) * 3, (1 - 2 * i, i, i), (i, 1 - 2 * i, i), (i, i, 1 - 2 * i)])
    extra = np.ceil(area / spacing_mm**2).astype(np.int64) * (area > spacing_mm**2)
    owner = np.concatenate(
        [np.repeat(np.arange(len(area)), 4), np.repeat(np.arange(len(area)), extra)]
    )
    # The additive recurrence of the plastic number fills the plane evenly for every count.
    k = np.arange(extra.sum())
    u, v = (0.7548776662466927 * k) % 1, (0.5698402909980532 * k) % 1
    fold = u + v > 1
    u, v = np.where(fold, 1 - u, u), np.where(fold, 1 - v, v)
    weights = np.concatenate([np.tile(fixed, (len(area), 1)), np.stack([1 - u - v, u, v], axis=1)])
    return np.einsum("nc,ncx->nx", weights, corners_mm[owner]), owner


def normals(corners_mm: Field) -> Field:
    """Return outward unit normals (m, 3) of triangles; zero for a triangle without area."""
    n = np.cross(*np.moveaxis(_edges(corners_mm), 1, 0))
    length = np.linalg.norm(n, axis=1, keepdims=True)
    return np.divide(n, length, out=np.zeros_like(n), where=length > 0)


def _edges(corners_mm: Field) -> Field:
    """Return two edges of each triangle, (m, 2, 3)."""
    return corners_mm[:, 1:] - corners_mm[:, :1]


class Walls:
    """The walls of one solid: sampled on its mesh, the thinnest measured on its exact surfaces."""

    def __init__(self, solid: Any, mesh: Mesh) -> None:
        self._corners = mesh.corners_mm
        self._triangles = Triangles(self._corners)
        self._outward = normals(self._corners)
        self._exact = ExactRays(solid)
        self.points_mm, self._triangle = samples(self._corners)
        self._face = mesh.face[self._triangle]

    def thinnest(self, mask: NDArray[np.bool_] | None = None) -> Wall | None:
        """Return the thinnest wall among the points of the mask; None without any wall.

        An upper bound of the true minimum, limited by the sampling. Faces that are further from
        antiparallel than OPPOSITE_DEG form an edge and do not count.
        """
        for reach_mm in REACHES_MM:
            screened = self._screened(reach_mm)
            wall = self._measured(screened if mask is None else np.where(mask, screened, np.inf))
            if wall is not None and wall[0] < reach_mm:
                return wall
        return None

    @cache  # noqa: B019  # freed with its part
    def _screened(self, reach_mm: float) -> Field:
        """Return wall thickness (n,) on the mesh up to reach_mm, inf for none."""
        inward = -self._outward[self._triangle]
        low, high = self._corners.min(axis=1), self._corners.max(axis=1)
        distance = np.full(len(inward), np.inf)
        hit = np.full(len(inward), -1, np.int64)
        # Rays that start close together meet few triangles within reach.
        cells = np.floor(self.points_mm / RAY_CELL_MM).astype(np.int64)
        order = np.lexsort((*cells.T, *np.round(inward.T)))
        for block in np.array_split(order, math.ceil(len(order) / RAYS_PER_BLOCK)):
            start, direction = self.points_mm[block], inward[block]
            ends = np.concatenate([start, start + direction * min(reach_mm, 1e4)])
            overlap = (low <= ends.max(axis=0)) & (high >= ends.min(axis=0))
            near = np.flatnonzero(overlap.all(axis=1))
            distance[block], hit[block] = self._triangles.first_hit(start, direction, chosen=near)
        opposite = np.einsum("ij,ij->i", inward, self._outward[hit])
        real = np.linalg.norm(inward, axis=1) > 0
        # Facets deviate from their surface: the exact normals decide later.
        lean = math.radians(OPPOSITE_DEG) + 0.2
        wall = real & (hit >= 0) & (opposite > math.cos(lean)) & (distance <= reach_mm)
        return np.where(wall, distance, np.inf)

    def _measured(self, screened: Field) -> Wall | None:
        order = np.argsort(screened, kind="stable")
        best: Wall | None = None
        rejected = 0
        for i in order[:MAX_EXACT_RAYS].tolist():
            if not math.isfinite(screened[i]) or rejected >= EXTRA_EXACT_RAYS:
                break
            wall = self._exact.thickness(self.points_mm[i], int(self._face[i]))
            if wall is not None and (best is None or wall[0] < best[0]):
                best = wall
            # Facets and surfaces differ: a few points beyond are measured, too.
            if best is not None and screened[i] > best[0] - FACET_GAP_MM:
                rejected += 1
        return best


class ExactRays:
    """Rays against the exact surfaces of a solid (0.1 ms each)."""

    def __init__(self, solid: Any) -> None:
        from OCP.BRep import BRep_Tool
        from OCP.BRepGProp import BRepGProp_Face
        from OCP.IntCurvesFace import IntCurvesFace_ShapeIntersector
        from OCP.ShapeAnalysis import ShapeAnalysis_Surface

        self._rays = IntCurvesFace_ShapeIntersector()
        self._rays.Load(solid.wrapped, 1e-9)
        faces = [face.wrapped for face in solid.Faces()]
        self._surfaces = [ShapeAnalysis_Surface(BRep_Tool.Surface_s(face)) for face in faces]
        self._oriented = [BRepGProp_Face(face) for face in faces]
        self._normal_of = BRepGProp_Face

    def thickness(self, point_mm: Field, face: int) -> Wall | None:
        """Return the thickness from the face's point nearest to point_mm; None at an edge."""
        from OCP.gp import gp_Pnt

        uv = self._surfaces[face].ValueOfUV(gp_Pnt(*point_mm.tolist()), 1e-7)
        point, normal = _point_normal(self._oriented[face], uv.X(), uv.Y())
        if normal is None:
            return None
        distance, hit = self.first(point, -normal)
        if hit is None:
            return None
        opposite, u, v = hit
        _, behind = _point_normal(self._normal_of(opposite), u, v)
        limit = math.cos(math.radians(OPPOSITE_DEG))
        if behind is None or float(-normal @ behind) < limit:
            return None
        x, y, z = point.tolist()
        return distance, (x, y, z)

    def first(
        self, origin_mm: Field, direction: Field
    ) -> tuple[float, tuple[Any, float, float] | None]:
        """Return the distance along a unit direction to the nearest surface, inf for none.

        Also the hit face and the hit's parameters (u, v) on it.
        """
        from OCP.gp import gp_Dir, gp_Lin, gp_Pnt

        rays = self._rays
        line = gp_Lin(gp_Pnt(*origin_mm.tolist()), gp_Dir(*direction.tolist()))
        rays.Perform(line, RAY_START_MM, 1e4)
        hits = [(rays.WParameter(k), k) for k in range(1, rays.NbPnt() + 1)]
        if not hits:
            return math.inf, None
        distance, k = min(hits)
        return float(distance), (rays.Face(k), rays.UParameter(k), rays.VParameter(k))


def _point_normal(face: Any, u: float, v: float) -> tuple[Field, Field | None]:
    """Return a point of an oriented face and its outward unit normal, None at a singularity."""
    from OCP.gp import gp_Pnt, gp_Vec

    point, normal = gp_Pnt(), gp_Vec()
    face.Normal(u, v, point, normal)
    length = normal.Magnitude()
    p = np.array((point.X(), point.Y(), point.Z()))
    if length < 1e-12:
        return p, None
    return p, np.array((normal.X(), normal.Y(), normal.Z())) / length
