"""Holes and shanks: the cylindrical faces of a solid whose axes run along z."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...aliases import Point

# A hole drilled further off than this is no hole for that screw.
TILT_DEG = 5.0


@dataclass(frozen=True)
class Cylinder:
    """One face: the ends of its axis (lower one first), its radius, and whether it is a hole."""

    low_mm: Point
    high_mm: Point
    radius_mm: float
    hole: bool

    def offset_mm(self, x_mm: float, y_mm: float) -> float:
        """Largest distance of the axis from the vertical line at (x, y)."""
        ends = (self.low_mm, self.high_mm)
        return max(math.hypot(end[0] - x_mm, end[1] - y_mm) for end in ends)


def along_z(shape: Any) -> list[Cylinder]:
    """Every cylindrical face whose axis leans from z by less than TILT_DEG."""
    from OCP.BRepAdaptor import BRepAdaptor_Surface
    from OCP.BRepGProp import BRepGProp_Face
    from OCP.GeomAbs import GeomAbs_Cylinder
    from OCP.gp import gp_Pnt, gp_Vec

    found = []
    for face in shape.Faces():
        surface = BRepAdaptor_Surface(face.wrapped, True)
        if surface.GetType() != GeomAbs_Cylinder:
            continue
        cylinder = surface.Cylinder()
        axis = cylinder.Axis()
        way = np.array((axis.Direction().X(), axis.Direction().Y(), axis.Direction().Z()))
        if abs(way[2]) < math.cos(math.radians(TILT_DEG)):
            continue
        base = np.array((axis.Location().X(), axis.Location().Y(), axis.Location().Z()))
        ends = [base + v * way for v in (surface.FirstVParameter(), surface.LastVParameter())]
        low, high = sorted(((float(x), float(y), float(z)) for x, y, z in ends), key=lambda p: p[2])
        point, normal = gp_Pnt(), gp_Vec()
        u = (surface.FirstUParameter() + surface.LastUParameter()) / 2
        v = (surface.FirstVParameter() + surface.LastVParameter()) / 2
        BRepGProp_Face(face.wrapped).Normal(u, v, point, normal)
        out = np.array((point.X(), point.Y(), point.Z())) - base
        out -= (out @ way) * way
        hole = float(out @ np.array((normal.X(), normal.Y(), normal.Z()))) < 0
        found.append(Cylinder(low, high, float(cylinder.Radius()), hole))
    return found


def near(
    cylinders: Iterable[Cylinder], x_mm: float, y_mm: float, reach_mm: float
) -> list[Cylinder]:
    """Those whose whole axis lies within reach_mm of the vertical line at (x, y)."""
    return [c for c in cylinders if c.offset_mm(x_mm, y_mm) <= reach_mm]
