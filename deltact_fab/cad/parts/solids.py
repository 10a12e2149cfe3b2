"""What parts are made of and cut with: prisms and cylinders along z, and cuboids."""

from __future__ import annotations

from collections.abc import Sequence

from ...aliases import Point2
from ..kernel import Workplane, require
from ..solid_gate import Box


def cylinders(
    centres_mm: Sequence[Point2], diameter_mm: float, low_mm: float, length_mm: float
) -> Workplane:
    """Equal cylinders along z from low_mm, upwards where length_mm is positive."""
    plan = require().Workplane().workplane(offset=low_mm).pushPoints(centres_mm)
    return plan.circle(diameter_mm / 2).extrude(length_mm)


def prism(outline_mm: Sequence[Point2], low_mm: float, length_mm: float) -> Workplane:
    """The polygon of these corners, extruded along z."""
    plan = require().Workplane().workplane(offset=low_mm).polyline(outline_mm).close()
    return plan.extrude(length_mm)


def cuboid(box: Box) -> Workplane:
    """A box from corner to corner."""
    cq = require()
    low, high = box
    size = [b - a for a, b in zip(low, high, strict=True)]
    return cq.Workplane(cq.Solid.makeBox(*size, cq.Vector(*low)))


def without_corners(half_mm: Point2, inner_mm: Point2) -> list[Point2]:
    """Corners of the rectangle +-half less what lies beyond both inner edges, counter-clockwise."""
    (w, h), (x, y) = half_mm, inner_mm
    upper = [(w, y), (x, y), (x, h), (-x, h), (-x, y), (-w, y)]
    return upper + [(-a, -b) for a, b in upper]
