"""Features of a solid from its boundary: planes, rounds (cylinders), and other faces.

Faces of one cylinder are one round, however often it is cut. Features do not depend on how the
solid was built: drawings and checks use the same faces.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any

import numpy as np

from deltact_fab.common import Field, Point

from .kernel import bounding_box

FEATURE_MERGE_MM = 1e-5  # by hand, equal coordinates: above rounding; larger merges features
AXIS_TOLERANCE = 1e-9  # by hand, of the cosine to an axis: above rounding; larger hides a slant
HALF_SPHERE_SLACK = 1e-6  # by hand, share of its area: above rounding; larger calls a cap a half
MAX_LEAN_DEG = 5.0  # by hand: a round that leans more has no axis in a drawing


@dataclass(frozen=True)
class FlatFace:
    """A flat face normal to an axis (0, 1, 2) of the frame, at a coordinate.

    up: True if the outward normal is along +axis. corners: (n, 3).
    """

    axis: int
    at_mm: float
    up: bool
    corners: Field


@dataclass(frozen=True)
class Round:
    """A cylinder along an axis of the frame, of one face or several.

    low_mm, high_mm: ends of its axis. hole: True if the solid is outside. turn_deg: covered angle.
    blind: the end of a hole closed by a flat floor: `low`, `high` or empty. point: on its face.
    opposite: two of its faces lie opposite each other, as those of a slotted peg.
    """

    axis: int
    low_mm: Point
    high_mm: Point
    radius_mm: float
    hole: bool
    point: Point
    turn_deg: float = 360.0
    blind: str = ""
    opposite: bool = False

    @property
    def by_diameter(self) -> bool:
        """True if a caliper can measure its diameter; else it has a radius."""
        return self.opposite or self.turn_deg > 180

    @property
    def full_turn(self) -> bool:
        """True if it covers 360 degrees."""
        return self.turn_deg > 360 - 1e-4

    @property
    def rounds_an_edge(self) -> bool:
        """True if it covers no more than 90 degrees, like a rounded edge."""
        return self.turn_deg < 90 + 1e-3

    @property
    def length_mm(self) -> float:
        """Length along its axis."""
        return self.high_mm[self.axis] - self.low_mm[self.axis]

    def offset_mm(self, x_mm: float, y_mm: float) -> float:
        """Largest distance of an axis along z from the vertical line at (x, y)."""
        ends = (self.low_mm, self.high_mm)
        return max(math.hypot(end[0] - x_mm, end[1] - y_mm) for end in ends)


@dataclass(frozen=True)
class OtherFace:
    """A face of another kind, dimensioned by a printed number.

    kind: label in a drawing. sizes: numbers of which one has to be printed. point: on the face.
    centre: coordinates to be dimensioned, None along an axis without. rim: points around the face
    with the outward normals there.
    """

    kind: str
    sizes: tuple[float, ...]
    point: Point
    centre: tuple[float | None, float | None, float | None] = (None, None, None)
    normal: Point = (0.0, 0.0, 0.0)
    rim: tuple[tuple[Point, Point], ...] = ()


@dataclass(frozen=True)
class SolidFeatures:
    """All faces of a solid, and its box. edges: round edges normal to an axis, without length."""

    planes: tuple[FlatFace, ...]
    rounds: tuple[Round, ...]
    other_faces: tuple[OtherFace, ...]
    edges: tuple[Round, ...]
    low_mm: Point
    high_mm: Point


def features_of(solid: Any) -> SolidFeatures:
    """Return the features of one solid, in a fixed order."""
    faces = [_classify_face(face) for face in solid.Faces()]
    planes = [face for face in faces if isinstance(face, FlatFace)]
    planes.sort(key=lambda p: (p.axis, p.at_mm, p.corners.tolist()))
    other_faces = sorted(
        (face for face in faces if isinstance(face, OtherFace)), key=lambda o: (o.kind, o.point)
    )
    pieces = [face for face in faces if isinstance(face, Round)]
    rounds, edges = (
        sorted(group, key=lambda r: (r.axis, r.low_mm, r.radius_mm))
        for group in (_merge_faces(pieces, planes), _round_edges(solid))
    )
    bounds = bounding_box(solid)
    return SolidFeatures(tuple(planes), tuple(rounds), tuple(other_faces), tuple(edges), *bounds)


def _round_edges(solid: Any) -> Iterator[Round]:
    for edge in solid.Edges():
        if edge.geomType() == "CIRCLE":
            normal = _to_point(edge.normal())
            axis = max(range(3), key=lambda i: abs(normal[i]))
            if abs(normal[axis]) > 1 - AXIS_TOLERANCE:
                centre = _to_point(edge.arcCenter())
                yield Round(axis, centre, centre, _round_off(edge.radius()), False, centre)


def rounds_near(rounds: Iterable[Round], x_mm: float, y_mm: float, reach_mm: float) -> list[Round]:
    """Return the rounds along z whose axis lies within reach_mm of the line at (x, y)."""
    return [r for r in rounds if r.axis == 2 and r.offset_mm(x_mm, y_mm) <= reach_mm]


def _classify_face(face: Any) -> FlatFace | Round | OtherFace:
    from OCP.BRepAdaptor import BRepAdaptor_Surface

    surface = BRepAdaptor_Surface(face.wrapped, True)
    kind = face.geomType()
    centre = _to_point(face.Center())
    if kind == "PLANE":
        normal = np.array(face.normalAt().toTuple())
        axis = int(np.argmax(np.abs(normal)))
        if abs(normal[axis]) > 1 - AXIS_TOLERANCE:
            corners = np.array([v.toTuple() for v in face.Vertices()])
            return FlatFace(axis, _round_off(centre[axis]), bool(normal[axis] > 0), corners)
        tilt = [math.degrees(math.acos(min(abs(float(n)), 1.0))) for n in normal]
        sizes = tuple(a for a in tilt if 1e-6 < a < 90 - 1e-6)
        return OtherFace("slant", sizes, centre, normal=_to_point(face.normalAt()))
    if kind == "CYLINDER":
        return _cylinder(face, surface)
    if kind == "SPHERE":
        sphere = surface.Sphere()
        r, middle = sphere.Radius(), _to_point(sphere.Location())
        half = face.Area() > 2 * math.pi * r**2 * (1 - HALF_SPHERE_SLACK)
        form, sizes = ("SØ", (2 * r, r)) if half else ("SR", (r, 2 * r))
        return OtherFace(form, sizes, _middle_point(surface), middle, rim=_rim(face, surface))
    if kind == "TORUS":
        ring = surface.Torus()
        turn, centre = _to_point(ring.Axis().Direction()), _to_point(ring.Location())
        x, y, z = (c if abs(d) == 1 else None for c, d in zip(centre, turn, strict=True))
        radius = (ring.MinorRadius(),)
        return OtherFace("R", radius, _middle_point(surface), (x, y, z), rim=_rim(face, surface))
    if kind == "CONE":
        half = math.degrees(abs(surface.Cone().SemiAngle()))
        sizes = half, 90 - half, 2 * half
        return OtherFace("cone", sizes, _middle_point(surface), rim=_rim(face, surface))
    box = face.BoundingBox()
    sides = (box.xlen, box.ylen, box.zlen)
    return OtherFace("curve", tuple(s * f for s in sides for f in (1.0, 0.5)), centre)


def _cylinder(face: Any, surface: Any) -> OtherFace | Round:
    """Return a cylindrical face as a round; as another face if it leans."""
    from cadquery import Vector

    cylinder = surface.Cylinder()
    radius = _round_off(cylinder.Radius())
    direction = np.array(_to_point(cylinder.Axis().Direction()))
    axis = int(np.argmax(np.abs(direction)))
    first, last = surface.FirstUParameter(), surface.LastUParameter()
    turn_deg = math.degrees(last - first)
    straight = abs(direction[axis]) > 1 - AXIS_TOLERANCE
    # A hole drilled askew is still a hole; a rounded edge that leans is an edge.
    lean_deg = math.degrees(math.acos(min(abs(direction[axis]), 1.0)))
    if not straight and (turn_deg < 180 or lean_deg > MAX_LEAN_DEG):
        return OtherFace("R", (radius, 2 * radius), _middle_point(surface), rim=_rim(face, surface))
    base = np.array(_to_point(cylinder.Axis().Location()))
    ends = [base + v * direction for v in (surface.FirstVParameter(), surface.LastVParameter())]
    low, high = sorted((_to_point(end) for end in ends), key=lambda p: p[axis])
    on = _middle_point(surface)
    out = np.array(on) - base
    out -= (out @ direction) * direction
    hole = float(out @ np.array(_to_point(face.normalAt(Vector(*on))))) < 0
    return Round(axis, low, high, radius, hole, on, turn_deg)


def _merge_faces(pieces: list[Round], planes: list[FlatFace]) -> list[Round]:
    """Merge faces of one cylinder into one round."""
    groups: dict[tuple[object, ...], list[Round]] = {}
    for piece in pieces:
        plan = [round(c / FEATURE_MERGE_MM) for i, c in enumerate(piece.low_mm) if i != piece.axis]
        top = [round(c / FEATURE_MERGE_MM) for i, c in enumerate(piece.high_mm) if i != piece.axis]
        key = (piece.axis, *plan, *top, round(piece.radius_mm / FEATURE_MERGE_MM), piece.hole)
        groups.setdefault(key, []).append(piece)
    return [_merge_round(run, planes) for group in groups.values() for run in _runs(group)]


def _runs(group: list[Round]) -> Iterator[list[Round]]:
    """Yield groups of faces of one cylinder that are contiguous along its axis."""
    axis = group[0].axis
    run: list[Round] = []
    reach = -math.inf
    for piece in sorted(group, key=lambda p: (p.low_mm[axis], p.point)):
        if run and piece.low_mm[axis] > reach + FEATURE_MERGE_MM:
            yield run
            run = []
        run.append(piece)
        reach = max(reach, piece.high_mm[axis])
    yield run


def _merge_round(pieces: list[Round], planes: list[FlatFace]) -> Round:
    """Return one round from its faces."""
    axis = pieces[0].axis
    low = min((p.low_mm for p in pieces), key=lambda p: p[axis])
    high = max((p.high_mm for p in pieces), key=lambda p: p[axis])
    first = max(pieces, key=lambda p: (p.turn_deg, p.point))
    turn_deg = max(sum(p.turn_deg for p in pieces if _spans_middle(p, face)) for face in pieces)
    whole = replace(
        first, low_mm=low, high_mm=high, turn_deg=min(turn_deg, 360.0),
        opposite=any(_share_diameter(a, b) for a, b in combinations(pieces, 2)),
    )  # fmt: skip
    for blind in (replace(whole, blind=end) for end in ("high", "low") if first.hole):
        if any(closes(plane, blind) for plane in planes):
            return blind
    return whole


def _share_diameter(a: Round, b: Round) -> bool:
    """True if two faces of one cylinder share a diameter."""
    u, v = (np.delete(np.subtract(p.point, p.low_mm), p.axis) for p in (a, b))
    cosine = float(u @ v) / (math.hypot(*u) * math.hypot(*v))
    turn_deg = math.degrees(math.acos(max(-1.0, min(cosine, 1.0))))
    return turn_deg + (a.turn_deg + b.turn_deg) / 2 > 180 + 1e-3


def _spans_middle(piece: Round, face: Round) -> bool:
    """True if a piece spans the middle of a face along its axis."""
    i = face.axis
    middle, slack = (face.low_mm[i] + face.high_mm[i]) / 2, FEATURE_MERGE_MM
    return piece.low_mm[i] - slack <= middle <= piece.high_mm[i] + slack


def closes(plane: FlatFace, hole: Round) -> bool:
    """True if a face closes a blind hole: it faces the hole and lies within its circle."""
    axis, end = hole.axis, hole.low_mm if hole.blind == "low" else hole.high_mm
    if not hole.blind or plane.axis != axis or plane.up != (hole.blind == "low"):
        return False
    if abs(plane.at_mm - end[axis]) > FEATURE_MERGE_MM:
        return False
    offsets = np.delete(plane.corners - np.array(end), axis, axis=1)
    return bool(np.hypot(offsets[:, 0], offsets[:, 1]).max() <= hole.radius_mm + FEATURE_MERGE_MM)


def _middle_point(surface: Any) -> Point:
    """Return the point at the middle of a face's parameters."""
    u = (surface.FirstUParameter() + surface.LastUParameter()) / 2
    v = (surface.FirstVParameter() + surface.LastVParameter()) / 2
    return _to_point(surface.Value(u, v))


