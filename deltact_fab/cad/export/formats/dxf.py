"""DXF (R2000) for a laser cutter: the outline of a flat part, millimetres, layer CUT.

Lines, arcs and circles come from the edges of the solid's own face: a section of it once gave a
drawing without a single entity, and no error.
"""

from __future__ import annotations

import io
import math
from typing import Any

from ....errors import RunFailed

LAYER = "CUT"
_MILLIMETRES = 4
_METRIC = 1
_JOIN_MM = 1e-6
_SAME = 1e-6


def dxf_bytes(solid: Any, name: str) -> bytes:
    """The outline of a plate, seen from +z in the coordinates of the CAD frame.

    Raises RunFailed when the solid is no plate along z, or an edge is neither line nor arc.
    """
    import ezdxf

    fixed = ezdxf.options.write_fixed_meta_data_for_testing
    # Dates and identifiers of the file are the library's own inventions, new every time.
    ezdxf.options.write_fixed_meta_data_for_testing = True
    try:
        document = ezdxf.new("R2000", units=_MILLIMETRES)
        _draw(document, solid, name)
        stream = io.StringIO()
        document.write(stream)
    finally:
        ezdxf.options.write_fixed_meta_data_for_testing = fixed
    return stream.getvalue().encode("utf-8")


def _draw(document: Any, solid: Any, name: str) -> None:
    face, thickness_mm = _plate(solid, name)
    document.header["$INSUNITS"] = _MILLIMETRES
    document.header["$MEASUREMENT"] = _METRIC
    document.layers.add(LAYER, color=1)
    space = document.modelspace()
    where = {"layer": LAYER}
    for wire in (face.outerWire(), *face.innerWires()):
        edges = _ordered(wire)
        _check_closed(edges, name)
        for edge in edges:
            start, end = _ends(edge)
            kind = edge.geomType()
            if kind == "LINE":
                space.add_line(start, end, where)
            elif kind == "CIRCLE":
                centre = edge.arcCenter()
                middle = (centre.x + 0.0, centre.y + 0.0)
                if edge.IsClosed():
                    space.add_circle(middle, edge.radius(), where)
                else:
                    angles = _angles_deg(edge, middle, start, end)
                    space.add_arc(middle, edge.radius(), *angles, dxfattribs=where)
            else:
                raise RunFailed(f"{name}: an edge is a {kind}; lines and arcs can be cut")
    held_mm3 = face.Area() * thickness_mm
    if not math.isclose(held_mm3, solid.Volume(), rel_tol=_SAME):
        raise RunFailed(
            f"{name}: no plate to cut: its outline holds {held_mm3:.3f} mm3 over the thickness, "
            f"the solid {solid.Volume():.3f}"
        )


def _plate(solid: Any, name: str) -> tuple[Any, float]:
    """The one flat face that looks up, and the distance to the one that looks down."""
    found = {}
    for sign in (1, -1):
        faces = [
            face
            for face in solid.Faces()
            if face.geomType() == "PLANE" and face.normalAt().z * sign > 1 - 1e-9
        ]
        if len(faces) != 1:
            side = "up" if sign > 0 else "down"
            raise RunFailed(f"{name}: {len(faces)} flat faces look {side}; a plate has one")
        found[sign] = faces[0]
    return found[1], found[1].Center().z - found[-1].Center().z


def _ordered(wire: Any) -> list[Any]:
    """Edges of a wire one after the other, each running its own way round."""
    from cadquery import Edge
    from OCP.BRepTools import BRepTools_WireExplorer

    explorer = BRepTools_WireExplorer(wire.wrapped)
    edges = []
    while explorer.More():
        edges.append(Edge(explorer.Current()))
        explorer.Next()
    return edges


def _ends(edge: Any) -> tuple[tuple[float, float], tuple[float, float]]:
    """Where an edge starts and ends as the wire runs."""
    from OCP.BRepAdaptor import BRepAdaptor_Curve
    from OCP.TopAbs import TopAbs_REVERSED

    curve = BRepAdaptor_Curve(edge.wrapped)
    low, high = (curve.Value(t) for t in (curve.FirstParameter(), curve.LastParameter()))
    start, end = ((p.X() + 0.0, p.Y() + 0.0) for p in (low, high))
    return (end, start) if edge.wrapped.Orientation() == TopAbs_REVERSED else (start, end)


def _check_closed(edges: list[Any], name: str) -> None:
    ends = [_ends(edge) for edge in edges]
    for (_, end), (start, _) in zip(ends, ends[1:] + ends[:1], strict=True):
        if not math.dist(end, start) <= _JOIN_MM:
            raise RunFailed(f"{name}: the outline is open at ({end[0]:.6f}, {end[1]:.6f}) mm")


def _angles_deg(
    edge: Any, centre: tuple[float, float], start: tuple[float, float], end: tuple[float, float]
) -> tuple[float, float]:
    """Start and end angle of an arc, counter-clockwise as DXF has it."""

    def angle(point: tuple[float, float]) -> float:
        return math.degrees(math.atan2(point[1] - centre[1], point[0] - centre[0]))

    a, b = angle(start), angle(end)
    middle = edge.positionAt(0.5)
    on_way = (angle((middle.x, middle.y)) - a) % 360 < (b - a) % 360
    return (a, b) if on_way else (b, a)
