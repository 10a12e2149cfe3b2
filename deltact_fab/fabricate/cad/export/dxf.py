"""DXF (R2000) for a laser cutter: each outline of a flat part as one closed polyline, layer CUT.

A cutter's program offsets a closed polyline by half the kerf directly; loose lines and arcs must
first be joined by hand. Lines and arcs (as bulges) come from the edges of the solid's own face: a
section of it once gave an empty drawing without an error.
"""

from __future__ import annotations

import io
import math
from typing import Any

from deltact_fab.common import RunFailed

CUT_LAYER = "CUT"
_INSUNITS_MM = 4  # DXF format
_MEASUREMENT_METRIC = 1  # DXF format
_JOIN_MM = 1e-6  # by hand: above the kernel's rounding; larger hides an open outline
_VOLUME_RTOL = 1e-6  # by hand: above the kernel's rounding; larger hides a pocket or chamfer


def dxf_bytes(solid: Any, name: str, outwards_mm: float = 0.0) -> bytes:
    """Return the outline of a plate, seen from +z in the coordinates of the CAD frame.

    outwards_mm: offset of the outline, corners sharp: half a kerf for a laser without kerf
    compensation. Raises RunFailed when the solid is no plate along z, or an edge is neither line
    nor arc.
    """
    import ezdxf
    import ezdxf.bbox

    face, thickness_mm = _plate(solid, name)
    plate_mm3 = face.Area() * thickness_mm
    if not math.isclose(plate_mm3, solid.Volume(), rel_tol=_VOLUME_RTOL):
        raise RunFailed(
            f"{name}: not a plate: outline x thickness is {plate_mm3:.3f} mm3, "
            f"the solid {solid.Volume():.3f}"
        )
    fixed = ezdxf.options.write_fixed_meta_data_for_testing
    # The library makes up new dates and identifiers for every file otherwise.
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
        # Cutting programs place the part by these; ezdxf leaves them at 1e20.
        extents = ezdxf.bbox.extents(document.modelspace())
        document.modelspace().reset_extents(extents.extmin, extents.extmax)
        stream = io.StringIO()
        document.write(stream)
    finally:
        ezdxf.options.write_fixed_meta_data_for_testing = fixed
    return stream.getvalue().encode("utf-8")


def _offset_wires(face: Any, outwards_mm: float) -> list[Any]:
    """Return the wires of a face, offset towards the waste."""
    if outwards_mm == 0:
        return [face.outerWire(), *face.innerWires()]
    inside = [w for wire in face.innerWires() for w in wire.offset2D(-outwards_mm, "intersection")]
    return [*face.outerWire().offset2D(outwards_mm, "intersection"), *inside]


def _plate(solid: Any, name: str) -> tuple[Any, float]:
    """Return the one flat face that points up, and its distance to the one that points down."""
    by_sign = {}
    for sign in (1, -1):
        faces = [
            face
            for face in solid.Faces()
            if face.geomType() == "PLANE" and face.normalAt().z * sign > 1 - 1e-9
        ]
        if len(faces) != 1:
            side = "up" if sign > 0 else "down"
            raise RunFailed(f"{name}: {len(faces)} flat faces point {side}; expected one")
        by_sign[sign] = faces[0]
    return by_sign[1], by_sign[1].Center().z - by_sign[-1].Center().z


def _ends(edge: Any) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return start and end of an edge in the direction of the wire."""
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
    """Return start and bulge of an edge: tan of a quarter of the arc's angle (DXF format).

    A full circle is two half ones. Raises RunFailed for an edge that is neither line nor arc.
    """
    start, end = _ends(edge)
    kind = edge.geomType()
    if kind == "LINE":
        return [(*start, 0.0)]
    if kind != "CIRCLE":
        raise RunFailed(f"{name}: edge of type {kind}; expected lines and arcs")
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
