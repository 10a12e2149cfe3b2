"""Poses of a press, and the results kept of each.

Positions are of the tip in the sensor frame, z < 0 in the gel. Forces are for a modulus of 1 MPa:
all stresses of the gel are proportional to it.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from deltact_fab.common import Note, Point
from deltact_fab.sensor import Indenter

from ..level import is_mirrored
from ..zones import ZoneMap, Zones

CONTACT_EPS_MM = 1e-9  # by hand: above a stage transform's rounding, below a motor step of 1e-3


@dataclass(frozen=True)
class Increments:
    """Longest distance between two knots, in mm: along the gel's normal and across it."""

    press_mm: float
    shear_mm: float

    def divide(self, start: Point, end: Point) -> tuple[list[float], list[Point]]:
        """Return fractions and points of a line's knots, one of them exactly at first touch."""
        cuts = [0.0, 1.0]
        if min(start[2], end[2]) < 0 < max(start[2], end[2]):
            cuts.insert(1, start[2] / (start[2] - end[2]))
        fractions = [0.0]
        for a, b in itertools.pairwise(cuts):
            dx, dy, dz = ((q - p) * (b - a) for p, q in zip(start, end, strict=True))
            z = (start[2] + f * (end[2] - start[2]) for f in (a, b))
            pieces = 1 if max(z) > CONTACT_EPS_MM else max(
                1,
                math.ceil(abs(dz) / self.press_mm - 1e-9),
                math.ceil(math.hypot(dx, dy) / self.shear_mm - 1e-9),
            )  # fmt: skip
            fractions += [a + (b - a) * k / pieces for k in range(1, pieces + 1)]
        points = []
        for f in fractions:
            x, y, z_mm = (p + f * (q - p) for p, q in zip(start, end, strict=True))
            points.append((x, y, 0.0 if abs(z_mm) < CONTACT_EPS_MM else z_mm))
        return fractions, points

    def poses(self, corners_mm: Sequence[Point]) -> tuple[KnotPose, ...]:
        """Return the poses of a path with corners (x, y, z), straight between them.

        The first corner is the start. Moves through the air have no pose.
        """
        knots = []
        for start, end in itertools.pairwise(corners_mm):
            fractions, points = self.divide(start, end)
            knots += [
                KnotPose(tip, 0.0, f)
                for f, tip in zip(fractions[1:], points[1:], strict=True)
                if tip[2] < 0
            ]
        return tuple(knots)


@dataclass(frozen=True)
class KnotPose:
    """Position and time of a knot: tip (x, y, z < 0), seconds since the previous knot.

    part: fraction of its line; 0 when the tip has rested since the end of the previous line.
    """

    tip_mm: Point
    seconds: float
    part: float


@dataclass(frozen=True)
class ObservedChannels:
    """Channels observed of a press; nothing else is computed or kept.

    fields: knots whose face displacement is kept. traction: keep the face's traction of the same
    knots. lacking: compute lacking_rel. lattice_mm: largest spacing of the lattice.
    """

    fields: Literal["none", "last", "all"] = "none"
    traction: bool = False
    lacking: bool = False
    lattice_mm: float = 0.25


@dataclass(frozen=True, eq=False)
class SolvedKnot:
    """Solution of the gel at a pose; a solver's are for a modulus of 1 MPa.

    key: number within the press, 0 at rest. displacement_mm, traction_mpa (ny, nx, 3), zone_map
    (ny, nx), 0 no contact, 1 slipping, 2 sticking: on the lattice, None unless observed; the map
    comes with the displacement. most_stretch: None at the linear level. lacking_rel: missing normal
    force compared with a hard contact, 0 unless observed. flags: warnings about this state.
    """

    key: int = 0
    force_n: Point = (0.0, 0.0, 0.0)
    torque_nmm: Point = (0.0, 0.0, 0.0)
    zones: Zones = field(default_factory=Zones)
    displacement_mm: NDArray[np.float32] | None = None
    flags: tuple[Note, ...] = ()
    traction_mpa: NDArray[np.float32] | None = None
    penetration_mm: float = 0.0
    most_stretch: float | None = None
    cuts: int = 0
    lacking_rel: float = 0.0
    zone_map: ZoneMap | None = None

    @property
    def wrench(self) -> tuple[float, ...]:
        return (*self.force_n, *self.torque_nmm)

    def scaled(self, modulus_mpa: float) -> SolvedKnot:
        """Scale the knot from 1 MPa to a modulus."""
        (fx, fy, fz), (tx, ty, tz), e = self.force_n, self.torque_nmm, modulus_mpa
        traction = self.traction_mpa
        return replace(
            self,
            force_n=(e * fx, e * fy, e * fz),
            torque_nmm=(e * tx, e * ty, e * tz),
            traction_mpa=None if traction is None else np.float32(e) * traction,
        )


@dataclass(frozen=True)
class Mirror:
    """Reflection that changes the sign of x, of y or of both; its own inverse.

    Gel and block are symmetric about x = 0 and y = 0. Where an indenter is too, only one of two
    presses that are mirror images is solved and used for both.
    """

    x: bool = False
    y: bool = False

    def point(self, p: Point) -> Point:
        """Reflect a point or a polar vector (force)."""
        # + 0.0: no -0.0, which the store would treat as another press.
        return (-p[0] if self.x else p[0]) + 0.0, (-p[1] if self.y else p[1]) + 0.0, p[2]

    def torque(self, t: Point) -> Point:
        """Reflect an axial vector: its part along the plane's normal stays."""
        sign = -1 if self.x != self.y else 1
        x, y, z = self.point(t)
        return sign * x, sign * y, sign * z

    def field(self, u: NDArray[Any]) -> NDArray[Any]:
        """Reflect vectors (ny, nx, 3), or scalars, on a lattice centred on 0."""
        if not (self.x or self.y):
            return u
        u = u[:: -1 if self.y else 1, :: -1 if self.x else 1].copy()
        for axis, flipped in enumerate((self.x, self.y)):
            if flipped and u.ndim == 3:
                u[..., axis] *= -1
        return u

    def knot_image(self, knot: SolvedKnot) -> SolvedKnot:
        u, t, zone_map = knot.displacement_mm, knot.traction_mpa, knot.zone_map
        return replace(
            knot,
            force_n=self.point(knot.force_n),
            torque_nmm=self.torque(knot.torque_nmm),
            displacement_mm=None if u is None else self.field(u),
            traction_mpa=None if t is None else self.field(t),
            zones=replace(knot.zones, centroid_mm=self.point((*knot.zones.centroid_mm, 0.0))[:2]),
            zone_map=None if zone_map is None else self.field(zone_map),
        )


def mirror_of(poses: Sequence[KnotPose], indenter: Indenter) -> Mirror:
    """Mirror from a press to its image that is solved, which leaves 0 towards +x and +y."""
    flip = []
    for axis in (0, 1):
        first = next((p.tip_mm[axis] for p in poses if p.tip_mm[axis] != 0), 0.0)
        flip.append(first < 0 and is_mirrored(indenter, axis))
    return Mirror(*flip)
