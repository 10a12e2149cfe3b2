"""Geometry of a rigid indenter: tips, stem and reach.

The tip's lowest point is at z = 0 in the indenter's frame; the body is above. `tips` defines the
attributes of a tip. A turned or tilted tip moves with its shank as one rigid body, shifted so that
its lowest point is at z = 0; the shank continues along its own axis up to the back plate.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from deltact_fab.common import Field, Point2

from .bounded import ShapeError
from .prism import PrismTip
from .tips import EllipsoidTip, RidgeTip, SphereTip
from .turned import TurnedTip

PlainTip = SphereTip | RidgeTip | EllipsoidTip | PrismTip | TurnedTip

TIP_TILT_DEG = 45.0  # by hand: steeper tips press with their shank
_SEARCH_STEP_MM = 0.1  # by hand: bracketing step of the underside; no tip is thinner
_UNIT_GRID = np.linspace(-1.0, 1.0, 61)


def edge_radius_mm(tip: PlainTip | PosedTip) -> float:
    """Smallest convex radius of a tip's underside, in any orientation."""
    if isinstance(tip, PosedTip):
        return edge_radius_mm(tip.tip)
    if isinstance(tip, EllipsoidTip):
        return min(tip.a_mm, tip.b_mm) ** 2 / max(tip.a_mm, tip.b_mm)
    if isinstance(tip, PrismTip):
        return tip.edge_mm
    if not isinstance(tip, TurnedTip):
        return tip.radius_mm
    radius, a = tip.radius_mm, tip.start_mm
    for piece in tip.pieces:
        c = piece.centre_mm
        if c is not None and c[1] >= max(a[1], piece.end_mm[1]) - 1e-9:
            radius = min(radius, math.dist(c, a))
        a = piece.end_mm
    return radius


@dataclass(frozen=True)
class PosedTip:
    """Tip tilted about x, then about y, then turned about z, at (x, y).

    tip: at x = y = 0. top_mm: height of the back plate, where the shank ends.
    """

    tip: PlainTip
    x_mm: float
    y_mm: float
    turn_deg: float = 0.0
    tilt_x_deg: float = 0.0
    tilt_y_deg: float = 0.0
    top_mm: float = 12.0

    def __post_init__(self) -> None:
        tilts = {"tilt_x_deg": TIP_TILT_DEG, "tilt_y_deg": TIP_TILT_DEG}
        for name, limit in {"turn_deg": 360.0, **tilts}.items():
            value = getattr(self, name)
            if not abs(value) <= limit:
                raise ShapeError(f"|{name}| <= {limit:g}: {value:g} fails")
        x, y = self.tip.x_mm, self.tip.y_mm
        if (x, y) != (0.0, 0.0):
            raise ShapeError(f"a posed tip must be at x = y = 0: {x:g}, {y:g} fails")

    @cached_property
    def turn(self) -> NDArray[np.float64]:
        """Rotation (3, 3) from the tip's own frame into the indenter's."""
        z, x, y = (math.radians(a) for a in (self.turn_deg, self.tilt_x_deg, self.tilt_y_deg))
        about_x = [[1, 0, 0], [0, math.cos(x), -math.sin(x)], [0, math.sin(x), math.cos(x)]]
        about_y = [[math.cos(y), 0, math.sin(y)], [0, 1, 0], [-math.sin(y), 0, math.cos(y)]]
        about_z = [[math.cos(z), -math.sin(z), 0], [math.sin(z), math.cos(z), 0], [0, 0, 1]]
        return np.array(about_z) @ np.array(about_y) @ np.array(about_x)

    @property
    def tilted(self) -> bool:
        """True if the axis is not vertical."""
        return self.tilt_x_deg != 0 or self.tilt_y_deg != 0

    @cached_property
    def origin_mm(self) -> NDArray[np.float64]:
        """Origin (3,) of the tip's own frame."""
        return np.array([self.x_mm, self.y_mm, -self._lowest[2]])

    @property
    def lowest_mm(self) -> Point2:
        return self.x_mm + self._lowest[0], self.y_mm + self._lowest[1]

    @cached_property
    def _lowest(self) -> tuple[float, float, float]:
        """Lowest point of the rotated underside relative to the tip's origin.

        By successive grid refinement; exact to 1e-9 mm for a convex tip.
        """
        if not self.tilted:
            (x, y), (dx, dy) = self.tip.lowest_mm, self.turn[:2, :2]
            return float(dx @ (x, y)), float(dy @ (x, y)), 0.0
        (u0, v0), (a, b) = (0.0, 0.0), self.tip.half_mm
        best = (0.0, 0.0, math.inf)
        for _ in range(16):
            u, v = np.meshgrid(u0 + a * _UNIT_GRID, v0 + b * _UNIT_GRID)
            w = self.tip.height_mm(u, v)
            inside = np.isfinite(w)
            points = np.stack([u[inside], v[inside], w[inside]])
            z = self.turn[2] @ points
            k = int(np.argmin(z))
            u0, v0 = points[0, k], points[1, k]
            x, y, z_mm = (self.turn @ points[:, k]).tolist()
            best = min(best, (x, y, z_mm), key=lambda point: point[2])
            a, b = a / 4, b / 4
        return best

    @property
    def radius_mm(self) -> float:
        edge = edge_radius_mm(self.tip) if self.tilted else self.tip.radius_mm
        return min(self.tip.radius_mm, edge)

    @cached_property
    def equator_mm(self) -> float:
        """Smallest height at which the sides turn vertical; to 1e-3 mm if tilted.

        Evaluated at the outline in 24 directions from the lowest point.
        """
        if not self.tilted:
            return self.tip.equator_mm
        angle = np.arange(24) * math.pi / 12
        direction, start = np.stack([np.cos(angle), np.sin(angle)]), self.lowest_mm
        low, high = np.zeros(24), np.full(24, 2 * math.hypot(*self.half_mm))
        for _ in range(40):
            middle = (low + high) / 2
            x, y = start[0] + middle * direction[0], start[1] + middle * direction[1]
            inside = np.isfinite(self.height_mm(x, y))
            low, high = np.where(inside, middle, low), np.where(inside, high, middle)
        rim = self.height_mm(start[0] + low * direction[0], start[1] + low * direction[1])
        return float(rim.min())

    @property
    def half_mm(self) -> Point2:
        """Half sides (x, y) of the bounding box of tip and tilted shank, seen along z."""
        (a, b), up = self.tip.half_mm, self.top_mm / self.turn[2, 2]
        x, y, _ = np.abs(self.turn) @ (a, b, up if self.tilted else 0.0)
        return float(x), float(y)

    @property
    def corner_mm(self) -> float:
        """Smallest convex radius of the outline; half of the tip's if tilted."""
        return self.tip.corner_mm / 2 if self.tilted else self.tip.corner_mm

    def height_mm(self, x_mm: Field, y_mm: Field) -> Field:
        """Height of the underside above the lowest point, inf outside; arrays of one shape.

        For a tilted tip, the first intersection of the vertical line with the body, bracketed in
        steps of _SEARCH_STEP_MM and bisected to 1e-12 mm.
        """
        x, y = np.broadcast_arrays(x_mm, y_mm)
        x, y = x.astype(np.float64) - self.x_mm, y.astype(np.float64) - self.y_mm
        if not self.tilted:
            (xx, xy), (yx, yy) = self.turn[:2, :2]
            return self.tip.height_mm(xx * x + yx * y, xy * x + yy * y)
        height = np.full(x.shape, np.inf)
        open_ = np.flatnonzero((np.abs(x) <= self.half_mm[0]) & (np.abs(y) <= self.half_mm[1]))
        flat_x, flat_y = x.ravel(), y.ravel()
        steps = math.ceil(self.top_mm / _SEARCH_STEP_MM)
        for k in range(steps + 1):
            z = self.top_mm * k / steps
            inside = self._contains(flat_x[open_], flat_y[open_], np.full(open_.shape, z))
            height.flat[open_[inside]] = z
            open_ = open_[~inside]
        index = np.flatnonzero(np.isfinite(height.ravel()) & (height.ravel() > 0))
        high = height.ravel()[index]
        low = high - self.top_mm / steps
        for _ in range(40):
            middle = (low + high) / 2
            inside = self._contains(flat_x[index], flat_y[index], middle)
            low, high = np.where(inside, low, middle), np.where(inside, middle, high)
        height.flat[index] = high
        return height

    def _contains(self, x: Field, y: Field, z: Field) -> NDArray[np.bool_]:
        """True for points, relative to the tip's position, inside the body."""
        u, v, w = self.turn.T @ np.stack([x, y, z + self._lowest[2]])
        inside: NDArray[np.bool_] = w >= self.tip.height_mm(u, v)
        return inside


