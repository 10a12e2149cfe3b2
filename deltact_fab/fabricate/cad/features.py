"""What a solid is made of, read off its boundary: planes, rounds, and faces of other kinds.

Faces of one cylinder are one round, however often it is cut. Nothing here knows how the solid was
built: what a drawing says and what the checks measure is found on the same faces.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from deltact_fab.common import Field, Point

from .kernel import bounding_box

SAME_MM = 1e-5
"""Coordinates closer than this are one."""
STRAIGHT = 1e-9  # of a direction's cosine: parallel to an axis of the frame
TILT_DEG = 5.0  # a round that leans further belongs to no axis


@dataclass(frozen=True)
class FlatFace:
    """A flat face normal to an axis (0, 1, 2) of the frame, at a coordinate.

    up: whether the solid lies below it. corners: (n, 3).
    """

    axis: int
    at_mm: float
    up: bool
    corners: Field


@dataclass(frozen=True)
class Round:
    """A cylinder along an axis of the frame, of one face or several.

    low_mm, high_mm: ends of its axis; radius_mm; hole: whether the solid is outside. turn_deg: how
    far it goes round. blind: the end of a hole that a flat floor closes: `low`, `high` or none.
    on: a point on it.
    """

    axis: int
    low_mm: Point
    high_mm: Point
    radius_mm: float
    hole: bool
    on: Point
    turn_deg: float = 360.0
    blind: str = ""

    @property
    def full_turn(self) -> bool:
        """Whether it goes all the way round."""
        return self.turn_deg > 360 - 1e-4

    @property
    def rounds_an_edge(self) -> bool:
        """Whether it turns no further than from one face to the next."""
        return self.turn_deg < 90 + 1e-3

    @property
    def length_mm(self) -> float:
        """Along its axis."""
        return self.high_mm[self.axis] - self.low_mm[self.axis]

    def offset_mm(self, x_mm: float, y_mm: float) -> float:
        """Largest distance of an axis along z from the vertical line at (x, y)."""
        ends = (self.low_mm, self.high_mm)
        return max(math.hypot(end[0] - x_mm, end[1] - y_mm) for end in ends)


@dataclass(frozen=True)
class OtherFace:
    """A face of another kind, whose form is said by a printed number.

    kind: as a drawing calls it. sizes: numbers of which one has to be printed. at: a point on it.
    centre: what has to be placed, along each axis None where nothing has to be.
    """

    kind: str
    sizes: tuple[float, ...]
    point: Point
    centre: tuple[float | None, float | None, float | None] = (None, None, None)
    normal: Point = (0.0, 0.0, 0.0)


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
    """The features of one solid, in a fixed order."""
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
            if abs(normal[axis]) > 1 - STRAIGHT:
                centre = _to_point(edge.arcCenter())
                yield Round(axis, centre, centre, _round_off(edge.radius()), False, centre)


def rounds_near(rounds: Iterable[Round], x_mm: float, y_mm: float, reach_mm: float) -> list[Round]:
    """Those along z whose whole axis lies within reach_mm of the vertical line at (x, y)."""
    return [r for r in rounds if r.axis == 2 and r.offset_mm(x_mm, y_mm) <= reach_mm]


def _classify_face(face: Any) -> FlatFace | Round | OtherFace:
    from OCP.BRepAdaptor import BRepAdaptor_Surface

    surface = BRepAdaptor_Surface(face.wrapped, True)
    kind = face.geomType()
    centre = _to_point(face.Center())
    if kind == "PLANE":
        normal = np.array(face.normalAt().toTuple())
        axis = int(np.argmax(np.abs(normal)))
        if abs(normal[axis]) > 1 - STRAIGHT:
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
        return OtherFace("SR", (r, 2 * r), _middle_point(surface), middle)
    if kind == "TORUS":
        return OtherFace("R", (surface.Torus().MinorRadius(),), _middle_point(surface))
    if kind == "CONE":
        half = math.degrees(abs(surface.Cone().SemiAngle()))
        return OtherFace("cone", (half, 90 - half, 2 * half), _middle_point(surface))
    box = face.BoundingBox()
    sides = (box.xlen, box.ylen, box.zlen)
    return OtherFace("curve", tuple(s * f for s in sides for f in (1.0, 0.5)), centre)


def _cylinder(face: Any, surface: Any) -> OtherFace | Round:
    """A face of a round; one that leans is told by its radius alone."""
    from cadquery import Vector

    cylinder = surface.Cylinder()
    radius = _round_off(cylinder.Radius())
    direction = np.array(_to_point(cylinder.Axis().Direction()))
    axis = int(np.argmax(np.abs(direction)))
    first, last = surface.FirstUParameter(), surface.LastUParameter()
    turn_deg = math.degrees(last - first)
    straight = abs(direction[axis]) > 1 - STRAIGHT
    # A hole that was drilled askew is one all the same; a rounded edge that leans is an edge.
    if not straight and (
        turn_deg < 180 or direction[axis] ** 2 < math.cos(math.radians(TILT_DEG)) ** 2
    ):
        return OtherFace("R", (radius, 2 * radius), _middle_point(surface))
    base = np.array(_to_point(cylinder.Axis().Location()))
    ends = [base + v * direction for v in (surface.FirstVParameter(), surface.LastVParameter())]
    low, high = sorted((_to_point(end) for end in ends), key=lambda p: p[axis])
    on = _middle_point(surface)
    out = np.array(on) - base
    out -= (out @ direction) * direction
    hole = float(out @ np.array(_to_point(face.normalAt(Vector(*on))))) < 0
    return Round(axis, low, high, radius, hole, on, turn_deg)


def _merge_faces(pieces: list[Round], planes: list[FlatFace]) -> list[Round]:
    """Faces of one cylinder as one round."""
    groups: dict[tuple[object, ...], list[Round]] = {}
    for piece in pieces:
        plan = [round(c / SAME_MM) for i, c in enumerate(piece.low_mm) if i != piece.axis]
        top = [round(c / SAME_MM) for i, c in enumerate(piece.high_mm) if i != piece.axis]
        key = (piece.axis, *plan, *top, round(piece.radius_mm / SAME_MM), piece.hole)
        groups.setdefault(key, []).append(piece)
    return [_merge_round(run, planes) for group in groups.values() for run in _runs(group)]


def _runs(group: list[Round]) -> Iterator[list[Round]]:
    """Faces of one cylinder that hang together along its axis."""
    axis = group[0].axis
    run: list[Round] = []
    reach = -math.inf
    for piece in sorted(group, key=lambda p: (p.low_mm[axis], p.on)):
        if run and piece.low_mm[axis] > reach + SAME_MM:
            yield run
            run = []
        run.append(piece)
        reach = max(reach, piece.high_mm[axis])
    yield run


def _merge_round(pieces: list[Round], planes: list[FlatFace]) -> Round:
    """One round of its faces."""
    axis = pieces[0].axis
    low = min((p.low_mm for p in pieces), key=lambda p: p[axis])
    high = max((p.high_mm for p in pieces), key=lambda p: p[axis])
    first = max(pieces, key=lambda p: (p.turn_deg, p.on))
    turn_deg = max(sum(p.turn_deg for p in pieces if _spans_middle(p, face)) for face in pieces)
    blind = ""
    for end, name in ((low, "low"), (high, "high")):
        if first.hole and any(_closes_hole(p, end, name, first) for p in planes):
            blind = name
    return replace(first, low_mm=low, high_mm=high, turn_deg=min(turn_deg, 360.0), blind=blind)


def _spans_middle(piece: Round, other_round: Round) -> bool:
    """Whether a face goes past another one's middle."""
    middle = (other_round.low_mm[other_round.axis] + other_round.high_mm[other_round.axis]) / 2
    return (
        piece.low_mm[other_round.axis] - SAME_MM
        <= middle
        <= piece.high_mm[other_round.axis] + SAME_MM
    )


