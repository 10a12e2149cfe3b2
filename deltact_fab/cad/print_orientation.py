"""How a printed part lies on the printer's platform, what touches it and what hangs over it.
Imports no CAD kernel.

Platform frame: z away from the platform, so that every part is at z >= 0; x, y along its sides.
What is exported to print, what the checks measure and what the guide says follow from one value.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ..aliases import Field
from .mesh import Mesh
from .rays import samples

Side = Literal["-x", "+x", "-y", "+y", "-z", "+z"]
Matrix = tuple[tuple[float, float, float], tuple[float, float, float], tuple[float, float, float]]

# Quarter turns, exact, by the side of the part's own frame that comes to face the platform.
_DOWN: dict[str, Matrix] = {
    "-z": ((1, 0, 0), (0, 1, 0), (0, 0, 1)),
    "+z": ((1, 0, 0), (0, -1, 0), (0, 0, -1)),
    "-y": ((1, 0, 0), (0, 0, -1), (0, 1, 0)),
    "+y": ((1, 0, 0), (0, 0, 1), (0, -1, 0)),
    "-x": ((0, 0, -1), (0, 1, 0), (1, 0, 0)),
    "+x": ((0, 0, 1), (0, 1, 0), (-1, 0, 0)),
}

SELF_SUPPORTING_DEG = 19.0
"""Least slope to the platform that SLA prints without support: the 19 degrees of service bureaus'
design guides for stereolithography (after Formlabs). Assumed: a printer's own may differ."""
MIN_CONTACT_MM2 = 25.0
"""Ours, assumed: what holds a part of some grams against the pull of the peeling film."""
MIN_CEILING_MM2 = 1.0
_TOUCH_MM = 1e-3


@dataclass(frozen=True)
class PrintPose:
    """down: the side of the part's frame that faces the platform; face: what that side is called.

    tilt_deg: then turned by so much about the platform's x, which lifts the side at +y; such a
    part stands on supports and touches the platform nowhere. supports: where they may be, and
    none where it is empty.
    """

    down: Side = "-z"
    face: str = "underside"
    tilt_deg: float = 0.0
    supports: str = ""

    def __post_init__(self) -> None:
        if not 0 <= self.tilt_deg <= 80 or (self.tilt_deg and not self.supports):
            raise ValueError(
                f"tilt_deg from 0 to 80, and a tilted part says where its supports are: "
                f"{self.tilt_deg:g} with supports {self.supports!r}"
            )

    @property
    def turn(self) -> Matrix:
        """Rotation from the part's frame to the platform's; a part that lies flat, exactly."""
        down = _DOWN[self.down]
        if not self.tilt_deg:
            return down
        c, s = math.cos(math.radians(self.tilt_deg)), math.sin(math.radians(self.tilt_deg))
        x, y, z = down
        lower = tuple(c * b - s * a for a, b in zip(z, y, strict=True))
        upper = tuple(s * b + c * a for a, b in zip(z, y, strict=True))
        return x, (lower[0], lower[1], lower[2]), (upper[0], upper[1], upper[2])

    @property
    def words(self) -> str:
        """The same for whoever prints it."""
        if self.tilt_deg:
            return f"{self.face} down, tilted by {self.tilt_deg:g}°, supports {self.supports}"
        how = f"supports {self.supports}" if self.supports else "no supports"
        return f"{self.face} down, straight on the platform, {how}"

    def size_mm(self, low: tuple[float, ...], high: tuple[float, ...]) -> tuple[float, ...]:
        """Sides (x, y, z) as it lies, from its box; of a tilted part an upper bound."""
        sides = [b - a for a, b in zip(low, high, strict=True)]
        return tuple(sum(abs(t) * s for t, s in zip(row, sides, strict=True)) for row in self.turn)


FLAT = PrintPose()


@dataclass(frozen=True)
class Stand:
    """Area on the platform, and what hangs flatter than SELF_SUPPORTING_DEG: the ceilings.

    ceilings_mm2: all of them, 0 for none. lowest_mm: over the platform. span_mm: diameter of the
    largest circle that one of them holds, which nothing bears but its rim.
    """

    contact_mm2: float
    ceilings_mm2: float = 0.0
    lowest_mm: float = 0.0
    span_mm: float = 0.0

    def words(self, supports: str) -> str:
        """The ceilings, and whether they may be supported; empty where there are none."""
        if not self.ceilings_mm2:
            return ""
        held = "on supports" if supports else "unsupported"
        return (
            f"{self.ceilings_mm2:.1f} mm2 from {self.lowest_mm:.1f} mm up, {self.span_mm:.1f} mm "
            f"across at most, {held}"
        )


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
    rim = _rim(mesh.triangles[hanging], mesh.vertices_mm)
    found = [
        (area_mm2, float(low[f].min()), _span_mm(corners[f], rim))
        for face in np.unique(mesh.face[hanging])
        for f in (hanging & (mesh.face == face),)
        if (area_mm2 := float(twice[f].sum()) / 2) >= MIN_CEILING_MM2
    ]
    contact_mm2 = float(twice[resting].sum()) / 2
    if not found:
        return Stand(contact_mm2)
    areas, lows, spans = zip(*found, strict=True)
    return Stand(contact_mm2, sum(areas), min(lows), max(spans))


def _rim(triangles: NDArray[np.int64], vertices_mm: NDArray[np.float32]) -> Field:
    """Edges (n, 2, 3) that only one of the triangles has: where what hangs ends."""
    edges = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    edges, count = np.unique(edges, axis=0, return_counts=True)
    return vertices_mm[edges[count == 1]].astype(np.float64)


def _span_mm(corners_mm: Field, rim: Field) -> float:
    """Twice the largest distance of a point of the triangles from the rim, of a grid of points."""
    points, _ = samples(corners_mm)
    if not len(rim):
        return 0.0
    start, way = rim[:, 0], rim[:, 1] - rim[:, 0]
    length2 = np.maximum((way**2).sum(axis=1), 1e-12)
    nearest = np.full(len(points), np.inf)
    for a, d, l2 in zip(start, way, length2, strict=True):
        t = np.clip(((points - a) @ d) / l2, 0.0, 1.0)
        nearest = np.minimum(nearest, np.linalg.norm(points - a - t[:, None] * d, axis=1))
    return 2 * float(nearest.max())
