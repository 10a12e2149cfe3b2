"""An indenter: the spherical tips of shapes.Indenter, a back plate and a stem for the tool holder.

    4dots                      sphere:10

        | |  stem                  | |
      +-----+                    +-----+
      |plate|  plate_mm          |     |
      ++-+-++                    |     |
       | | |   shank_mm          |     |
       u u u   tips    z = 0      \\___/

The lowest point is at z = 0, on the axis x = y = 0 of the stem; the body lies above. Under a tip
the underside is `Indenter.height_mm`; elsewhere nothing lies lower than the plate.
"""

from __future__ import annotations

import itertools
import math
from typing import TYPE_CHECKING

from ..checks import Expected, less
from ..design import IndenterDimensions
from ..kernel import require

if TYPE_CHECKING:
    from cadquery import Shape


def plate_half_mm(dims: IndenterDimensions) -> tuple[float, float]:
    """Half sides (x, y) of the back plate: it covers the tips' footprint and the stem."""
    stem_mm = dims.indenter.stem_diameter_mm / 2
    x_mm, y_mm = dims.indenter.footprint_half_mm
    return max(x_mm, stem_mm), max(y_mm, stem_mm)


def _round_plate_mm(dims: IndenterDimensions) -> float:
    """Radius of the plate of a single tip on the axis, else 0: the plate is then rectangular."""
    tips = dims.indenter.tips
    if len(tips) == 1 and tips[0].x_mm == tips[0].y_mm == 0:
        return plate_half_mm(dims)[0]
    return 0.0


def expect(dims: IndenterDimensions) -> Expected:
    """Closed forms of the indenter. Raises InputError stating the inequality that fails.

    Where tips overlap the volume is bounded by one tip and by the sum of all.
    """
    indenter, body = dims.indenter, dims.body
    name = f"indenter-{indenter.slug}"
    for tip in indenter.tips:
        less(name, ("0", 0.0), ("radius_mm", tip.radius_mm))
    for label, value in (
        ("shank_mm", body.shank_mm),
        ("plate_mm", body.plate_mm),
        ("stem_diameter_mm", indenter.stem_diameter_mm),
        ("stem_length_mm", indenter.stem_length_mm),
    ):
        less(name, ("0", 0.0), (label, value))
    plate_z = dims.plate_z_mm
    x, y = plate_half_mm(dims)
    if radius := _round_plate_mm(dims):
        plate_mm2 = math.pi * radius**2
    else:
        corner = _corner_mm(dims)
        plate_mm2 = 4 * x * y - (4 - math.pi) * corner**2
    stem_mm3 = math.pi / 4 * indenter.stem_diameter_mm**2 * indenter.stem_length_mm
    # half a sphere, then a cylinder from the equator to the plate
    tips_mm3 = [
        math.pi * t.radius_mm**2 * (2 / 3 * t.radius_mm + plate_z - t.radius_mm)
        for t in indenter.tips
    ]
    solid_mm3 = plate_mm2 * body.plate_mm + stem_mm3
    disjoint = all(
        math.hypot(a.x_mm - b.x_mm, a.y_mm - b.y_mm) >= a.radius_mm + b.radius_mm
        for a, b in itertools.combinations(indenter.tips, 2)
    )
    high = solid_mm3 + sum(tips_mm3)
    top = plate_z + body.plate_mm + indenter.stem_length_mm
    return Expected(
        (high if disjoint else solid_mm3 + max(tips_mm3), high),
        ((-x, -y, 0.0), (x, y, top)),
        {
            **{f"radius_{i}_mm": t.radius_mm for i, t in enumerate(indenter.tips)},
            "shank_mm": body.shank_mm,
            "plate_mm": body.plate_mm,
            "stem_diameter_mm": indenter.stem_diameter_mm,
            "stem_length_mm": indenter.stem_length_mm,
        },
    )


def build(dims: IndenterDimensions) -> Shape:
    """The indenter as one solid in its own frame, z from 0 to the end of the stem."""
    cq = require()
    indenter = dims.indenter
    plate_z, plate_mm = dims.plate_z_mm, dims.body.plate_mm
    x, y = plate_half_mm(dims)
    base = cq.Workplane().workplane(offset=plate_z)
    if radius := _round_plate_mm(dims):
        plate = base.circle(radius).extrude(plate_mm)
    else:
        plate = base.rect(2 * x, 2 * y).extrude(plate_mm).edges("|Z").fillet(_corner_mm(dims))
    stem = (
        cq.Workplane()
        .workplane(offset=plate_z + plate_mm)
        .circle(indenter.stem_diameter_mm / 2)
        .extrude(indenter.stem_length_mm)
    )
    body = plate.union(stem)
    for tip in indenter.tips:
        r = tip.radius_mm
        profile = (
            cq.Workplane("XZ")
            .moveTo(0, 0)
            .threePointArc((r * math.sin(math.pi / 4), r - r * math.cos(math.pi / 4)), (r, r))
            .lineTo(r, plate_z)
            .lineTo(0, plate_z)
            .close()
            .revolve(360, (0, 0, 0), (0, 1, 0))
        )
        body = body.union(profile.translate((tip.x_mm, tip.y_mm, 0)))
    return body.val()


def _corner_mm(dims: IndenterDimensions) -> float:
    """Corner radius of a rectangular plate: the smallest tip's, and less than half a side."""
    smallest = min(t.radius_mm for t in dims.indenter.tips)
    return min(smallest, 0.9 * min(plate_half_mm(dims)))