Tip = PlainTip | PosedTip
DEFAULT_REACH_MM = 12.0  # paper: thickness of the standard gel


@dataclass(frozen=True)
class Indenter:
    """Rigid indenter: tips with shanks on one back plate, and a stem.

    name: normalised user input (`sphere:10`, `4dots`).
    tips: surfaces that can touch the gel.
    stem_diameter_mm: fits the stage's tool holder.
    stem_flat_at_mm: distance of the stem's flat from its axis, on the tips' +x side over the whole
    length; it orients the tips in the tool holder. The same for all indenters.
    reach_mm: free length from the lowest point up to the back plate, the largest depth of a press.
    """

    name: str
    tips: tuple[Tip, ...]
    stem_diameter_mm: float = 6.0
    stem_length_mm: float = 20.0
    stem_flat_at_mm: float = 2.2
    reach_mm: float = DEFAULT_REACH_MM

    @property
    def edge_radius_mm(self) -> float:
        """Smallest convex radius of all undersides."""
        return min(map(edge_radius_mm, self.tips))

    @property
    def slug(self) -> str:
        """Name for use in file names."""
        return self.name.replace(":", "-").replace(".", "p")

    @property
    def footprint_half_mm(self) -> tuple[float, float]:
        """Half sides (x, y) of the bounding box of the tips, seen along z."""
        return (
            max(abs(t.x_mm) + t.half_mm[0] for t in self.tips),
            max(abs(t.y_mm) + t.half_mm[1] for t in self.tips),
        )

    @property
    def equator_mm(self) -> float:
        """Depth at which the sides of the first tip turn vertical.

        A height-field model of the face is valid up to this depth.
        """
        return min(t.equator_mm for t in self.tips)

    def height_mm(self, x_mm: Field, y_mm: Field) -> Field:
        """Height of the indenter's underside above its lowest point, inf outside the tips.

        x_mm, y_mm: arrays of one shape, relative to the indenter's axis. Returns that shape,
        without shanks and back plate.
        """
        height = np.full(np.broadcast(x_mm, y_mm).shape, np.inf)
        for tip in self.tips:
            height = np.minimum(height, tip.height_mm(x_mm, y_mm))
        return height