def _closes_hole(plane: FlatFace, end: Point, name: str, hole: Round) -> bool:
    """Whether a face closes a hole there: it looks into it and lies within its circle."""
    axis = hole.axis
    if plane.axis != axis or plane.up != (name == "low"):
        return False
    if abs(plane.at_mm - end[axis]) > SAME_MM:
        return False
    offsets = np.delete(plane.corners - np.array(end), axis, axis=1)
    return bool(np.hypot(offsets[:, 0], offsets[:, 1]).max() <= hole.radius_mm + SAME_MM)


def _middle_point(surface: Any) -> Point:
    """The middle of a face in its own parameters."""
    u = (surface.FirstUParameter() + surface.LastUParameter()) / 2
    v = (surface.FirstVParameter() + surface.LastVParameter()) / 2
    return _to_point(surface.Value(u, v))


def _to_point(p: Any) -> Point:
    """Of the kernel's own, cadquery's or numpy's."""
    if hasattr(p, "X"):
        p = p.X(), p.Y(), p.Z()
    x, y, z = p.toTuple() if hasattr(p, "toTuple") else p
    return _round_off(float(x)), _round_off(float(y)), _round_off(float(z))


def _round_off(value: float) -> float:
    """Without what sums leave behind the ninth digit, and without a minus zero."""
    return round(value, 9) + 0.0
