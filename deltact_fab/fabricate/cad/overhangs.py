"""A mesh in its print pose: contact with the platform, and overhangs."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from deltact_fab.common import Field

from .mesh import Mesh
from .part import SELF_SUPPORTING_DEG, PrintPose
from .rays import samples

MIN_CONTACT_MM2 = 25.0
"""By hand: holds a part of some grams against the peeling film; more needs larger feet."""
MIN_CEILING_MM2 = 1.0  # by hand: smaller ceilings print without support
_ON_PLATFORM_MM = 1e-3  # by hand: above the rounding of float32; larger counts overhangs as contact


@dataclass(frozen=True)
class PlatformContact:
    """Area on the platform, and ceilings: overhangs flatter than SELF_SUPPORTING_DEG.

    ceilings_mm2: total area. lowest_mm: height of the lowest over the platform. span_mm: diameter
    of the largest circle within a ceiling, supported by its rim alone.
    """

    contact_mm2: float
    ceilings_mm2: float = 0.0
    lowest_mm: float = 0.0
    span_mm: float = 0.0

    def ceilings_text(self, supports: str) -> str:
        """Describe the ceilings and their support; empty without ceilings."""
        if not self.ceilings_mm2:
            return ""
        support = "on supports" if supports else "unsupported"
        return (
            f"{self.ceilings_mm2:.1f} mm2, lowest at {self.lowest_mm:.1f} mm, span up to "
            f"{self.span_mm:.1f} mm, {support}"
        )


def lay_on_platform(mesh: Mesh, pose: PrintPose) -> Mesh:
    """Return the mesh in its print pose: on z = 0, its box centred at x = y = 0."""
    points = mesh.vertices_mm.astype(np.float64) @ np.array(pose.turn, float).T
    low, high = points.min(axis=0), points.max(axis=0)
    middle = np.array([(low[0] + high[0]) / 2, (low[1] + high[1]) / 2, low[2]])
    # +0.0 turns -0.0 into 0.0
    return replace(mesh, vertices_mm=(points - middle + 0.0).astype(np.float32))


def find_contact(mesh: Mesh) -> PlatformContact:
    """Find platform contact and ceilings of a mesh in print pose; a ceiling is one CAD face."""
    corners = mesh.corners_mm
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    twice = np.linalg.norm(normal, axis=1)
    down = -normal[:, 2] / np.where(twice > 0, twice, 1.0)
    low, high = corners[..., 2].min(axis=1), corners[..., 2].max(axis=1)
    resting = (high < _ON_PLATFORM_MM) & (down > 0.999)
    hanging = (down > math.cos(math.radians(SELF_SUPPORTING_DEG))) & ~resting
    rim = _rim(mesh.triangles[hanging], mesh.vertices_mm)
    ceilings = [
        (area_mm2, float(low[f].min()), _span_mm(corners[f], rim))
        for face in np.unique(mesh.face[hanging])
        for f in (hanging & (mesh.face == face),)
        if (area_mm2 := float(twice[f].sum()) / 2) >= MIN_CEILING_MM2
    ]
    contact_mm2 = float(twice[resting].sum()) / 2
    if not ceilings:
        return PlatformContact(contact_mm2)
    areas, lows, spans = zip(*ceilings, strict=True)
    return PlatformContact(contact_mm2, sum(areas), min(lows), max(spans))


def _rim(triangles: NDArray[np.int64], vertices_mm: NDArray[np.float32]) -> Field:
    """Return boundary edges (n, 2, 3) of the triangles."""
    edges = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    edges, count = np.unique(edges, axis=0, return_counts=True)
    return vertices_mm[edges[count == 1]].astype(np.float64)


def _span_mm(corners_mm: Field, rim: Field) -> float:
    """Return twice the largest distance of sample points on the triangles from the rim."""
    points, _ = samples(corners_mm)
    if not len(rim):
        return 0.0
    start, direction = rim[:, 0], rim[:, 1] - rim[:, 0]
    length2 = np.maximum((direction**2).sum(axis=1), 1e-12)
    nearest = np.full(len(points), np.inf)
    for a, d, l2 in zip(start, direction, length2, strict=True):
        t = np.clip(((points - a) @ d) / l2, 0.0, 1.0)
        nearest = np.minimum(nearest, np.linalg.norm(points - a - t[:, None] * d, axis=1))
    return 2 * float(nearest.max())
