"""DXF (R2000) for a laser cutter: each outline of a flat part as one closed polyline, layer CUT.

A cutter's program offsets a closed polyline by half the kerf as it is; of loose lines and arcs
somebody first has to join the ends. Lines and arcs (as bulges) come from the edges of the solid's
own face: a section of it once gave a drawing without a single entity, and no error.
"""

from __future__ import annotations

import io
import math
from typing import Any

from deltact_fab.common import RunFailed

CUT_LAYER = "CUT"
_INSUNITS_MM = 4
_MEASUREMENT_METRIC = 1
_JOIN_MM = 1e-6
_VOLUME_RTOL = 1e-6


def dxf_bytes(solid: Any, name: str, outwards_mm: float = 0.0) -> bytes:
    """The outline of a plate, seen from +z in the coordinates of the CAD frame.

    outwards_mm: how far outside the plate its outline is drawn, corners sharp: half a kerf for the
    path of a laser that knows of none. Raises RunFailed when the solid is no plate along z, or an
    edge is neither line nor arc.
    """
    import ezdxf

    face, thickness_mm = _plate(solid, name)
    held_mm3 = face.Area() * thickness_mm
    if not math.isclose(held_mm3, solid.Volume(), rel_tol=_VOLUME_RTOL):
        raise RunFailed(
            f"{name}: no plate to cut: its outline holds {held_mm3:.3f} mm3 over the thickness, "
            f"the solid {solid.Volume():.3f}"
        )
    fixed = ezdxf.options.write_fixed_meta_data_for_testing
    # Dates and identifiers of the file are the library's own inventions, new every time.
    ezdxf.options.write_fixed_meta_data_for_testing = True
    try:
        document = ezdxf.new("R2000", units=_INSUNITS_MM)
        document.header["$INSUNITS"] = _INSUNITS_MM
        document.header["$MEASUREMENT"] = _MEASUREMENT_METRIC
        document.layers.add(CUT_LAYER, color=1)
        for wire in _offset_wires(face, outwards_mm):
            edges = list(wire)
            _check_closed(edges, name)
            corners = [corner for edge in edges for corner in _corners(edge, name)]
            shape = {"close": True, "dxfattribs": {"layer": CUT_LAYER}}
            document.modelspace().add_lwpolyline(corners, "xyb", **shape)
        stream = io.StringIO()
        document.write(stream)
    finally:
        ezdxf.options.write_fixed_meta_data_for_testing = fixed
    return stream.getvalue().encode("utf-8")


def _offset_wires(face: Any, outwards_mm: float) -> list[Any]:
    """The wires of a face, that far into what is cut away."""
    if outwards_mm == 0:
        return [face.outerWire(), *face.innerWires()]
    inside = [w for wire in face.innerWires() for w in wire.offset2D(-outwards_mm, "intersection")]
    return [*face.outerWire().offset2D(outwards_mm, "intersection"), *inside]


def _plate(solid: Any, name: str) -> tuple[Any, float]:
    """The one flat face that looks up, and the distance to the one that looks down."""
    by_sign = {}
    for sign in (1, -1):
        faces = [
            face
            for face in solid.Faces()
            if face.geomType() == "PLANE" and face.normalAt().z * sign > 1 - 1e-9
        ]
        if len(faces) != 1:
            side = "up" if sign > 0 else "down"
            raise RunFailed(f"{name}: {len(faces)} flat faces look {side}; a plate has one")
        by_sign[sign] = faces[0]
    return by_sign[1], by_sign[1].Center().z - by_sign[-1].Center().z


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


def _corners(edge: Any, name: str) -> list[tuple[float, float, float]]:
    """Where an edge starts, and its bulge: the tangent of a quarter of an arc's angle (DXF).

    A full circle is two half ones. Raises RunFailed for what a cutter does not know.
    """
    start, end = _ends(edge)
    kind = edge.geomType()
    if kind == "LINE":
        return [(*start, 0.0)]
    if kind != "CIRCLE":
        raise RunFailed(f"{name}: an edge is a {kind}; lines and arcs can be cut")
    if edge.IsClosed():
        centre = edge.arcCenter()
        across = (2 * centre.x - start[0], 2 * centre.y - start[1])
        return [(*start, 1.0), (*across, 1.0)]
    middle = edge.positionAt(0.5)
    chord = (end[0] - start[0], end[1] - start[1])
    to_middle = (middle.x - start[0], middle.y - start[1])
    # The height of the arc to the right of its chord, over half the chord.
    height = (to_middle[0] * chord[1] - to_middle[1] * chord[0]) / math.hypot(*chord)
    return [(*start, height / (math.hypot(*chord) / 2))]
