"""Snap strain of the cover's pegs, from the legs, lips and holes as built."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ...errors import RunFailed
from ..features import near
from ..solid_gate import bounding_box
from .built import BuiltDesign
from .row import Row


def rows(built: BuiltDesign) -> Iterator[Row]:
    """A leg is a cantilever that gives way by the lip: strain = 3 fibre lip / length^2."""
    strains = [_strain(built, x, y) for x, y in built.design.peg_centres_mm]
    worst = max(strains, key=lambda found: found[0])
    strain, fibre_mm, lip_mm, length_mm = worst
    limit = built.design.cover.strain_limit
    yield Row(
        "snap strain",
        "cover, camera-holder",
        f"{100 * strain:.2f} % (fibre {fibre_mm:.2f}, lip {lip_mm:.2f}, length {length_mm:.2f} mm)",
        f"<= {100 * limit:.2g} %",
        strain <= limit + 1e-9,
    )


def _strain(built: BuiltDesign, x: float, y: float) -> tuple[float, float, float, float]:
    """Strain, outermost fibre, lip, and length up to the lip's underside of the peg at (x, y)."""
    reach = built.design.screw.row.thread_mm
    outer = [c for c in near(built.cylinders("cover"), x, y, reach) if not c.hole]
    holes = [c for c in near(built.cylinders("camera-holder"), x, y, reach) if c.hole]
    if not outer or not holes:
        missing = "cover has no peg" if not outer else "camera-holder has no hole"
        raise RunFailed(f"{missing} at ({x:.2f}, {y:.2f})")
    shaft = min(outer, key=lambda c: c.low_mm[2])
    root_mm = shaft.low_mm[2]
    # A lip stands out beyond the shaft; what is left of a shaft that was cut does not.
    reach_mm = shaft.radius_mm + 1e-6
    lips = [c for c in outer if c.radius_mm + c.offset_mm(*shaft.low_mm[:2]) > reach_mm]
    if not lips:
        raise RunFailed(f"cover has a peg without a lip at ({x:.2f}, {y:.2f})")
    # The widest place of a lip: its own axis may lie beside the peg's.
    wide = max(c.radius_mm + c.offset_mm(*shaft.low_mm[:2]) for c in outer)
    lip_mm = max(wide - holes[0].radius_mm, 0.0)
    length_mm = min(c.low_mm[2] for c in lips) - root_mm
    half_slot_mm = _half_slot_mm(built, x, y, shaft.radius_mm, root_mm)
    fibre_mm = _fibre_mm(built, x, y, shaft.radius_mm, half_slot_mm, root_mm)
    return 3 * fibre_mm * lip_mm / length_mm**2, fibre_mm, lip_mm, length_mm


def _fibre_mm(
    built: BuiltDesign, x: float, y: float, radius_mm: float, half_slot_mm: float, root_mm: float
) -> float:
    """Outermost fibre of a leg from its centroid: that of a thin slice of the solid."""
    from ..kernel import require

    cq = require()
    thin_mm = 0.05
    corner = cq.Vector(x, y - radius_mm - 0.5, root_mm + 0.1)
    block = cq.Solid.makeBox(radius_mm + 0.5, 2 * radius_mm + 1, thin_mm, corner)
    slices = built.solid("cover").intersect(block).Solids()
    if not slices:
        raise RunFailed(f"cover has no leg beside ({x:.2f}, {y:.2f})")
    leg = max(slices, key=lambda s: s.Volume())
    centroid = leg.Center().x - x
    outside = bounding_box(leg)[1][0] - x
    return float(max(outside - centroid, centroid - half_slot_mm))


def _half_slot_mm(
    built: BuiltDesign, x: float, y: float, radius_mm: float, root_mm: float
) -> float:
    """Distance from a peg's axis to the flat of its slot; 0 for a peg without one."""
    flats = []
    for face in built.solid("cover").Faces():
        if face.geomType() != "PLANE":
            continue
        centre, normal = face.Center(), face.normalAt()
        beside = np.hypot(centre.x - x, centre.y - y) < radius_mm
        if beside and centre.z > root_mm + 1e-6 and abs(normal.z) < 1e-6:
            flats.append(abs((centre.x - x) * normal.x + (centre.y - y) * normal.y))
    return min(flats, default=0.0)
