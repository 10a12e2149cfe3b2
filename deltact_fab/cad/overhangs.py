"""A mesh as it lies on the platform: what touches it, and what hangs over it."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from .mesh import Mesh
from .print_orientation import SELF_SUPPORTING_DEG, PrintPose

MIN_CONTACT_MM2 = 25.0
"""Ours, assumed: what holds a part of some grams against the pull of the peeling film."""
MIN_CEILING_MM2 = 1.0
_TOUCH_MM = 1e-3


@dataclass(frozen=True)
class Ceiling:
    """What of a face hangs: its area, and its least height above the platform."""

    area_mm2: float
    height_mm: float


@dataclass(frozen=True)
class Stand:
    """Area on the platform, and what hangs flatter than SELF_SUPPORTING_DEG, largest first."""

    contact_mm2: float
    ceilings: tuple[Ceiling, ...]

    @property
    def ceilings_mm2(self) -> float:
        """All of them."""
        return sum(c.area_mm2 for c in self.ceilings)

    def words(self, supports: str) -> str:
        """The ceilings, and whether they may be supported; empty where there are none."""
        if not self.ceilings:
            return ""
        lowest = min(c.height_mm for c in self.ceilings)
        held = "on supports" if supports else "unsupported"
        return f"{self.ceilings_mm2:.1f} mm2 from {lowest:.1f} mm up, {held}"


def laid(mesh: Mesh, lies: PrintPose) -> Mesh:
    """The mesh as it is printed: on z = 0, the middle of its box at x = y = 0."""
    points = mesh.vertices_mm.astype(np.float64) @ np.array(lies.turn, float).T
    low, high = points.min(axis=0), points.max(axis=0)
    middle = np.array([(low[0] + high[0]) / 2, (low[1] + high[1]) / 2, low[2]])
    # +0.0 turns -0.0 into 0.0
    return replace(mesh, vertices_mm=(points - middle + 0.0).astype(np.float32))


def stand(mesh: Mesh) -> Stand:
    """Where a laid mesh touches the platform and overhangs; a ceiling is one face of the CAD."""
    corners = mesh.corners_mm
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    twice = np.linalg.norm(normal, axis=1)
    down = -normal[:, 2] / np.where(twice > 0, twice, 1.0)
    low, high = corners[..., 2].min(axis=1), corners[..., 2].max(axis=1)
    resting = (high < _TOUCH_MM) & (down > 0.999)
    hanging = (down > math.cos(math.radians(SELF_SUPPORTING_DEG))) & ~resting
    faces = (hanging & (mesh.face == face) for face in np.unique(mesh.face))
    found = [Ceiling(float(twice[f].sum()) / 2, float(low[f].min(initial=np.inf))) for f in faces]
    ceilings = [c for c in found if c.area_mm2 >= MIN_CEILING_MM2]
    return Stand(
        float(twice[resting].sum()) / 2,
        tuple(sorted(ceilings, key=lambda c: (-c.area_mm2, c.height_mm))),
    )