def _rim(face: Any, surface: Any) -> tuple[tuple[Point, Point], ...]:
    """Return points of a face, of which some lie on its outline in each view, with normals."""
    from cadquery import Vector
    from OCP.BRep import BRep_Tool

    first, last = surface.FirstUParameter(), surface.LastUParameter()
    v = (surface.FirstVParameter() + surface.LastVParameter()) / 2
    turns = (first * (1 - share) + last * share for share in (0.5, 0.25, 0.75))
    points = [_to_point(surface.Value(u, v)) for u in turns]
    edges = (edge for edge in face.Edges() if not BRep_Tool.Degenerated_s(edge.wrapped))
    points += [_to_point(edge.positionAt(0.5)) for edge in edges]
    return tuple((point, _to_point(face.normalAt(Vector(*point)))) for point in points)


def _to_point(p: Any) -> Point:
    """Convert a point of the kernel, cadquery or numpy."""
    if hasattr(p, "X"):
        p = p.X(), p.Y(), p.Z()
    x, y, z = p.toTuple() if hasattr(p, "toTuple") else p
    return _round_off(float(x)), _round_off(float(y)), _round_off(float(z))


def _round_off(value: float) -> float:
    """Round to nine digits, without a minus zero."""
    return round(value, 9) + 0.0
